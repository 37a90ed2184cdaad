"""computed_torque in a process of its own: efforts by name and in order, references, parameters, its life cycle."""

import time

import numpy as np
import pytest
from lifecycle_msgs.msg import Transition
from nav_msgs.msg import Odometry
from nodes.controller_probe import PANDA, ControllerProbe, Q, trajectory_message
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from scipy.spatial.transform import Rotation

from robot_dynamics import Base, Dynamics, Inertia, load_robot
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.codecs.geometry import write_twist
from robot_dynamics.nodes.computed_torque.node import ComputedTorque
from robot_dynamics.nodes.diagnostics import ERROR
from robot_dynamics.nodes.processes import running_node

LIBRARY = Dynamics(load_robot("panda"), compiled=False)
LIMITS = np.array([87.0] * 4 + [12.0] * 3)
QUIET = {"robot_file": "panda", "deadline": 1.0, "state_timeout": 0.2}  # a busy machine is no fault here


@pytest.fixture
def start_controller(start_server, client):
    controller = []

    def start(parameters=None, namespace=None):
        target = start_server({**QUIET, **(parameters or {})}, namespace, executable="computed_torque")
        controller.append(ControllerProbe(target, client))
        return controller[-1]

    yield start
    for probe in controller:
        probe.close()


def last(start_controller):
    return start_controller.commands[-1][1]


def test_efforts_hold_the_robot_in_joint_order_and_by_name(start_controller):
    order = [6, 0, 3, 1, 2, 5, 4]
    controller = start_controller({"mode": "gravity_compensation", "joints": [PANDA[k] for k in order]})
    controller.stream_until_steady(q=Q[::-1], names=PANDA[::-1])
    expected = LIBRARY.gravity(Q)
    np.testing.assert_allclose(last(controller), expected[order], atol=1e-9)
    assert list(controller.efforts[-1].name) == [PANDA[k] for k in order]
    np.testing.assert_allclose(controller.efforts[-1].effort, expected[order], atol=1e-9)
    assert {to_nanoseconds(effort.header.stamp) for effort in controller.efforts[-10:]} < set(
        controller.state_stamps
    )  # of the states that they belong to
    # names that change, and joints of other robots beside
    other_pose = Q + 0.1
    is_at_other_pose = lambda: np.abs(last(controller) - LIBRARY.gravity(other_pose)[order]).max() < 1e-9  # noqa: E731
    controller.stream_until(
        is_at_other_pose, "efforts of the other pose", q=[9.0, *other_pose], names=["other_joint", *PANDA]
    )
    # velocities are not required to hold a robot
    controller.stream_until(
        lambda: np.abs(last(controller) - expected[order]).max() < 1e-9, "without velocities", qd=[]
    )
    controller.stream_until(lambda: controller.states, "~/state")
    assert (
        list(controller.states[-1].joint_names) == [PANDA[k] for k in order] and len(controller.states[-1].points) == 4
    )


def test_trajectory_is_followed_by_its_time_stamps_and_held_at_its_end(start_controller):
    controller = start_controller({"kp": [100.0], "kd": [20.0]})
    controller.stream_until_steady()
    goal, order = Q + 0.2, [3, 1, 2, 0, 6, 5, 4]
    rest = np.zeros((2, 7))
    sent = trajectory_message([PANDA[k] for k in order], [0.0, 1.0], [Q[order], goal[order]], rest, rest)
    controller.reference.publish(sent)
    began = time.time()
    controller.stream_until(lambda: time.time() > began + 1.5, "the end")
    # the robot stands still, so that the efforts follow from the reference alone
    reached = LIBRARY.inverse(Q, np.zeros(7), 100 * (goal - Q))
    np.testing.assert_allclose(last(controller), np.clip(reached, -LIMITS, LIMITS), atol=1e-9)
    wanted, feedback, error, output = controller.states[-1].points
    np.testing.assert_allclose(wanted.positions, goal, atol=1e-12)
    np.testing.assert_allclose(feedback.positions, Q, atol=1e-12)
    np.testing.assert_allclose(error.positions, goal - Q, atol=1e-12)
    assert len(output.effort) == 7
    for state in controller.states:
        if len(state.points[0].positions):
            at = state.header.stamp.sec + state.header.stamp.nanosec * 1e-9 - began
            s = np.clip(at, 0, 1)
            expected = Q + (goal - Q) * (10 * s**3 - 15 * s**4 + 6 * s**5)
            # by some ms: a message is in transit, and the state is older than its message
            assert np.abs(np.array(state.points[0].positions) - expected).max() < 0.2 * 1.9 * 0.1


