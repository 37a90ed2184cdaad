"""joint_state_completer: loops are closed in what it publishes, by Pinocchio on the URDF that is written."""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from nodes.completer_probe import CompleterProbe, stamp_of, values_by_name
from nodes.simulator_probe import SimulatorProbe
from peers.cut_urdf import CutUrdf
from peers.loop_states import closed_rates
from visualization_msgs.msg import Marker

from robot_dynamics import Dynamics, load_robot

NODE = "joint_state_completer"
PREFIX = "left/"  # of the names of links
LOOPED = ("four_bar", "delta", "gough_stewart", "hexapod_stack", "navaro")


class Robot:
    """A robot, its motors at the initial positions, and its cut URDF."""

    def __init__(self, name):
        self.dynamics = Dynamics(load_robot(name), compiled=False)
        self.description = self.dynamics.robot
        self.motors = list(self.dynamics.joint_names)
        self.start = self.positions_of(self.dynamics.initial_joint_positions)
        self.urdf = CutUrdf(self.description)

    def positions_of(self, q):
        return np.asarray(q)[[self.description.joint_numbers[name] for name in self.motors]]

    def moved(self, step):
        """Motor positions of a step of a motion."""
        return self.start + 0.03 * np.sin(0.05 * step * (1 + np.arange(len(self.start))))


@pytest.mark.parametrize("name", LOOPED)
def test_loops_are_closed_and_names_complete_in_any_order_of_the_input(client, start_server, name):
    robot = Robot(name)
    probe = CompleterProbe(start_server({"robot_file": name}, executable=NODE), client)
    rng = np.random.default_rng(0)
    for step in range(1, 30):
        order = rng.permutation(len(robot.motors))
        names = [*(robot.motors[k] for k in order), "joint_of_a_gripper"]
        q = robot.moved(step)
        qd = np.cos(np.arange(len(q)) + step)
        stamp = 7 * 10**9 + step
        state = probe.complete(stamp, names, [*q[order], 1.5], [*qd[order], 0.0])
        assert list(state.name) == list(robot.dynamics.all_joint_names) and set(robot.urdf.joint_names) <= {*state.name}
        positions = values_by_name(state)
        assert [positions[joint] for joint in robot.motors] == q.tolist()
        robot.urdf.move(positions)
        assert np.abs(robot.urdf.gaps()).max() < 1e-9
        dependent = [robot.description.joint_numbers[joint] for joint in robot.dynamics.dependent_joint_names]
        rates = np.zeros(len(state.name))
        rates[[robot.description.joint_numbers[joint] for joint in robot.motors]] = qd
        expected = closed_rates(robot.description, np.array(state.position), rates, dependent)
        np.testing.assert_allclose(state.velocity, expected, rtol=0, atol=1e-8 * np.abs(expected).max())
    assert not probe.complete(99, robot.motors, q).velocity  # as there are none in the message
    probe.wait_for_diagnostic(DiagnosticStatus.STALE, "no messages on")


def test_locked_joints_are_published_where_they_are_locked(client, start_server):
    locked = {"locked_joints": ["right_crank"], "locked_positions": [2.9]}
    dynamics = Dynamics(load_robot("five_bar", locked={"right_crank": 2.9}), compiled=False)
    start = float(dynamics.initial_joint_positions[dynamics.robot.joint_numbers["left_crank"]])
    probe = CompleterProbe(start_server({"robot_file": "five_bar", **locked}, executable=NODE), client)
    state = probe.complete(5, ["left_crank", "right_crank"], [start, 2.8], [0.5, 0.0])
    assert list(state.name) == [*dynamics.all_joint_names, "right_crank"]
    assert state.position[-1] == 2.9 and state.velocity[-1] == 0.0
    np.testing.assert_allclose(state.position[:-1], dynamics.expand_positions([start]), atol=1e-9)


