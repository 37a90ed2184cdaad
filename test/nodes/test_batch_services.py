"""Services with flat arrays return what the library and the services with trajectories return, for many points."""

import numpy as np
import pytest
from nodes.service_requests import (
    PANDA,
    QD,
    QDD,
    Q,
    assert_same,
    assert_still_serves,
    base_accelerations,
    base_trajectory,
    call_service,
    call_successfully,
    direct_request,
    field,
    inverse_request,
    motion,
    wrench_values,
)
from peers.real_robots import real_urdf
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import JointTrajectoryPoint

from robot_dynamics import Base, Dynamics, InvalidInputError, load_robot
from robot_dynamics.dynamics import BASE_ROWS
from robot_dynamics_interfaces.srv import DirectDynamicsBatch, DynamicsTermsBatch, InverseDynamicsBatch

SERVICES = {
    InverseDynamicsBatch: "inverse_dynamics_batch",
    DirectDynamicsBatch: "direct_dynamics_batch",
    DynamicsTermsBatch: "dynamics_terms_batch",
}


def call_batch(client, server, kind, joints, **arguments):
    return client.call_batch(kind, f"{server}/{SERVICES[kind]}", joints, **arguments)


def inverse_batch(client, server, joints, q, qd, qdd, **others):
    arguments = {"positions": q, "velocities": qd, "accelerations": qdd, **others}
    return call_batch(client, server, InverseDynamicsBatch, joints, **arguments)


def direct_batch(client, server, joints, q, qd, efforts, **others):
    arguments = {"positions": q, "velocities": qd, "efforts": efforts, **others}
    return call_batch(client, server, DirectDynamicsBatch, joints, **arguments)


def refusal_of(client, server, kind=InverseDynamicsBatch, **fields):
    """The message of the refusal of a request that is valid for the Panda apart from `fields`."""
    request = kind.Request(count=3, joint_names=PANDA)
    values = {"positions": Q, "velocities": QD, **fields}
    if kind is InverseDynamicsBatch:
        values = {"accelerations": QDD, **values}
    for name, value in values.items():
        setattr(request, name, value.ravel().tolist() if isinstance(value, np.ndarray) else value)
    response = client.call(kind, f"{server}/{SERVICES[kind]}", request)
    assert not response.success
    return response.message


def with_value(values, index, value):
    values = values.copy()
    values[index] = value
    return values


@pytest.mark.parametrize("count", [1, 2, 40, 10_000])
def test_inverse_and_direct_dynamics_are_those_of_the_library(count, client, panda, panda_dynamics):
    q, qd, qdd = motion(count, 7, seed=count)
    efforts = panda_dynamics.inverse(q, qd, qdd)
    result = inverse_batch(client, panda, PANDA, q, qd, qdd)
    assert result.joint_names == tuple(PANDA) and set(result.fields) == {"efforts"}
    assert_same(result["efforts"], efforts)
    back = direct_batch(client, panda, PANDA, q, qd, efforts)
    assert set(back.fields) == {"accelerations"}
    np.testing.assert_allclose(back["accelerations"], qdd, atol=1e-8)


def test_joints_in_another_order_and_motion_on_request(client, panda, panda_dynamics):
    q, qd, qdd = motion(300, 7)
    order = [4, 0, 6, 2, 1, 5, 3]
    names = [PANDA[k] for k in order]
    result = inverse_batch(client, panda, names, q[:, order], qd[:, order], qdd[:, order], motion=True)
    assert result.joint_names == tuple(names)
    assert_same(result["efforts"], panda_dynamics.inverse(q, qd, qdd)[:, order])
    for name, expected in (("positions", q), ("velocities", qd), ("accelerations", qdd)):
        np.testing.assert_array_equal(result[name], expected[:, order])


