"""The errors of the project. Every message states the fault, its place, and the remedy."""

from collections.abc import Iterable
from difflib import get_close_matches

MOST_NAMES = 40  # in a message
INTERRUPTED_EXIT_STATUS = 130  # exit status after Ctrl-C, by the convention of shells


class RobotDynamicsError(Exception):
    """Base class of every error that this package raises on purpose."""


class DescriptionError(RobotDynamicsError):
    """A robot description cannot be read, or describes an impossible robot."""


class InvalidInputError(RobotDynamicsError):
    """An input does not fit the robot: wrong names, shapes or values."""


class UnavailableModelError(InvalidInputError, AttributeError):
    """A robot has no model of this kind; an AttributeError too, so that `hasattr` returns False."""


class SingularModelError(RobotDynamicsError):
    """A model has no solution: no inertia resists some motion, or no equilibrium exists near the initial guess."""


class RecordingError(RobotDynamicsError):
    """A bag or table of measurements cannot be read, or lacks data that the task needs."""


class MissingPackageError(RobotDynamicsError, ImportError):
    """A Python package that a task needs is not installed. The message contains the command that installs it."""


class CompilationError(RobotDynamicsError):
    """A program cannot be compiled on this machine. It can still be run as Python."""


class SimulationError(RobotDynamicsError):
    """A simulation cannot continue: its state diverged."""


def describe_unknown_name(kind: str, name: object, known: Iterable[str]) -> str:
    """Return a message that `name` is not a known name, with the most similar names or a list of all.

    Parameters
    ----------
    kind : str
        What the name denotes, such as ``"joint"``.
    name : object
        The unknown name.
    known : iterable of str
        All valid names.
    """
    text = str(name)[:100]
    known = list(known)
    close = get_close_matches(text, known, n=3, cutoff=0.75)
    if close:
        return f"unknown {kind} {text!r}: did you mean {' or '.join(map(repr, close))}?"
    more = f", and {len(known) - MOST_NAMES} more" if len(known) > MOST_NAMES else ""
    return f"unknown {kind} {text!r}: known are {', '.join(known[:MOST_NAMES]) or 'none'}{more}"