def test_states_are_continued_from_each_other_and_chosen_by_passive_positions(client, start_server):
    """The crank turns twice; with its coupler below, the passive positions of one message choose that mode."""
    robot = Robot("four_bar")
    probe = CompleterProbe(start_server({"robot_file": "four_bar"}, executable=NODE), client)
    start = robot.start[0]
    for stamp, angle in enumerate(np.linspace(start, start + 4 * np.pi, 60), 1):
        state = values_by_name(probe.complete(stamp, ["crank"], [angle]))
    np.testing.assert_allclose(state["rocker"] % (2 * np.pi), robot.dynamics.initial_joint_positions[2] % (2 * np.pi))
    for mode in (1, -1):  # knee above, below: the rocker mirrored about the diagonal
        tip = 2 * np.array([math.cos(start), math.sin(start)])
        diagonal = tip - [10.0, 0.0]
        distance = np.linalg.norm(diagonal)
        opening = math.acos((distance**2 + 5.0**2 - 8.0**2) / (2 * 5.0 * distance))
        rocker = math.atan2(diagonal[1], diagonal[0]) - mode * opening
        knee = np.array([10.0, 0.0]) + 5 * np.array([math.cos(rocker), math.sin(rocker)])
        coupler = math.atan2(*(knee - tip)[::-1]) - start
        seeded = probe.complete(1000 + mode, ["rocker", "crank", "coupler"], [rocker + 0.05, start, coupler])
        later = probe.complete(2000 + mode, ["crank"], [start])
        for message in (seeded, later):
            difference = values_by_name(message)["rocker"] - rocker
            assert abs(math.remainder(difference, 2 * math.pi)) < 1e-9
            robot.urdf.move(values_by_name(message))
            assert np.abs(robot.urdf.gaps()).max() < 1e-9


def test_passive_positions_are_ignored_by_request(client, start_server):
    """Those of joint_state_publisher_gui are its sliders."""
    robot = Robot("delta")
    parameters = {"robot_file": "delta", "use_passive_positions": False}
    probe = CompleterProbe(start_server(parameters, executable=NODE), client)
    for step in range(1, 5):
        names = robot.urdf.joint_names
        sliders = dict.fromkeys(names, 3.0) | dict(zip(robot.motors, robot.moved(step), strict=True))
        state = values_by_name(probe.complete(step, names, [sliders[name] for name in names]))
        expected = robot.dynamics.expand_positions(robot.moved(step))
        np.testing.assert_allclose([state[name] for name in robot.dynamics.all_joint_names], expected, atol=1e-9)


def test_bad_inputs_give_a_reason_and_no_output_and_the_node_goes_on(client, start_server):
    robot = Robot("gough_stewart")
    probe = CompleterProbe(start_server({"robot_file": "gough_stewart"}, executable=NODE), client)
    names, q = robot.motors, robot.start
    probe.complete(1, names, q)
    far = q + 2.0
    far[0] = 40.0
    broken = q.copy()
    broken[3] = math.nan
    cases = [
        (names, far, "does not close"),
        (names, broken, "position nan of 'leg_4'"),
        (names[:-1], q[:-1], "'leg_6'"),
        ([*names, names[0]], [*q, q[0]], "'leg_1' more than once"),
        (names, q[:-1], "5 positions for 6 names"),
    ]
    for number, (joints, values, reason) in enumerate(cases, 2):
        begin = len(probe.diagnostics)
        for _ in range(300):
            probe.send(number, joints, values)
            client.spin(0.1)
            if any(reason in status[1] for status in probe.diagnostics[begin:]):
                break
        levels = {status[0] for status in probe.diagnostics[begin:] if reason in status[1]}
        assert levels and levels <= {DiagnosticStatus.WARN, DiagnosticStatus.ERROR}, (reason, probe.diagnostics[-1])
        assert number not in set(map(stamp_of, probe.states))
        probe.complete(100 + number, names, q)
    for _ in range(30):  # of another robot only
        probe.send(50, ["a", "b"], [0.0, 0.0])
        client.spin(0.1)
    assert 50 not in set(map(stamp_of, probe.states))
    assert any(
        "unknown are 'a', 'b'" in status[1] for status in probe.diagnostics if status[0] == DiagnosticStatus.WARN
    )
    state = probe.complete(200, names, q, np.full(6, math.nan))
    assert not state.velocity and len(state.position) == len(robot.description.joints)


