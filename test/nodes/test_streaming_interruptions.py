"""A node that stood still has messages without stamps that waited: they are late, though the time of arrival is new.

Default timeouts, states at 1 kHz. `make soak` runs it with INTERRUPTION_ROUNDS=100; by default there are few rounds.
What becomes of messages with stamps, and of states that stop, is judged in `faults/`.
"""

import os
import re
import signal
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from nodes.controller_probe import PANDA, Q, trajectory_message
from nodes.faults.bench import DAMPED, FURTHER, LED, LED_FURTHER, PANDA_DYNAMICS, PATIENCE, Bench, is_near, wait_until
from nodes.faults.invariants import SLACK, TIMEOUT
from peers.effort_observer import COMMAND
from peers.state_publisher import SWEEP, drifted
from trajectory_msgs.msg import JointTrajectory

ROUNDS = int(os.environ.get("INTERRUPTION_ROUNDS", "3"))


@pytest.fixture(scope="module")
def bench(ros, client, tmp_path_factory):
    with ExitStack() as stack:
        yield Bench(stack, client, tmp_path_factory.mktemp("observer"))


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
    with ExitStack() as stack:
        bench = Bench(stack, client, tmp_path, parameters, ["--unstamped", "--drift", str(drift)])
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
            print(f"stopped for {duration * 1e3:.0f} ms, {text}")
            assert not faults, f"{faults}: {text}"


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


def wait_until_stopped(process):
    """Until no thread of a process runs: a signal takes effect later than the call returns."""

    def is_stopped():
        threads = Path(f"/proc/{process.pid}/task").iterdir()
        return {Path(thread, "stat").read_text().rpartition(")")[2].split()[0] for thread in threads} == {"T"}

    wait_until(is_stopped, "the process stops")


def test_unstamped_points_that_waited_during_a_standstill_are_late(bench, client):
    """States fill the buffer of the socket of a node that is stopped in a tenth of a second: later points are lost."""
    bench.lead()
    publisher = client.node.create_publisher(JointTrajectory, f"{bench.namespace}/computed_torque/reference_point", 10)
    point = trajectory_message(PANDA, [0.0], [FURTHER], [np.zeros(7)], [np.zeros(7)])
    try:
        until = time.monotonic() + PATIENCE
        followed = False
        while not followed:
            assert time.monotonic() < until, "the node does not follow the points"
            publisher.publish(point)
            time.sleep(0.01)
            bench.look()
            last = bench.of(COMMAND)["efforts"][-50:]
            followed = len(last) == 50 and is_near(last, LED_FURTHER).all()
        before = bench.diagnosis()
        bench.node.send_signal(signal.SIGSTOP)
        wait_until_stopped(bench.node)
        for _ in range(10):
            publisher.publish(point)
        waited = time.monotonic()
        time.sleep(0.5)
        waited = time.monotonic() - waited
        bench.node.send_signal(signal.SIGCONT)
        until = time.monotonic() + PATIENCE
        while (values := bench.diagnosis())["references refused"] == before["references refused"]:
            assert time.monotonic() < until, values
        age = re.search(r"the point is (\d+\.\d+) s old", values["last refusal"])
        assert age and float(age[1]) > waited - SLACK * 1e-9, values
        assert int(values["standstills"]) > int(before["standstills"])
        assert int(values["references refused"]) == int(before["references refused"]) + 10
        bench.forget()
        assert bench.settled(DAMPED, LED, LED_FURTHER) is DAMPED
    finally:
        client.node.destroy_publisher(publisher)