def test_a_single_row_holds_at_every_point(client, panda, panda_dynamics):
    q, _, _ = motion(100, 7)
    rest = np.zeros(7)
    result = inverse_batch(client, panda, PANDA, q, rest, rest)
    assert_same(result["efforts"], panda_dynamics.gravity(q))
    single = inverse_batch(client, panda, PANDA, q[:1], rest, rest)
    assert_same(single["efforts"], panda_dynamics.gravity(q[:1]))


def test_wrenches_are_constant_or_of_each_point_and_add_up(client, panda, panda_dynamics):
    q, qd, qdd = motion(50, 7)
    of_points = np.random.default_rng(4).normal(size=(50, 6))
    constant = np.array([1.0, 2, 3, 4, 5, 6])
    for wrenches in ({"panda_link8": constant}, {"panda_link8": of_points, "panda_link3": constant}):
        result = inverse_batch(client, panda, PANDA, q, qd, qdd, external_wrenches=wrenches)
        assert_same(result["efforts"], panda_dynamics.inverse(q, qd, qdd, external_wrenches=wrenches))
    both = {"wrench_links": ["panda_link8", "panda_link8"], "external_wrenches": np.concatenate([constant, constant])}
    efforts = inverse_batch_of_fields(client, panda, q, qd, qdd, both)
    assert_same(efforts, panda_dynamics.inverse(q, qd, qdd, external_wrenches={"panda_link8": 2 * constant}))


def inverse_batch_of_fields(client, server, q, qd, qdd, fields):
    """Efforts for a request that is made by hand."""
    request = InverseDynamicsBatch.Request(count=len(q), joint_names=PANDA)
    for name, value in {"positions": q, "velocities": qd, "accelerations": qdd, **fields}.items():
        setattr(request, name, value.ravel().tolist() if isinstance(value, np.ndarray) else value)
    response = client.call(InverseDynamicsBatch, f"{server}/inverse_dynamics_batch", request)
    assert response.success, response.message
    return np.reshape(response.efforts, q.shape)


def test_reactions_are_those_of_the_library(client, panda, panda_dynamics):
    q, qd, qdd = motion(60, 7)
    names = PANDA[::-1]
    result = inverse_batch(client, panda, names, q[:, ::-1], qd[:, ::-1], qdd[:, ::-1], reaction_wrenches=True)
    expected = panda_dynamics.solve(q, qd, qdd=qdd)
    assert list(result.response.reaction_links) == ["panda_link0", *(f"panda_link{k}" for k in range(7, 0, -1))]
    assert_same(result["reactions"], expected.reactions[:, [0, 7, 6, 5, 4, 3, 2, 1]])
    assert_same(result["efforts"], expected.efforts[:, ::-1])


def test_terms_are_those_of_the_library(client, panda, panda_dynamics):
    q, qd, _ = motion(200, 7)
    names = PANDA[::-1]
    terms = call_batch(client, panda, DynamicsTermsBatch, names, positions=q[:, ::-1], velocities=qd[:, ::-1])
    assert terms.joint_names == tuple(names)
    assert_same(terms["inertia_matrix"], panda_dynamics.inertia_matrix(q)[:, ::-1, ::-1])
    assert_same(terms["coriolis"], panda_dynamics.coriolis(q, qd)[:, ::-1])
    assert_same(terms["gravity"], panda_dynamics.gravity(q)[:, ::-1])
    assert_same(terms["friction"], panda_dynamics.friction(qd)[:, ::-1])
    assert_same(terms["elasticity"], np.zeros((200, 7)))
    chosen = call_batch(client, panda, DynamicsTermsBatch, PANDA, positions=q, velocities=qd[0], terms=["gravity"])
    assert set(chosen.fields) == {"gravity"}
    assert_same(chosen["gravity"], panda_dynamics.gravity(q))


@pytest.fixture(scope="module")
def flyer(start_module_server):
    return start_module_server({"robot_file": "free_flying_arm"})