def test_without_robot_or_loops(client, start_server):
    probe = CompleterProbe(start_server({}, executable=NODE), client)
    probe.wait_for_diagnostic(DiagnosticStatus.ERROR, "no robot is loaded")
    panda = CompleterProbe(start_server({"robot_file": "panda"}, executable=NODE), client)
    names = [f"panda_joint{k}" for k in range(7, 0, -1)]
    state = panda.complete(5, names, np.arange(7) * 0.1)
    assert values_by_name(state) == dict(zip(names, np.arange(7) * 0.1, strict=True))


@pytest.mark.parametrize("name", ["delta", "panda"])
def test_markers_are_at_the_centres_of_mass_and_along_the_axes(client, start_server, name):
    robot = Robot(name)
    parameters = {"robot_file": name, "markers.length": 0.5, "markers.force": 20.0, "markers.torque": 40.0}
    parameters |= {"markers.rate": 1000.0, "frame_prefix": PREFIX}
    probe = CompleterProbe(start_server(parameters, executable=NODE), client)
    state = probe.complete(11, robot.motors, robot.moved(3))
    link = "platform" if robot.description.platforms else "panda_link5"
    wrench = [3.0, 0.0, -4.0, 0.0, 8.0, 0.0]
    for stamp in range(12, 200):
        probe.send_wrench(link, wrench)
        probe.send(stamp, robot.motors, robot.moved(3))
        client.spin(0.02)
        if probe.markers and any(marker.ns == "external_torque" for marker in probe.markers[-1].markers):
            break
    markers = probe.markers[-1].markers
    assert {stamp_of(marker) for marker in markers} <= {*range(11, 200)} and len(set(map(stamp_of, markers))) == 1
    assert {marker.action for marker in markers} == {Marker.ADD}
    robot.urdf.move(values_by_name(state))
    check_masses(robot, [marker for marker in markers if marker.ns == "centre_of_mass"])
    check_efforts(robot, state, [marker for marker in markers if marker.ns == "joint_effort"])
    arrows = {marker.ns: marker for marker in markers if marker.ns.startswith("external")}
    assert set(map(link_of, arrows.values())) == {link}
    for ns, expected in (("external_force", [0.075, 0, -0.1]), ("external_torque", [0, 0.1, 0])):
        begin, end = map(point, arrows[ns].points)
        np.testing.assert_allclose([begin, end], [np.zeros(3), expected], atol=1e-12)
    wait_until_the_wrench_is_removed(robot, probe, client)


def wait_until_the_wrench_is_removed(robot, probe, client):
    for stamp in range(300, 500):
        probe.send(stamp, robot.motors, robot.moved(3))
        client.spin(0.02)
        actions = {marker.ns: marker.action for message in probe.markers for marker in message.markers}
        if actions["external_force"] == Marker.DELETE:
            break
    assert actions["external_force"] == actions["external_torque"] == Marker.DELETE


def link_of(marker):
    assert marker.header.frame_id.startswith(PREFIX)
    return marker.header.frame_id.removeprefix(PREFIX)


def point(message):
    return np.array([message.x, message.y, message.z])


def check_masses(robot, markers):
    expected = {}
    for link in robot.description.links:
        position, mass = robot.urdf.centre_of_mass(link.name)
        if mass:
            expected[link.name] = position, mass
    assert set(map(link_of, markers)) == set(expected) and len(markers) == len(expected) > 3
    for marker in markers:
        position, mass = expected[link_of(marker)]
        actual = robot.urdf.pose(link_of(marker)) @ np.append(point(marker.pose.position), 1)
        np.testing.assert_allclose(actual[:3], position, rtol=0, atol=1e-9)
        diameters = marker.scale.x, marker.scale.y, marker.scale.z
        assert math.pi / 6 * math.prod(diameters) * 2700 == pytest.approx(mass)


