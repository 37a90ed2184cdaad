"""Elastic joints in the legs of parallel modules, in coordinates of their platforms: direct and inverse model and
equilibrium against multipliers on maximal coordinates and Pinocchio."""

import numpy as np
import pytest
from peers.loop_states import loop_gaps
from peers.maximal_coordinates import MaximalCoordinates
from peers.pinocchio_loops import PinocchioLoops
from peers.planar_stack import planar_stack
from peers.platform_states import random_states

from robot_dynamics import Dynamics, InvalidInputError, SingularModelError, load_robot
from robot_dynamics.results import JointMotion

COUNT = 30
GEARS, MOUNTS = (Dynamics(load_robot(planar_stack(springs)), compiled=False) for springs in ("gears", "mounts"))
BOTH = pytest.mark.parametrize("dynamics", [GEARS, MOUNTS], ids=["gears", "mounts"])


def states(dynamics, count=COUNT):
    return random_states(dynamics, count, np.random.default_rng(4), reach=0.05)


def columns_of(dynamics, names):
    return [dynamics.joint_names.index(name) for name in names]


def embed(dynamics, values):
    return dynamics.embed_efforts(values)


@BOTH
def test_deflections_are_part_of_the_state_and_the_motors_follow(dynamics):
    poses, twists, _, other_joints = states(dynamics)
    assert {*dynamics.unactuated_joint_names} < {*dynamics.platform.other_joint_names}
    q, qd, _ = dynamics.platform.joint_motion(poses, twists, other_joints=other_joints)
    numbers = [dynamics.robot.joint_numbers[name] for name in dynamics.platform.other_joint_names]
    np.testing.assert_array_equal(q[:, numbers], other_joints[0])
    np.testing.assert_allclose(qd[:, numbers], other_joints[1], atol=1e-12)
    assert max(np.abs(loop_gaps(dynamics.robot, sample)).max() for sample in q) < 1e-11
    for link, pose in dynamics.platform.pose(q).items():
        np.testing.assert_allclose(pose, poses[link], atol=1e-12)
    default_positions = dynamics.platform.joint_positions(poses)  # default: the initial positions of the description
    np.testing.assert_array_equal(default_positions[:, numbers], np.zeros((COUNT, len(numbers))))


@pytest.mark.slow
@BOTH
def test_direct_model_agrees_with_multipliers_and_pinocchio(dynamics):
    poses, twists, _, other_joints = states(dynamics)
    efforts = np.random.default_rng(5).uniform(-20, 20, (COUNT, len(dynamics.joint_names)))
    efforts[:, columns_of(dynamics, dynamics.unactuated_joint_names)] = 0
    result = dynamics.platform.solve(poses, twists, efforts=efforts, other_joints=other_joints)
    actual = dynamics.platform.direct(poses, twists, efforts, other_joints=other_joints)
    peers = MaximalCoordinates(dynamics.robot), PinocchioLoops(dynamics.robot)
    for k in range(COUNT):
        for peer, tolerance in zip(peers[: 1 if k > 3 else 2], (1e-8, 1e-6), strict=False):
            expected = peer.direct(result.motion.positions[k], result.motion.velocities[k],
                                   embed(dynamics, efforts[k])).accelerations  # fmt: skip
            scale = np.abs(expected).max()
            np.testing.assert_allclose(result.motion.accelerations[k], expected, rtol=0, atol=tolerance * scale)
            motion = JointMotion(result.motion.positions[k], result.motion.velocities[k], expected)
            for link, acceleration in dynamics.platform.acceleration(motion).items():
                np.testing.assert_allclose(actual[link][k], acceleration, rtol=0, atol=tolerance * scale)


