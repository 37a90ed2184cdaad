"""dynamics_server in a process of its own returns the results of the library, by name, complete and in order."""

import threading

import numpy as np
import pytest
from nodes.service_requests import (
    PANDA,
    STEP_NS,
    assert_same,
    base_accelerations,
    base_trajectory,
    call_successfully,
    direct_request,
    field,
    inverse_request,
    motion,
    terms_request,
    wrench,
    wrench_values,
)
from peers.frictions import with_random_friction
from peers.real_robots import real_urdf
from scipy.spatial.transform import Rotation

from robot_dynamics import Base, Dynamics, Inertia, InvalidInputError, load_robot
from robot_dynamics.dynamics import BASE_ROWS
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.nodes.client import ServiceClient


def test_inverse_and_direct_dynamics_are_those_of_the_library(client, panda, panda_dynamics):
    q, qd, qdd = motion(50, 7)
    response = call_successfully(client, panda, inverse_request(PANDA, q, qd, qdd))
    efforts = panda_dynamics.inverse(q, qd, qdd)
    assert list(response.trajectory.joint_names) == PANDA
    for name, expected in (("positions", q), ("velocities", qd), ("accelerations", qdd), ("effort", efforts)):
        assert_same(field(response.trajectory, name), expected)
    assert response.base.points == [] and response.reactions == []
    back = call_successfully(client, panda, direct_request(PANDA, q, qd, efforts))
    assert_same(field(back.trajectory, "accelerations"), panda_dynamics.direct(q, qd, efforts))
    np.testing.assert_allclose(field(back.trajectory, "accelerations"), qdd, atol=1e-9)


def test_terms_are_those_of_the_library(client, panda, panda_dynamics):
    q, qd, _ = motion(1, 7)[:, 0]
    response = call_successfully(client, panda, terms_request(PANDA, q, qd))
    assert list(response.joint_names) == PANDA
    np.testing.assert_array_equal(np.reshape(response.inertia_matrix, (7, 7)), panda_dynamics.inertia_matrix(q))
    np.testing.assert_array_equal(response.coriolis, panda_dynamics.coriolis(q, qd))
    np.testing.assert_array_equal(response.gravity, panda_dynamics.gravity(q))
    np.testing.assert_array_equal(response.friction, panda_dynamics.friction(qd))


def test_ten_thousand_points_are_returned_complete_and_in_order(client, panda, panda_dynamics):
    q, qd, qdd = motion(10_000, 7)
    response = call_successfully(client, panda, inverse_request(PANDA, q, qd, qdd))
    np.testing.assert_array_equal(field(response.trajectory, "positions"), q)
    assert_same(field(response.trajectory, "effort"), panda_dynamics.inverse(q, qd, qdd))
    times = [p.time_from_start.sec * 10**9 + p.time_from_start.nanosec for p in response.trajectory.points]
    assert times == [k * STEP_NS for k in range(10_000)]


def test_joints_in_another_order_are_matched_by_name(client, panda, panda_dynamics):
    q, qd, qdd = motion(3, 7)
    order = [4, 0, 6, 2, 1, 5, 3]
    names = [PANDA[k] for k in order]
    response = call_successfully(client, panda, inverse_request(names, q[:, order], qd[:, order], qdd[:, order]))
    assert list(response.trajectory.joint_names) == names
    efforts = panda_dynamics.inverse(q, qd, qdd)
    assert_same(field(response.trajectory, "effort"), efforts[:, order])
    back = call_successfully(client, panda, direct_request(names, q[:, order], qd[:, order], efforts[:, order]))
    np.testing.assert_allclose(field(back.trajectory, "accelerations"), qdd[:, order], atol=1e-9)
    terms = call_successfully(client, panda, terms_request(names, q[0, order], qd[0, order]))
    assert list(terms.joint_names) == names
    matrix = np.reshape(terms.inertia_matrix, (7, 7))
    np.testing.assert_array_equal(matrix, panda_dynamics.inertia_matrix(q[0])[np.ix_(order, order)])
    np.testing.assert_array_equal(terms.coriolis, panda_dynamics.coriolis(q[0], qd[0])[order])
    np.testing.assert_array_equal(terms.gravity, panda_dynamics.gravity(q[0])[order])


