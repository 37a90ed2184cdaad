"""Processes around streamed efforts are stopped and killed while others listen, one of which judges by its own clock.

A listener with shared memory shares locks with the publisher that is killed; the observer does not, so messages that
it receives late were sent late.

Default parameters, states at 1 kHz. `make soak` runs it with INTERRUPTION_ROUNDS=100; by default there are few rounds.
"""

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import peers
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from nodes.controller_probe import PANDA, Q, trajectory_message
from peers.effort_observer import COMMAND, EFFORT, RECORD, STATE
from peers.state_publisher import SWEEP, drifted
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.nodes.processes import running_node, terminate_process

ROUNDS = int(os.environ.get("INTERRUPTION_ROUNDS", "5"))
OBSERVER, PUBLISHER = (Path(peers.__file__).with_name(name) for name in ("effort_observer.py", "state_publisher.py"))
TIMEOUT, RAMP = 20_000_000, 100_000_000  # [ns] state_timeout and ramp_time by default
SLACK = 10_000_000  # [ns] a period of the watchdog, and the way to the observer on a machine that does other things
PANDA_DYNAMICS = Dynamics(load_robot("panda"), compiled=False)
REFERENCE = Q + 0.02
KP = 100.0  # [1/s^2] the default
DAMPED = PANDA_DYNAMICS.gravity(Q)  # efforts without a reference, of a robot at rest
LED = PANDA_DYNAMICS.inverse(Q, np.zeros(7), KP * (REFERENCE - Q))  # efforts that lead it to the reference
PATIENCE = 30.0  # [s]