@pytest.mark.slow
def test_inverse_model_with_elastic_mounts_gives_the_platforms_their_acceleration():
    poses, twists, accelerations, other_joints = states(MOUNTS)
    result = MOUNTS.platform.solve(poses, twists, acceleration=accelerations, other_joints=other_joints)
    efforts = MOUNTS.platform.inverse(poses, twists, accelerations, other_joints=other_joints)
    np.testing.assert_allclose(result.efforts, efforts, rtol=1e-9, atol=1e-9)
    assert not efforts[:, columns_of(MOUNTS, MOUNTS.unactuated_joint_names)].any()
    peer, turning_joints = (
        MaximalCoordinates(MOUNTS.robot),
        [MOUNTS.robot.joint_numbers[name] for name in ("turn", "point")],
    )
    for k in range(COUNT):
        q, qd = result.motion.positions[k], result.motion.velocities[k]
        expected = peer.direct(q, qd, embed(MOUNTS, efforts[k])).accelerations
        for link, acceleration in MOUNTS.platform.acceleration(JointMotion(q, qd, expected)).items():
            np.testing.assert_allclose(acceleration, accelerations[link][k], rtol=0, atol=1e-7)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(result.motion.accelerations[k], expected, rtol=0, atol=1e-8 * scale)
        np.testing.assert_allclose(expected[turning_joints], other_joints[2][k, :2], rtol=0, atol=1e-8 * scale)


def test_inverse_model_is_refused_where_springs_determine_the_acceleration():
    """Multipliers give the same platform accelerations for all efforts on the ground: the springs determine them."""
    poses, twists, accelerations, other_joints = states(GEARS)
    with pytest.raises(SingularModelError, match=r"springs stand between the motors and the platform \(gear_lower_1, "):
        GEARS.platform.inverse(poses, twists, accelerations, other_joints=other_joints)
    peer, (q, qd, _) = (
        MaximalCoordinates(GEARS.robot),
        GEARS.platform.joint_motion(poses, twists, other_joints=other_joints),
    )
    actual = []
    for push in (0.0, 50.0):
        efforts = np.array([push * ("crank_lower" in name) for name in GEARS.joint_names])
        joint_accelerations = peer.direct(q[0], qd[0], embed(GEARS, efforts)).accelerations
        actual.append(GEARS.platform.acceleration(JointMotion(q[0], qd[0], joint_accelerations)))
    for link in poses:
        np.testing.assert_allclose(actual[0][link], actual[1][link], rtol=0, atol=1e-8 * np.abs(actual[0][link]).max())


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize("wrench", [None, [5.0, -8, 3, 0.2, 0.1, 0.5]])
def test_equilibrium_at_a_pose_has_zero_accelerations(dynamics, wrench):
    poses, _, _, other_joints = states(dynamics, 8)
    wrenches = None if wrench is None else {"upper": wrench}
    equilibrium = dynamics.platform.equilibrium(poses, other_joints=other_joints[:1], external_wrenches=wrenches)
    for link, pose in dynamics.platform.pose(equilibrium.joint_positions).items():
        np.testing.assert_allclose(pose, poses[link], atol=1e-10)
    springs = columns_of(dynamics, dynamics.unactuated_joint_names)
    assert np.abs(equilibrium.positions[:, springs] - other_joints[0][:, 2:]).max() > 1e-3
    upper, peer = dynamics.robot.frame("upper"), MaximalCoordinates(dynamics.robot)
    for k in range(8):
        options = {}
        if wrench is not None:
            R = upper.placement[:3, :3]
            options = {"external_wrenches": {upper.link: np.concatenate([R @ wrench[:3], R @ wrench[3:]])}}
        q = equilibrium.joint_positions[k]
        joint_accelerations = peer.direct(q, 0 * q, embed(dynamics, equilibrium.efforts[k]), **options).accelerations
        assert np.abs(joint_accelerations).max() < 1e-6  # springs out of equilibrium cause about 1e3


def test_acceleration_of_an_elastic_joint_is_refused():
    poses, twists, _, other_joints = states(MOUNTS)
    other_accelerations = np.zeros(other_joints[2].shape)
    other_accelerations[0, 2] = 3.0
    with pytest.raises(
        InvalidInputError, match=r"accelerations of other joints\[2\] is 3: joint 'mount_lower_1': no motor"
    ):
        MOUNTS.platform.inverse(poses, twists, None, other_joints=(*other_joints[:2], other_accelerations))