def test_joints_and_links_are_matched_under_the_namespace_of_the_node(client, start_server, panda_dynamics):
    server = start_server({"robot_file": "panda"}, namespace="/cell/left")
    q, qd, qdd = motion(1, 7)
    weight = [1.0, 2, 3, 4, 5, 6]
    expected = panda_dynamics.inverse(q, qd, qdd, external_wrenches={"panda_link8": weight})
    for prefix in ("", "cell/left/", "/cell/left/"):
        names = [prefix + name for name in reversed(PANDA)]
        request = inverse_request(names, q[:, ::-1], qd[:, ::-1], qdd[:, ::-1])
        request.external_wrenches = [wrench(f"{prefix}panda_link8", weight)]
        response = call_successfully(client, server, request)
        assert list(response.trajectory.joint_names) == names
        np.testing.assert_allclose(field(response.trajectory, "effort"), expected[:, ::-1], rtol=1e-12, atol=1e-12)


def test_wrenches_act_at_the_points_of_their_stamp_and_add_up(client, panda, panda_dynamics):
    q, qd, qdd = motion(4, 7)
    always, once = np.array([1.0, 2, 3, 4, 5, 6]), np.array([0, 0, -10.0, 0, 1, 0])
    request = inverse_request(PANDA, q, qd, qdd)
    request.external_wrenches = [
        wrench("panda_link8", always),
        wrench("panda_link8", once, 2),
        wrench("panda_link3", once),
    ]
    tip = np.tile(always, (4, 1))
    tip[2] += once
    expected = panda_dynamics.inverse(q, qd, qdd, external_wrenches={"panda_link8": tip, "panda_link3": once})
    np.testing.assert_allclose(
        field(call_successfully(client, panda, request).trajectory, "effort"), expected, rtol=1e-12, atol=1e-12
    )


def test_reactions_name_the_link_and_the_point(client, panda, panda_dynamics):
    q, qd, qdd = motion(2, 7)
    names = PANDA[::-1]
    request = inverse_request(names, q[:, ::-1], qd[:, ::-1], qdd[:, ::-1], reaction_wrenches=True)
    response = call_successfully(client, panda, request)
    expected = panda_dynamics.solve(q, qd, qdd=qdd).reactions
    links = ["panda_link0", *(f"panda_link{k}" for k in range(7, 0, -1))]
    assert [r.header.frame_id for r in response.reactions] == links * 2
    assert [r.header.stamp.nanosec for r in response.reactions] == [0] * 8 + [STEP_NS] * 8
    returned_reactions = np.array([wrench_values(r) for r in response.reactions]).reshape(2, 8, 6)
    np.testing.assert_array_equal(returned_reactions, expected[:, [0, 7, 6, 5, 4, 3, 2, 1]])


