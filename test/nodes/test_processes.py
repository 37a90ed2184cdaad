"""Nodes as child processes: they end with the process that has started them, even if that is killed."""

import os
import signal
import subprocess
import sys
import time

PARENT = """
import time
from robot_dynamics.nodes.processes import running_node
with running_node("dynamics_server", {"robot_file": "panda"}) as process:
    print(process.pid, flush=True)
    time.sleep(120)
"""


def is_running(pid):
    """Whether a process runs; one that has ended may wait for its parent as a zombie."""
    try:
        with open(f"/proc/{pid}/stat") as status:
            return status.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_nodes_end_when_their_parent_is_killed(tmp_path):
    log = (tmp_path / "log").open("w")
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, stderr=log, text=True) as parent:
        try:
            node = int(parent.stdout.readline())
            deadline = time.monotonic() + 60
            while "serving" not in (tmp_path / "log").read_text():
                assert time.monotonic() < deadline
                time.sleep(0.05)
            assert is_running(node)
        finally:
            parent.kill()
    try:
        deadline = time.monotonic() + 10
        while is_running(node):
            assert time.monotonic() < deadline, "the node runs on"
            time.sleep(0.05)
    finally:
        if is_running(node):
            os.kill(node, signal.SIGKILL)
