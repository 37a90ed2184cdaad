"""Parallel modules in series: each platform in coordinates of what it stands on, all of them together and each alone,
against closed forms, the first solution, multipliers on maximal coordinates and Pinocchio."""

import numpy as np
import pytest
from peers.first_solution import attached, seed_of_attached
from peers.maximal_coordinates import MaximalCoordinates
from peers.pinocchio_loops import PinocchioLoops
from peers.planar_stack import planar_stack
from peers.platform_states import random_states
from scipy.spatial.transform import Rotation

from robot_dynamics import Dynamics, InvalidInputError, SingularModelError, load_robot
from robot_dynamics.parallel.pose_map import pose_map

COUNT = {"hexapod_stack": 250, "planar_stack": 1000}
DYNAMICS = {name: Dynamics(load_robot(text)) for name, text in
            (("hexapod_stack", "hexapod_stack"), ("planar_stack", planar_stack()))}  # fmt: skip
STATES = {name: random_states(dynamics, COUNT[name], np.random.default_rng(0)) for name, dynamics in DYNAMICS.items()}
HYBRIDS = tuple(DYNAMICS)


def told(name, count=None):
    """(dynamics, poses, twists, accelerations, others) of the first states."""
    states = STATES[name]
    cut = ({link: values[:count] for link, values in part.items()} for part in states[:3])
    return DYNAMICS[name], *cut, tuple(values[:count] for values in states.other_joints)


def independent(dynamics):
    return [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]


@pytest.mark.parametrize("name", HYBRIDS)
def test_pose_is_that_in_the_frame_on_which_the_platform_stands(name):
    dynamics, poses, _, _, other_joints = told(name)
    q = dynamics.platform.joint_positions(poses, other_joints=other_joints)
    for link, platform in zip(dynamics.robot.platform_links, dynamics.robot.platforms, strict=True):
        stands = np.eye(4) if platform.base is None else dynamics.link_pose(platform.base, q)
        np.testing.assert_allclose(dynamics.link_pose(link, q), stands @ poses[link], atol=1e-11)


def test_legs_of_both_hexapods_are_as_long_as_the_way_between_their_joints():
    dynamics, poses, *_ = told("hexapod_stack")
    q = dynamics.platform.joint_positions(poses)
    around = np.radians(np.arange(3) * 120)
    base = np.sort(np.concatenate([around - np.radians(2.5), around + np.radians(2.5)]))
    plate = np.sort(np.concatenate([around - np.radians(50), around + np.radians(50)]))
    for link, size in (("lower", 1), ("upper", 1 / 3)):
        numbers = [dynamics.robot.joint_numbers[f"leg_{link}_{k}"] for k in range(1, 7)]
        ways = [(poses[link] @ [size * np.cos(above), size * np.sin(above), 0, 1])[:, :3]
                - 3 * size * np.array([np.cos(below), np.sin(below), 0])
                for below, above in zip(base, plate, strict=True)]  # fmt: skip
        # copies go round by 120°, 240°; these are sorted by angles from -180° on
        lengths = np.sort(np.linalg.norm(ways, axis=-1).T, axis=1)
        np.testing.assert_allclose(np.sort(q[:, numbers], axis=1), lengths, rtol=1e-13)


@pytest.mark.parametrize("name", HYBRIDS)
def test_direct_geometry_finds_the_poses_it_came_from(name):
    dynamics, poses, _, _, other_joints = told(name)
    q = dynamics.platform.joint_positions(poses, other_joints=other_joints)
    found = dynamics.platform.pose(q[:, independent(dynamics)])
    for link, pose in poses.items():
        np.testing.assert_allclose(found[link], pose, atol=1e-10)


