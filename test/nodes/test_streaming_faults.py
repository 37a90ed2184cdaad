"""Faults on real processes while efforts stream: they go to zero in time, never exceed limits, and come back.

Times are those of the stamps of efforts and states: the transit time of messages to this process does not count.
"""

import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import peers
import pytest
from nodes.controller_probe import PANDA, ControllerProbe, Q, to_time, trajectory_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.processes import running_node
from robot_dynamics.nodes.qos import LATCHED_QOS

PUBLISHER = Path(peers.__file__).with_name("state_publisher.py")
GRAVITY = Dynamics(load_robot("panda"), compiled=False).gravity(Q)
LIMITS = np.array([30.0] * 4 + [10.0] * 3)
HELD = np.clip(GRAVITY, -LIMITS, LIMITS)
TIMEOUT, RAMP, SOON = 20, 100, 20  # [ms]: state_timeout, ramp_time, and until efforts are safe
TOLD = {
    "robot_file": "panda",
    "effort_limits": LIMITS.tolist(),
    "state_timeout": TIMEOUT * 1e-3,
    "ramp_time": RAMP * 1e-3,
    "deadline": 1.0,  # other tests are late on purpose, the machine is not meant
}


@contextmanager
def probing(target, client):
    probe_of_target = ControllerProbe(target, client)
    try:
        yield probe_of_target
        sent = np.array([efforts for _, efforts in probe_of_target.commands])
        assert len(sent) and np.isfinite(sent).all() and (np.abs(sent) <= LIMITS).all()
    finally:
        probe_of_target.close()


@pytest.fixture(scope="module")
def target(start_module_server):
    return start_module_server(TOLD, executable="computed_torque")


@pytest.fixture
def probe(target, client):
    with probing(target, client) as probe_of_target:
        yield probe_of_target


@contextmanager
def publisher(namespace, names=PANDA, q=Q):
    """The process that publishes states."""
    joints = [f"{name}={value}" for name, value in zip(names, q, strict=True)]
    process = subprocess.Popen([sys.executable, PUBLISHER, namespace, "500", *joints])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def held(probe):
    return bool(probe.efforts) and np.abs(np.array(probe.efforts[-1].effort) - HELD).max() < 1e-9


def check_way_to_zero(probe, since, visible):
    """Efforts of messages from number `since` on are on the way to zero soon after the fault was visible [ns]."""
    late = [(to_nanoseconds(m.header.stamp) - visible) * 1e-6 - SOON for m in probe.efforts[since:]]
    allowed = {ms: max(0.0, 1 - ms / RAMP) for ms in late}
    for ms, message in zip(late, probe.efforts[since:], strict=True):
        if ms >= 0:
            assert (np.abs(message.effort) <= allowed[ms] * np.abs(HELD) + 1e-9).all(), f"{ms:.1f} ms too late"
    assert max(late) > RAMP, "zeros are not sent on"


def first_held(efforts, after=0):
    """The stamp [ns] of the first efforts beyond `after` that hold the robot; None where none do yet."""
    later = (
        m for m in efforts if to_nanoseconds(m.header.stamp) > after
    )  # few: a look must not keep states from coming
    return next((to_nanoseconds(m.header.stamp) for m in later if np.abs(np.array(m.effort) - HELD).max() < 1e-9), None)


def check_recovery(probe):
    """From the last zeros, sent because states were still missing, to efforts that hold the robot."""
    last = max(k for k, message in enumerate(probe.efforts) if not np.any(message.effort))
    began = to_nanoseconds(probe.efforts[last].header.stamp)
    print(f"efforts again after {(first_held(probe.efforts[last:]) - began) * 1e-6:.0f} ms")  # a time of this machine


def zeros(probe, count=5):
    return len(probe.efforts) >= count and not np.any([message.effort for message in probe.efforts[-count:]])


def test_efforts_end_with_a_killed_publisher_and_return_with_another_joint_order(probe):
    namespace = probe.target.rpartition("/")[0]
    with publisher(namespace) as process:
        probe.wait_until(lambda: held(probe) and len(probe.state_stamps) > 100, "efforts")
        process.send_signal(signal.SIGKILL)
        process.wait()
        probe.wait_until(lambda: zeros(probe), "zeros")
    time.sleep(0.2)
    visible = probe.state_stamps[-1] + TIMEOUT * 1_000_000
    since = next(k for k, m in enumerate(probe.efforts) if to_nanoseconds(m.header.stamp) > probe.state_stamps[-1])
    check_way_to_zero(probe, since, visible)
    probe.wait_until(lambda: probe.has_diagnostic("no joint_states for more than 20 ms"), "the cause")
    with publisher(namespace, PANDA[::-1], Q[::-1]):
        probe.wait_until(lambda: held(probe), "efforts again")
    check_recovery(probe)


