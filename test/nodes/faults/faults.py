"""Faults around running nodes: what happens to them, and what they may do then."""

import json
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from nodes.faults.bench import aside, kill

DISTURBERS = Path(__file__).with_name("disturbers.py")


@dataclass
class Fault:
    """A fault for some time.

    Attributes
    ----------
    name : str
    durations : (shortest, longest) [s]
    simulated : whether the node follows the simulated time.
    outcome : "safe", or besides "undisturbed": there are no zeros; "zeros": there are some.
    node : what becomes of the node: "runs", "stands" still, or "dies".
    latches : whether a new reference is needed afterwards.
    is_observed : whether messages reach the observer during the fault.
    keeps_reference : whether the reference is dropped where efforts are zero, and there only.
    zeros_after : time [s] after which zeros are due, if states go on; None: only where states stop.
    environment : variables of the node.
    done : of each round, what a process has done that disturbs the node.
    """

    name: str
    durations: tuple[float, float] = (0.03, 0.5)
    simulated: bool = False
    outcome: str = "safe"
    node: str = "runs"
    latches: bool = False
    is_observed: bool = True
    keeps_reference: bool = True
    zeros_after: float | None = None
    environment: dict[str, str] = field(default_factory=dict)
    done: list[dict[str, float]] = field(default_factory=list)

    @contextmanager
    def prepared(self, bench):
        """What is needed for all rounds."""
        yield

    def begin(self, bench, rng):
        """Let it happen."""

    def end(self, bench):
        """Let it be over."""


@contextmanager
def stopped(process):
    """A process that does not run in the block."""
    process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        process.send_signal(signal.SIGCONT)


class Stop(Fault):
    """A process does not run for a time."""

    def __init__(self, name, process, **outcome):
        super().__init__(name, **outcome)
        self._process = process

    def begin(self, bench, rng):
        getattr(bench, self._process).send_signal(signal.SIGSTOP)

    def end(self, bench):
        getattr(bench, self._process).send_signal(signal.SIGCONT)


class KillPublisher(Fault):
    """The robot is killed, and starts anew."""

    def begin(self, bench, rng):
        kill(bench.publisher)

    def end(self, bench):
        bench.start_publisher()


class KillListener(Fault):
    """A subscriber is killed, and starts anew."""

    def begin(self, bench, rng):
        kill(bench.listener)

    def end(self, bench):
        bench.start_listener()


class KillNode(Fault):
    """The node is killed, and starts anew."""

    def begin(self, bench, rng):
        bench.kill_node()

    def end(self, bench):
        bench.start_node()


class JumpOfClock(Fault):
    """The clock of the robot is wrong by up to some seconds; as the simulated time it stays so."""

    def __init__(self, name, sign, largest=5.0, **outcome):
        super().__init__(name, **outcome)
        self._sign, self._largest = sign, largest
        self._offset = 0.0

    def begin(self, bench, rng):
        jump = self._sign * rng.uniform(0.2, self._largest)
        self._offset = self._offset + jump if self.simulated else jump
        bench.set_clock(self._offset)

    def end(self, bench):
        if not self.simulated:
            bench.set_clock(0.0)


class Disturber(Fault):
    """Another process is busy with the topics and services of the node."""

    def __init__(self, name, kind, **outcome):
        super().__init__(name, durations=(0.3, 1.0), **outcome)
        self._kind = kind

    @contextmanager
    def prepared(self, bench):
        self._start(bench)
        try:
            yield
        finally:
            self._kill()

    def _start(self, bench):
        command = [sys.executable, DISTURBERS, self._kind, bench.namespace]
        self._process = aside(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True))
        assert self._process.stdout.readline() == "ready\n"
        time.sleep(0.5)

    def _kill(self):
        kill(self._process)
        self._process.stdout.close()

    def begin(self, bench, rng):
        print("go", file=self._process.stdin, flush=True)

    def end(self, bench):
        print("rest", file=self._process.stdin, flush=True)
        self.done.append(json.loads(self._process.stdout.readline()))


class KilledDisturber(Disturber):
    """Another process is killed while it is busy with the topics and services of the node."""

    def end(self, bench):
        self._kill()
        self._start(bench)


class FullDisk(Fault):
    """No file can be written where the node has its logs and its cache, and there is something to log."""

    def __init__(self, name, disk, restart=False, **outcome):
        environment = {variable: str(disk) for variable in ("HOME", "ROS_LOG_DIR", "TMPDIR", "XDG_CACHE_HOME")}
        super().__init__(name, environment=environment, **outcome)
        self._file = disk / "filling"
        self._restart = restart

    def begin(self, bench, rng):
        fill(self._file)
        if self._restart:
            bench.kill_node()
            bench.start_node()
        else:
            bench.publisher.send_signal(signal.SIGSTOP)

    def end(self, bench):
        if self._restart:
            bench.wait_for_states(time.time_ns())
        else:
            bench.publisher.send_signal(signal.SIGCONT)
        self._file.unlink()


def fill(path):
    """Write a file until there is no space."""
    with open(path, "wb", buffering=0) as file:
        for size in (65536, 4096, 1):
            try:
                while file.write(bytes(size)) == size:
                    pass
            except OSError:
                pass


class NoNetwork(Fault):
    """The network interface through which all nodes communicate is down."""

    def begin(self, bench, rng):
        subprocess.run(["ip", "link", "set", "lo", "down"], check=True)

    def end(self, bench):
        subprocess.run(["ip", "link", "set", "lo", "up"], check=True)


def all_faults(disk=None, has_network=False):
    """The faults that are possible here.

    disk: a small file system in which the node has its home; None: there is none. has_network: whether the network
    interfaces are those of this process alone.
    """
    stand = {"node": "stands", "outcome": "zeros"}
    faults = [
        KillPublisher("robot killed", outcome="zeros"),
        Stop("robot stopped", "publisher", durations=(0.03, 1.0)),
        KillListener("subscriber killed", outcome="undisturbed"),
        Stop("subscriber stopped", "listener", outcome="undisturbed"),
        KillNode("node killed", node="dies"),
        Stop("node stopped", "node", durations=(0.2, 1.0), **stand),
        JumpOfClock("clock of the robot ahead", 1, outcome="zeros", durations=(0.2, 0.5)),
        JumpOfClock("clock of the robot behind", -1, outcome="zeros", durations=(0.2, 0.5)),
        Disturber("subscriber that never reads", "unread", outcome="undisturbed"),
        Disturber("states at 10 kHz", "states"),
        Disturber("invalid states at 10 kHz", "invalid_states"),
        Disturber("points at 10 kHz", "points", keeps_reference=False),
        Disturber("discovery storm", "storm"),
        Disturber("50 clients", "clients"),
        KilledDisturber("50 clients killed", "clients"),
    ]
    if disk is not None:
        faults += [
            FullDisk("disk full", disk, outcome="zeros", durations=(0.2, 0.5)),
            FullDisk("start on a full disk", disk, restart=True, node="dies"),
        ]
    if has_network:
        faults.append(NoNetwork("no network", durations=(0.03, 1.0), is_observed=False))
    return [
        *faults,
        JumpOfClock("simulated time jumps ahead", 1, simulated=True, outcome="zeros"),
        JumpOfClock(
            "simulated time jumps back",
            -1,
            simulated=True,
            outcome="zeros",
            durations=(0.2, 0.5),
            latches=True,
            zeros_after=0.1,
        ),
        KillPublisher("simulated robot killed", simulated=True, durations=(0.5, 1.0)),
        Stop("simulated time stands still", "publisher", simulated=True, durations=(1.2, 1.5), outcome="zeros"),
    ]
