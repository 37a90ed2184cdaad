"""The action ~/follow_joint_trajectory: succeeded, aborted, preempted, cancelled, rejected, and clients that die."""

import ctypes
import hashlib
import importlib.util
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from lifecycle_msgs.msg import Transition
from nodes.built_interfaces import build_interfaces, import_variables
from nodes.controller_probe import PANDA, ControllerProbe, Q, trajectory_message
from nodes.goal_client import ABORTED, CANCELED, SUCCEEDED, GoalClient
from nodes.test_security import allowed, opened
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from robot_dynamics.nodes.processes import running_node

SOURCE = Path(__file__).resolve().parent.parent / "interfaces" / "control_msgs"
QUIET = {"robot_file": "panda", "deadline": 1.0, "state_timeout": 0.3}  # a busy machine is no fault here
TARGET = Q + 0.1


@pytest.fixture(scope="module")
def control_msgs(request):
    """FollowJointTrajectory and JointTolerance: as installed, or of interfaces that are compiled once."""
    with pytest.MonkeyPatch.context() as patch:
        if importlib.util.find_spec("control_msgs") is None:
            digest = hashlib.sha256(f"{sys.prefix} {sys.version}".encode())
            for path in sorted(SOURCE.rglob("*.*")):
                digest.update(path.read_bytes())
            folder = Path(request.config.cache.mkdir("control_msgs")) / digest.hexdigest()[:12]
            complete = folder / "complete"
            if not complete.exists():
                build_interfaces(SOURCE, folder / "build", folder / "prefix")
                complete.touch()
            for name, value in import_variables(folder / "prefix").items():
                patch.setenv(name, value)
            for library in sorted((folder / "prefix" / "lib").glob("*.so")):  # this process has read its variables
                ctypes.CDLL(str(library))
            patch.syspath_prepend(os.environ["PYTHONPATH"].split(os.pathsep)[0])
        from control_msgs.action import FollowJointTrajectory
        from control_msgs.msg import JointTolerance

        yield FollowJointTrajectory, JointTolerance


@pytest.fixture
def start(control_msgs, start_server, client):
    """A function that starts a node, and returns its probe and a client of its action."""
    running = []

    def start_node(parameters=None, steady=True):
        target = start_server({**QUIET, **(parameters or {})}, executable="computed_torque")
        probe = ControllerProbe(target, client)
        goals = GoalClient(probe, control_msgs[0])
        running.append(probe)
        if steady:
            probe.stream_until_steady()
        return probe, goals

    yield start_node
    for each in running:
        each.close()


def motion(seconds=0.4, goal=TARGET, begin=Q):
    rest = np.zeros((2, 7))
    return trajectory_message(PANDA, [0.0, seconds], [begin, goal], rest, rest)


def tolerances(control_msgs, **values):
    return [control_msgs[1](name=name, **values) for name in PANDA]


def seconds(value):
    return Duration(sec=int(value), nanosec=round(value % 1 * 1e9))


def wait_for_result(probe, goal, q=Q):
    probe.stream_until(lambda: goal.is_done, "result", q=q)


def reference(probe):
    """Positions of the last reference; None where there is none."""
    positions = probe.states[-1].points[0].positions
    return np.array(positions) if len(positions) else None


