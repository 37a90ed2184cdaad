"""Kinematics of frames and whole-body momentum and energy over real services: those of the library, and refusals."""

import numpy as np
import pytest
from nodes.service_requests import PANDA, base_trajectory, call_service, call_successfully, point, twist_values
from scipy.spatial.transform import Rotation

from robot_dynamics import Base, Dynamics, load_robot
from robot_dynamics_interfaces.srv import FrameKinematics, WholeBody

ORDER = [6, 0, 5, 1, 4, 2, 3]  # joints of the requests
Q, QD = np.random.default_rng(2).uniform(-1, 1, (2, 7))


def request_of(kind, names, q, qd=(), **others):
    return kind.Request(joint_names=list(names), state=point(0, positions=q, velocities=qd), **others)


def vector(message):
    return np.array([message.x, message.y, message.z])


def pose_matrix(message):
    matrix = np.eye(4)
    turn = message.orientation
    matrix[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    matrix[:3, 3] = vector(message.position)
    return matrix


def assert_frames(response, dynamics, axes, q, qd, columns, base=None):
    jacobians = np.reshape(response.jacobians, (len(response.frames), 6, len(response.joint_names)))
    for k, name in enumerate(response.frames):
        frame = dynamics.frame(name)
        pairs = [
            (pose_matrix(response.poses[k]), frame.pose(q, base=base)),
            (twist_values(response.twists[k]), frame.twist(q, qd, axes=axes, base=base)),
            (
                twist_values(response.bias_accelerations[k]),
                frame.bias_acceleration(q, qd, axes=axes, base=base),
            ),
            (jacobians[k], frame.jacobian(q, axes=axes, base=base)[:, columns]),
        ]
        for actual, expected in pairs:
            np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-11)


def assert_whole_body(response, dynamics, q, qd, columns, base=None):
    body = dynamics.whole_body
    momentum, bias = body.centroidal_momentum(q, qd, base=base), body.centroidal_momentum_bias(q, qd, base=base)
    pairs = [
        (response.mass, body.mass),
        (vector(response.centre_of_mass), body.centre_of_mass(q, base=base)),
        (vector(response.centre_of_mass_velocity), body.centre_of_mass_velocity(q, qd, base=base)),
        (np.r_[vector(response.linear_momentum), vector(response.angular_momentum)], momentum),
        (np.r_[vector(response.momentum_bias.force), vector(response.momentum_bias.torque)], bias),
        (
            np.reshape(response.momentum_matrix, (6, -1)),
            body.centroidal_momentum_matrix(q, base=base)[:, columns],
        ),
        (response.kinetic_energy, body.kinetic_energy(q, qd, base=base)),
        (response.gravitational_energy, body.gravitational_energy(q, base=base)),
        (response.elastic_energy, body.elastic_energy(q)),
    ]
    for actual, expected in pairs:
        np.testing.assert_allclose(actual, expected, rtol=1e-11, atol=1e-11)


def test_panda_kinematics_are_those_of_the_library(client, panda, panda_dynamics):
    names = [PANDA[k] for k in ORDER]
    request = request_of(FrameKinematics, names, Q[ORDER], QD[ORDER], frames=["panda_link8", "panda_link3"])
    for request.world_axes in (False, True):
        response = call_successfully(client, panda, request)
        assert response.joint_names == names and response.frames == ["panda_link8", "panda_link3"]
        assert_frames(response, panda_dynamics, "world" if request.world_axes else "frame", Q, QD, ORDER)
    at_rest = call_successfully(client, panda, request_of(FrameKinematics, PANDA, Q))
    assert at_rest.frames == [frame.name for frame in panda_dynamics.robot.frames]
    assert_frames(at_rest, panda_dynamics, "frame", Q, np.zeros(7), range(7))
    response = call_successfully(client, panda, request_of(WholeBody, names, Q[ORDER], QD[ORDER]))
    assert_whole_body(response, panda_dynamics, Q, QD, ORDER)


def test_kinematics_of_a_moving_base(client, start_server):
    dynamics = Dynamics(load_robot("free_flying_arm"), compiled=False)
    flyer = start_server({"robot_file": "free_flying_arm"})
    turn, position, twist = Rotation.from_rotvec([0.3, -0.5, 0.9]), [0.1, -0.4, 2.0], [0.2, -0.1, 0.4, 0.5, 0.3, -0.7]
    moving = base_trajectory([turn.as_quat()], [position], [twist]).points[0]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn.as_matrix(), position
    base, names, q, qd = Base(pose, twist), dynamics.joint_names, Q[:6], QD[:6]
    frames = [dynamics.robot.base_link, dynamics.robot.links[-1].name]
    request = request_of(FrameKinematics, names, q, qd, base=moving, frames=frames, world_axes=True)
    response = call_successfully(client, flyer, request)
    assert response.joint_names[:6] == [f"base.{kind}.{axis}" for kind in ("linear", "angular") for axis in "xyz"]
    assert_frames(response, dynamics, "world", q, qd, range(12), base)
    response = call_successfully(client, flyer, request_of(WholeBody, names, q, qd, base=moving))
    assert_whole_body(response, dynamics, q, qd, range(12), base)
    moving.velocities = []
    response = call_successfully(client, flyer, request_of(WholeBody, names, q, base=moving))
    assert response.kinetic_energy == 0 and vector(response.linear_momentum).tolist() == [0, 0, 0]


def test_kinematics_of_a_closed_loop_from_its_motor(client, start_server):
    dynamics = Dynamics(load_robot("four_bar"), compiled=False)
    server = start_server({"robot_file": "four_bar"})
    names, q, qd = dynamics.joint_names, [0.4], [1.3]
    response = call_successfully(client, server, request_of(FrameKinematics, names, q, qd))
    assert response.joint_names == list(names)
    assert_frames(response, dynamics, "frame", q, qd, [0])
    response = call_successfully(client, server, request_of(WholeBody, names, q, qd))
    assert_whole_body(response, dynamics, q, qd, [0])


@pytest.mark.parametrize("kind", [FrameKinematics, WholeBody])
def test_invalid_requests_are_refused(client, panda, kind):
    def refusal(**others):
        names = others.pop("names", PANDA)
        response = call_service(client, panda, request_of(kind, names, others.pop("q", Q), **others))
        assert not response.success
        return response.message

    assert "joints missing: 'panda_joint7'" in refusal(names=PANDA[:6], q=Q[:6])
    assert "state.positions[2] is nan" in refusal(q=[0, 0, np.nan, 0, 0, 0, 0])
    assert "state.velocities has 2 values" in refusal(qd=[1.0, 2.0])
    assert "leave the field base empty" in refusal(base=base_trajectory([[0, 0, 0, 1]], [[0] * 3], [[0] * 6]).points[0])
    request = request_of(kind, PANDA, Q)
    request.state.effort = [0.0] * 7
    assert "state.effort has values" in call_service(client, panda, request).message
    if kind is FrameKinematics:
        assert "frames[1]: unknown link 'hand'" in refusal(frames=["panda_link8", "hand"])
