"""replay_check in a process of its own, with motions and efforts of a known robot, computed by Pinocchio.

Samples are stamped at 200 Hz and published faster than real time, as a bag may be played.
"""

import time

import numpy as np
import pinocchio as pin
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from peers import flights
from peers.recorded import BEGINNING, JOINTS, panda_model, panda_motion, uneven_times
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.model.placement import to_scipy_rotation
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.codecs.geometry import write_pose, write_twist
from robot_dynamics.nodes.diagnostics import ERROR, OK, STALE, WARN

from .controller_probe import DEEP, to_time

RATE, TOGETHER = 200.0, 4
MOTION = panda_motion(duration=8.0, rate=RATE)
NOISE = 0.05


class Watch:
    """Publishes joint states, and keeps the messages of the node."""

    def __init__(self, name, client, topics=("joint_states", "wrist_states")):
        self.name, self.client, self.predicted, self.residuals = name, client, [], []
        self.whole, self.joints = [], {}  # (level, message, values), last of each joint
        node, namespace = client.node, name.rpartition("/")[0]
        self.outs = [node.create_publisher(JointState, f"{namespace}/{topic}", DEEP)
                     for topic in topics]  # fmt: skip
        self._held = [
            node.create_subscription(kind, topic, take, DEEP)
            for kind, topic, take in (
                (JointState, f"{name}/predicted_effort", self.predicted.append),
                (JointState, f"{name}/residual", self.residuals.append),
                (DiagnosticArray, "/diagnostics", self._on_diagnostics),
            )
        ]
        self.wait_until(lambda: all(out.get_subscription_count() for out in self.outs), "the topics are heard")
        self.wait_until(lambda: self.whole, "diagnostics")

    def _on_diagnostics(self, array):
        for status in array.status:
            name, _, part = status.name.partition(": ")
            if name == self.name:
                told = status.level, status.message, {pair.key: pair.value for pair in status.values}
                if part == "check":
                    self.whole.append(told)
                else:
                    self.joints[part] = told

    def wait_until(self, condition, description, patience=30.0):
        deadline = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < deadline, (
                f"not within {patience} s: {description}; {self.whole[-1:]}, {self.joints}"
            )
            self.client.spin(0.02)

    def tell(self, messages):
        """Publish (publisher, message) pairs, a few in the time between two samples."""
        due = time.monotonic()
        for number, (out, message) in enumerate(messages):
            self.outs[out].publish(message)
            if number % TOGETHER == 0:
                due = max(due + 1 / RATE, time.monotonic() - 0.05)
                self.client.spin(max(0.0, due - time.monotonic()))

    def call_trigger(self, service):
        return self.client.call(Trigger, f"{self.name}/{service}", Trigger.Request())

    def has_diagnostic(self, text):
        return any(text in " ".join([message, *map(str, values.values())])
                   for _, message, values in [*self.whole[-1:], *self.joints.values()])  # fmt: skip


@pytest.fixture(scope="module")
def watch(start_module_server, client):
    parameters = {"robot_file": "panda", "topics": ["joint_states", "wrist_states"]}
    return Watch(start_module_server(parameters, executable="replay_check"), client)


@pytest.fixture
def fresh(watch):
    assert watch.call_trigger("reset").success
    watch.client.spin(0.3)  # what was sent before it is no concern of the next test
    for kept in (watch.predicted, watch.residuals, watch.whole, watch.joints):
        kept.clear()
    return watch


def stated(time, q, qd=(), efforts=(), names=JOINTS):
    message = JointState(name=list(names), position=list(q), velocity=list(qd), effort=list(efforts))
    message.header.stamp = to_time(BEGINNING + round(time * 1e9))
    return message


def measured(motion=MOTION):
    return motion.efforts + NOISE * np.random.default_rng(0).normal(size=motion.efforts.shape)


def state_messages(efforts, motion=MOTION):
    return [(0, stated(*row)) for row in zip(motion.times, motion.q, motion.qd, efforts, strict=True)]


def payload_efforts(mass):
    model = panda_model()
    hand = model.getJointId("panda_joint7")
    model.inertias[hand] += pin.Inertia(mass, np.array([0.0, 0.0, 0.15]), np.zeros((3, 3)))
    data = model.createData()
    return np.array([pin.rnea(model, data, *row)
                     for row in zip(MOTION.q, MOTION.qd, MOTION.qdd, strict=True)])  # fmt: skip


