"""Nodes and viewers that a page starts: they run in the background until the page ends, or one of that name starts."""

import os
import re
import subprocess
import time
from pathlib import Path

from page_runner.command_lines import program_words
from robot_dynamics.nodes.processes import terminate_process

START_TIME = 120.0  # [s] until a node is ready
# what the log of a node says when it is ready
READY = {
    "dynamics_server": "serving Robot|no robot yet",
    "payload_identifier": "serving Robot|no robot yet",
    "replay_check": "serving Robot|no robot yet",
    "joint_state_completer": "serving Robot|no robot yet",
    "contact_monitor": "serving Robot|no robot yet",
    "computed_torque": "controls |no robot yet",
    "mobile_base_simulator": "simulates |no robot yet",
    "robot-dynamics view": "is at http://",
}


def background_program(command_words: list[str]) -> str | None:
    """The program of a command that runs until it is ended, as in READY; None for a command that ends by itself."""
    program, *arguments = command_words
    if program == "robot-dynamics" and arguments[:1] == ["view"] and "--output" not in arguments:
        program = "robot-dynamics view"
    return program if program in READY and "--help" not in arguments else None


class BackgroundNodes:
    """Processes of nodes by the full names of the nodes; their logs are files in a folder."""

    def __init__(self, logs: Path) -> None:
        self._logs = logs
        self._processes: dict[str, tuple[subprocess.Popen[bytes], Path]] = {}
        self._count = 0

    def start(self, command: str) -> str:
        """Start a node by its command line, wait until it is ready, and return what it logged until then."""
        program = background_program(program_words(command))
        assert program is not None, f"{command!r} ends by itself"
        executable = program.partition(" ")[0]
        name = full_name(program_words(command))
        if name in self._processes:
            self._end(name)
        self._count += 1
        log = self._logs / f"{executable}_{self._count}.log"
        with log.open("wb") as stream:
            process = subprocess.Popen(
                ["bash", "-c", f"exec {command}" if command.startswith(executable) else command],
                stdin=subprocess.DEVNULL, stdout=stream, stderr=stream, start_new_session=True,
            )  # fmt: skip
        try:
            _wait_until_ready(command, program, process, log)
        except BaseException:
            terminate_process(process)
            raise
        self._processes[name] = (process, log)
        return _text(log)

    def _end(self, name: str) -> None:
        process, log = self._processes.pop(name)
        status = process.poll()
        terminate_process(process)
        assert status is None, f"{name} ended by itself with status {status}:\n{_text(log)}"
        assert process.returncode == 0, f"{name} ended with status {process.returncode}:\n{_text(log)}"

    def close(self) -> None:
        """End all nodes. Raises AssertionError if one has ended before, or did not end cleanly."""
        failures = []
        for name in list(self._processes):
            try:
                self._end(name)
            except AssertionError as error:
                failures.append(str(error))
        assert not failures, "\n".join(failures)


def _wait_until_ready(command: str, program: str, process: subprocess.Popen[bytes], log: Path) -> None:
    ready = READY["dynamics_server" if "autostart:=false" in command else program]
    deadline = time.monotonic() + START_TIME
    while not re.search(ready, _text(log)):
        assert process.poll() is None, f"{command!r} ended with status {process.returncode}:\n{_text(log)}"
        assert time.monotonic() < deadline, f"{command!r} is not ready after {START_TIME:g} s:\n{_text(log)}"
        time.sleep(0.05)


def _text(log: Path) -> str:
    return log.read_text(encoding="utf-8", errors="replace")


def full_name(command_words: list[str]) -> str:
    """The name of a node with its namespace, from the words of its command line."""
    namespace, name = "", command_words[0]
    for word in command_words:
        if word.startswith("__ns:="):
            namespace = word.removeprefix("__ns:=").rstrip("/")
        if re.match(r"__(node|name):=", word):
            name = word.partition(":=")[2]
    return f"{namespace}/{os.path.basename(name)}"
