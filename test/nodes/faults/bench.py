"""computed_torque between a robot and subscribers, each in a process of its own, and an observer outside of it.

A listener with shared memory shares locks with the publisher that is killed; the observer does not, so messages that
it receives late were sent late.
"""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import peers
from diagnostic_msgs.msg import DiagnosticArray
from nodes.controller_probe import PANDA, Q, trajectory_message
from nodes.faults.waiting import WaitingRecorder
from peers.effort_observer import COMMAND, RECORD, STATE
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.nodes.processes import running_node, terminate_process

OBSERVER, PUBLISHER = (Path(peers.__file__).with_name(name) for name in ("effort_observer.py", "state_publisher.py"))
LIMITS = np.array([87.0, 87.0, 14.0, 87.0, 12.0, 1.5, 12.0])  # two of them are reached
PANDA_DYNAMICS = Dynamics(load_robot("panda"), compiled=False)
REFERENCE = Q + 0.02
KP = 100.0  # [1/s^2] the default
DAMPED = np.clip(PANDA_DYNAMICS.gravity(Q), -LIMITS, LIMITS)  # efforts without a reference, of a robot at rest
LED = np.clip(PANDA_DYNAMICS.inverse(Q, np.zeros(7), KP * (REFERENCE - Q)), -LIMITS, LIMITS)  # they lead it there
FURTHER = Q + 0.04  # another reference
LED_FURTHER = np.clip(PANDA_DYNAMICS.inverse(Q, np.zeros(7), KP * (FURTHER - Q)), -LIMITS, LIMITS)
PATIENCE = 30.0  # [s]


class NotSettledError(Exception):
    """Efforts are not those that are expected, within PATIENCE."""