def test_moving_base_is_that_of_the_library(client, start_server):
    server = start_server({"robot_file": "free_flying_arm"})
    panda_dynamics = Dynamics(load_robot("free_flying_arm"), compiled=False)
    joints = list(panda_dynamics.joint_names)
    q, qd, qdd = motion(3, len(joints))
    rng = np.random.default_rng(1)
    rotations, positions, twists = Rotation.random(3, random_state=1), rng.normal(size=(3, 3)), rng.normal(size=(3, 6))
    pose = np.tile(np.eye(4), (3, 1, 1))
    pose[:, :3, :3], pose[:, :3, 3] = rotations.as_matrix(), positions
    base_motion = base_trajectory(rotations.as_quat(), positions, twists)

    expected = panda_dynamics.solve(q, qd, qdd=qdd, base=Base(pose, twists))
    response = call_successfully(client, server, inverse_request(joints, q, qd, qdd, base=base_motion))
    np.testing.assert_allclose(field(response.trajectory, "effort"), expected.efforts, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(base_accelerations(response.base), expected.base_acceleration, rtol=1e-9, atol=1e-9)
    assert response.base.joint_names == [panda_dynamics.robot.base_link]
    assert response.base.points[2].transforms[0] == base_motion.points[2].transforms[0]
    back = call_successfully(client, server, direct_request(joints, q, qd, expected.efforts, base=base_motion))
    np.testing.assert_allclose(field(back.trajectory, "accelerations"), qdd, atol=1e-7)

    prescribed = rng.normal(size=(3, 6))
    request = inverse_request(joints, q, qd, qdd, reaction_wrenches=True)
    request.base = base_trajectory(rotations.as_quat(), positions, twists, prescribed)
    response = call_successfully(client, server, request)
    expected = panda_dynamics.solve(q, qd, qdd=qdd, base=Base(pose, twists, prescribed))
    np.testing.assert_allclose(base_accelerations(response.base), prescribed, rtol=0, atol=1e-12)
    np.testing.assert_allclose(wrench_values(response.reactions[0]), expected.reactions[0, 0], rtol=1e-9)

    response = call_successfully(client, server, terms_request(joints, q[1], qd[1], base_motion.points[1]))
    size, base = 6 + len(joints), Base(pose[1], twists[1])
    assert list(response.joint_names) == [*BASE_ROWS, *joints]
    np.testing.assert_allclose(
        np.reshape(response.inertia_matrix, (size, size)), panda_dynamics.inertia_matrix(q[1]), rtol=1e-12
    )
    np.testing.assert_allclose(response.coriolis, panda_dynamics.coriolis(q[1], qd[1], base=base), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(response.gravity, panda_dynamics.gravity(q[1], base=base), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(response.friction, np.zeros(size))


def test_friction_of_all_kinds_is_that_of_the_library(client, start_server):
    robot = with_random_friction(load_robot("free_flying_arm"), 3)
    server = start_server({"robot_description": write_mdh_yaml(robot)})
    dynamics = Dynamics(robot, compiled=False)
    joints = list(dynamics.joint_names)
    q, qd, qdd = motion(2, len(joints))
    rotations, positions, twists = Rotation.random(2, random_state=1), np.zeros((2, 3)), np.ones((2, 6))
    pose = np.tile(np.eye(4), (2, 1, 1))
    pose[:, :3, :3] = rotations.as_matrix()
    base_motion = base_trajectory(rotations.as_quat(), positions, twists)
    response = call_successfully(client, server, inverse_request(joints, q, qd, qdd, base=base_motion))
    efforts = dynamics.inverse(q, qd, qdd, base=Base(pose, twists))
    np.testing.assert_allclose(field(response.trajectory, "effort"), efforts, rtol=1e-9, atol=1e-9)
    back = call_successfully(client, server, direct_request(joints, q, qd, efforts, base=base_motion))
    np.testing.assert_allclose(field(back.trajectory, "accelerations"), qdd, atol=1e-8)
    terms = call_successfully(client, server, terms_request(joints, q[1], qd[1], base_motion.points[1]))
    expected = dynamics.friction(qd[1], q[1], base=Base(pose[1], twists[1]))
    np.testing.assert_allclose(terms.friction, [*np.zeros(6), *expected], rtol=1e-9, atol=1e-9)


def test_sdf_text_is_served(client, start_server):
    """A pole of 3 kg with its centre 0.5 m above a horizontal axis: 3 · 9.81 · 0.5 · sin q, upside down."""
    inertia = "<inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>"
    server = start_server(
        {
            "robot_description": '<sdf version="1.9"><model name="pole"><link name="pole"><inertial><mass>3</mass>'
            f"<pose>0 0 0.5 0 0 0</pose>{inertia}</inertial></link><joint name='swing' type='revolute'>"
            "<parent>world</parent><child>pole</child><axis><xyz>0 1 0</xyz></axis></joint></model></sdf>"
        }
    )
    response = call_successfully(client, server, inverse_request(["swing"], [[0.3]], [[0.0]], [[0.0]]))
    np.testing.assert_allclose(field(response.trajectory, "effort"), [[-3 * 9.81 * 0.5 * np.sin(0.3)]], atol=1e-12)


def test_base_and_gravity_parameters_take_effect(client, start_server):
    urdf = real_urdf("borinot")
    server = start_server({"robot_description": urdf, "base": "fixed", "gravity": [0.0, 3.0, 0.0]})
    panda_dynamics = Dynamics(load_robot(urdf, moving_base=False, gravity=(0, 3, 0)), compiled=False)
    q, qd, qdd = motion(2, len(panda_dynamics.joint_names))
    response = call_successfully(client, server, inverse_request(panda_dynamics.joint_names, q, qd, qdd))
    assert_same(field(response.trajectory, "effort"), panda_dynamics.inverse(q, qd, qdd))
    assert client.set_parameters(server, {"base": "moving"}).successful
    base = base_trajectory([[0, 0, 0, 1]] * 2, np.zeros((2, 3)), np.zeros((2, 6)))
    response = call_successfully(client, server, inverse_request(panda_dynamics.joint_names, q, qd, qdd, base=base))
    assert len(response.base.points) == 2


def test_mimic_joints_may_be_left_out_and_are_appended(client, start_server):
    urdf = real_urdf("panda")
    server, panda_dynamics = start_server({"robot_description": urdf}), Dynamics(load_robot(urdf), compiled=False)
    joints, follower = list(panda_dynamics.joint_names), "panda_finger_joint2"
    q, qd, qdd = motion(2, 8)
    response = call_successfully(client, server, inverse_request(joints, q, qd, qdd, reaction_wrenches=True))
    assert list(response.trajectory.joint_names) == [*joints, follower]
    np.testing.assert_array_equal(field(response.trajectory, "positions"), panda_dynamics.expand_positions(q))
    efforts = field(response.trajectory, "effort")
    assert_same(efforts[:, :8], panda_dynamics.inverse(q, qd, qdd))
    np.testing.assert_array_equal(efforts[:, 8], 0)
    assert len(response.reactions) == 2 * 10
    named = [follower, *joints]
    both = [np.concatenate([values[:, 7:], values], axis=1) for values in (q, qd, qdd)]
    response = call_successfully(client, server, inverse_request(named, *both))
    assert list(response.trajectory.joint_names) == named
    assert_same(field(response.trajectory, "effort"), np.roll(efforts, 1, axis=1))
    # an effort on the follower counts at its leader
    shared = np.concatenate([np.full((2, 1), 0.5), efforts[:, :8]], axis=1)
    shared[:, 8] -= 0.5
    positions, velocities, _ = both
    response = call_successfully(client, server, direct_request(named, positions, velocities, shared))
    np.testing.assert_allclose(field(response.trajectory, "accelerations"), both[2], atol=1e-7)
    terms = call_successfully(client, server, terms_request(named, positions[0], velocities[0]))
    assert list(terms.joint_names) == joints


def test_payload_changed_at_run_time_shows_in_the_next_response(client, start_server, panda_dynamics):
    server = start_server({"robot_file": "panda"})
    q, qd, qdd = motion(5, 7)
    request = inverse_request(PANDA, q, qd, qdd)
    assert_same(
        field(call_successfully(client, server, request).trajectory, "effort"), panda_dynamics.inverse(q, qd, qdd)
    )
    payload = {"payload.mass": 2.0, "payload.first_moments": [0.02, 0, 0.2]}  # an integer among others
    payload["payload.inertia"] = [0.03, 0.001, -0.002, 0.0332, -0.001, 0.0102]
    assert client.set_parameters(server, payload).successful
    # nothing is carried until a link is named
    assert_same(
        field(call_successfully(client, server, request).trajectory, "effort"), panda_dynamics.inverse(q, qd, qdd)
    )
    assert client.set_parameters(server, {"payload.link": "panda_link8"}).successful
    tensor = [[0.03, 0.001, -0.002], [0.001, 0.0332, -0.001], [-0.002, -0.001, 0.0102]]
    loaded = Dynamics(
        panda_dynamics.robot.with_payload("panda_link8", Inertia(2.0, [0.02, 0.0, 0.2], tensor)), compiled=False
    )
    efforts = field(call_successfully(client, server, request).trajectory, "effort")
    assert_same(efforts, loaded.inverse(q, qd, qdd))
    assert np.abs(efforts - panda_dynamics.inverse(q, qd, qdd)).max() > 1
    assert client.set_parameters(server, {"payload.link": ""}).successful
    assert_same(
        field(call_successfully(client, server, request).trajectory, "effort"), panda_dynamics.inverse(q, qd, qdd)
    )


def test_requests_are_not_dropped_while_the_robot_is_reloaded(client, start_server, panda_dynamics):
    server = start_server({"robot_file": "panda"})
    q, qd, qdd = motion(1, 7)
    request = inverse_request(PANDA, q, qd, qdd)
    empty = panda_dynamics.inverse(q, qd, qdd)
    heavy = Dynamics(load_robot("panda", gravity=(0, 0, -98.1)), compiled=False).inverse(q, qd, qdd)
    call_successfully(client, server, request)
    responses, faults, first, stop = [], [], threading.Event(), threading.Event()

    def hammer():
        other_client = ServiceClient("hammer")
        try:
            while not stop.is_set():
                responses.append(field(call_successfully(other_client, server, request).trajectory, "effort"))
                first.set()
        except BaseException as fault:  # told to the test below
            faults.append(fault)
        finally:
            other_client.close()

    thread = threading.Thread(target=hammer)
    thread.start()
    try:
        assert first.wait(60)
        for k in range(20):
            strong = k % 2 == 0
            assert client.set_parameters(server, {"gravity": [0.0, 0.0, -98.1 if strong else -9.81]}).successful
            now = field(call_successfully(client, server, request).trajectory, "effort")
            assert_same(now, heavy if strong else empty)
    finally:
        stop.set()
        thread.join(60)
    assert not faults and not thread.is_alive()
    kinds = [np.allclose(a, empty) + 2 * np.allclose(a, heavy) for a in responses]
    assert set(kinds) == {1, 2} and len(responses) >= 20


def test_parameter_of_no_parameter_type_is_refused_by_name(client, panda):
    for value in ([0.0, "x"], {"a": 1}, object()):
        with pytest.raises(InvalidInputError, match=r"parameter 'payload\.first_moments' is .* is needed"):
            client.set_parameters(panda, {"payload.first_moments": value})
