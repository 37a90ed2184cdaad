"""The folder of ROS logs: another one where the usual one cannot be written, because rclpy would not start."""

import os
import sys
import tempfile
from collections.abc import Mapping
from errno import ENOENT
from pathlib import Path

LOG_FOLDER = "ROS_LOG_DIR"


def ensure_log_folder() -> None:
    """Let ROS write its logs into a temporary folder if its own cannot be written, and say so on stderr.

    Call it before `rclpy.init`. Child processes inherit the folder.
    """
    folder = None
    try:
        folder = log_folder(os.environ)
        if folder is None:
            raise FileNotFoundError(ENOENT, "HOME is not set")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, RuntimeError) as error:  # RuntimeError: "~" of a user without a home folder
        os.environ[LOG_FOLDER] = tempfile.mkdtemp(prefix="ros_log_")
        reason = getattr(error, "strerror", None) or error
        place = f"{folder} cannot be written, " if folder else ""
        print(f"ROS logs are in {os.environ[LOG_FOLDER]}: {place}{reason}", file=sys.stderr)


def log_folder(environment: Mapping[str, str]) -> Path | None:
    """Return the folder into which ROS writes its logs, None if no variable names one.

    Parameters
    ----------
    environment : variables of the process.
    """
    if environment.get(LOG_FOLDER):
        return Path(environment[LOG_FOLDER]).expanduser()
    if environment.get("ROS_HOME"):
        return Path(environment["ROS_HOME"]).expanduser() / "log"
    return Path(environment["HOME"]) / ".ros" / "log" if environment.get("HOME") else None