def test_robot_equal_to_its_model_passes_with_efforts_of_pinocchio(fresh):
    fresh.tell(state_messages(measured()))
    fresh.wait_until(lambda: fresh.predicted and fresh.joints, "efforts and verdicts")
    # the last sample that is told is a period of the cut-off, 8 Hz, before the end
    last = BEGINNING + round((MOTION.times[-1] - 0.13) * 1e9)
    fresh.wait_until(
        lambda: to_nanoseconds(fresh.residuals[-1].header.stamp) > last, "the rest, when nothing more comes"
    )
    fresh.wait_until(lambda: {each[0] for each in fresh.joints.values()} == {STALE}, "that data are stale")
    assert set(fresh.joints) == set(JOINTS) and "is tolerated" in fresh.joints["panda_joint4"][1]
    assert "not judged: its effort of 0.0" in fresh.joints["panda_joint7"][1]  # the noise is as large as its effort
    numbers = np.round((np.array([to_nanoseconds(m.header.stamp) for m in fresh.predicted]) - BEGINNING) * 1e-9 * RATE)
    assert len(numbers) > 0.9 * len(MOTION.times) and list(fresh.predicted[0].name) == list(JOINTS)
    stamps = np.array([to_nanoseconds(message.header.stamp) for message in fresh.predicted])
    assert np.abs(stamps - BEGINNING - numbers * 1e9 / RATE).max() < 1000  # [ns]
    expected = MOTION.efforts[numbers.astype(int)]
    found = np.array([message.effort for message in fresh.predicted])
    # what the filter takes off motions of up to 0.5 Hz; more at the ends, where it sees one side only
    assert np.abs(found - expected)[100:-100].max() < 0.02 * np.abs(expected).max(axis=0).min()
    assert np.abs(found - expected).max() < 1.0
    residuals = np.array([message.effort for message in fresh.residuals])
    assert residuals.std(axis=0) == pytest.approx(np.full(7, NOISE * np.sqrt(8 / 100)), rel=0.4)
    assert any(level == OK for level, *_ in fresh.whole)
    report = fresh.call_trigger("report")
    assert (
        report.success and report.message.endswith("not judged: panda_joint7") and report.message.count("  passed") == 6
    )


def named(fresh):
    """The joints that are out of tolerance, as diagnostics of each say."""
    return {name for name, (_, _, values) in fresh.joints.items() if "since [s]" in values}


@pytest.mark.parametrize("fault", ["payload", "sign"])
def test_fault_is_reported_with_its_joint_and_time_within_seconds(fresh, fault):
    efforts, onset = measured(), 600
    if fault == "payload":
        efforts[onset:] += (payload_efforts(1.0) - MOTION.efforts)[onset:]
    else:
        efforts[onset:, 3] *= -1
    messages = state_messages(efforts)
    fresh.tell(messages[:onset])
    fresh.wait_until(lambda: fresh.joints, "verdicts")
    assert {level for level, *_ in fresh.joints.values()} == {OK}
    fresh.tell(messages[onset : onset + 900])  # 4.5 s
    # by Pinocchio, 1 kg takes 1.3 N m of joint 6, where 0.48 is tolerated, and 4.5 of joints 2 and 4, where 3.5 is
    wrong = {"sign": {"panda_joint4"}, "payload": {"panda_joint6"}}[fault]
    fresh.wait_until(lambda: wrong <= named(fresh), f"errors of {wrong}")
    assert named(fresh) <= wrong | ({"panda_joint2", "panda_joint4"} if fault == "payload" else set())
    assert fresh.whole[-1][0] == ERROR and all(name in fresh.whole[-1][1] for name in wrong)
    for name in wrong:
        assert float(fresh.joints[name][2]["since [s]"]) == pytest.approx(BEGINNING / 1e9 + onset / RATE, abs=1.1)
    report = fresh.call_trigger("report")
    assert not report.success and any(f"{name}: " in report.message for name in wrong)
    assert "FAILED" in report.message.splitlines()[-1]


def test_other_orders_and_topics_are_accepted_and_invalid_data_are_reported(fresh):
    """Joints 1 to 4 backwards and a finger on one topic, 5 to 7 on another, joint 7 without efforts; and nonsense."""
    rng, messages, efforts = np.random.default_rng(1), [], measured()
    arm, wrist = [3, 2, 1, 0], [4, 5]
    for number, (at, q, qd) in enumerate(zip(MOTION.times, MOTION.q, MOTION.qd, strict=True)):
        position = q[arm].copy()
        if number % 100 == 50:
            position[rng.integers(4)] = np.nan
        names = [*(JOINTS[k] for k in arm), "finger"]
        told = [*position, 0.02], [*qd[arm], 0.0], [*efforts[number, arm], 0.0]
        messages.append((0, stated(at, *told, names)))
        later = at + 0.001
        messages.append((1, stated(later, q[wrist], qd[wrist], efforts[number, wrist], [JOINTS[k] for k in wrist])))
        messages.append((1, stated(later, q[6:], qd[6:], names=JOINTS[6:])))
        if number in (400, 900):
            messages += [
                (0, stated(at, [0.0, 0.0], names=["panda_joint1", "panda_joint1"])),
                (0, stated(at, [0.0])),
                (0, JointState()),
            ]
    fresh.tell(messages)
    fresh.wait_until(lambda: fresh.joints and fresh.has_diagnostic("skipped"), "diagnostics")
    for text in ("panda_joint7: no effort was measured", "nan or infinite", "does not have: finger",
                 "named twice in one message", "a different number of values than names"):  # fmt: skip
        fresh.wait_until(lambda text=text: fresh.has_diagnostic(text), text)
    assert fresh.whole[-1][0] == WARN
    residuals = np.array([message.effort for message in fresh.residuals])
    assert len(residuals) > 1000 and np.isfinite(residuals).all(axis=0).tolist() == [True] * 6 + [False]
    assert np.isnan(residuals[:, 6]).all()
    report = fresh.call_trigger("report")
    assert not report.success and report.message.count("  passed") == 6 and "  FAILED" in report.message
    fresh.wait_until(lambda: fresh.has_diagnostic("no messages on panda_joint1"), "that nothing comes any more")