class Bench:
    """computed_torque, a publisher of states, a listener and an observer, each in a process of its own.

    records: those of the observer since `forget`. parameters: of the node, in addition to the defaults. options: of the
    publisher.
    """

    def __init__(self, stack, client, path, parameters=None, options=()):
        self.namespace = f"/interruptions_{os.getpid()}_{time.monotonic_ns()}"
        target = f"{self.namespace}/computed_torque"
        self._stack, self._options = stack, options
        node_parameters = {"robot_file": "panda", **(parameters or {})}
        self.node = stack.enter_context(running_node("computed_torque", node_parameters, self.namespace))
        listener = subprocess.Popen(
            [sys.executable, OBSERVER, target, os.devnull], env={**os.environ, "FASTDDS_BUILTIN_TRANSPORTS": "DEFAULT"}
        )
        stack.callback(terminate_process, listener)
        self.observer = subprocess.Popen([sys.executable, OBSERVER, target, path])
        stack.callback(terminate_process, self.observer)
        self.publisher = None
        self.start_publisher()
        self._reference = client.node.create_publisher(JointTrajectory, f"{target}/reference", 1)
        stack.callback(client.node.destroy_publisher, self._reference)
        until = time.monotonic() + PATIENCE
        while not path.exists():
            assert time.monotonic() < until, "the observer did not start"
            time.sleep(0.01)
        self._file = stack.enter_context(open(path, "rb"))
        self.records = np.zeros(0, dtype=RECORD)

    def start_publisher(self):
        joints = [f"{name}={value}" for name, value in zip(PANDA, Q, strict=True)]
        options = ["--subscribers", "3", *self._options]  # the node, the listener and the observer
        self.publisher = subprocess.Popen([sys.executable, PUBLISHER, self.namespace, "1000", *joints, *options])
        self._stack.callback(_kill, self.publisher)

    def of(self, kind):
        return self.records[self.records["kind"] == kind]

    def waiting(self):
        """How long [ns] the thread of the node that sends, and those of the observer, have been ready to run while a
        busy machine had no processor for them. Threads that wait for a lock do not count."""
        threads = [f"/proc/{self.node.pid}", *Path(f"/proc/{self.observer.pid}/task").iterdir()]
        return sum(int(Path(thread, "schedstat").read_text().split()[1]) for thread in threads)

    def diagnosis(self, client, pattern=""):
        """Values of the next status on /diagnostics in whose message a pattern is found."""
        statuses = []
        subscription = client.node.create_subscription(
            DiagnosticArray, "/diagnostics", lambda array: statuses.extend(array.status), 10
        )
        until = time.monotonic() + PATIENCE
        try:
            while True:
                assert time.monotonic() < until, statuses[-3:]
                client.spin(0.1)
                for status in statuses:
                    ours = status.name == f"{self.namespace}/computed_torque: control"
                    if ours and re.search(pattern, status.message):
                        return {pair.key: pair.value for pair in status.values}
        finally:
            client.node.destroy_subscription(subscription)

    def forget(self):
        self._file.seek(0, os.SEEK_END)
        self._file.seek(self._file.tell() // RECORD.itemsize * RECORD.itemsize)
        self.records = np.zeros(0, dtype=RECORD)

    def look(self):
        data = self._file.read()
        whole = len(data) // RECORD.itemsize * RECORD.itemsize
        self._file.seek(whole - len(data), os.SEEK_CUR)
        self.records = np.concatenate([self.records, np.frombuffer(data[:whole], dtype=RECORD)])

    def settled(self, *allowed):
        """Those of the efforts `allowed` at which the last 50 commands stand; waits for it."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            self.look()
            last = self.of(COMMAND)["efforts"][-50:]
            for efforts in allowed:
                if len(last) == 50 and np.abs(last - efforts).max() < 1e-6:
                    return efforts
            time.sleep(0.02)
        raise AssertionError(f"efforts do not settle: {self.of(COMMAND)['efforts'][-3:]}")

    def wait_for_states(self, since):
        """States whose stamp is later than `since` [ns] have come, and efforts answer them."""
        until = time.monotonic() + PATIENCE
        while not (self.of(STATE)["stamp"] > since).any():
            assert time.monotonic() < until, "no states come"
            time.sleep(0.02)
            self.look()
        time.sleep(0.2)

    def wait_for_efforts(self, count=200):
        """For so many more non-zero commands."""
        self.look()
        before, until = len(self.of(COMMAND)), time.monotonic() + PATIENCE
        while self.of(COMMAND)["efforts"][before:].any(axis=1).sum() < count:
            assert time.monotonic() < until, "no efforts come"
            time.sleep(0.02)
            self.look()

    def lead(self):
        """Have the robot led to the reference, and forget what was before."""
        self.forget()
        until = time.monotonic() + PATIENCE
        while self.settled(DAMPED, LED) is DAMPED:
            assert time.monotonic() < until, "the reference is not followed"
            self._reference.publish(trajectory_message(PANDA, [0.0], [REFERENCE]))
            time.sleep(0.3)
            self.forget()
        self.forget()


def _kill(process):
    process.send_signal(signal.SIGCONT)
    process.kill()
    process.wait()


@pytest.fixture(scope="module")
def bench(ros, client, tmp_path_factory):
    with ExitStack() as stack:
        yield Bench(stack, client, tmp_path_factory.mktemp("observer") / "records.bin")


@contextmanager
def reported(name):
    """A list of rounds, which is printed at the end."""
    rounds = []
    try:
        yield rounds
    finally:
        print(f"\n{name}: {len(rounds)} rounds")
        for line in rounds:
            print("   ", line)


def stop_publisher(bench, duration):
    bench.publisher.send_signal(signal.SIGSTOP)
    time.sleep(duration)
    bench.publisher.send_signal(signal.SIGCONT)


def kill_publisher(bench, duration):
    _kill(bench.publisher)
    time.sleep(duration)
    bench.start_publisher()


def silence(bench):
    """The longest time without states in a round: stamps [ns] of the last before it and of the first after it."""
    stamps = bench.of(STATE)["stamp"]
    k = np.diff(stamps).argmax()
    return stamps[k], stamps[k + 1]


def check_silence(bench, dropped, slack):
    """Zeros by state_timeout + ramp_time after the last state, but for slack [ns], and the reference dropped where
    zeros were sent."""
    last, following = silence(bench)
    due, commands = last + TIMEOUT + RAMP, bench.of(COMMAND)
    text = f"silent for {(following - last) * 1e-6:.0f} ms, reference {'dropped' if dropped else 'kept'}"
    text += f", no efforts for {np.diff(commands['received']).max() * 1e-6:.0f} ms"
    faults = []
    if following > due + slack:
        inside = commands[(commands["received"] > last) & (commands["received"] < following)]
        active = inside["efforts"].any(axis=1)
        last_active, zeros = inside["received"][active].max(initial=last), inside["received"][~active]
        text += f", last non-zero efforts {(last_active - due) * 1e-6:.1f} ms"
        text += f" and first zeros {(zeros.min(initial=following) - due) * 1e-6:.1f} ms after zeros are due"
        if max(last_active, zeros.min(initial=following)) > due + slack:
            faults.append("efforts are not zero in time")
        if not dropped:
            faults.append("the reference is kept after a long fault")
    if dropped == commands["efforts"].any(axis=1).all():
        faults.append("the reference is to be dropped where efforts are zero, and there only")
    return text, faults


def test_unstamped_states_that_waited_during_a_standstill_are_stale(ros, client, tmp_path):
    """The second joint moves, so its effort identifies the state that it belongs to, at once without a ramp."""
    drift = 0.025
    swept = np.linspace(0.0, SWEEP, 2000, endpoint=False)
    q = np.tile(Q, (len(swept), 1))
    q[:, 1] = drifted(Q[1], drift, swept * 1e9)
    efforts = PANDA_DYNAMICS.gravity(q)[:, 1]
    assert (np.diff(efforts) < 0).all()
    rng = np.random.default_rng(2)
    parameters = {"mode": "gravity_compensation", "ramp_time": 0.0}
    with ExitStack() as stack, reported("stop of the node, states without stamps") as rounds:
        bench = Bench(stack, client, tmp_path / "records.bin", parameters, ["--unstamped", "--drift", str(drift)])
        for _ in range(ROUNDS):
            bench.forget()
            bench.wait_for_efforts()
            resumed = stop_node(bench, duration := rng.uniform(0.2, 1.0))
            bench.wait_for_efforts()
            commands = since(bench.of(COMMAND), resumed)
            active = commands["efforts"].any(axis=1)
            answered = np.interp(-commands["efforts"][:, 1], -efforts, swept) * 1e9
            age = (commands["received"] - answered) % (SWEEP * 10**9)
            old = active & is_old(age, commands, resumed) & (age < 10 * 10**9)  # later than that: a sweep began
            text, faults = check_standstill(resumed, commands["received"][~active], commands["received"][old])
            rounds.append(f"stopped for {duration * 1e3:.0f} ms, {text}")
            assert not faults, f"{faults}: {rounds[-1]}"


@pytest.mark.parametrize(
    ("interrupt", "durations"), [(stop_publisher, (0.03, 1.0)), (kill_publisher, (0.0, 0.3))], ids=["stop", "kill"]
)
@pytest.mark.timeout(60 + 15 * ROUNDS)
def test_efforts_end_with_the_states_for_another_process(interrupt, durations, bench):
    rng = np.random.default_rng(0)
    wrong = []
    with reported(interrupt.__name__) as rounds:
        for k in range(ROUNDS):
            bench.lead()
            time.sleep(rng.uniform(0.2, 0.3))
            waiting = bench.waiting()
            interrupt(bench, np.exp(rng.uniform(*np.log(np.add(durations, 1e-3)))))
            bench.wait_for_states(time.time_ns())
            waiting = bench.waiting() - waiting
            text, faults = check_silence(bench, bench.settled(DAMPED, LED) is DAMPED, SLACK + waiting)
            rounds.append(f"{text}; a busy machine accounts for {waiting * 1e-6:.1f} ms")
            wrong += [f"round {k}: {fault}: {text}" for fault in faults]
    assert not wrong, "\n".join(wrong)


def stop_node(bench, duration):
    """Stop the process of the node for a time, and return the time [ns] at which it goes on."""
    bench.node.send_signal(signal.SIGSTOP)
    time.sleep(duration)
    resumed = time.time_ns()
    bench.node.send_signal(signal.SIGCONT)
    return resumed


def check_standstill(resumed, zeros, old):
    """A node that stood still sends zeros first, and answers no state from before. Returns text, faults.

    resumed: time at which it goes on; zeros, old: times at which zeros were received, and efforts that answer old
    states, all [ns]. One message that it had handed over to the middleware when it was stopped may leave before zeros.
    """
    if not len(zeros):
        return "no zeros", ["no zeros were sent"]
    text = f"{len(zeros)} zeros, the first {(zeros[0] - resumed) * 1e-6:.1f} ms after it goes on"
    faults = []
    if len(old):
        text += f", {len(old)} efforts for old states, the last {(old.max() - zeros[0]) * 1e-6:.1f} ms after zeros"
        if len(old) > 1 or old.max() > zeros[0]:
            faults.append("efforts answer old states")
    return text, faults


def is_old(age, records, resumed):
    """Whether efforts answer states that are too old, because the node stood still: whether the machine lets efforts
    for new states wait on their way is not for the node to say."""
    return (age > TIMEOUT + SLACK) & (records["received"] - age < resumed)


def since(records, time):
    return records[records["received"] >= time]


@pytest.mark.timeout(60 + 15 * ROUNDS)
def test_standstill_of_the_node_sends_no_stale_efforts(bench, client):
    rng = np.random.default_rng(1)
    wrong = []
    before = bench.diagnosis(client)
    with reported("stop of the node") as rounds:
        for k in range(ROUNDS):
            bench.lead()
            time.sleep(rng.uniform(0.2, 0.3))
            resumed = stop_node(bench, duration := rng.uniform(0.2, 1.0))
            time.sleep(0.3)
            dropped = bench.settled(DAMPED, LED) is DAMPED
            commands, efforts = since(bench.of(COMMAND), resumed), since(bench.of(EFFORT), resumed)
            zeros = commands["received"][~commands["efforts"].any(axis=1)]
            early = commands["received"][commands["received"] < zeros.min(initial=np.iinfo(int).max)]
            age = efforts["received"] - efforts["stamp"]
            old = efforts["received"][efforts["efforts"].any(axis=1) & is_old(age, efforts, resumed)]
            text, faults = check_standstill(resumed, zeros, np.append(early, old))
            text = f"stopped for {duration * 1e3:.0f} ms, reference {'dropped' if dropped else 'kept'}, {text}"
            if not dropped:
                faults.append("the reference is kept")
            rounds.append(text)
            wrong += [f"round {k}: {fault}: {text}" for fault in faults]
    assert not wrong, "\n".join(wrong)
    values = bench.diagnosis(client, "it was dropped when efforts went to zero: ")
    assert int(values["standstills"]) >= int(before["standstills"]) + ROUNDS


def test_unstamped_points_that_waited_during_a_standstill_are_late(bench, client):
    bench.lead()
    publisher = client.node.create_publisher(JointTrajectory, f"{bench.namespace}/computed_torque/reference_point", 10)
    point = trajectory_message(PANDA, [0.0], [REFERENCE], [np.zeros(7)], [np.zeros(7)])

    def stream(count):
        for _ in range(count):
            publisher.publish(point)
            time.sleep(0.01)

    try:
        until = time.monotonic() + PATIENCE
        while not publisher.get_subscription_count():
            assert time.monotonic() < until, "the node takes no points"
            time.sleep(0.02)
        stream(100)
        bench.node.send_signal(signal.SIGSTOP)
        stream(10)
        time.sleep(0.4)
        bench.node.send_signal(signal.SIGCONT)
        time.sleep(0.5)
        assert bench.settled(DAMPED, LED) is DAMPED
        values = bench.diagnosis(client)
        assert re.search(r"the point is 0\.[45]\d* s old", values["last refusal"]), values
    finally:
        client.node.destroy_publisher(publisher)
