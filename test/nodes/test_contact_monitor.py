"""contact_monitor in a process of its own: motions, efforts and contacts are those of Pinocchio.

Efforts are exact, so that the external torques are known: Jᵀ f of a wrench f on the flange."""

import time
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from peers import flights
from peers.recorded import BEGINNING, JOINTS, loaded_panda, panda_model, panda_motion
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.model.placement import to_scipy_rotation
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.codecs.geometry import write_pose, write_twist
from robot_dynamics.nodes.diagnostics import ERROR, OK, STALE, WARN
from robot_dynamics.nodes.qos import LATCHED_QOS

from .controller_probe import DEEP, to_time

RATE = 200.0
MOTION = panda_motion(duration=2.0, rate=RATE)
FLANGE = "panda_link8"
WRENCH = np.array([4.0, -25.0, 12.0, 0.5, -1.0, 0.3])  # on the flange, in its axes [N, N m]
PUSH = slice(200, 320)  # samples with the wrench
BANDWIDTH = 50.0
BOUNDS = np.array([8.7, 8.7, 8.7, 8.7, 1.2, 1.2, 1.2])  # 10 % of the effort limits


def flange_torques(q):
    """Jᵀ f (7,) of the wrench at positions (7,)."""
    model = panda_model()
    data = model.createData()
    frame = model.getFrameId(FLANGE)
    return pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL).T @ WRENCH


def pushed_efforts():
    """Efforts (N, 7) of the motion while the wrench acts for some time."""
    efforts = MOTION.efforts.copy()
    for k in range(PUSH.start, PUSH.stop):
        efforts[k] -= flange_torques(MOTION.q[k])
    return efforts


def state_message(time, q, qd, efforts, names=JOINTS):
    message = JointState(name=list(names), position=list(q), velocity=list(qd), effort=list(efforts))
    message.header.stamp = to_time(BEGINNING + round(time * 1e9))
    return message


class Probe:
    """Publishes joint states and keeps the messages of a node. Times of states go on from call to call."""

    def __init__(self, name, client, inputs=((JointState, "joint_states"),)):
        self.name, self.client, self.time = name, client, 0.0
        self.torques, self.wrenches, self.base_wrenches, self.events, self.collisions, self.statuses = (
            [] for _ in range(6)
        )
        node, namespace = client.node, name.rpartition("/")[0]
        self.outs = [node.create_publisher(kind, f"{namespace}/{topic}", DEEP) for kind, topic in inputs]
        self._held = [
            node.create_subscription(kind, topic, take, qos)
            for kind, topic, take, qos in (
                (JointState, f"{name}/external_torque", self.torques.append, DEEP),
                (WrenchStamped, f"{name}/external_wrench", self.wrenches.append, DEEP),
                (WrenchStamped, f"{name}/external_base_wrench", self.base_wrenches.append, DEEP),
                (DiagnosticStatus, f"{name}/event", self.events.append, DEEP),
                (Bool, f"{name}/collision", self.collisions.append, DEEP),
                (DiagnosticArray, "/diagnostics", self._on_diagnostics, DEEP),
            )
        ]
        self.wait_until(lambda: all(out.get_subscription_count() for out in self.outs), "subscriptions")
        self.wait_until(lambda: self.statuses, "diagnostics")

    def _on_diagnostics(self, array):
        for status in array.status:
            if status.name == f"{self.name}: contacts":
                self.statuses.append((status.level, status.message, {v.key: v.value for v in status.values}))

    def wait_until(self, condition, description, patience=30.0):
        deadline = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < deadline, f"not within {patience} s: {description}; {self.statuses[-1:]}"
            self.client.spin(0.02)

    def wait_for_status(self, level, text):
        del self.statuses[:]
        self.wait_until(lambda: any(s[0] == level and text in s[1] for s in self.statuses), f"{text!r} of {level}")

    def publish(self, out, message):
        self.outs[out].publish(message)
        time.sleep(0.5 / RATE)

    def play(self, efforts, rows=slice(None), extra=lambda k: ()):
        """Publish states of the motion with efforts (N, 7), after those before; return the first time."""
        begin = self.time
        for k in range(*rows.indices(len(MOTION.times))):
            for out, message in extra(k):
                self.publish(out, message)
            self.publish(0, state_message(self.time, MOTION.q[k], MOTION.qd[k], efforts[k]))
            self.time += 1 / RATE
        return begin

    def torques_since(self, begin, count):
        """External torques (count, 7) of the samples from a time on; waits for them."""
        stamp = BEGINNING + round(begin * 1e9)

        def found():
            return [m for m in self.torques if to_nanoseconds(m.header.stamp) >= stamp]

        self.wait_until(lambda: len(found()) >= count, f"{count} external torques, not {len(found())}")
        return np.array([m.effort for m in found()])

    def late_collision(self):
        """What a subscriber receives that comes only now."""
        received = []
        late = self.client.node.create_subscription(Bool, f"{self.name}/collision", received.append, LATCHED_QOS)
        self.wait_until(lambda: received, "the latched collision")
        self.client.node.destroy_subscription(late)
        return received[-1].data

    def reset(self):
        response = self.client.call(Trigger, f"{self.name}/reset", Trigger.Request())
        assert response.success
        return response.message