def test_moving_base_is_that_of_the_library(client, flyer):
    dynamics = Dynamics(load_robot("free_flying_arm"), compiled=False)
    joints, count = list(dynamics.joint_names), 70
    q, qd, qdd = motion(count, len(joints))
    rng = np.random.default_rng(1)
    rotations, twists = Rotation.random(count, random_state=1), rng.normal(size=(count, 6))
    pose = np.tile(np.eye(4), (count, 1, 1))
    pose[:, :3, :3], pose[:, :3, 3] = rotations.as_matrix(), rng.normal(size=(count, 3))
    base = {"base_poses": np.hstack([pose[:, :3, 3], rotations.as_quat()]), "base_twists": twists}

    free = dynamics.solve(q, qd, qdd=qdd, base=Base(pose, twists))
    result = inverse_batch(client, flyer, joints, q, qd, qdd, **base)
    assert list(result.response.base_links) == [dynamics.robot.base_link]
    np.testing.assert_allclose(result["efforts"], free.efforts, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(result["base_accelerations"], free.base_acceleration, rtol=1e-9, atol=1e-9)
    back = direct_batch(client, flyer, joints, q, qd, free.efforts, **base)
    np.testing.assert_allclose(back["accelerations"], qdd, atol=1e-8)
    np.testing.assert_allclose(back["base_accelerations"], free.base_acceleration, rtol=1e-8, atol=1e-8)

    acceleration = rng.normal(size=(count, 6))
    prescribed = dynamics.solve(q, qd, qdd=qdd, base=Base(pose, twists, acceleration))
    result = inverse_batch(client, flyer, joints, q, qd, qdd, base_accelerations=acceleration, **base)
    np.testing.assert_allclose(result["efforts"], prescribed.efforts, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(result["base_accelerations"], acceleration)

    terms = call_batch(client, flyer, DynamicsTermsBatch, joints, positions=q, velocities=qd, **base)
    assert terms.joint_names == (*BASE_ROWS, *joints)
    still = Base(pose, twists)
    assert_same(terms["inertia_matrix"], dynamics.inertia_matrix(q))
    np.testing.assert_allclose(terms["coriolis"], dynamics.coriolis(q, qd, base=still), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(terms["gravity"], dynamics.gravity(q, base=still), rtol=1e-9, atol=1e-9)


def test_loops_and_mimic_joints_are_completed(client, start_server):
    dynamics = Dynamics(load_robot("four_bar"), compiled=False)
    server = start_server({"robot_file": "four_bar"})
    joints = list(dynamics.joint_names)
    count = 40
    q = np.linspace(0.2, 1.0, count)[:, None] * np.ones(len(joints))
    qd, qdd = np.random.default_rng(0).uniform(-1, 1, (2, count, len(joints)))
    expected = dynamics.solve(q, qd, qdd=qdd)
    result = inverse_batch(client, server, joints, q, qd, qdd, motion=True)
    order = [dynamics.all_joint_names.index(name) for name in result.joint_names]
    assert sorted(order) == list(range(len(dynamics.all_joint_names)))
    assert_same(result["efforts"], dynamics.embed_efforts(expected.efforts)[:, order])
    for name, values in expected.motion._asdict().items():
        np.testing.assert_allclose(result[name], values[:, order], rtol=1e-9, atol=1e-9)
    back = direct_batch(client, server, joints, q, qd, expected.efforts)
    np.testing.assert_allclose(back["accelerations"], expected.motion.accelerations[:, order], atol=1e-7)

    urdf = real_urdf("panda")
    dynamics = Dynamics(load_robot(urdf), compiled=False)
    server = start_server({"robot_description": urdf})
    q, qd, qdd = motion(3, 8)
    result = inverse_batch(client, server, dynamics.joint_names, q, qd, qdd, motion=True)
    assert result.joint_names == (*dynamics.joint_names, "panda_finger_joint2")
    np.testing.assert_array_equal(result["positions"], dynamics.expand_positions(q))
    assert_same(result["efforts"], dynamics.embed_efforts(dynamics.inverse(q, qd, qdd)))


def test_motion_of_a_platform_is_that_of_the_service_with_trajectories(client, start_server):
    server = start_server({"robot_file": "gough_stewart"})
    dynamics = Dynamics(load_robot("gough_stewart"), compiled=False)
    count = 4
    rng = np.random.default_rng(2)
    pose = dynamics.platform.pose(dynamics.initial_joint_positions)
    positions = pose[:3, 3] + rng.uniform(-0.02, 0.02, (count, 3))
    quaternions = (
        Rotation.from_matrix(pose[:3, :3]) * Rotation.from_rotvec(rng.uniform(-0.05, 0.05, (count, 3)))
    ).as_quat()
    twists, accelerations = rng.uniform(-0.5, 0.5, (2, count, 6))
    request = inverse_request([], np.zeros((0, 0)), [], [])
    request.trajectory.points = [JointTrajectoryPoint() for _ in range(count)]
    request.base = base_trajectory(quaternions, positions, twists, accelerations)
    by_messages = call_successfully(client, server, request)
    base = {"base_poses": np.hstack([positions, quaternions]), "base_twists": twists}
    result = call_batch(client, server, InverseDynamicsBatch, [], base_accelerations=accelerations, motion=True, **base)
    assert list(result.joint_names) == list(by_messages.trajectory.joint_names)
    for name, flat_name in (("positions",) * 2, ("velocities",) * 2, ("effort", "efforts")):
        np.testing.assert_allclose(result[flat_name], field(by_messages.trajectory, name), rtol=1e-9, atol=1e-9)
    assert list(result.response.base_links) == list(by_messages.base.joint_names)
    np.testing.assert_allclose(result["base_twists"], twists, atol=1e-9)
    np.testing.assert_allclose(result["base_accelerations"], accelerations, atol=1e-7)
    np.testing.assert_allclose(base_accelerations(by_messages.base), accelerations, atol=1e-7)
    np.testing.assert_allclose(result["base_poses"][:, :3], positions, atol=1e-9)

    motors = list(dynamics.joint_names)
    columns = [result.joint_names.index(name) for name in motors]
    back = direct_batch(client, server, motors, [], [], result["efforts"][:, columns], **base)
    np.testing.assert_allclose(back["accelerations"], result["accelerations"], atol=1e-6)


BAD = {
    "no points": ({"count": 0}, "count is 0: one point at least is needed"),
    "few positions": (
        {"positions": Q[:, :6]},
        "positions has 18 values: 21 are needed, for each of 3 points a row of 7 values, one for each joint; or 7 "
        "values that hold at every point",
    ),
    "no velocities": ({"velocities": QD[:0]}, "velocities has 0 values: 21 are needed"),
    "another count": ({"count": 4}, "positions has 21 values: 28 are needed"),
    "NaN": ({"positions": with_value(Q, (1, 4), np.nan)}, "positions[11] (point 1, joint 'panda_joint5') is nan"),
    "NaN at every point": ({"velocities": with_value(QD[0], 2, np.inf)}, "velocities[2] (joint 'panda_joint3') is inf"),
    "missing joint": ({"joint_names": PANDA[:6]}, "joints missing: 'panda_joint7'"),
    "unknown joint": ({"joint_names": [*PANDA[:6], "panda_joint8"]}, "unknown joint 'panda_joint8': did you mean"),
    "unknown link": (
        {"wrench_links": ["panda_link8", "tip"], "external_wrenches": np.ones(12)},
        "wrench_links[1]: unknown link 'tip'",
    ),
    "few wrenches": (
        {"wrench_links": ["panda_link8"], "external_wrenches": np.ones(12)},
        "external_wrenches has 12 values: 18 are needed, for each of 3 points a row of 6 values, force and torque on "
        "each of 1 wrench_links; or 6 values that hold at every point",
    ),
    "wrenches on no link": ({"external_wrenches": np.ones(6)}, "external_wrenches has 6 values: 0 are needed"),
    "NaN wrench": (
        {"wrench_links": ["panda_link8"], "external_wrenches": with_value(np.ones((3, 6)), (2, 5), np.nan)},
        "external_wrenches on 'panda_link8' at point 2 is not finite",
    ),
    "base of a fixed robot": ({"base_poses": np.ones(7)}, "the base of 'panda' is fixed: leave the field base_poses"),
    "overflow": ({"velocities": QD + 1e200}, "is not a finite number"),
}


@pytest.mark.parametrize("case", BAD)
def test_invalid_request_is_refused_with_a_reason_and_the_next_is_served(case, client, panda, panda_dynamics):
    fields, reason = BAD[case]
    assert reason in refusal_of(client, panda, **fields)
    assert_still_serves(client, panda, panda_dynamics)


def test_invalid_efforts_and_terms_are_refused(client, panda):
    message = refusal_of(client, panda, DirectDynamicsBatch, efforts=with_value(QDD, (0, 6), np.nan))
    assert "efforts[6] (point 0, joint 'panda_joint7') is nan: a finite number is needed" in message
    assert "efforts has 0 values" in refusal_of(client, panda, DirectDynamicsBatch)
    message = refusal_of(client, panda, DynamicsTermsBatch, terms=["gravity", "inertia"])
    assert "terms: unknown term 'inertia'" in message and "inertia_matrix" in message


def test_the_point_of_an_invalid_value_is_named_in_long_requests(client, panda, start_server):
    q, qd, qdd = motion(20_000, 7)
    fields = {"count": 20_000, "velocities": qd, "accelerations": qdd}
    message = refusal_of(client, panda, positions=with_value(q, (17_000, 2), np.nan), **fields)
    assert f"positions[{17_000 * 7 + 2}] (point 17000, joint 'panda_joint3') is nan" in message
    request = inverse_request(PANDA, q, qd, qdd)
    request.trajectory.points[17_000].positions[2] = np.nan
    response = call_service(client, panda, request)
    assert "points[17000].positions[2] is nan" in response.message
    dynamics = Dynamics(load_robot("gough_stewart"), compiled=False)
    server = start_server({"robot_file": "gough_stewart"})
    columns = [dynamics.all_joint_names.index(name) for name in dynamics.joint_names]
    q = np.tile(dynamics.initial_joint_positions[columns], (12, 1))
    q[9, 0] += 10.0  # out of reach
    rest = np.zeros_like(q)
    service = f"{server}/inverse_dynamics_batch"
    with pytest.raises(InvalidInputError, match=r"does not close at sample 9\b"):
        client.call_batch(
            InverseDynamicsBatch, service, dynamics.joint_names, positions=q, velocities=rest, accelerations=rest
        )


BAD_BASES = {
    "no pose": ({"base_poses": []}, "base_poses has 0 values: 21 are needed"),
    "two twists": ({"base_twists": np.zeros((2, 6))}, "base_twists has 12 values: 18 are needed"),
    "zero quaternion": (
        {"base_poses": with_value(np.tile([0.0, 0, 0, 0, 0, 0, 1], (3, 1)), (2, 6), 0)},
        "the quaternion of 'base_link' at point 2 has norm 0: 1 is needed",
    ),
    "NaN position": ({"base_poses": np.array([np.nan, 0, 0, 0, 0, 0, 1])}, "the position of 'base_link' at point 0"),
    "infinite twist": ({"base_twists": np.full(6, np.inf)}, "base_twists of 'base_link' at point 0 is not finite"),
    "other link": ({"base_links": ["wrist"]}, "unknown base link 'wrist'"),
}


@pytest.mark.parametrize("case", BAD_BASES)
def test_invalid_state_of_the_base_is_refused_with_a_reason(case, client, flyer):
    fields, reason = BAD_BASES[case]
    robot = load_robot("free_flying_arm")
    base = {"base_poses": np.array([0.0, 0, 0, 0, 0, 0, 1]), "base_twists": np.zeros(6), **fields}
    names = [joint.name for joint in robot.joints]
    values = dict(zip(("positions", "velocities", "accelerations"), (Q[:, :6], QD[:, :6], QDD[:, :6]), strict=True))
    message = refusal_of(client, flyer, joint_names=names, **values, **base)
    assert reason.replace("base_link", robot.base_link) in message, message


def test_requests_with_too_many_points_are_refused(client, start_server, panda_dynamics):
    server = start_server({"robot_file": "panda", "max_points": 3})
    assert_still_serves(client, server, panda_dynamics)
    q, qd, qdd = motion(4, 7)
    reason = "the request has 4 points: 3 at most are accepted"
    with pytest.raises(InvalidInputError, match=reason):
        inverse_batch(client, server, PANDA, q, qd, qdd)
    for request in (inverse_request(PANDA, q, qd, qdd), direct_request(PANDA, q, qd, qdd)):
        response = call_service(client, server, request)
        assert not response.success and reason in response.message and "max_points" in response.message
    assert client.set_parameters(server, {"max_points": 4}).successful
    inverse_batch(client, server, PANDA, q, qd, qdd)
    refused = client.set_parameters(server, {"max_points": 0})
    assert not refused.successful and "max_points is 0: a whole number from 1 on is needed" in refused.reason
    inverse_batch(client, server, PANDA, q, qd, qdd)


def test_client_refuses_arrays_that_do_not_fit(client, panda):
    with pytest.raises(InvalidInputError, match="numbers of points differ: positions has 3, velocities has 2"):
        inverse_batch(client, panda, PANDA, Q, QD[:2], QDD)
    with pytest.raises(InvalidInputError, match="InverseDynamicsBatch has no field 'effort'"):
        inverse_batch(client, panda, PANDA, Q, QD, QDD, effort=QDD)
    with pytest.raises(InvalidInputError, match=r"positions has shape \(1, 3, 7\)"):
        inverse_batch(client, panda, PANDA, Q[None], QD, QDD)


@pytest.mark.parametrize("points_per_request", [1, 40, 100, 101])
def test_client_sends_many_points_in_several_requests(points_per_request, client, panda, panda_dynamics):
    q, qd, qdd = motion(101, 7)
    wrenches = {"panda_link8": np.random.default_rng(4).normal(size=(101, 6)), "panda_link3": np.ones(6)}
    arguments = {"external_wrenches": wrenches, "points_per_request": points_per_request, "reaction_wrenches": True}
    result = inverse_batch(client, panda, PANDA, q, qd, qdd[0], **arguments)
    expected = panda_dynamics.solve(q, qd, qdd=qdd[0], external_wrenches=wrenches)
    assert_same(result["efforts"], expected.efforts)
    assert_same(result["reactions"], expected.reactions)
    spoiled = with_value(q, (100, 3), np.nan)
    place = "" if points_per_request > 100 else f" from point {100 // points_per_request * points_per_request} on"
    with pytest.raises(InvalidInputError, match=rf"refused the request{place}.*joint 'panda_joint4'\) is nan"):
        inverse_batch(client, panda, PANDA, spoiled, qd, qdd[0], **arguments)
    assert_same(inverse_batch(client, panda, PANDA, q, qd, qdd)["efforts"], panda_dynamics.inverse(q, qd, qdd))


def test_reactions_of_both_forms_agree(client, panda):
    request = inverse_request(PANDA, Q, QD, QDD, reaction_wrenches=True)
    by_messages = call_successfully(client, panda, request)
    result = inverse_batch(client, panda, PANDA, Q, QD, QDD, reaction_wrenches=True)
    expected = np.array([wrench_values(reaction) for reaction in by_messages.reactions]).reshape(3, 8, 6)
    assert_same(result["reactions"], expected)