@pytest.mark.parametrize("name", HYBRIDS)
def test_inverse_then_direct_gives_the_accelerations_of_the_platforms_back(name):
    dynamics, poses, twists, accelerations, other_joints = told(name)
    assert (
        dynamics.platform.condition_number(dynamics.platform.joint_positions(poses, other_joints=other_joints)).max()
        < 1e4
    )
    efforts = dynamics.platform.inverse(poses, twists, accelerations, other_joints=other_joints)
    answer = dynamics.platform.solve(poses, twists, efforts=efforts, other_joints=other_joints)
    found, rates = dynamics.platform.acceleration(answer.motion), dynamics.platform.twist(answer.motion)
    for link, expected in accelerations.items():
        assert np.abs(found[link] - expected).max() < 1e-9
        assert np.abs(rates[link] - twists[link]).max() < 1e-10
    numbers = [dynamics.robot.joint_numbers[other] for other in dynamics.platform.other_joint_names]
    np.testing.assert_allclose(answer.motion.accelerations[:, numbers], other_joints[2], atol=1e-9)


@pytest.mark.parametrize(("name", "legs"), [("hexapod_stack", (0, 9)), ("planar_stack", (3, 2))])
def test_second_solution_is_the_first(name, legs):
    """Each platform on one of its legs, loops through all others: all states, to 1e-10 of the efforts."""
    dynamics, poses, twists, accelerations, other_joints = told(name)
    robot, other = dynamics.robot, Dynamics(attached(dynamics.robot, *legs))
    q, qd, qdd = dynamics.platform.joint_motion(poses, twists, accelerations, other_joints=other_joints)
    n = [robot.joint_numbers[joint] for joint in other.joint_names]
    found = other.inverse(seed_of_attached(dynamics, other, q, *legs), qd[:, n], qdd[:, n])
    efforts = dynamics.platform.inverse(poses, twists, accelerations, other_joints=other_joints)
    efforts = efforts[:, [dynamics.joint_names.index(joint) for joint in other.joint_names]]
    assert np.abs(found - efforts).max() < 1e-10 * np.abs(efforts).max()


@pytest.mark.parametrize(("name", "count"), [("hexapod_stack", 10), ("planar_stack", 50)])
def test_both_models_are_those_of_multipliers_and_of_pinocchio(name, count):
    dynamics, poses, twists, accelerations, other_joints = told(name, count)
    maximal, pinocchio, n = MaximalCoordinates(dynamics.robot), PinocchioLoops(dynamics.robot), independent(dynamics)
    q, qd, qdd = dynamics.platform.joint_motion(poses, twists, accelerations, other_joints=other_joints)
    efforts = dynamics.platform.inverse(poses, twists, accelerations, other_joints=other_joints)
    given = np.full(q.shape, np.nan)
    given[:, n] = qdd[:, n]
    for k in range(count):
        expected = maximal.inverse(q[k], qd[k], given[k])
        assert np.abs(expected.efforts[n] - efforts[k]).max() < 1e-8 * np.abs(efforts[k]).max()
        assert np.abs(expected.accelerations - qdd[k]).max() < 1e-8 * np.abs(qdd[k]).max()
    for k in range(3):
        found = pinocchio.inverse(q[k], qd[k], given[k]).efforts[n]
        assert np.abs(found - efforts[k]).max() < 1e-6 * np.abs(efforts[k]).max()


@pytest.mark.parametrize("name", HYBRIDS)
def test_one_platform_alone_is_asked_beside_the_motors_of_the_other(name):
    dynamics, poses, twists, accelerations, other_joints = told(name, 20)
    q, qd, qdd = dynamics.platform.joint_motion(poses, twists, accelerations, other_joints=other_joints)
    efforts = dynamics.platform.inverse(poses, twists, accelerations, other_joints=other_joints)
    assert dynamics.platforms.keys() == {"lower", "upper"}
    for link, alone in dynamics.platforms.items():
        numbers = [dynamics.robot.joint_numbers[joint] for joint in alone.other_joint_names]
        beside = (q[:, numbers], qd[:, numbers], qdd[:, numbers])
        assert len(numbers) == len(dynamics.joint_names) - len(alone.free)
        np.testing.assert_allclose(alone.joint_positions(poses[link], other_joints=beside), q, atol=1e-10)
        found = alone.inverse(poses[link], twists[link], accelerations[link], other_joints=beside)
        assert np.abs(found - efforts).max() < 1e-9 * np.abs(efforts).max()
        back = alone.direct(poses[link], twists[link], efforts, other_joints=beside)
        np.testing.assert_allclose(back, accelerations[link], atol=1e-8)
        np.testing.assert_allclose(alone.pose(q), poses[link], atol=1e-12)
        seeded = alone.joint_positions(poses[link], seed=q)  # a seed tells of the others too
        np.testing.assert_allclose(seeded, q, atol=1e-10)


