"""Parallel robots in platform coordinates: second solution against first, multipliers, Pinocchio and virtual work."""

import numpy as np
import pytest
from peers.first_solution import attached
from peers.gough_stewart import gough_stewart
from peers.maximal_coordinates import MaximalCoordinates
from peers.pinocchio_loops import PinocchioLoops
from scipy.spatial.transform import Rotation

from robot_dynamics import Dynamics, InvalidInputError, SingularModelError, load_robot
from robot_dynamics.parallel.platform_dynamics import coordinates_from_pose, twist_drift, twist_matrix

RNG = np.random.default_rng(1)
ROBOT = gough_stewart()
DYNAMICS = Dynamics(ROBOT)
MOTORS = [ROBOT.joint_numbers[name] for name in DYNAMICS.joint_names]


def poses(count, rng=RNG):
    """Return poses within 0.1 m and 0.3 rad of the initial pose."""
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, 3] = np.array([0, 0, 0.8]) + rng.uniform(-0.1, 0.1, (count, 3))
    matrices[:, :3, :3] = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, (count, 3))).as_matrix()
    return matrices


POSES = poses(1000)
TWISTS, ACCELERATIONS = RNG.uniform(-1, 1, (2, 1000, 6))


@pytest.mark.slow
def test_leg_lengths_agree_with_closed_forms():
    """Leg lengths and platform poses by hand."""
    q = DYNAMICS.platform.joint_positions(POSES)
    for k in range(6):
        low, high = (ROBOT.joints[3 * k].placement[:3, 3], DYNAMICS.link_pose(f"rod{k}", q)[:, :3, 3])
        lengths = np.linalg.norm(high - low, axis=1)
        np.testing.assert_allclose(q[:, ROBOT.joint_numbers[f"leg{k}"]], lengths, atol=1e-12)
    np.testing.assert_allclose(DYNAMICS.link_pose("platform", q), POSES, atol=1e-12)


def test_direct_geometry_inverts_inverse_geometry():
    q = DYNAMICS.platform.joint_positions(POSES)
    np.testing.assert_allclose(DYNAMICS.platform.pose(q[:, MOTORS]), POSES, atol=1e-10)


def test_joint_motion_is_the_derivative_along_a_platform_motion():
    """Positions of all joints along a screw motion with this twist: first and second differences."""
    pose, twist = POSES[0], TWISTS[0]
    h = 1e-4

    def moved(t):
        actual = pose.copy()
        R = pose[:3, :3]
        actual[:3, :3] = R @ Rotation.from_rotvec(t * twist[3:]).as_matrix()
        actual[:3, 3] = pose[:3, 3] + t * R @ twist[:3]  # the origin moves on a straight line, its acceleration is zero
        return DYNAMICS.platform.joint_positions(actual)

    q, qd, qdd = DYNAMICS.platform.joint_motion(pose, twist, np.zeros(6))
    before, after = moved(-h), moved(h)
    np.testing.assert_allclose((after - before) / (2 * h), qd, atol=1e-6)
    np.testing.assert_allclose((after - 2 * q + before) / h**2, qdd, atol=1e-5)


@pytest.mark.slow
def test_direct_model_inverts_the_inverse_model():
    efforts = DYNAMICS.platform.inverse(POSES, TWISTS, ACCELERATIONS)
    actual = DYNAMICS.platform.direct(POSES, TWISTS, efforts)
    assert np.abs(actual - ACCELERATIONS).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("leg", [0, 3])
def test_second_solution_agrees_with_the_first(leg):
    """The platform on one of the legs, loops through all others: 1000 poses and twists, to 1e-10 of the efforts."""
    first = Dynamics(attached(ROBOT, leg))
    q, qd, qdd = DYNAMICS.platform.joint_motion(POSES, TWISTS, ACCELERATIONS)
    efforts = DYNAMICS.platform.inverse(POSES, TWISTS, ACCELERATIONS)
    assert first.joint_names == DYNAMICS.joint_names
    seed = np.full((1000, len(first.all_joint_names)), np.nan)
    for column, name in enumerate(first.all_joint_names):
        if name in ROBOT.joint_numbers:
            seed[:, column] = q[:, ROBOT.joint_numbers[name]]
    R = np.swapaxes(DYNAMICS.link_pose(f"rod{leg}", q)[:, :3, :3], 1, 2) @ POSES[:, :3, :3]
    # three joints about z, then x, then y of the frame before: Rz(a) C Rz(b) C Rz(c), with C the cyclic turn
    C = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    for sample in range(1000):
        seed[sample, -3:] = _angles(R[sample], C)
    actual = first.inverse(seed, qd[:, MOTORS], qdd[:, MOTORS])
    assert np.abs(actual - efforts).max() < 1e-10 * np.abs(efforts).max()
    closed = first.expand_positions(seed)
    for name in ("u0", "v5", "leg2"):
        np.testing.assert_allclose(
            closed[:, first.all_joint_names.index(name)], q[:, ROBOT.joint_numbers[name]], atol=1e-10
        )