BAD = {
    "nan": ({"q": [*Q[:3], np.nan, *Q[4:]]}, "position of joint 'panda_joint4' is nan"),
    "infinite velocity": ({"qd": [np.inf, *[0.0] * 6]}, "velocity of joint 'panda_joint1' is inf"),
    "no velocities": ({"qd": []}, "0 velocities for 7 names"),
    "a joint missing": ({"q": Q[:6], "names": PANDA[:6]}, "joint_states has no 'panda_joint7'"),
    "a joint twice": ({"q": [*Q, 0.0], "names": [*PANDA, PANDA[0]]}, "names 'panda_joint1' more than once"),
    "too few positions": ({"q": Q[:6], "names": PANDA}, "6 positions for 7 names"),
    "an old stamp": ({"stamp": 10**9}, "s old by their stamp"),
    "a stamp of tomorrow": ({"stamp": 2 * 10**18}, "ahead of the clock"),
}


@pytest.mark.parametrize("case", BAD)
def test_invalid_states_lead_to_zero_efforts(case, probe):
    bad, reason = BAD[case]
    probe.stream_until(lambda: held(probe), "efforts")
    since, began = len(probe.efforts), time.time_ns()
    probe.stream(0.25, **bad)
    probe.wait_until(
        lambda: probe.has_diagnostic(f"efforts go to zero: {reason}") or probe.has_diagnostic(reason), reason
    )
    check_way_to_zero(probe, since, began)
    probe.stream_until(lambda: held(probe), "efforts again")
    check_recovery(probe)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_efforts_on_the_way_to_zero_do_not_have_the_stamps_of_refused_states(value, probe):
    """A simulator pairs states and efforts by their stamps: these efforts are no answer."""
    probe.stream_until(lambda: held(probe), "efforts")
    refused = []
    for _ in range(50):
        refused.append(time.time_ns())
        probe.publish(q=[*Q[:3], value, *Q[4:]], stamp=refused[-1])
        time.sleep(0.004)
    probe.wait_until(lambda: zeros(probe), "zeros")
    stamps = {to_nanoseconds(message.header.stamp) for message in probe.efforts}
    assert len(stamps & set(probe.state_stamps)) > 10, "good states are answered with their stamps"
    assert not stamps & set(refused)


def test_diagnostics_tell_that_refused_states_have_stopped(probe):
    probe.stream_until(lambda: held(probe), "efforts")
    probe.stream(0.3, q=Q[:6], names=PANDA[:6])
    refusal = "joint_states has no 'panda_joint7'"
    since = len(probe.diagnostics)
    probe.wait_until(lambda: probe.has_diagnostic("no joint_states for more than 20 ms", since), "the silence")
    probe.wait_until(lambda: len(probe.diagnostics) > since + 2, "further diagnostics")
    message = probe.diagnostics[-1][1]
    assert "no joint_states for more than 20 ms" in message and refusal in message


def test_efforts_return_after_a_burst_of_ten_thousand_messages(probe):
    probe.stream_until(lambda: held(probe), "efforts")
    for k in range(10_000):
        probe.publish(q=Q + 1e-4 * (k % 7))
    since, ended = len(probe.efforts), time.time_ns()
    probe.stream_until(lambda: first_held(probe.efforts[since:], ended), "efforts after the burst")
    print(f"efforts again {(first_held(probe.efforts[since:], ended) - ended) * 1e-6:.0f} ms after the burst")


def test_repeated_deadline_misses_lead_to_zero_efforts(probe):
    probe.stream_until(lambda: held(probe), "efforts")
    assert probe.set_parameters(deadline=1e-4, deadline_misses=5).successful  # [s], no message is that fast
    probe.stream_until(
        lambda: probe.has_diagnostic("efforts go to zero: the efforts for the last 5 states were later than 0.1 ms"),
        "it",
    )
    probe.stream_until(lambda: zeros(probe), "zeros")
    assert probe.set_parameters(deadline=TOLD["deadline"]).successful
    probe.stream_until(lambda: held(probe), "efforts again")