def test_single_points_are_followed_while_they_come(start_controller):
    controller = start_controller({"reference_timeout": 0.3, "without_reference": "gravity", "mode": "feedforward"})
    controller.stream_until_steady()
    is_held, a = last(controller), np.linspace(-1, 1, 7)
    point = trajectory_message(PANDA, [0.0], [Q], [np.zeros(7)], [a])
    wanted = LIBRARY.inverse(Q, np.zeros(7), a)
    seen = []

    def followed():
        controller.reference_point.publish(point)
        seen.append(np.abs(last(controller) - wanted).max())
        return min(seen) < 0.6  # the point goes on with its acceleration until the next one

    controller.stream_until(followed, "efforts of the point")
    controller.stream_until(
        lambda: controller.has_diagnostic("no point of the stream for more than 300 ms"), "the loss"
    )
    controller.stream_until(lambda: np.abs(last(controller) - is_held).max() < 1e-9, "gravity")


def test_invalid_references_are_refused_with_a_reason(start_controller):
    controller = start_controller()
    controller.stream_until_steady()
    two, rest = [0.0, 1.0], np.zeros((2, 7))
    with_effort = trajectory_message(PANDA, two, [Q, Q])
    with_effort.points[1].effort = [1.0] * 7
    uneven = trajectory_message(PANDA, two, [Q, Q], rest)
    uneven.points[1].velocities = [0.0] * 6
    for message, expected_text in (
        (trajectory_message(PANDA[:6], two, [Q[:6]] * 2), "joints missing: 'panda_joint7'"),
        (trajectory_message([*PANDA[:6], "panda_joint8"], two, [Q, Q]), "unknown joint 'panda_joint8'"),
        (trajectory_message(PANDA, [1.0, 0.5], [Q, Q]), "points[1].time_from_start is not after"),
        (trajectory_message(PANDA, two, [Q, np.full(7, np.nan)]), "points[1].positions is not finite"),
        (trajectory_message(PANDA, two, [Q, Q], rest + 1), "points[1].velocities[0] is 1: a trajectory ends"),
        (trajectory_message(PANDA, two, [Q, Q], start=10**9), "the trajectory ended"),
        (with_effort, "points[1].effort has values"),
        (uneven, "points[1].velocities has 6 values: 7 are needed"),
        (trajectory_message(PANDA, two, [Q, [*Q[:3], 0.2, *Q[4:]]]), "points[1].positions has 0.2 for 'panda_joint4'"),
    ):
        controller.reference.publish(message)
        controller.stream_until(
            lambda expected_text=expected_text: controller.has_diagnostic(f"reference refused: {expected_text}"),
            expected_text,
        )
    controller.reference_point.publish(trajectory_message(PANDA, two, [Q, Q]))
    controller.stream_until(lambda: controller.has_diagnostic("reference_point refused: 2 points came"), "two points")
    np.testing.assert_allclose(last(controller), LIBRARY.gravity(Q), atol=1e-9)