def _angles(R, C):
    """Return a, b, c with Rz(a) C Rz(b) C Rz(c) = R."""
    # Rz(a) Rx(b) Ry(c) C C = R, as C Rz C' = Rx and C Rx C' = Ry
    return Rotation.from_matrix(R @ C @ C.T @ np.linalg.inv(C @ C)).as_euler("ZXY")


@pytest.mark.slow
def test_both_models_agree_with_multipliers_and_pinocchio():
    maximal, pinocchio = MaximalCoordinates(ROBOT), PinocchioLoops(ROBOT)
    q, qd, qdd = DYNAMICS.platform.joint_motion(POSES, TWISTS, ACCELERATIONS)
    efforts = DYNAMICS.platform.inverse(POSES, TWISTS, ACCELERATIONS)
    prescribed = np.full(q.shape, np.nan)
    prescribed[:, MOTORS] = qdd[:, MOTORS]
    for k in range(100):
        expected = maximal.inverse(q[k], qd[k], prescribed[k])
        assert np.abs(expected.efforts[MOTORS] - efforts[k]).max() < 1e-8 * np.abs(efforts[k]).max()
        assert np.abs(expected.accelerations - qdd[k]).max() < 1e-8 * np.abs(qdd[k]).max()
    for k in range(20):
        actual = pinocchio.inverse(q[k], qd[k], prescribed[k]).efforts[MOTORS]
        assert np.abs(actual - efforts[k]).max() < 1e-6 * np.abs(efforts[k]).max()


def test_jacobian_maps_motor_rates_to_the_twist_and_efforts_to_the_wrench():
    """V = J_p q̇, and a force on the platform at rest changes the efforts by -J_pᵀ w."""
    q, qd, _ = DYNAMICS.platform.joint_motion(POSES, TWISTS)
    J = DYNAMICS.platform.jacobian(q)
    np.testing.assert_allclose((J @ qd[:, MOTORS, None])[..., 0], TWISTS, atol=1e-10)
    wrench = np.array([3.0, -2, 5, 0.5, 1, -0.7])
    held = DYNAMICS.platform.inverse(POSES[:50])
    loaded = DYNAMICS.platform.inverse(POSES[:50], external_wrenches={"platform": wrench})
    np.testing.assert_allclose(loaded - held, -np.swapaxes(J[:50], 1, 2) @ wrench, atol=1e-9)


def test_coordinates_and_rates_agree_with_pose_and_twist():
    x = coordinates_from_pose(POSES)
    h, rates = 1e-6, RNG.uniform(-1, 1, (1000, 6))

    def pose_at(x):
        actual = np.tile(np.eye(4), (len(x), 1, 1))
        actual[:, :3, :3] = Rotation.from_euler("ZYX", x[:, 3:]).as_matrix()
        actual[:, :3, 3] = x[:, :3]
        return actual

    np.testing.assert_allclose(pose_at(x), POSES, atol=1e-12)
    step = np.linalg.inv(pose_at(x - h * rates)) @ pose_at(x + h * rates)
    rotation_rates = Rotation.from_matrix(step[:, :3, :3]).as_rotvec() / (2 * h)
    twist = (twist_matrix(x) @ rates[..., None])[..., 0]
    np.testing.assert_allclose(rotation_rates, twist[:, 3:], atol=1e-8)
    later, sooner = ((twist_matrix(x + t * rates) @ rates[..., None])[..., 0] for t in (h, -h))
    np.testing.assert_allclose((later - sooner)[:, 3:] / (2 * h), twist_drift(x, rates)[:, 3:], atol=1e-7)


def test_invalid_and_singular_poses_are_refused():
    far = np.eye(4)
    far[2, 3] = 0.8
    half = far.copy()
    half[:3, :3] = Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix()
    flat = gough_stewart()
    with pytest.raises(InvalidInputError, match=r"pose of the platform has shape"):
        DYNAMICS.platform.inverse(np.eye(3))
    with pytest.raises(InvalidInputError, match="has no platform"):
        _ = Dynamics(load_robot("five_bar")).platform
    with pytest.raises((SingularModelError, InvalidInputError), match=r"condition number|singular|mode"):
        # a platform of the base's shape turned by a quarter: the six legs are tangent to a cylinder (Fichter)
        Dynamics(flat).platform.direct(half, np.zeros(6), np.zeros(6))
