"""Elastic joints and robots from MDH tables over ROS 2: a real server returns the results of the library."""

import numpy as np
import pytest
from nodes.service_requests import (
    base_accelerations,
    base_trajectory,
    call_service,
    call_successfully,
    direct_request,
    equilibrium_request,
    field,
    inverse_request,
    terms_request,
    twist,
    wrench,
    wrench_values,
)
from scipy.spatial.transform import Rotation

from robot_dynamics import Base, Dynamics, Inertia, load_robot
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml

FIXED = Dynamics(load_robot("manutec_r3"), compiled=False)
# what stands on the ground has no mass in the table; free to move it must have some
PEDESTAL = {"payload.link": "base", "payload.mass": 200.0, "payload.inertia": [20.0, 0.0, 0.0, 20.0, 0.0, 20.0]}
MOVING = Dynamics(
    load_robot("manutec_r3", moving_base=True).with_payload("base", Inertia(200.0, np.zeros(3), 20 * np.eye(3))),
    compiled=False,
)
ORDER = np.random.default_rng(5).permutation(9)
JOINTS = [FIXED.joint_names[k] for k in ORDER]
SPRINGS = [JOINTS.index(name) for name in FIXED.unactuated_joint_names]
BACK = np.argsort(ORDER)  # from the asker's order to the robot's
Q, QD, QDD = np.random.default_rng(6).uniform(-1, 1, (3, 4, 9)) * np.array([1, 1, 3])[:, None, None]
Q[:, SPRINGS] *= 1e-3
QDD[:, SPRINGS] = np.nan


@pytest.fixture(scope="module")
def manutec(start_module_server):
    return start_module_server({"robot_file": "manutec_r3"})


@pytest.fixture(scope="module")
def flying(start_module_server):
    return start_module_server({"robot_file": "manutec_r3", "base": "moving", **PEDESTAL})


def in_library(dynamics, base=None, wrenches=None):
    return dynamics.solve(Q[:, BACK], QD[:, BACK], qdd=QDD[:, BACK], base=base, external_wrenches=wrenches)


@pytest.mark.parametrize("left_open", [np.nan, 0.0])
def test_inverse_dynamics_returns_spring_accelerations_and_motor_efforts(manutec, client, left_open):
    inputs = np.nan_to_num(QDD, nan=left_open)
    load = wrench("load", [3, -5, -150, 1, 0, 2])
    result = call_successfully(client, manutec, inverse_request(JOINTS, Q, QD, inputs, external_wrenches=[load]))
    expected = in_library(FIXED, wrenches={"load": [3, -5, -150, 1, 0, 2]})
    assert list(result.trajectory.joint_names) == JOINTS
    np.testing.assert_array_equal(field(result.trajectory, "accelerations"), expected.accelerations[:, ORDER])
    np.testing.assert_array_equal(field(result.trajectory, "effort"), expected.efforts[:, ORDER])
    assert not field(result.trajectory, "effort")[:, SPRINGS].any()
    assert np.abs(field(result.trajectory, "accelerations")[:, SPRINGS]).min() > 0


def test_direct_dynamics_inverts_inverse_dynamics(manutec, client):
    expected = in_library(FIXED)
    efforts = expected.efforts[:, ORDER].copy()
    efforts[:, SPRINGS] = np.nan
    result = call_successfully(client, manutec, direct_request(JOINTS, Q, QD, efforts))
    np.testing.assert_allclose(field(result.trajectory, "accelerations"), expected.accelerations[:, ORDER], rtol=1e-8)


def base_of(rng, count=4):
    quaternions = Rotation.random(count, random_state=3).as_quat()
    positions, twists = rng.uniform(-1, 1, (count, 3)), rng.uniform(-1, 1, (count, 6))
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = Rotation.from_quat(quaternions).as_matrix(), positions
    return quaternions, positions, twists, poses


def test_elastic_joints_on_a_moving_base(flying, client):
    quaternions, positions, twists, poses = base_of(np.random.default_rng(7))
    base = base_trajectory(quaternions, positions, twists)
    result = call_successfully(client, flying, inverse_request(JOINTS, Q, QD, QDD, base=base))
    expected = in_library(MOVING, Base(poses, twists))
    np.testing.assert_array_equal(field(result.trajectory, "effort"), expected.efforts[:, ORDER])
    np.testing.assert_array_equal(base_accelerations(result.base), expected.base_acceleration)