def test_modes_gains_limits_and_payload_change_at_run_time(start_controller):
    controller = start_controller({"kp": 50, "kd": [10.0] * 7})
    controller.stream_until_steady()
    goal = Q + 0.05
    controller.reference.publish(trajectory_message(PANDA, [0.0, 0.1], [Q, goal]))
    e = goal - Q

    def comes_to(expected, description):
        controller.stream_until(
            lambda: np.abs(last(controller) - np.clip(expected, -LIMITS, LIMITS)).max() < 1e-9, description
        )

    comes_to(LIBRARY.inverse(Q, np.zeros(7), 50 * e), "computed torque")
    for changes, expected in (
        ({"mode": "feedforward"}, LIBRARY.gravity(goal)),
        ({"mode": "pd_gravity", "kp": [80.0]}, LIBRARY.inverse(Q, np.zeros(7), 80 * e)),
        ({"mode": "gravity_compensation"}, LIBRARY.gravity(Q)),
        ({"effort_limits": [9.0] * 7}, np.clip(LIBRARY.gravity(Q), -9, 9)),
    ):
        count = len(controller.commands)
        assert controller.set_parameters(**changes).successful
        comes_to(expected, str(changes))
        steps = np.abs(np.diff([efforts for _, efforts in controller.commands[count:]], axis=0)).max()
        assert "effort_limits" in changes or steps < 20, "a jump"
    controller.stream_until(lambda: controller.has_diagnostic("at its limit: panda_joint2"), "saturation")
    assert "nothing but zeros" in controller.set_parameters(effort_limits=[0.0] * 7).reason
    assert controller.set_parameters(effort_limits=[80.0] * 7).successful
    excess = "effort_limits exceed those of the description: panda_joint5 80 (12)"
    controller.stream_until(lambda: controller.has_diagnostic(excess), "limits")
    payload = {"payload.link": "panda_link8", "payload.mass": 2.0, "payload.first_moments": [0.0, 0.0, 0.2]}
    loaded = LIBRARY.robot.with_payload("panda_link8", Inertia(2.0, [0, 0, 0.2], np.diag([0.02, 0.02, 0.0])))
    assert controller.client.set_parameters(controller.target, payload).successful
    comes_to(Dynamics(loaded, compiled=False).gravity(Q), "payload")
    controller.stream_until(lambda: controller.has_diagnostic("0.02, 0.0, 0.0] kg m², which are used"), "a point mass")
    assert controller.client.set_parameters(controller.target, {"payload.mass": 0.0}).successful
    controller.stream_until(lambda: controller.has_diagnostic("payload before stays in force"), "moments without mass")
    comes_to(Dynamics(loaded, compiled=False).gravity(Q), "the payload before")
    assert controller.client.set_parameters(controller.target, {"payload.link": ""}).successful
    comes_to(LIBRARY.gravity(Q), "no payload")


def test_springs_behind_motors_need_no_state_and_their_links_follow(start_controller):
    manutec = Dynamics(load_robot("manutec_r3"), compiled=False)
    controller = start_controller({"robot_file": "manutec_r3", "mode": "feedforward", "ramp_time": 0.01})
    motors = [name for name in manutec.joint_names if name not in manutec.unactuated_joint_names]
    state = {"q": np.array([0.0, 0.5, 0.4, 0.2, -0.3, 0.1]), "qd": np.zeros(6), "names": motors}
    goal = np.array([0.1, 0.7, 0.5, 0.2, -0.2, 0.1])
    controller.stream_until(lambda: len(controller.commands) > 5, "efforts", **state)
    controller.reference.publish(trajectory_message(motors, [0.0, 0.1], [goal, goal]))
    controller.stream_until(
        lambda: any(message == "feedforward" for _, message, _ in controller.diagnostics), "no objection", **state
    )
    # the springs hold the links at the reference, and the motors hold the springs
    q, springs = np.zeros(9), [manutec.joint_names.index(name) for name in manutec.unactuated_joint_names]
    q[[manutec.joint_names.index(name) for name in motors]] = goal
    is_held = manutec.gravity(q)
    assert np.abs(is_held[springs]).max() > 10
    expected = [is_held[manutec.joint_names.index(name)] for name in motors]
    controller.stream_until(
        lambda: np.abs(last(controller) - expected).max() < 1e-9, "the efforts of the goal", **state
    )


def test_friction_compensation_uses_the_reference_or_the_measured_velocity(start_controller):
    puma = Dynamics(load_robot("puma560"), compiled=False)
    q, qd = np.array([0.1, -0.5, 0.3, 0.2, 0.4, -0.3]), np.array([0.2, -0.1, 0.3, -0.2, 0.1, 0.4])
    controller = start_controller({"robot_file": "puma560"})
    state = {"q": q, "qd": qd, "names": puma.joint_names}
    controller.stream_until(lambda: len(controller.commands) > 5, "efforts", **state)
    controller.reference.publish(trajectory_message(puma.joint_names, [0.0, 0.1], [q, q]))
    without = puma.inverse(q, qd, -20 * qd) - puma.friction(qd)
    assert np.abs(puma.friction(qd)).min() > 0.1

    def comes_to(expected, description):
        controller.stream_until(lambda: np.abs(last(controller) - expected).max() < 1e-9, description, **state)

    comes_to(without, "friction at the velocity of the reference, zero")
    assert controller.set_parameters(friction_velocity="measured").successful
    comes_to(without + puma.friction(qd), "friction at the measured velocity")