def test_goal_succeeds_when_the_robot_is_there_at_rest(start):
    probe, goals = start({f"constraints.{name}.goal": 0.02 for name in PANDA})
    goal = goals.start(motion(), Q)
    began = time.time()
    while time.time() < began + 0.7:  # the end is over, the robot is not there
        probe.stream(0.02)
    assert not goal.is_done
    probe.stream_until(lambda: len(goal.feedback) > 5, "feedback")
    probe.stream(0.1, q=TARGET, qd=np.full(7, 0.05))
    assert not goal.is_done, "the robot is there, but moves"
    wait_for_result(probe, goal, TARGET)
    assert (goal.status, goal.result.error_code, goal.result.error_string) == (
        SUCCEEDED,
        0,
        "Goal successfully reached!",
    )
    first = goal.feedback[0]
    assert list(first.joint_names) == PANDA
    np.testing.assert_allclose(first.actual.positions, Q, atol=1e-12)
    np.testing.assert_allclose(np.subtract(first.desired.positions, first.actual.positions), first.error.positions)
    elapsed = first.desired.time_from_start.nanosec * 1e-9
    s = elapsed / 0.4
    np.testing.assert_allclose(first.desired.positions, Q + 0.1 * (10 * s**3 - 15 * s**4 + 6 * s**5), atol=1e-6)
    stamps = [message.header.stamp.sec + message.header.stamp.nanosec * 1e-9 for message in goal.feedback]
    assert np.median(np.diff(stamps)) == pytest.approx(0.05, abs=0.02)  # action_monitor_rate


def test_robot_beside_its_path_aborts_the_goal_and_is_held_where_it_is(start, control_msgs):
    probe, goals = start()
    goal = goals.start(motion(2.0, Q + 0.3), Q, path_tolerance=tolerances(control_msgs, position=0.05))
    wait_for_result(probe, goal)
    assert (goal.status, goal.result.error_code) == (ABORTED, -4)
    assert goal.result.error_string.startswith(
        "Aborted due to path tolerance violation: position of panda_joint1 is 0.05"
    )
    probe.stream_until(lambda: np.allclose(reference(probe), Q, atol=1e-9), "the present position as reference")


def test_robot_that_does_not_arrive_in_time_aborts_the_goal(start, control_msgs):
    probe, goals = start({"constraints.goal_time": 0.3})
    tolerance = tolerances(control_msgs, position=0.02)
    goal = goals.start(motion(), Q, goal_tolerance=tolerance)
    wait_for_result(probe, goal)
    assert (goal.status, goal.result.error_code) == (ABORTED, -5)
    assert goal.result.error_string.startswith("Aborted due to goal_time_tolerance exceeding by 0.3")
    began = time.time()
    goal = goals.start(motion(), Q, goal_tolerance=tolerance, goal_time_tolerance=seconds(0.8))
    wait_for_result(probe, goal)
    assert (goal.status, goal.result.error_code) == (ABORTED, -5)
    assert time.time() - began > 1.1


def test_next_goal_or_reference_preempts_a_goal(start):
    probe, goals = start()
    first = goals.start(motion(5.0), Q)
    second = goals.start(motion(5.0, Q - 0.1), Q)
    wait_for_result(probe, first)
    assert (first.status, first.result.error_code) == (ABORTED, -1)
    assert first.result.error_string.startswith("Current goal preempted by")
    assert not second.is_done
    probe.reference.publish(motion(0.2))
    wait_for_result(probe, second)
    assert (second.status, second.result.error_code) == (ABORTED, -1)
    probe.stream_until(lambda: np.allclose(reference(probe), TARGET), "the reference of the topic")
    third = goals.start(motion(5.0), Q)
    probe.reference_point.publish(trajectory_message(PANDA, [0.0], [Q]))
    wait_for_result(probe, third)
    assert (third.status, third.result.error_code) == (ABORTED, -1)


def test_cancelled_goal_stops_the_robot_without_a_jump(start):
    probe, goals = start({"ramp_time": 0.1})
    goal = goals.start(motion(2.0, Q + 0.5), Q)
    probe.stream(0.8)
    cancelled = goal.accepted.result().cancel_goal_async()
    wait_for_result(probe, goal)
    assert len(cancelled.result().goals_canceling) == 1
    assert (goal.status, goal.result.error_code) == (CANCELED, 0)
    probe.stream(0.3)
    stopped = reference(probe)
    assert np.all((stopped > Q + 0.02) & (stopped < Q + 0.45))
    probe.stream(0.2)
    np.testing.assert_array_equal(reference(probe), stopped)
    positions = [state.points[0].positions[0] for state in probe.states if len(state.points[0].positions)]
    assert np.abs(np.diff(positions)).max() < 0.04  # at most 0.47 rad/s, at 50 messages a second