@pytest.mark.parametrize("kind", ["random", "pairs", "pieces"])
def test_uneven_stamps_are_compared_and_short_segments_are_counted(fresh, kind):
    """Also with few samples between two pauses: the node reports it and goes on without an internal error."""
    motion = panda_motion(times=uneven_times(kind, 14.0, RATE))
    fresh.tell(state_messages(measured(motion), motion))
    # random steps leave pieces of a second or so between pauses of 5.5 steps, of which the filter leaves half
    last = BEGINNING + round((8.0 if kind == "random" else motion.times[-1] - 1.0) * 1e9)
    fresh.wait_until(
        lambda: fresh.residuals and to_nanoseconds(fresh.residuals[-1].header.stamp) > last, "the last ones"
    )
    stamps = np.array([to_nanoseconds(message.header.stamp) for message in fresh.predicted])
    assert (np.diff(stamps) > 0).all()
    if kind == "pieces":
        fresh.wait_until(lambda: fresh.has_diagnostic("too short to be filtered"), "the note on short pieces")
    else:
        fresh.wait_until(
            lambda: fresh.has_diagnostic("less than a third of the usual step"), "the note on stamps that are too close"
        )
    assert not fresh.has_diagnostic("internal error") and "internal error" not in str(fresh.whole)
    report = fresh.call_trigger("report")
    assert report.success and report.message.count("  passed") == 6 and "panda_joint7  not judged" in report.message
    residuals = np.array([message.effort for message in fresh.residuals])
    assert len(residuals) > 400 and np.sqrt((residuals**2).mean(axis=0)).max() < 0.1


def test_invalid_parameters_are_refused_and_another_robot_restarts_the_check(watch, tmp_path):
    (tmp_path / "drives.yaml").write_text("format: 1\neffort_gains: {panda_joint9: 2}\n")
    for values, reason in (
        ({"drives": str(tmp_path / "drives.yaml")}, "did you mean"),
        ({"tolerances": "nowhere.yaml"}, "nowhere.yaml"),
        ({"cutoff": -1.0}, "0.1 or more"),
        ({"topics": ["others"]}, "is read at startup"),
    ):
        result = watch.client.set_parameters(watch.name, values)
        assert not result.successful and reason in result.reason
    assert watch.client.set_parameters(watch.name, {"base": "moving"}).successful
    watch.wait_until(
        lambda: watch.whole[-1][0] == WARN and watch.has_diagnostic("the base for"), "that odom is missing"
    )
    report = watch.call_trigger("report")
    assert not report.success and "nothing was compared yet" in report.message
    assert watch.client.set_parameters(watch.name, {"base": ""}).successful
    watch.wait_until(lambda: not watch.has_diagnostic("the base for"), "that it begins anew")


def test_flying_arm_is_checked_with_odom_and_a_missing_payload_is_detected(start_module_server, client):
    parameters = {"robot_file": "free_flying_arm", "gravity": list(flights.GRAVITY), "topics": ["joint_states"]}
    watch = Watch(start_module_server(parameters, executable="replay_check"), client, topics=("joint_states",))
    namespace = watch.name.rpartition("/")[0]
    watch.outs.append(client.node.create_publisher(Odometry, f"{namespace}/odom", DEEP))
    watch.wait_until(lambda: watch.outs[-1].get_subscription_count(), "odom is heard")
    told, names = [], Dynamics(load_robot("free_flying_arm"), compiled=False).joint_names
    for number, sample in enumerate(flights.flight(1, 6.0)):
        told.append((0, stated(sample.time, sample.q, sample.qd, sample.efforts, names)))
        if number % 4 == 0:
            odom = Odometry(header=told[-1][1].header, child_frame_id="base_body")
            turned = to_scipy_rotation(sample.pose[:3, :3]).as_quat()
            odom.pose.pose, odom.twist.twist = write_pose(sample.pose[:3, 3], turned), write_twist(sample.twist)
            told.append((1, odom))
    watch.tell(told)
    watch.wait_until(lambda: watch.joints, "verdicts")
    assert {level for level, *_ in watch.joints.values()} <= {OK, STALE}
    report = watch.call_trigger("report")
    assert report.success and report.message.count("  passed") == 6
    loaded = {"payload.link": "arm_tool0", "payload.mass": 5.0}
    assert client.set_parameters(watch.name, loaded).successful  # by the model, and not in truth
    watch.tell(told)
    watch.wait_until(lambda: named(watch), "joints out of tolerance")