def test_jacobians_map_motor_rates_to_the_twist_in_what_the_platform_stands_on():
    dynamics, poses, twists, *_ = told("hexapod_stack", 50)
    q, qd, _ = dynamics.platform.joint_motion(poses, twists)
    found = dynamics.platform.jacobian(q)
    for link, twist in twists.items():
        rates = qd[:, independent(dynamics), None]
        np.testing.assert_allclose((found[link] @ rates)[..., 0], twist, atol=1e-10)
    assert np.abs(found["upper"][..., :6]).max() < 1e-12  # motors of the lower module do not move it there


def test_a_weight_on_the_upper_platform_is_felt_by_both_modules():
    """Virtual work: wrench w on the upper platform, efforts -Jᵀ w of its absolute twist, by differences of poses."""
    dynamics, poses, *_ = told("hexapod_stack", 1)
    pose = {link: values[0] for link, values in poses.items()}
    wrench = np.array([30.0, -20, -100, 5, 8, -3])
    q = dynamics.platform.joint_positions(pose)
    change = dynamics.platform.inverse(pose, external_wrenches={"upper": wrench}) - dynamics.platform.inverse(pose)
    n, h, here = independent(dynamics), 1e-6, dynamics.link_pose("upper", q)
    for k, number in enumerate(n):
        moved = []
        for side in (1, -1):
            beside = q.copy()
            beside[number] += side * h
            moved.append(np.linalg.inv(here) @ dynamics.link_pose("upper", beside))
        turned = [Rotation.from_matrix(step[:3, :3]).as_rotvec() for step in moved]
        twist = np.concatenate([moved[0][:3, 3] - moved[1][:3, 3], turned[0] - turned[1]]) / (2 * h)
        assert change[k] == pytest.approx(-twist @ wrench, rel=1e-6, abs=1e-5)


def test_what_does_not_fit_is_told():
    dynamics, poses, twists, *_ = told("hexapod_stack", 2)
    platform = dynamics.platform
    with pytest.raises(InvalidInputError, match="pose of platforms lower, upper: a mapping by these names is needed"):
        platform.inverse(poses["upper"])
    with pytest.raises(InvalidInputError, match="pose of platform 'upper' missing"):
        platform.inverse({"lower": poses["lower"]})
    with pytest.raises(InvalidInputError, match="unknown platform 'uper': did you mean 'upper'"):
        platform.inverse({**poses, "uper": poses["upper"]})
    with pytest.raises(InvalidInputError, match="twist of platform 'lower'"):
        platform.inverse(poses, {**twists, "lower": np.zeros(5)})
    with pytest.raises(InvalidInputError, match="give acceleration or efforts"):
        platform.solve(poses, twists)
    with pytest.raises(InvalidInputError, match=r"has 2 platforms \(lower, upper\): say which"):
        _ = dynamics.robot.platform
    with pytest.raises(InvalidInputError, match="positions of other joints has shape"):
        dynamics.platforms["upper"].joint_positions(poses["upper"], other_joints=[np.zeros(5)])
    with pytest.raises(InvalidInputError, match="unknown platform 'foo': known are lower, upper"):
        dynamics.platforms["foo"]
    with pytest.raises(InvalidInputError, match="a map is of one alone"):
        pose_map(dynamics, {"x": np.zeros(2)})
    dynamics, poses, *_ = told("planar_stack", 2)
    far = np.zeros((4, 4))
    far[0, 3] = 3.0
    with pytest.raises(SingularModelError, match=r"loop 'wrist_upper_\d' does not close"):
        dynamics.platform.joint_positions({**poses, "upper": poses["upper"] + far})
