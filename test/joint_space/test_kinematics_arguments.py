"""Arguments of the kinematics of frames and of the whole body: reference frames, refusals, and what they never need."""

import pickle

import numpy as np
import pytest
from peers.real_robots import without_inertials

from robot_dynamics import Base, Dynamics, InvalidInputError, load_robot, shipped_robots
from robot_dynamics.model.formats.urdf.reader import read_urdf

Q, QD = np.random.default_rng(4).uniform(-1, 1, (2, 7))
FLYER = Dynamics(load_robot("free_flying_arm"), compiled=False)


@pytest.fixture(scope="module")
def panda():
    return Dynamics(load_robot("panda"), compiled=False)


def test_poses_relative_to_another_frame_compose(panda):
    hand = panda.frame("panda_link8")
    relative = hand.pose(np.stack([Q, QD]), relative_to="panda_link3")
    for q, pose in zip((Q, QD), relative, strict=True):
        np.testing.assert_allclose(panda.frame("panda_link3").pose(q) @ pose, hand.pose(q), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(hand.pose(Q, relative_to=panda.robot.base_link), hand.pose(Q))
    np.testing.assert_array_equal(panda.link_pose("panda_link8", Q), hand.pose(Q))


def test_frames_of_a_moving_base_need_its_state_where_they_depend_on_it():
    q = Q[:6]
    frame, base = FLYER.frame("arm_wrist_3_link"), Base(twist=[1, 2, 3, 4, 5, 6])
    assert frame.jacobian(q).shape == (6, 12)
    assert frame.pose(q, relative_to=FLYER.robot.base_link).shape == (4, 4)
    of_base = FLYER.frame(FLYER.robot.base_link)
    np.testing.assert_allclose(of_base.twist(q, QD[:6], base=base), base.twist, rtol=0, atol=1e-14)
    for call in (
        lambda: frame.pose(q),
        lambda: frame.jacobian(q, axes="world"),
        lambda: frame.twist(q, QD[:6]),
        lambda: FLYER.whole_body.centre_of_mass(q),
        lambda: FLYER.whole_body.kinetic_energy(q, QD[:6]),
    ):
        with pytest.raises(InvalidInputError, match="the base of 'free_flying_arm' moves: give its state"):
            call()
    with pytest.raises(InvalidInputError, match="the acceleration of the moving base is needed"):
        frame.acceleration(q, QD[:6], QD[:6], base=base)
    with pytest.raises(InvalidInputError, match="leave it out of Base"):
        frame.bias_acceleration(q, QD[:6], base=Base(acceleration=np.zeros(6)))


def test_invalid_arguments_are_refused(panda):
    hand, body = panda.frame("panda_link8"), panda.whole_body
    for call, reason in (
        (lambda: panda.frame("hand"), "unknown link 'hand'"),
        (lambda: hand.jacobian(Q, axes="base"), 'axes are "frame" or "world", not \'base\''),
        (lambda: hand.jacobian(Q[:6]), r"positions has shape \(6,\)"),
        (lambda: hand.jacobian([np.nan] * 7), r"positions\[0\] is nan"),
        (lambda: hand.twist(np.zeros((2, 7)), np.zeros((3, 7))), "batches of"),
        (lambda: hand.pose(Q, base=Base()), "the base of 'panda' is fixed"),
        (lambda: hand.jacobian(Q, base=Base()), "the base of 'panda' is fixed"),
        (lambda: hand.pose(Q, relative_to="hand"), "unknown link 'hand'"),
        (lambda: body.centroidal_momentum(Q, np.full(7, 1e308) * QD), "not a finite number"),
        (lambda: panda.compile("jacobian"), "jacobian is that of a frame: give its name"),
        (lambda: panda.compile("inverse", frame="panda_link8"), "inverse is not that of a frame: leave it out"),
        (lambda: panda.compile("pose", frame="hand"), "unknown link 'hand'"),
    ):
        with pytest.raises(InvalidInputError, match=reason):
            call()


def test_a_robot_without_masses_has_no_centre_of_mass():
    massless = Dynamics(read_urdf(without_inertials(shipped_robots()["ur5e"].read_text())), compiled=False)
    body, q, qd = massless.whole_body, Q[:6], QD[:6]
    assert body.mass == body.gravitational_energy(q) == body.kinetic_energy(q, qd) == body.elastic_energy(q) == 0
    for call in (
        lambda: body.centre_of_mass(q),
        lambda: body.centroidal_momentum_matrix(q),
        lambda: massless.compile("centre_of_mass"),
    ):
        with pytest.raises(InvalidInputError, match="no mass that can move"):
            call()
    assert massless.frame("tool0").jacobian(q).shape == (6, 6)


def test_a_robot_without_joints_has_empty_jacobians():
    body = '<link name="body"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'  # fmt: skip # noqa: E501
    rigid = Dynamics(read_urdf(f'<robot name="rigid">{body}</robot>', moving_base=True))
    base = Base(twist=[0, 0, 1, 0, 0, 2])
    np.testing.assert_array_equal(rigid.frame("body").jacobian([]), np.eye(6))
    assert rigid.whole_body.kinetic_energy([], [], base=base) == 0.5 * 2 * 1 + 0.5 * 1 * 4
    fixed = Dynamics(read_urdf(f'<robot name="rigid">{body}</robot>'))
    assert fixed.frame("body").jacobian([]).shape == (6, 0)
    assert fixed.whole_body.mass == 0


def test_objects_are_copied_with_their_robot(panda):
    hand, body = (pickle.loads(pickle.dumps(part)) for part in (panda.frame("panda_link8"), panda.whole_body))
    np.testing.assert_array_equal(hand.pose(Q), panda.frame("panda_link8").pose(Q))
    assert body.kinetic_energy(Q, QD) == panda.whole_body.kinetic_energy(Q, QD)
