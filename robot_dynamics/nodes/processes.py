"""Nodes of this package as child processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

import yaml

PARENT = "ROBOT_DYNAMICS_PARENT"  # variable with the number of the process without which a node shall not run


@contextmanager
def running_node(
    executable: str,
    parameters: Mapping[str, object] | None = None,
    namespace: str = "/",
    environment: Mapping[str, str] | None = None,
    log: IO[str] | IO[bytes] | None = None,
    remappings: Mapping[str, str] | None = None,
) -> Iterator[subprocess.Popen[bytes]]:
    """Run a node of this package in a process of its own, and end it when the block ends, also by an exception.

    The node also ends when this process is killed: see `is_orphaned`.

    Parameters
    ----------
    executable : name of its package in robot_dynamics.nodes.
    parameters : values by name.
    environment : variables to add to those of this process.
    log : open file for its output; None: the output of this process.
    remappings : {name: new name}.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "parameters.yaml"
        file.write_text(yaml.safe_dump({"/**": {"ros__parameters": dict(parameters or {})}}))
        command = [sys.executable, "-m", f"robot_dynamics.nodes.{executable}", "--ros-args"]
        command += ["-r", f"__ns:={namespace}", "--params-file", str(file)]
        for old, new in (remappings or {}).items():
            command += ["-r", f"{old}:={new}"]
        process = subprocess.Popen(
            command,
            env={**os.environ, **(environment or {}), PARENT: str(os.getpid())},
            stdout=log,
            stderr=log,
            start_new_session=True,  # Ctrl-C in a terminal reaches this process, which then ends the node
        )
        try:
            yield process
        finally:
            terminate_process(process)


def is_orphaned() -> bool:
    """Return whether `running_node` of another process started this one, and that process has ended."""
    parent = os.environ.get(PARENT, "")
    return bool(parent) and str(os.getppid()) != parent


def terminate_process(process: subprocess.Popen[bytes], patience: float = 20.0) -> None:
    """Terminate a process, and kill it if it has not ended within `patience` seconds."""
    deadline = time.monotonic() + patience
    while process.poll() is None:
        process.send_signal(signal.SIGTERM if time.monotonic() < deadline else signal.SIGKILL)
        with suppress(subprocess.TimeoutExpired):
            process.wait(1.0)
