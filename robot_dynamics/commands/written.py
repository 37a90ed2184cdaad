"""Files that verbs write."""

from contextlib import contextmanager
from pathlib import Path

from robot_dynamics.errors import RobotDynamicsError


@contextmanager
def writing(path):
    """Yields the Path of a file for the block to write, its folder made where it is not there. Raises
    RobotDynamicsError where the system refuses one of the two."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield path
    except (OSError, ValueError) as error:  # the latter of names that no file can have
        reason = getattr(error, "strerror", None) or error
        raise RobotDynamicsError(f"{str(path)[:200]} cannot be written: {reason}") from None


def write_text(path, text):
    """Write a text into the file at a path. Raises RobotDynamicsError."""
    with writing(path) as file:
        file.write_text(text, encoding="utf-8")


def check_writable(path):
    """Refuse a file that cannot be written before hours are spent on what goes into it. Raises RobotDynamicsError."""
    with writing(path) as file, file.open("ab"):
        pass
    if not file.stat().st_size:
        file.unlink()