@pytest.fixture(scope="module")
def module_probe(start_module_server, client):
    parameters = {"robot_file": "panda", "frame": FLANGE, "bandwidth": BANDWIDTH}
    return Probe(start_module_server(parameters, executable="contact_monitor"), client)


@pytest.fixture
def probe(module_probe):
    module_probe.reset()
    module_probe.time += 10.0
    module_probe.client.spin(0.2)
    for kept in (module_probe.torques, module_probe.wrenches, module_probe.events, module_probe.collisions):
        kept.clear()
    return module_probe


def test_a_push_shows_in_torques_wrench_collision_and_diagnostics(probe):
    assert probe.late_collision() is False
    begin = probe.play(pushed_efforts(), slice(0, PUSH.stop))
    torques = probe.torques_since(begin, PUSH.stop)
    assert len(torques) == PUSH.stop  # one for each state
    assert list(probe.torques[-1].name) == list(JOINTS)
    stamps = np.array([to_nanoseconds(m.header.stamp) for m in probe.torques])
    assert np.array_equal(stamps - BEGINNING, np.round((begin + MOTION.times[: PUSH.stop]) * 1e9))
    assert np.abs(torques[: PUSH.start]).max() < 0.02  # of the trapezoidal rule at 200 Hz
    expected = np.array([flange_torques(q) for q in MOTION.q[PUSH]])
    elapsed = (np.arange(len(expected)) + 0.5) / RATE  # the efforts change within one step
    response = expected * (1 - np.exp(-BANDWIDTH * elapsed))[:, None]
    assert np.abs(torques[PUSH] - response).max() < 0.05 * np.abs(expected).max()
    wrench = probe.wrenches[-1]
    assert wrench.header.frame_id == FLANGE and len(probe.wrenches) == PUSH.stop
    force, torque = wrench.wrench.force, wrench.wrench.torque
    found = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
    # the torques lag by 1 / BANDWIDTH, the Jacobian does not
    assert np.linalg.norm(found[:3] - WRENCH[:3]) < 0.05 * np.linalg.norm(WRENCH[:3])
    assert np.linalg.norm(found[3:] - WRENCH[3:]) < 0.3
    probe.wait_until(lambda: probe.events, "the event")
    event = probe.events[-1]
    values = {pair.key: pair.value for pair in event.values}
    first = np.argmax((np.abs(response) > BOUNDS).any(axis=1))
    assert event.level == ERROR and event.hardware_id == "panda" and "collision at" in event.message
    seconds = begin + MOTION.times[PUSH.start + first] + BEGINNING * 1e-9
    assert float(values["stamp [s]"]) == pytest.approx(seconds, abs=1.5 / RATE)
    assert [message.data for message in probe.collisions] == [True] and probe.late_collision() is True
    probe.wait_for_status(ERROR, "collision at")
    probe.play(pushed_efforts(), slice(PUSH.stop, None))
    probe.wait_until(lambda: len(probe.collisions) == 2, "the end of the collision")
    assert probe.collisions[-1].data is False and probe.events[-1].level == OK
    assert "condition of the wrench" in probe.statuses[-1][2]


def test_reset_ends_a_collision_and_restarts_the_observer(probe):
    begin = probe.play(pushed_efforts(), slice(0, PUSH.stop))
    probe.torques_since(begin, PUSH.stop)
    assert probe.late_collision() is True
    assert probe.reset() == "the collision was reset"
    assert probe.late_collision() is False
    probe.wait_until(lambda: probe.events[-1].message == "the collision was reset", "the event")
    begin = probe.play(MOTION.efforts, slice(0, 3))
    assert np.array_equal(probe.torques_since(begin, 3)[0], np.zeros(7))
    assert probe.reset() == "there was no collision"