def test_equilibrium_under_gravity_and_a_wrench(manutec, client):
    inputs = equilibrium_request(JOINTS, Q, external_wrenches=[wrench("load", [0, 0, -150, 0, 0, 0], stamp=2)])
    inputs.reaction_wrenches = True
    result = call_successfully(client, manutec, inputs)
    wrenches = np.zeros((4, 6))
    wrenches[2, 2] = -150
    expected = FIXED.equilibrium(Q[:, BACK], external_wrenches={"load": wrenches})
    np.testing.assert_array_equal(field(result.trajectory, "positions"), expected.positions[:, ORDER])
    np.testing.assert_array_equal(field(result.trajectory, "effort"), expected.efforts[:, ORDER])
    assert not field(result.trajectory, "velocities").any() and not field(result.trajectory, "accelerations").any()
    assert list(result.stable) == [True] * 4
    ground = wrench_values(result.reactions[0])
    np.testing.assert_array_equal(ground, expected.reactions[0, 0])
    np.testing.assert_allclose(np.linalg.norm(ground[:3]), 9.81 * 116.8)


def test_equilibrium_on_a_base_at_rest_or_in_motion(flying, client):
    quaternions, positions, twists, poses = base_of(np.random.default_rng(8))
    held_base = base_trajectory(quaternions, positions, np.zeros((4, 6)))
    expected = MOVING.equilibrium(Q[:, BACK], base=Base(poses))
    for velocities in ([twist(np.zeros(6))], []):
        for base_point in held_base.points:
            base_point.velocities = velocities
        result = call_successfully(client, flying, equilibrium_request(JOINTS, Q, base=held_base))
        np.testing.assert_array_equal(field(result.trajectory, "positions"), expected.positions[:, ORDER])
    base_motion = np.random.default_rng(9).uniform(-3, 3, (4, 6))
    moved = base_trajectory(quaternions, positions, np.zeros((4, 6)), base_motion)
    result = call_successfully(client, flying, equilibrium_request(JOINTS, Q, base=moved))
    expected = MOVING.equilibrium(Q[:, BACK], base=Base(poses, acceleration=base_motion))
    np.testing.assert_array_equal(field(result.trajectory, "effort"), expected.efforts[:, ORDER])
    turning = equilibrium_request(JOINTS, Q, base=base_trajectory(quaternions, positions, twists))
    assert "an equilibrium is at rest" in call_service(client, flying, turning).message


def test_terms_have_the_springs_alone(manutec, client):
    result = call_successfully(client, manutec, terms_request(JOINTS, Q[0], QD[0]))
    expected = FIXED.elasticity(Q[0, BACK], QD[0, BACK])[ORDER]
    np.testing.assert_array_equal(result.elasticity, expected)
    assert np.flatnonzero(result.elasticity).tolist() == sorted(SPRINGS)


def with_values_of_springs(field_name, value):
    """A request with a value of an unactuated joint."""
    inputs = QDD.copy() if field_name == "accelerations" else np.zeros((4, 9))
    inputs[1, SPRINGS[0]] = value
    make = inverse_request if field_name == "accelerations" else direct_request
    return make(JOINTS, Q, QD, inputs)


def with_velocities():
    request = equilibrium_request(JOINTS, Q)
    request.trajectory.points[1].velocities = [0.0] * 9
    return request


BAD = {
    "acceleration of a spring": (with_values_of_springs("accelerations", 0.5), r"joint 'spring_1': no motor drives it"),
    "effort of a spring": (with_values_of_springs("effort", 0.5), r"joint 'spring_1': no motor drives it"),
    "nan of a motor": (inverse_request(JOINTS, Q, QD, QDD * np.nan), "a finite number is needed"),
    "nan of a position": (inverse_request(JOINTS, Q + QDD, QD, QDD), "a finite number is needed"),
    "velocities at rest": (with_velocities(), "points[1].velocities has values: the service computes it"),
    "a spring left out": (inverse_request(JOINTS[:8], Q[:, :8], QD[:, :8], QDD[:, :8]), "joints missing"),
}