def test_invalid_parameters_are_refused_with_a_reason(start_controller):
    controller = start_controller()
    controller.stream_until_steady()
    for change, expected_text in (
        ({"mode": "computed_torqe"}, "did you mean 'computed_torque'"),
        ({"mode": 3}, "a text is needed"),
        ({"friction_velocity": "mesured"}, "did you mean 'measured'"),
        ({"kp": [1.0, 2.0]}, "kp has 2 values: 7 are needed"),
        ({"kp": [-1.0]}, "0 or more"),
        ({"kd": float("nan")}, "0 or more"),
        ({"effort_limits": [1.0]}, "effort_limits has 1 values: 7 are needed"),
        ({"without_reference": "hold"}, "known are gravity, damp, zero"),
        ({"state_timeout": 0.0}, "0.0001 or more"),
        ({"ramp_time": float("inf")}, "0 or more"),
        ({"deadline_misses": 0}, "a whole number from 1 on"),
        ({"joints": PANDA}, "call cleanup first"),
        ({"robot_file": "ur5e"}, "deactivate the node"),
        ({"payload.link": "hand"}, "unknown link 'hand'"),
    ):
        result = controller.set_parameters(**change)
        assert not result.successful and expected_text in result.reason, (change, result.reason)
    controller.stream(0.1)
    np.testing.assert_allclose(last(controller), LIBRARY.gravity(Q), atol=1e-9)


def test_parameters_that_do_not_fit_the_robot_are_an_error(start_controller):
    controller = start_controller({"joints": [*PANDA[:6], "panda_joint9"]})
    controller.wait_until(lambda: controller.diagnostics, "diagnostics")
    level, message, _ = controller.diagnostics[-1]
    assert level == ERROR
    assert "not configured: parameter joints: unknown joint 'panda_joint9'" in message
    assert controller.set_parameters(joints=PANDA).successful
    controller.stream_until_steady()


def test_states_of_another_clock_before_the_simulated_time_are_refused_by_name(start_controller):
    controller = start_controller({"use_sim_time": True})
    reason = "efforts go to zero: use_sim_time is set, and nothing came on /clock yet: joint_states have a stamp of"
    controller.stream_until(lambda: controller.has_diagnostic(reason), reason)
    assert np.abs(last(controller)).max() == 0


def test_settings_are_logged_at_the_start(tmp_path, ros):
    log = tmp_path / "log"
    parameters = {"robot_file": "panda", "mode": "pd_gravity", "kp": [30.0], "kd": [1.0, *[11.0] * 6]}
    with log.open("w") as file, running_node("computed_torque", parameters, "/logged", log=file):
        until = time.monotonic() + 60
        while "controls panda_joint1" not in log.read_text():
            assert time.monotonic() < until, log.read_text()
            time.sleep(0.05)
    assert (
        "mode pd_gravity, kp 30 1/s^2, kd [1.0, 11.0, 11.0, 11.0, 11.0, 11.0, 11.0] 1/s, without_reference damp, "
        "ramp_time 0.1 s, state_timeout 0.02 s, reference_timeout 0.1 s, deadline 0.005 s"
    ) in log.read_text()


def test_flying_base_is_read_from_odom(start_controller):
    controller = start_controller({"robot_file": "free_flying_arm", "gravity": [0.0, 0.0, -9.81]})
    library = Dynamics(load_robot("free_flying_arm", gravity=(0, 0, -9.81)), compiled=False)
    q, qd, twist = np.linspace(-0.5, 0.5, 6), np.linspace(0.2, -0.2, 6), np.array([0.1, 0.2, -0.1, 0.3, -0.2, 0.1])
    state = {"q": q, "qd": qd, "names": library.joint_names}
    controller.stream_until(
        lambda: controller.has_diagnostic("no odom yet, and the base of the robot moves"), "the cause", **state
    )
    turned = Rotation.from_rotvec([0.3, -0.2, 0.5])
    pose = np.eye(4)
    pose[:3, :3] = turned.as_matrix()
    expected = library.solve(q, np.zeros(6), qdd=-20 * qd, base=Base(pose, twist)).efforts
    odom = Odometry(child_frame_id=library.robot.base_link)
    x, y, z, odom.pose.pose.orientation.w = turned.as_quat()
    odom.pose.pose.orientation.x, odom.pose.pose.orientation.y, odom.pose.pose.orientation.z = x, y, z
    odom.twist.twist = write_twist(twist)

    def is_held():
        controller.odom.publish(odom)
        return np.abs(last(controller) - expected).max() < 1e-9

    controller.stream_until(is_held, "efforts", **state)
    controller.stream_until(
        lambda: controller.has_diagnostic("efforts go to zero: no odom for more than 200 ms"), "the loss", **state
    )
    odom.child_frame_id = "base_footprint"

    def refused():
        controller.odom.publish(odom)
        return controller.has_diagnostic("odom refused: unknown base link 'base_foot")

    controller.stream_until(refused, "the refusal", **state)


