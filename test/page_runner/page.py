"""What the blocks of one page share: a folder, an environment, background processes, and a ROS client."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from page_runner.background import BackgroundNodes

if TYPE_CHECKING:
    from page_runner.ros_commands import RosCommands

COMMAND_TIME = 240.0  # [s] for a command that ends


class Page:
    """The state of a page while its blocks run."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="page_"))
        self._logs = Path(tempfile.mkdtemp(prefix="page_logs_"))
        self.nodes = BackgroundNodes(self._logs)
        self._ros: RosCommands | None = None

    @property
    def ros(self) -> RosCommands:
        """What carries out `ros2 ...`."""
        if self._ros is None:
            from page_runner.ros_commands import RosCommands  # pages without ROS need no rclpy

            self._ros = RosCommands(self.nodes)
        return self._ros

    @contextmanager
    def active(self) -> Iterator[None]:
        """Work in the folder and the environment of the page."""
        before, path_before, folder_before = dict(os.environ), list(sys.path), Path.cwd()
        os.environ.update(page_environment())
        sys.path.insert(0, str(self.folder))
        os.chdir(self.folder)
        try:
            yield
        finally:
            os.chdir(folder_before)
            sys.path[:] = path_before
            os.environ.clear()
            os.environ.update(before)

    def run_command(self, command: str) -> str:
        """Run a command to its end and return what it prints. Raises AssertionError if it fails."""
        process = subprocess.Popen(
            ["bash", "-c", command],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            start_new_session=True,
        )  # fmt: skip
        try:
            output, _ = process.communicate(timeout=COMMAND_TIME)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            output, _ = process.communicate()
            raise AssertionError(f"{command!r} did not end within {COMMAND_TIME:g} s:\n{output}") from None
        assert process.returncode == 0, f"{command!r} ended with status {process.returncode}:\n{output}"
        return output

    def end_nodes(self) -> None:
        """End all nodes and publications."""
        if self._ros is not None:
            self._ros.close()
            self._ros = None
        self.nodes.close()

    def close(self) -> None:
        """End all processes of the page and remove its files."""
        with ExitStack() as stack:
            stack.callback(shutil.rmtree, self._logs, ignore_errors=True)
            stack.callback(shutil.rmtree, self.folder, ignore_errors=True)
            stack.callback(self._forget_modules)
            stack.callback(self.nodes.close)
            if self._ros is not None:
                stack.callback(self._ros.close)
            if "rclpy" in sys.modules:
                stack.callback(sys.modules["rclpy"].try_shutdown)  # a block of Python that did not get so far
            if "matplotlib.pyplot" in sys.modules:
                stack.callback(sys.modules["matplotlib.pyplot"].close, "all")

    def _forget_modules(self) -> None:
        """Modules that blocks imported from the folder: another page may have one of the same name."""
        for name, module in list(sys.modules.items()):
            if str(getattr(module, "__file__", None) or "").startswith(f"{self.folder}{os.sep}"):
                del sys.modules[name]


def page_environment() -> dict[str, str]:
    """Variables of a page: programs of the running Python, and a DDS domain of this process."""
    return {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "MPLBACKEND": "Agg",
        "COLUMNS": "120",
    }