@pytest.mark.parametrize("case", BAD)
def test_request_with_values_of_unactuated_joints_is_refused(case, manutec, client):
    request, reason = BAD[case]
    response = call_service(client, manutec, request)
    assert not response.success and reason in response.message, response.message


@pytest.mark.parametrize("form", ["yaml", "par"])
def test_server_reads_an_mdh_table_or_a_par_as_text_and_as_file(form, client, start_server, tmp_path):
    if form == "yaml":
        text = write_mdh_yaml(load_robot("rx90"))
        names = [f"joint_{k}" for k in range(1, 7)]
    else:
        rows = {"ant": "0,1", "sigma": "0,1", "b": "0,0", "d": "0,0.5", "r": "0,r2", "gamma": "0,0", "alpha": "0,pi/2",
                "theta": "th1,0", "M": "1,2", "ZZ": "0.1,0.2", "MX": "0.3,0"}  # fmt: skip
        text = "NL = 2\nNJ = 2\n" + "\n".join(f"{key} = {{{row}}}" for key, row in rows.items())
        names = ["joint_1", "joint_2"]
    path = tmp_path / f"robot.{form}"
    path.write_text(text)
    dynamics = Dynamics(load_robot(text), compiled=False)
    q, qd, qdd = np.random.default_rng(1).uniform(-1, 1, (3, 2, len(names)))
    server = start_server({"robot_description": text, "robot_path": [str(tmp_path)]})
    for _ in range(2):
        result = call_successfully(client, server, inverse_request(names, q, qd, qdd))
        np.testing.assert_array_equal(field(result.trajectory, "effort"), dynamics.inverse(q, qd, qdd))
        changed = client.set_parameters(server, {"robot_description": "", "robot_file": str(path)})
        assert changed.successful, changed.reason
    changed = client.set_parameters(server, {"gravity": [0.0, 0.0, -1.62]})
    assert changed.successful, changed.reason
    result = call_successfully(client, server, inverse_request(names, q, qd, qdd))
    moon = Dynamics(load_robot(text, gravity=(0, 0, -1.62)), compiled=False)
    np.testing.assert_array_equal(field(result.trajectory, "effort"), moon.inverse(q, qd, qdd))
    changed = client.set_parameters(server, {"gravity": ""})
    assert changed.successful, changed.reason


FOLLOWED = """robot: followed
joints:
  - {joint: sprung, link: one, role: elastic, spring: {stiffness: 40}, mass: 1, centre_of_mass: [0.2, 0, 0]}
  - {joint: follower, link: two, mdh: {d: 0.4}, mimic: {joint: sprung, multiplier: -0.5}, mass: 1}
  - {joint: driven, link: three, mdh: {alpha: pi/2, d: 0.3}, mass: 1, centre_of_mass: [0, 0.1, 0]}
"""


def test_mimic_of_an_elastic_joint_may_be_nan_as_well(client, start_server):
    """nan stands for the acceleration of the spring and of its mimic; both are in the response."""
    server, dynamics = start_server({"robot_description": FOLLOWED}), Dynamics(load_robot(FOLLOWED), compiled=False)
    names, nan = ["driven", "follower", "sprung"], np.nan
    q, qd, qdd = [[0.3, -0.1, 0.2]], [[0.1, -0.25, 0.5]], [[1.0, nan, nan]]
    result = call_successfully(client, server, inverse_request(names, q, qd, qdd))
    expected = dynamics.solve([0.2, 0.3], [0.5, 0.1], qdd=[nan, 1.0])
    sprung = expected.accelerations[0]
    np.testing.assert_allclose(field(result.trajectory, "accelerations"), [[1.0, -0.5 * sprung, sprung]], rtol=1e-12)
    np.testing.assert_allclose(field(result.trajectory, "effort"), [[expected.efforts[1], 0, 0]], rtol=1e-12)
    refused = call_service(client, server, inverse_request(names, q, qd, [[nan, nan, nan]]))
    assert not refused.success and "a finite number is needed" in refused.message