def test_goals_that_cannot_be_followed_are_rejected(start, control_msgs):
    probe, goals = start()
    wrong = trajectory_message([*PANDA[:6], "elbow"], [0.0, 1.0], [Q, Q])
    moving = trajectory_message(PANDA, [0.0, 1.0], [Q, Q], np.ones((2, 7)))
    for message, fields in (
        (wrong, {}),
        (trajectory_message(PANDA[:6], [0.0, 1.0], [Q[:6]] * 2), {}),
        (trajectory_message(PANDA, [], []), {}),
        (trajectory_message(PANDA, [1.0, 0.5], [Q, Q]), {}),
        (trajectory_message(PANDA, [0.0, 1.0], [Q, np.full(7, np.nan)]), {}),
        (moving, {}),
        (trajectory_message(PANDA, [0.0, 1.0], [Q, Q], start=10**9), {}),
        (motion(), {"path_tolerance": [control_msgs[1](name="elbow", position=0.1)]}),
        (motion(), {"goal_tolerance": [control_msgs[1](name=PANDA[0], position=-0.5)]}),
    ):
        sent = goals.send(message, **fields)
        probe.stream_until(lambda sent=sent: sent.is_answered, "answer")
        assert not sent.accepted.result().accepted
    assert probe.set_parameters(mode="gravity_compensation")
    sent = goals.send(motion())
    probe.stream_until(lambda: sent.is_answered, "answer")
    assert not sent.accepted.result().accepted


def test_goal_ends_with_the_states_and_with_the_activity_of_the_node(start):
    probe, goals = start()
    goal = goals.start(motion(5.0), Q)
    probe.wait_until(lambda: goal.is_done, "result without states")
    assert (goal.status, goal.result.error_code) == (ABORTED, -1)
    assert "no joint_states for more than 300 ms" in goal.result.error_string
    goal = goals.start(motion(5.0), Q)
    assert probe.change_state(Transition.TRANSITION_DEACTIVATE)
    probe.wait_until(lambda: goal.is_done, "result of a node that is not active")
    assert (goal.status, goal.result.error_code) == (ABORTED, -1)
    assert goal.result.error_string == "Current goal cancelled during deactivate transition."
    sent = goals.send(motion())
    probe.stream_until(lambda: sent.is_answered, "answer")
    assert not sent.accepted.result().accepted
    assert probe.change_state(Transition.TRANSITION_ACTIVATE)
    probe.stream_until_steady()
    goal = goals.start(motion(0.1, Q), Q)
    wait_for_result(probe, goal)
    assert goal.status == SUCCEEDED


def test_other_description_ends_a_goal_and_holds_the_robot_but_another_payload_does_not(control_msgs, start, client):
    probe, goals = start({"robot_file": "", "autostart": True}, steady=False)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    namespace = probe.target.rpartition("/")[0]
    description = probe.node.create_publisher(String, f"{namespace}/robot_description", latched)
    text = (Path(__file__).parents[2] / "config" / "robots" / "panda.urdf").read_text()
    description.publish(String(data=text))
    probe.stream_until_steady()
    goal = goals.start(motion(5.0, Q + 0.3), Q)
    assert probe.set_parameters(**{"payload.link": "panda_link7", "payload.mass": 0.5})
    probe.stream(0.3)
    assert not goal.is_done
    description.publish(String(data=text.replace("</robot>", "  <!-- calibrated --></robot>")))
    wait_for_result(probe, goal)
    assert (goal.status, goal.result.error_code) == (ABORTED, -1)
    assert goal.result.error_string == "the robot description changed"
    probe.stream(0.3)
    held = reference(probe)
    probe.stream(0.3)
    np.testing.assert_array_equal(reference(probe), held)


