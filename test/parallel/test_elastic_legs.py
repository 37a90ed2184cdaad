"""Elastic joints in the legs of parallel modules, asked in the coordinates of their platforms: direct and inverse model
and equilibrium against multipliers on maximal coordinates and Pinocchio."""

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


def places(dynamics, names):
    return [dynamics.joint_names.index(name) for name in names]


def spread(dynamics, values):
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
    left = dynamics.platform.joint_positions(poses)  # left out: where the description has them first
    np.testing.assert_array_equal(left[:, numbers], np.zeros((COUNT, len(numbers))))


@BOTH
def test_direct_model_is_that_of_multipliers_and_of_pinocchio(dynamics):
    poses, twists, _, other_joints = states(dynamics)
    efforts = np.random.default_rng(5).uniform(-20, 20, (COUNT, len(dynamics.joint_names)))
    efforts[:, places(dynamics, dynamics.unactuated_joint_names)] = 0
    answer = dynamics.platform.solve(poses, twists, efforts=efforts, other_joints=other_joints)
    found = dynamics.platform.direct(poses, twists, efforts, other_joints=other_joints)
    peers = MaximalCoordinates(dynamics.robot), PinocchioLoops(dynamics.robot)
    for k in range(COUNT):
        for peer, tolerance in zip(peers[: 1 if k > 3 else 2], (1e-8, 1e-6), strict=False):
            expected = peer.direct(answer.motion.positions[k], answer.motion.velocities[k],
                                   spread(dynamics, efforts[k])).accelerations  # fmt: skip
            scale = np.abs(expected).max()
            np.testing.assert_allclose(answer.motion.accelerations[k], expected, rtol=0, atol=tolerance * scale)
            moved = JointMotion(answer.motion.positions[k], answer.motion.velocities[k], expected)
            for link, acceleration in dynamics.platform.acceleration(moved).items():
                np.testing.assert_allclose(found[link][k], acceleration, rtol=0, atol=tolerance * scale)


def test_inverse_model_of_motors_on_elastic_mounts_accelerates_the_platforms_as_told():
    poses, twists, accelerations, other_joints = states(MOUNTS)
    answer = MOUNTS.platform.solve(poses, twists, acceleration=accelerations, other_joints=other_joints)
    efforts = MOUNTS.platform.inverse(poses, twists, accelerations, other_joints=other_joints)
    np.testing.assert_allclose(answer.efforts, efforts, rtol=1e-9, atol=1e-9)
    assert not efforts[:, places(MOUNTS, MOUNTS.unactuated_joint_names)].any()
    peer, turning = MaximalCoordinates(MOUNTS.robot), [MOUNTS.robot.joint_numbers[name] for name in ("turn", "point")]
    for k in range(COUNT):
        q, qd = answer.motion.positions[k], answer.motion.velocities[k]
        expected = peer.direct(q, qd, spread(MOUNTS, efforts[k])).accelerations
        for link, acceleration in MOUNTS.platform.acceleration(JointMotion(q, qd, expected)).items():
            np.testing.assert_allclose(acceleration, accelerations[link][k], rtol=0, atol=1e-7)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(answer.motion.accelerations[k], expected, rtol=0, atol=1e-8 * scale)
        np.testing.assert_allclose(expected[turning], other_joints[2][k, :2], rtol=0, atol=1e-8 * scale)


def test_where_springs_drive_the_platform_its_acceleration_cannot_be_asked_for():
    """Whatever the motors on the ground do, multipliers have the platforms accelerate alike: the springs decide."""
    poses, twists, accelerations, other_joints = states(GEARS)
    with pytest.raises(SingularModelError, match=r"springs stand between the motors and the platform \(gear_lower_1, "):
        GEARS.platform.inverse(poses, twists, accelerations, other_joints=other_joints)
    peer, (q, qd, _) = (
        MaximalCoordinates(GEARS.robot),
        GEARS.platform.joint_motion(poses, twists, other_joints=other_joints),
    )
    found = []
    for push in (0.0, 50.0):
        efforts = np.array([push * ("crank_lower" in name) for name in GEARS.joint_names])
        moved = peer.direct(q[0], qd[0], spread(GEARS, efforts)).accelerations
        found.append(GEARS.platform.acceleration(JointMotion(q[0], qd[0], moved)))
    for link in poses:
        np.testing.assert_allclose(found[0][link], found[1][link], rtol=0, atol=1e-8 * np.abs(found[0][link]).max())


@BOTH
@pytest.mark.parametrize("wrench", [None, [5.0, -8, 3, 0.2, 0.1, 0.5]])
def test_in_equilibrium_at_a_pose_nothing_accelerates(dynamics, wrench):
    poses, _, _, other_joints = states(dynamics, 8)
    wrenches = None if wrench is None else {"upper": wrench}
    rest = dynamics.platform.equilibrium(poses, other_joints=other_joints[:1], external_wrenches=wrenches)
    for link, pose in dynamics.platform.pose(rest.joint_positions).items():
        np.testing.assert_allclose(pose, poses[link], atol=1e-10)
    springs = places(dynamics, dynamics.unactuated_joint_names)
    assert np.abs(rest.positions[:, springs] - other_joints[0][:, 2:]).max() > 1e-3
    upper, peer = dynamics.robot.frame("upper"), MaximalCoordinates(dynamics.robot)
    for k in range(8):
        told = {}
        if wrench is not None:
            R = upper.placement[:3, :3]
            told = {"external_wrenches": {upper.link: np.concatenate([R @ wrench[:3], R @ wrench[3:]])}}
        q = rest.joint_positions[k]
        moved = peer.direct(q, 0 * q, spread(dynamics, rest.efforts[k]), **told).accelerations
        assert np.abs(moved).max() < 1e-6  # of some 1e3 that springs cause where they are not in balance


def test_what_springs_cannot_be_told_is_refused():
    poses, twists, _, other_joints = states(MOUNTS)
    pushed = np.zeros(other_joints[2].shape)
    pushed[0, 2] = 3.0
    with pytest.raises(
        InvalidInputError, match=r"accelerations of other joints\[2\] is 3: joint 'mount_lower_1': no motor"
    ):
        MOUNTS.platform.inverse(poses, twists, None, other_joints=(*other_joints[:2], pushed))
