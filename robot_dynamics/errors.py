"""The errors of the project. Every message says what was wrong, where, and what would be right."""

from difflib import get_close_matches

INTERRUPTED_EXIT_STATUS = 130  # exit status of what a user ended with Ctrl-C, as shells have it


class RobotDynamicsError(Exception):
    """Base of every error that this package raises on purpose."""


class DescriptionError(RobotDynamicsError):
    """A description of a robot cannot be read, or says something impossible."""


class InvalidInputError(RobotDynamicsError):
    """A question does not fit the robot: wrong names, shapes or values."""


class SingularModelError(RobotDynamicsError):
    """A model has no answer: nothing with inertia resists some motion, or no equilibrium was found."""


class RecordingError(RobotDynamicsError):
    """A bag or table of measurements cannot be read, or does not tell what is needed of the robot."""


class MissingPackageError(RobotDynamicsError, ImportError):
    """A Python package that a task needs is not installed; the message says how to install it."""


class CompilationError(RobotDynamicsError):
    """A program cannot be compiled on this machine; it can still be run as Python."""


class SimulationError(RobotDynamicsError):
    """A simulation cannot go on: its numbers grew beyond all bounds."""


def describe_unknown_name(kind, name, known):
    """Say that `name` is none of the `known` names of this kind, with the likeliest ones."""
    name, known = str(name)[:100], list(known)
    close = get_close_matches(name, known, n=3, cutoff=0.75)
    hint = f"did you mean {' or '.join(map(repr, close))}?" if close else f"known are {', '.join(known[:40]) or 'none'}"
    return f"unknown {kind} {name!r}: {hint}"
