"""Files that verbs write."""

from pathlib import Path

from robot_dynamics.errors import RobotDynamicsError


def write_text(path, text):
    """Write a text into the file at a path, its folder made where it is not there. Raises RobotDynamicsError."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RobotDynamicsError(f"{str(path)[:200]} cannot be written: {error.strerror}") from None