def test_life_cycle_starts_and_ends_with_zero_efforts(start_controller):
    controller = start_controller({"autostart": False, "mode": "gravity_compensation"})
    assert not controller.change_state(Transition.TRANSITION_ACTIVATE)
    assert controller.change_state(Transition.TRANSITION_CONFIGURE)
    controller.stream(0.3)
    assert not controller.commands
    assert controller.change_state(Transition.TRANSITION_ACTIVATE)
    controller.stream_until_steady()
    assert np.abs(controller.commands[0][1]).max() == 0
    assert controller.change_state(Transition.TRANSITION_DEACTIVATE)
    controller.wait_until(lambda: np.abs(last(controller)).max() == 0, "zeros")
    count = len(controller.commands)
    controller.stream(0.2)
    assert len(controller.commands) == count
    assert controller.set_parameters(robot_file="ur5e").successful
    assert controller.change_state(Transition.TRANSITION_CLEANUP) and controller.change_state(
        Transition.TRANSITION_CONFIGURE
    )
    assert controller.change_state(Transition.TRANSITION_ACTIVATE)
    ur5e = Dynamics(load_robot("ur5e"), compiled=False)
    controller.stream_until_steady(q=Q[:6], names=ur5e.joint_names)
    np.testing.assert_allclose(last(controller), ur5e.gravity(Q[:6]), atol=1e-9)


def test_fault_deactivates_the_node_on_request_until_it_is_activated(start_controller):
    parameters = {"mode": "gravity_compensation", "deactivate_on_fault": True, "ramp_time": 0.05}
    controller = start_controller(parameters)
    time.sleep(0.5)  # without states: the node waits for the first one
    controller.stream_until_steady()
    controller.wait_until(
        lambda: controller.has_diagnostic("deactivated by a fault: no joint_states for more than 200 ms"), "the reason"
    )
    assert controller.diagnostics[-1][0] == ERROR and np.abs(last(controller)).max() == 0
    count = len(controller.commands)
    controller.stream(0.5)  # good states alone change nothing
    assert len(controller.commands) == count
    assert controller.change_state(Transition.TRANSITION_ACTIVATE)
    controller.stream_until_steady()
    np.testing.assert_allclose(last(controller), LIBRARY.gravity(Q), atol=1e-9)
    assert controller.set_parameters(deactivate_on_fault=False).successful
    controller.wait_until(lambda: np.abs(last(controller)).max() == 0, "zeros")
    controller.stream_until_steady()  # they return by themselves


def test_two_nodes_run_in_one_process_with_remapped_topics(ros, client):
    nodes, probes, executor = [], [], SingleThreadedExecutor()
    robots = {"/left": "panda", "/right": "ur5e"}
    try:
        for namespace, robot in robots.items():
            robot_parameters = {**QUIET, "robot_file": robot, "mode": "gravity_compensation"}
            overrides = [Parameter(name, value=value) for name, value in robot_parameters.items()]
            arguments = ["--ros-args", "-r", f"__ns:={namespace}", "-r", "joint_states:=encoders"]
            nodes.append(ComputedTorque(parameter_overrides=overrides, cli_args=arguments))
            executor.add_node(nodes[-1])
            probes.append(ControllerProbe(f"{namespace}/computed_torque", client, states="encoders"))
        libraries = [Dynamics(load_robot(robot), compiled=False) for robot in robots.values()]
        expected = [library.gravity(Q[: len(library.joint_names)]) for library in libraries]
        until = time.monotonic() + 20
        while any(
            not probe.commands or np.abs(last(probe) - efforts).max() > 1e-9
            for probe, efforts in zip(probes, expected, strict=True)
        ):
            assert time.monotonic() < until, [probe.diagnostics[-1:] for probe in probes]
            for probe, library in zip(probes, libraries, strict=True):
                probe.publish(q=Q[: len(library.joint_names)], names=library.joint_names)
            for _ in range(8):
                executor.spin_once(timeout_sec=0.001)
    finally:
        for probe in probes:
            probe.close()
        executor.shutdown()
        for node in nodes:
            node.destroy_node()