def test_description_of_another_robot_stops_efforts_until_the_right_one_comes(start_server, client):
    parameters = {name: value for name, value in TOLD.items() if name != "robot_file"}
    target = start_server(parameters, executable="computed_torque")
    with probing(target, client) as probe:
        description = probe.node.create_publisher(String, "robot_description", LATCHED_QOS)
        texts = {name: shipped_robots()[name].read_text() for name in ("panda", "ur5e")}
        description.publish(String(data=texts["panda"]))
        probe.stream_until(lambda: held(probe), "efforts")
        description.publish(String(data="<robot"))
        probe.stream_until(lambda: probe.has_diagnostic("last change refused: topic robot_description"), "the refusal")
        assert held(probe), "what is no robot leaves the one before it"
        description.publish(String(data=texts["ur5e"]))
        reason = "the description of 'ur5e' does not fit: parameter joints: unknown joint 'panda_joint1'"
        probe.stream_until(lambda: probe.has_diagnostic(f"efforts go to zero: {reason}"), reason)
        probe.stream_until(lambda: zeros(probe), "zeros")
        heavier = texts["panda"].replace('<mass value="3', '<mass value="4')
        description.publish(String(data=heavier))
        library = Dynamics(load_robot(heavier), compiled=False)
        expected = np.clip(library.gravity(Q), -LIMITS, LIMITS)
        back = time.monotonic()
        probe.stream_until(lambda: np.abs(probe.commands[-1][1] - expected).max() < 1e-9, "the heavier robot")
        print(f"another robot was ready after {time.monotonic() - back:.2f} s")


def test_clock_that_jumps_back_or_stands_still_stops_efforts(start_server, client):
    target = start_server({**TOLD, "use_sim_time": True}, executable="computed_torque")
    with probing(target, client) as probe:
        clock, now = probe.node.create_publisher(Clock, "/clock", 10), [10 * 10**9]

        def run(condition, case, patience=20.0):
            """Time runs, and states come."""
            until = time.monotonic() + patience
            while not condition():
                assert time.monotonic() < until, f"{case}: {probe.diagnostics[-1:]}"
                now[0] += 4_000_000
                clock.publish(Clock(clock=to_time(now[0])))
                probe.publish(stamp=now[0])
                time.sleep(0.004)

        run(lambda: held(probe), "efforts")
        now[0] = 2 * 10**9
        since = len(probe.efforts)
        run(lambda: zeros(probe, 40), "zeros")
        run(lambda: probe.has_diagnostic("the clock jumped back by"), "the cause")
        sent = [m for m in probe.efforts[since:] if to_nanoseconds(m.header.stamp) < 9 * 10**9]
        for message in sent:
            ms = to_nanoseconds(message.header.stamp) * 1e-6 - 2000 - SOON
            assert (np.abs(message.effort) <= np.clip(1 - ms / RAMP, 0, 1) * np.abs(HELD) + 1e-9).all()
        probe.reference.publish(trajectory_message(PANDA, [0.0, 1.0], [Q, Q]))
        run(lambda: held(probe), "efforts with a new reference")
        # the simulation is gone: no time goes on, and no state comes
        since = len(probe.diagnostics)
        probe.wait_until(lambda: zeros(probe), "zeros while time stands still", patience=3.0)
        probe.wait_until(
            lambda: probe.has_diagnostic("no joint_states for 1 s, and the clock stands still", since), "the cause"
        )
        run(lambda: held(probe), "efforts where time goes on")


def test_killed_node_restarts_with_zero_efforts(ros, client):
    namespace, ramp = "/killed", 10.0  # [s] longer than it may take until the new process is heard
    with publisher(namespace), probing(f"{namespace}/computed_torque", client) as probe:
        with running_node("computed_torque", TOLD, namespace) as process:
            probe.wait_until(lambda: held(probe), "efforts")
            process.send_signal(signal.SIGKILL)
            process.wait()
        time.sleep(0.5)  # what it had sent before arrives
        count, since, started = len(probe.commands), len(probe.efforts), time.time_ns()
        with running_node("computed_torque", {**TOLD, "ramp_time": ramp}, namespace):
            probe.wait_until(lambda: len(probe.efforts) > since + 20, "efforts again")
        probe.wait_until(lambda: not np.any(probe.commands[-1][1]), "zeros, the last of a node that ends")
        first, sent = probe.efforts[since], np.array([efforts for _, efforts in probe.commands[count:]])
        share = np.abs(first.effort).max() / np.abs(HELD).max()  # of the ramp, by which it was at zero
        assert to_nanoseconds(first.header.stamp) - share * ramp * 1e9 > started
        assert np.abs(np.diff(sent[:-1], axis=0)).max() < 0.1 * np.abs(HELD).max()
