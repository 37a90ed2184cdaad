"""The command `robot-dynamics` in a process whose standard output nobody reads, as `robot-dynamics ... | true`."""

import os
import subprocess
import sys


def run_with_closed_stdout(*arguments):
    """Exit status and stderr of the command."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "robot_dynamics.cli.main", *map(str, arguments)]
    try:
        process = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, timeout=120)
    finally:
        os.close(writer)
    return process.returncode, process.stderr