BAD = {
    "nan": (lambda m: m.position.__setitem__(2, np.nan), "position of 'panda_joint3' is nan"),
    "infinite effort": (lambda m: m.effort.__setitem__(0, np.inf), "effort of 'panda_joint1' is inf"),
    "missing joint": (
        lambda m: [values.pop() for values in (m.name, m.position, m.velocity, m.effort)],
        "joint_states has no 'panda_joint7'",
    ),
    "no velocities": (lambda m: setattr(m, "velocity", []), "joint_states has 0 velocities for 7 names"),
    "no efforts": (lambda m: setattr(m, "effort", []), "0 efforts for 7 names: publish efforts, or set effort_topic"),
    "few positions": (lambda m: setattr(m, "position", [0.0] * 3), "joint_states has 3 positions for 7 names"),
    "repeated name": (lambda m: m.name.__setitem__(1, "panda_joint1"), "names 'panda_joint1' more than once"),
    "time": (lambda m: setattr(m.header, "stamp", to_time(BEGINNING - 10**9)), "stamps went back by"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_messages_restart_the_observer_with_a_reason_and_it_goes_on(probe, kind):
    spoil, reason = BAD[kind]
    begin = probe.play(MOTION.efforts, slice(0, 20))
    probe.torques_since(begin, 20)
    message = state_message(probe.time, MOTION.q[20], MOTION.qd[20], MOTION.efforts[20])
    spoil(message)
    probe.publish(0, message)
    restarts = [s[2].get("last restart", "") for s in probe.statuses]
    probe.wait_until(
        lambda: any(reason in f"{s[2].get('last restart', '')}{s[2]['last refusal']}" for s in probe.statuses),
        f"{reason!r} in the diagnostics, not only {restarts[-1:]}",
    )
    probe.torques.clear()
    probe.time += 1 / RATE
    begin = probe.play(MOTION.efforts, slice(20, 40))
    assert np.abs(probe.torques_since(begin, 20)).max() < 0.02
    assert probe.late_collision() is False


def test_messages_of_another_robot_are_ignored(probe):
    """The robot rests meanwhile."""
    holding = pin.rnea(panda_model(), panda_model().createData(), MOTION.q[0], np.zeros(7), np.zeros(7))

    def rests():
        probe.publish(0, state_message(probe.time, [0.0], [0.0], [0.0], ["gripper"]))
        probe.publish(0, state_message(probe.time, MOTION.q[0], np.zeros(7), holding))
        probe.time += 1 / RATE
        return any(level == OK and "no collision" in text for level, text, _ in probe.statuses)

    del probe.statuses[:]
    probe.wait_until(rests, "a status without complaints")
    assert np.abs([message.effort for message in probe.torques]).max() < 1e-6


def test_payload_changes_while_the_robot_is_observed(probe):
    model = loaded_panda(3.0, (0, 0, 0.107))
    data = model.createData()
    rows = zip(MOTION.q, MOTION.qd, MOTION.qdd, strict=True)
    loaded = np.array([pin.rnea(model, data, *row) for row in rows])
    begin = probe.play(loaded, slice(0, 100))
    assert np.abs(probe.torques_since(begin, 100)[-1]).max() > 5.0
    payload = {"payload.link": FLANGE, "payload.mass": 3.0}
    assert probe.client.set_parameters(probe.name, payload).successful
    begin = probe.play(loaded, slice(100, 200))
    assert np.abs(probe.torques_since(begin, 100)).max() < 0.05
    assert probe.client.set_parameters(probe.name, {"payload.link": "", "payload.mass": 0.0}).successful


def test_parameters_are_refused_with_reasons(probe, tmp_path):
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("format: 1\nbandwidth: 20\njoints: {elbow: {moving: 1}}\n")
    right = tmp_path / "right.yaml"
    right.write_text("format: 1\nbandwidth: 20\njoints: {panda_joint1: {moving: 1}}\n")
    for changes, reason in [
        ({"frame": "hand"}, "unknown"),
        ({"frame": "panda_link0"}, "fixed to the base"),
        ({"wrench": "moment"}, "unknown value 'moment'"),
        ({"bandwidth": -1.0}, "parameter bandwidth is -1"),
        ({"thresholds": str(wrong)}, "unknown joint 'elbow'"),
        ({"thresholds": str(right)}, "thresholds hold for 20"),
        ({"thresholds": str(tmp_path / "absent.yaml")}, "absent.yaml"),
        ({"effort_topic": "effort"}, "is read at startup"),
    ]:
        result = probe.client.set_parameters(probe.name, changes)
        assert not result.successful and reason in result.reason, (changes, result.reason)
    begin = probe.play(MOTION.efforts, slice(0, 5))
    probe.torques_since(begin, 5)
    changes = {"thresholds": str(right), "bandwidth": 0.0}
    for name, value in changes.items():  # first the bandwidth would be refused
        probe.client.set_parameters(probe.name, {"bandwidth": 20.0})
        assert probe.client.set_parameters(probe.name, {name: value}).successful
    assert probe.client.set_parameters(probe.name, {"thresholds": ""}).successful
    assert probe.client.set_parameters(probe.name, {"bandwidth": BANDWIDTH}).successful


def test_silence_is_reported_as_stale(probe):
    begin = probe.play(MOTION.efforts, slice(0, 5))
    probe.torques_since(begin, 5)
    probe.wait_for_status(STALE, "no messages on")


def test_efforts_of_a_controller_topic(start_server, client):
    name = start_server(
        {"robot_file": "panda", "effort_topic": "commanded", "bandwidth": BANDWIDTH}, executable="contact_monitor"
    )
    probe = Probe(name, client, ((JointState, "joint_states"), (JointState, "commanded")))
    probe.publish(0, state_message(0.0, MOTION.q[0], MOTION.qd[0], []))
    probe.wait_until(lambda: any("no efforts on" in s[1] for s in probe.statuses), "that efforts are missing")
    probe.time = 1.0
    begin = probe.play(
        np.zeros((len(MOTION.q), 0)),
        slice(0, 100),
        lambda k: [(1, state_message(probe.time, [], [], MOTION.efforts[k]))],
    )
    assert np.abs(probe.torques_since(begin, 100)[50:]).max() < 0.2


def test_moving_base_has_the_wrench_that_carries_it(start_server, client):
    """The thrust of a flight acts on the base, and no external torque on the joints."""
    name = start_server({"robot_file": "free_flying_arm", "gravity": list(flights.GRAVITY), "bandwidth": 20.0},
                        executable="contact_monitor")  # fmt: skip
    probe = Probe(name, client, ((JointState, "joint_states"), (Odometry, "odom")))
    samples = list(flights.flight(3, 2.0))
    robot = load_robot("free_flying_arm")
    names = Dynamics(robot, compiled=False).joint_names
    for sample in samples:
        odometry = Odometry(child_frame_id="base_body")
        turned = to_scipy_rotation(sample.pose[:3, :3]).as_quat()
        odometry.pose.pose, odometry.twist.twist = write_pose(sample.pose[:3, 3], turned), write_twist(sample.twist)
        odometry.header.stamp = to_time(BEGINNING + round(sample.time * 1e9))
        probe.publish(1, odometry)
        probe.publish(0, state_message(sample.time, sample.q, sample.qd, sample.efforts, names))
    probe.wait_until(lambda: len(probe.base_wrenches) >= 0.9 * len(samples), "wrenches on the base")
    mass = sum(link.inertia.mass for link in robot.links)
    lift = np.array([m.wrench.force.z for m in probe.base_wrenches])
    assert lift[len(lift) // 2 :].mean() == pytest.approx(9.81 * mass, rel=0.2)
    assert np.abs([m.effort for m in probe.torques][len(lift) // 2 :]).max() < 1.0
    assert probe.base_wrenches[-1].header.frame_id == "base_body"
    steps = [to_nanoseconds(b.header.stamp) - to_nanoseconds(a.header.stamp) for a, b in pairwise(probe.base_wrenches)]
    assert np.median(steps) == pytest.approx(1e9 / flights.RATE, rel=1e-6)


def test_description_without_masses_is_not_observed(start_server, client):
    urdf = """<robot name="bare"><link name="base"/><link name="arm"/><joint name="turn" type="continuous">
    <parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint></robot>"""
    name = start_server({"robot_description": urdf}, executable="contact_monitor")
    probe = Probe(name, client)
    probe.wait_for_status(ERROR, "nothing is observed")
    assert "no masses" in probe.statuses[-1][1]
    response = client.call(Trigger, f"{name}/reset", Trigger.Request())
    assert not response.success and "no masses" in response.message
    assert WARN not in [s[0] for s in probe.statuses]