def check_efforts(robot, state, markers):
    """An arrow is along the axis of the joint in Pinocchio, as long as the gravity effort over the limit."""
    gravity = dict(zip(robot.motors, robot.dynamics.gravity(np.array(state.position)), strict=True))
    numbers = {name: robot.description.joint_numbers[name] for name in robot.motors}
    arrows = {marker.id - 1: marker for marker in markers}
    assert set(arrows) <= set(numbers.values()) and arrows
    for name, number in numbers.items():
        limit = robot.description.joints[number].limits.effort
        vector = 0.5 * gravity[name] / (limit if math.isfinite(limit) else 40.0)
        origin, axis = robot.urdf.joint_axis(name)
        if number not in arrows:
            assert abs(vector) < 0.01 * 0.5
            continue
        pose = robot.urdf.pose(link_of(arrows[number]))
        begin, end = (pose[:3, :3] @ point(tip) + pose[:3, 3] for tip in arrows[number].points)
        np.testing.assert_allclose(end - begin, vector * axis, rtol=0, atol=1e-9)
        assert np.linalg.norm(np.cross(begin - origin, axis)) < 1e-9


@pytest.mark.parametrize("name", ["four_bar", "delta"])
def test_simulator_publishes_the_passive_joints_as_well(client, start_server, name):
    robot = Robot(name)
    probe = SimulatorProbe(start_server({"robot_file": name}, executable="mobile_base_simulator"), client)
    probe.wait_until(lambda: len(probe.joint_states) > 100, "states")
    for message in probe.joint_states[::20]:
        assert set(robot.urdf.joint_names) <= set(message.name)
        robot.urdf.move(values_by_name(message))
        assert np.abs(robot.urdf.gaps()).max() < 1e-9


def test_another_robot_at_run_time_replaces_joints_and_markers(client, start_server):
    name = start_server({"robot_file": "delta", "markers.rate": 1000.0}, executable=NODE)
    probe = CompleterProbe(name, client)
    first, second = Robot("delta"), Robot("four_bar")
    assert "platform" in frames_of_masses(probe.mark(1, first.motors, first.start))
    assert client.set_parameters(f"/{name.strip('/')}", {"robot_file": "four_bar"}).successful
    probe.wait_until(lambda: Marker.DELETEALL in actions_of(probe.markers[-1]), "the removal of markers")
    state = probe.complete(2, second.motors, second.start)
    assert list(state.name) == list(second.dynamics.all_joint_names)
    second.urdf.move(values_by_name(state))
    assert np.abs(second.urdf.gaps()).max() < 1e-9
    assert frames_of_masses(probe.mark(3, second.motors, second.start)) == {"crank", "coupler", "rocker"}


def actions_of(message):
    return {marker.action for marker in message.markers}


def frames_of_masses(markers):
    return {marker.header.frame_id for marker in markers if marker.ns == "centre_of_mass"}


def test_measured_efforts_are_shown_and_gravity_not_where_the_base_moves(client, start_server):
    name = start_server(
        {"robot_file": "free_flying_arm", "markers.rate": 1000.0, "markers.torque": 8.0}, executable=NODE
    )
    probe = CompleterProbe(name, client)
    dynamics = Dynamics(load_robot("free_flying_arm"), compiled=False)
    names, count = list(dynamics.joint_names), len(dynamics.joint_names)
    efforts = [math.nan, 4.0, -2.0, *[0.0] * (count - 3)]

    def arrows(stamp):
        markers = probe.mark(stamp, names, np.zeros(count), efforts)
        return {marker.id: marker for marker in markers if marker.ns == "joint_effort" and marker.action == Marker.ADD}

    assert not arrows(1)
    assert client.set_parameters(f"/{name.strip('/')}", {"markers.efforts": "measured"}).successful
    shown = arrows(2)
    assert set(shown) == {dynamics.robot.joint_numbers[joint] + 1 for joint in names[1:3]}
    for joint, effort in zip(names[1:3], (4.0, -2.0), strict=True):
        number = dynamics.robot.joint_numbers[joint]
        limit = dynamics.robot.joints[number].limits.effort
        begin, end = map(point, shown[number + 1].points)
        assert np.linalg.norm(end - begin) == pytest.approx(
            0.3 * abs(effort) / (limit if math.isfinite(limit) else 8.0)
        )