def test_simulated_robot_reaches_its_goal_within_narrow_tolerances(control_msgs, start_server, client):
    namespace = f"/simulated_{os.getpid()}"
    simulator = {"robot_file": "panda", "wait_for_commands": "each"}
    simulator.update({"initial.joints": PANDA, "initial.positions": Q.tolist()})
    clock = {"/clock": f"{namespace}/clock"}
    efforts = {"~/effort": "computed_torque/effort", **clock}
    control = {**QUIET, "use_sim_time": True, "kp": [400.0], "kd": [40.0], "state_timeout": 1.0, "ramp_time": 0.01}
    with (
        running_node("mobile_base_simulator", simulator, namespace, remappings=efforts),
        running_node("computed_torque", control, namespace, remappings=clock),
    ):
        probe = ControllerProbe(f"{namespace}/computed_torque", client, states="unused")
        goals = GoalClient(probe, control_msgs[0])
        probe.wait_until(lambda: len(probe.commands) > 20, "efforts")
        narrow = tolerances(control_msgs, position=2e-3)
        message = trajectory_message(PANDA, [1.0], [Q + 0.3], np.zeros((1, 7)), np.zeros((1, 7)))
        sent = goals.send(message, path_tolerance=narrow, goal_tolerance=narrow)
        probe.wait_until(lambda: sent.is_answered, "answer")
        sent.result_future = sent.accepted.result().get_result_async()
        probe.wait_until(lambda: sent.is_done, "result", patience=60.0)
        probe.close()
    assert (sent.status, sent.result.error_string) == (SUCCEEDED, "Goal successfully reached!")
    np.testing.assert_allclose(sent.feedback[-1].actual.positions, Q + 0.3, atol=5e-3)


def test_controller_state_has_the_numbers_of_the_state(start):
    from control_msgs.msg import JointTrajectoryControllerState

    probe, goals = start()
    seen = []
    probe.node.create_subscription(JointTrajectoryControllerState, f"{probe.target}/controller_state", seen.append, 10)
    goal = goals.start(motion(0.1), TARGET)
    wait_for_result(probe, goal, TARGET)
    probe.stream_until(
        lambda: seen and len(seen[-1].reference.positions) and np.allclose(seen[-1].reference.positions, TARGET),
        "~/controller_state",
    )
    last = seen[-1]
    assert list(last.joint_names) == PANDA and last.speed_scaling_factor == 1.0
    np.testing.assert_allclose(np.subtract(last.reference.positions, last.feedback.positions), last.error.positions)
    np.testing.assert_allclose(last.output.effort, probe.commands[-1][1], atol=0.5)


def test_policy_allows_what_the_action_opens(control_msgs, client, tmp_path):
    names = opened("computed_torque", {"robot_file": "panda", "use_sim_time": True}, client, tmp_path / "log")
    assert names == allowed("computed_torque")


DYING_CLIENT = """
import os, sys, rclpy
from rclpy.action import ActionClient
from control_msgs.action import FollowJointTrajectory
from nodes.controller_probe import PANDA, Q, trajectory_message
rclpy.init()
node = rclpy.create_node("dying")
client = ActionClient(node, FollowJointTrajectory, sys.argv[1] + "/follow_joint_trajectory")
assert client.wait_for_server(20.0)
goal = FollowJointTrajectory.Goal(trajectory=trajectory_message(PANDA, [0.0, 1.0], [Q, Q + 0.1]))
sent = client.send_goal_async(goal)
rclpy.spin_until_future_complete(node, sent)
sent.result().get_result_async()
os._exit(0)
"""


def test_client_that_dies_leaves_the_goal_to_its_end(start):
    probe, goals = start()
    folder = str(Path(__file__).resolve().parent.parent)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([folder, os.environ["PYTHONPATH"]])}
    with subprocess.Popen([sys.executable, "-c", DYING_CLIENT, probe.target], env=environment) as dying:
        probe.stream_until(lambda: dying.poll() is not None, "the end of the client", patience=30.0)
    assert dying.returncode == 0
    probe.stream_until(lambda: reference(probe) is not None and np.allclose(reference(probe), TARGET), "the end")
    goal = goals.start(motion(0.1), TARGET)
    wait_for_result(probe, goal, TARGET)
    assert goal.status == SUCCEEDED