class Bench:
    """The processes, the node with `effort_limits` of LIMITS; all end with the stack.

    Parameters
    ----------
    stack : ExitStack
    client : ServiceClient
    folder : Path, for the records of the observer and the output of the node.
    parameters : of the node, in addition to the defaults.
    options : of the publisher of states.
    environment : variables of the node.

    Attributes
    ----------
    records : array of RECORD, those of the observer since `forget`.
    """

    def __init__(self, stack, client, folder, parameters=None, options=(), environment=None):
        self.stack, self.client = stack, client
        self.namespace = f"/bench_{os.getpid()}_{time.monotonic_ns()}"
        self.target = f"{self.namespace}/computed_torque"
        self.log = folder / "node.log"
        self._parameters = {"robot_file": "panda", "effort_limits": LIMITS.tolist(), **(parameters or {})}
        self._options, self._environment = options, environment
        self._node_block = None
        stack.callback(self.end_node)
        self.start_node()
        self.listener = self.publisher = None
        self.start_listener()
        path = folder / "records.bin"
        self.observer = subprocess.Popen([sys.executable, OBSERVER, self.target, path])
        stack.callback(terminate_process, self.observer)
        self.start_publisher()
        self._reference = client.node.create_publisher(JointTrajectory, f"{self.target}/reference", 1)
        stack.callback(client.node.destroy_publisher, self._reference)
        self._statuses = []
        subscription = client.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        stack.callback(client.node.destroy_subscription, subscription)
        wait_until(path.exists, "the observer starts", patience=2 * PATIENCE)
        self._file = stack.enter_context(open(path, "rb"))
        self.records = np.zeros(0, dtype=RECORD)

    def start_node(self):
        """Start computed_torque."""
        log = self.stack.enter_context(open(self.log, "ab"))
        self._node_block = running_node("computed_torque", self._parameters, self.namespace, self._environment, log)
        self.node = self._node_block.__enter__()

    def end_node(self):
        """End computed_torque, which may have been stopped."""
        if self._node_block is not None:
            self.node.send_signal(signal.SIGCONT)
            self._node_block.__exit__(None, None, None)
            self._node_block = None

    def kill_node(self):
        """Kill computed_torque."""
        self.node.kill()
        self.node.wait()
        self._node_block.__exit__(None, None, None)
        self._node_block = None

    def start_publisher(self):
        """Start the publisher of states, at 1 kHz."""
        joints = [f"{name}={value}" for name, value in zip(PANDA, Q, strict=True)]
        options = ["--subscribers", "3", *self._options]  # the node, the listener and the observer
        command = [sys.executable, PUBLISHER, self.namespace, "1000", *joints, *options]
        self.publisher = subprocess.Popen(command, stdin=subprocess.PIPE, text=True)
        self.stack.callback(kill, self.publisher)

    def set_clock(self, offset):
        """Set the clock of the publisher ahead of that of the machine by an offset [s]."""
        print(offset, file=self.publisher.stdin, flush=True)

    def start_listener(self):
        """Start a subscriber that may use shared memory."""
        environment = {**os.environ, "FASTDDS_BUILTIN_TRANSPORTS": "DEFAULT"}
        command = [sys.executable, OBSERVER, self.target, os.devnull]
        self.listener = aside(subprocess.Popen(command, env=environment))
        self.stack.callback(kill, self.listener)

    def of(self, kind):
        """Records of a kind."""
        return self.records[self.records["kind"] == kind]

    def waiting(self):
        """A WaitingRecorder of the thread of the node that sends, and of the observer."""
        return WaitingRecorder(lambda: self.node.pid, self.observer.pid)

    def _on_diagnostics(self, array):
        self._statuses += [status for status in array.status if status.name == f"{self.target}: control"]

    def diagnosis(self, pattern=""):
        """Values of the next status on /diagnostics in whose message a pattern is found."""
        self._statuses.clear()
        until = time.monotonic() + PATIENCE
        while True:
            assert time.monotonic() < until, self._statuses[-3:]
            self.client.spin(0.1)
            for status in self._statuses:
                if re.search(pattern, status.message):
                    return {pair.key: pair.value for pair in status.values}

    def forget(self):
        """Forget what the observer has recorded."""
        self._file.seek(0, os.SEEK_END)
        self._file.seek(self._file.tell() // RECORD.itemsize * RECORD.itemsize)
        self.records = np.zeros(0, dtype=RECORD)

    def look(self):
        """Read what the observer has recorded."""
        data = self._file.read()
        whole = len(data) // RECORD.itemsize * RECORD.itemsize
        self._file.seek(whole - len(data), os.SEEK_CUR)
        self.records = np.concatenate([self.records, np.frombuffer(data[:whole], dtype=RECORD)])

    def settled(self, *allowed):
        """Those of the efforts `allowed` at which the last 50 commands stand; waits for it."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            self.look()
            last = self.of(COMMAND)[-50:]
            for efforts in allowed:
                if len(last) == 50 and is_near(last["efforts"], efforts).all():
                    return efforts
            time.sleep(0.01)
        raise NotSettledError(f"efforts do not settle: {self.of(COMMAND)['efforts'][-1:].tolist()}")

    def wait_for_states(self, since):
        """States and efforts of other messages that are received later than `since` [ns] have come."""

        def have_come():
            self.look()
            return all((self.of(kind)["received"] > since).sum() > 10 for kind in (STATE, COMMAND))

        wait_until(have_come, "states and efforts")

    def wait_for_efforts(self, count=200):
        """For so many more non-zero commands."""
        self.look()
        before, until = len(self.of(COMMAND)), time.monotonic() + PATIENCE
        while self.of(COMMAND)["efforts"][before:].any(axis=1).sum() < count:
            assert time.monotonic() < until, "no efforts come"
            time.sleep(0.02)
            self.look()

    def send_reference(self):
        """Send the reference, to which efforts of LED lead."""
        self._reference.publish(trajectory_message(PANDA, [0.0], [REFERENCE]))

    def lead(self):
        """Have the robot led to the reference, and forget what was before."""
        self.forget()
        until = time.monotonic() + PATIENCE
        while self.settled(DAMPED, LED) is DAMPED:
            if time.monotonic() > until:
                raise NotSettledError("the reference is not followed")
            self.send_reference()
            time.sleep(0.15)
            self.forget()
        self.forget()


def is_near(efforts, expected):
    """Whether rows of efforts (..., joints) are those that are expected (joints,)."""
    return np.abs(efforts - expected).max(axis=-1) < 1e-6


def aside(process):
    """A process that runs with half the priority of the node where both have real-time priorities, as it is not judged
    when it sends and receives."""
    policy = os.sched_getscheduler(process.pid)
    if policy in (os.SCHED_RR, os.SCHED_FIFO):
        priority = os.sched_getparam(process.pid).sched_priority
        os.sched_setscheduler(process.pid, policy, os.sched_param(max(1, priority // 2)))
    return process


def own_memory(process):
    """Memory [bytes] of a process that no file backs, also in swap.

    Pages of libraries do not count: they become its own when other processes end.
    """
    lines = Path(f"/proc/{process.pid}/smaps_rollup").read_text().splitlines()
    return 1024 * sum(int(line.split()[1]) for line in lines if line.startswith(("Anonymous:", "Swap:")))


def kill(process):
    """Kill a process, also one that has been stopped."""
    process.kill()
    process.wait()
    if process.stdin is not None:
        process.stdin.close()


def wait_until(condition, description, patience=PATIENCE):
    """Wait until a condition holds, at most for a time [s]."""
    until = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < until, f"not within {patience} s: {description}"
        time.sleep(0.01)
