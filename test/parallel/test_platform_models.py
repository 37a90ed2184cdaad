"""Every parallel robot that ships, in coordinates of its platform: 1000 random motions in its workspace, by the second
solution (platform and legs apart, projected) and the first (platform on a leg, loops closed), by multipliers on maximal
coordinates and Pinocchio; inverse and back; virtual work; errors near singular poses and out of reach."""

import os
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from peers.first_solution import attached, seed_of_attached
from peers.maximal_coordinates import MaximalCoordinates
from peers.pinocchio_loops import PinocchioLoops
from peers.platform_states import random_states

from robot_dynamics import DescriptionError, Dynamics, SingularModelError, load_robot, shipped_robots
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.placement import placement
from robot_dynamics.parallel.platform_dynamics import pose_from_coordinates

COUNT = 1000
COMPARED = int(
    os.environ.get("COMPARED", 0)
)  # of them with multipliers and Pinocchio, where not a few; `make soak`: all
# parallel.test_hybrid_robots has robots with several platforms
PARALLEL = [name for name in shipped_robots() if len(load_robot(name).platforms) == 1]


@cache
def dynamics_of(name):
    return Dynamics(load_robot(name), compiled=False)


@cache
def motions(name):
    """Return platform arguments, (q, qd, qdd) of all joints and efforts of COUNT random motions."""
    dynamics = dynamics_of(name)
    states = random_states(dynamics, COUNT, np.random.default_rng(7), reach=1.0)
    pose, twist, acceleration = (next(iter(part.values())) for part in states[:3])
    motion = dynamics.platform.joint_motion(pose, twist, acceleration, other_joints=states.other_joints)
    efforts = dynamics.inverse(motion[0], *(values[:, independent(dynamics)] for values in motion[1:]))
    return (pose, twist, acceleration, states.other_joints), motion, efforts


def independent(dynamics):
    return [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]


def legs_of(robot):
    """Return the numbers of the loops that close legs on the platform."""
    return [number for number, loop in enumerate(robot.loops) if loop.closed_on.link == robot.platform.link]


def test_shipped_robots_include_each_kind():
    assert {"gough_stewart", "delta", "orthoglide", "navaro", "delta_wrist"} <= set(PARALLEL)


@pytest.mark.slow
@pytest.mark.parametrize("name", PARALLEL)
def test_second_solution_agrees_with_the_first(name):
    dynamics, (arguments, (q, qd, qdd), efforts) = dynamics_of(name), motions(name)
    leg = legs_of(dynamics.robot)[-1]
    first = Dynamics(attached(dynamics.robot, leg), compiled=False)
    n = [dynamics.robot.joint_numbers[joint] for joint in first.joint_names]
    actual = first.inverse(seed_of_attached(dynamics, first, q, leg), qd[:, n], qdd[:, n])
    columns = [dynamics.joint_names.index(joint) for joint in first.joint_names]
    assert sorted(columns) == list(range(len(dynamics.joint_names)))
    assert np.abs(actual - efforts[:, columns]).max() < 1e-10 * np.abs(efforts).max()
    by_platform = dynamics.platform.inverse(*arguments[:3], seed=q, other_joints=arguments[3])
    assert np.abs(by_platform - efforts).max() < 1e-10 * np.abs(efforts).max()


@pytest.mark.parametrize("name", PARALLEL)
@pytest.mark.parametrize("count", [1, 6, 7])  # six samples look like the six columns of a matrix
def test_omitted_motion_is_zero_at_each_pose_of_a_batch(name, count):
    """Also a single twist and acceleration broadcast to many poses."""
    dynamics, (arguments, (q, _, _), _) = dynamics_of(name), motions(name)
    platform, poses, seed, other_joints = dynamics.platform, arguments[0][:count], q[:count], arguments[3]
    acceleration = arguments[2][0]
    other_joints = None if other_joints is None else (other_joints[0][:count],)
    rest = np.zeros((count, 6))
    expected = platform.inverse(poses, rest, rest, seed=seed, other_joints=other_joints)
    np.testing.assert_array_equal(platform.inverse(poses, seed=seed, other_joints=other_joints), expected)
    twist = arguments[1][0]
    np.testing.assert_array_equal(
        platform.inverse(poses, twist, acceleration, seed=seed, other_joints=other_joints),
        platform.inverse(
            poses,
            np.tile(twist, (count, 1)),
            np.tile(acceleration, (count, 1)),
            seed=seed,
            other_joints=other_joints,
        ),
    )
    actual = platform.direct(poses, None, expected, seed=seed, other_joints=other_joints)
    assert np.abs(actual).max() < 1e-8 * max(
        1, np.abs(platform.direct(poses, None, 0 * expected, seed=seed, other_joints=other_joints)).max()
    )


def test_pose_may_be_read_only():
    platform, (arguments, _, _) = dynamics_of("gough_stewart").platform, motions("gough_stewart")
    for pose in (arguments[0][0], arguments[0][:3]):
        pose = pose.copy()
        expected = platform.inverse(pose)
        pose.flags.writeable = False
        np.testing.assert_array_equal(platform.inverse(pose), expected)


@pytest.mark.slow
@pytest.mark.parametrize("name", PARALLEL)
def test_both_models_agree_with_multipliers(name):
    dynamics, (_, motion, efforts) = dynamics_of(name), motions(name)
    check_both_models(dynamics, MaximalCoordinates(dynamics.robot), motion, efforts, COMPARED or 20, 1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", PARALLEL)
def test_both_models_agree_with_pinocchio(name):
    dynamics, (_, motion, efforts) = dynamics_of(name), motions(name)
    if not dynamics.robot.links[dynamics.robot.platform.link].inertia.mass:  # Pinocchio takes no end without mass
        dynamics = Dynamics(with_heavy_platform(dynamics.robot), compiled=False)
        n, (q, qd, qdd) = independent(dynamics), motion
        efforts = dynamics.inverse(q, qd[:, n], qdd[:, n])
    check_both_models(dynamics, PinocchioLoops(dynamics.robot), motion, efforts, COMPARED or 50, 1e-6)


def with_heavy_platform(robot):
    number = robot.platform.link
    inertia = Inertia.about_centre_of_mass(2.0, np.diag([0.02, 0.03, 0.04]), placement(None, (0.1, -0.05, 0.02)))
    heavy = replace(robot.links[number], inertia=inertia)
    return replace(robot, links=(*robot.links[:number], heavy, *robot.links[number + 1 :]))


def check_both_models(dynamics, peer, motion, efforts, count, tolerance):
    """Check inverse and direct model of the first `count` motions against a peer, relative to the largest entry."""
    n, (q, qd, qdd) = independent(dynamics), (values[:count] for values in motion)
    prescribed = np.full(q.shape, np.nan)
    prescribed[:, n] = qdd[:, n]
    accelerations = dynamics.direct(q, qd[:, n], efforts[:count])
    for k in range(count):
        expected = peer.inverse(q[k], qd[k], prescribed[k])
        assert np.abs(expected.efforts[n] - efforts[k]).max() < tolerance * np.abs(efforts[k]).max()
        assert np.abs(expected.accelerations - qdd[k]).max() < tolerance * np.abs(qdd[k]).max()
        actual = peer.direct(q[k], qd[k], dynamics.embed_efforts(efforts[k])).accelerations
        assert np.abs(actual[n] - accelerations[k]).max() < tolerance * np.abs(actual).max()


@pytest.mark.parametrize("name", PARALLEL)
def test_direct_model_inverts_the_inverse_model(name):
    dynamics, ((pose, twist, acceleration, other_joints), (q, *_), efforts) = dynamics_of(name), motions(name)
    assert dynamics.platform.condition_number(q).max() < 1e4
    actual = dynamics.platform.direct(pose, twist, efforts, seed=q, other_joints=other_joints)
    assert np.abs(actual - acceleration).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", PARALLEL)
def test_direct_geometry_inverts_inverse_geometry(name):
    dynamics, ((pose, *_), (q, *_), _) = dynamics_of(name), motions(name)
    np.testing.assert_allclose(dynamics.platform.pose(q[:, independent(dynamics)]), pose, atol=1e-10)


@pytest.mark.parametrize("name", PARALLEL)
def test_virtual_work_of_a_wrench_on_the_platform_is_that_of_the_motors(name):
    """Virtual work: a wrench w on the platform changes the efforts by δΓ with δΓᵀ q̇ = -wᵀ V for every motion."""
    dynamics, ((_, twist, *_), (q, qd, qdd), efforts) = dynamics_of(name), motions(name)
    n, wrench = independent(dynamics), np.array([3.0, -2, 5, 0.5, 1, -0.7])
    q, qd, qdd = (values[:200] for values in (q, qd, qdd))
    wrenches = {dynamics.robot.platform_links[0]: wrench}
    loaded = dynamics.inverse(q, qd[:, n], qdd[:, n], external_wrenches=wrenches)
    work = np.sum((loaded - efforts[:200]) * qd[:, n], axis=1)
    scale = np.abs(efforts).max() * np.abs(qd).max()
    np.testing.assert_allclose(work, -twist[:200] @ wrench, rtol=0, atol=1e-11 * scale)


def orthoglide_with_bars_in_a_plane():
    """All three bars are normal to the diagonal at x = y = z = t with l² = 6 t²."""
    return np.array([1.0, 1, 1, 0, 0, 0]), np.array([0.31025 / np.sqrt(6)] * 3 + [0, 0, 0])


def navaro_with_bars_through_the_centre():
    """Where all three bars D-E point at P: A-D is 0.21 m, P-D 0.21 + 0.2027 m, P-A 0.7/√3 m."""
    long, far = 0.21 + 0.2027, 0.7 / np.sqrt(3)
    angle = np.arccos((long**2 + far**2 - 0.21**2) / (2 * long * far))
    return np.array([0, 0, 0, -1.0, 0, 0]), np.array([0, 0, 0, -angle, 0, 0])


def gough_stewart_turned_by_a_quarter():
    """Fichter's: turned by 90°, a platform whose joints are on circles as those of the ground are."""
    return np.array([0, 0, 0, 1.0, 0, 0]), np.array([0, 0, 2, np.pi / 2, 0, 0])


SINGULAR = {
    "orthoglide": orthoglide_with_bars_in_a_plane,
    "navaro": navaro_with_bars_through_the_centre,
    "gough_stewart": gough_stewart_turned_by_a_quarter,
}


@pytest.mark.parametrize("name", SINGULAR)
def test_singular_pose_is_refused_with_its_condition_number(name):
    dynamics, (direction, singular) = dynamics_of(name), SINGULAR[name]()
    platform, still = dynamics.platform, np.zeros(6)
    conditions = [
        platform.condition_number(platform.joint_positions(pose_from_coordinates(singular - step * direction)))
        for step in (1e-2, 1e-3)
    ]
    assert conditions[1] / conditions[0] == pytest.approx(10, rel=0.03)  # the closed form of the singular pose holds
    for step in (0.0, 1e-10, 1e-8):
        with pytest.raises(SingularModelError, match=r"is singular: .*\(condition number \d\.?\d*e\+\d+\)"):
            platform.direct(
                pose_from_coordinates(singular - step * direction), still, np.zeros(len(dynamics.joint_names))
            )


@pytest.mark.slow
def test_leg_out_of_reach_is_named_with_its_gap():
    """The Delta: one leg is too short when stretched out, the others reach."""
    dynamics, gaps, x = dynamics_of("delta"), [], np.array([0.3, 0.6, -1.2, 0, 0, 0])
    for angle in np.radians([0, 120, 240]):
        out, aside = np.array([np.cos(angle), np.sin(angle), 0]), np.array([-np.sin(angle), np.cos(angle), 0])
        vector = x[:3] - (0.33 - 0.125) * out
        gaps.append(np.hypot(np.hypot(vector @ out, vector[2]) - 0.42, vector @ aside) - 1.055)
    assert gaps[2] > 0.005 and max(gaps[:2]) < 0
    with pytest.raises(
        SingularModelError, match=r"loop '(left|right)_ball_3' does not close: .* out of reach"
    ) as refusal:
        dynamics.platform.joint_positions(pose_from_coordinates(x))
    assert float(str(refusal.value).split("stay ")[1].split(" m")[0]) == pytest.approx(gaps[2], rel=0.05)


def described(name, wrong, right):
    """Return a changed description of a shipped robot."""
    text = shipped_robots()[name].read_text(encoding="utf-8")
    assert wrong in text
    return text.replace(wrong, right)


def test_platform_without_inertia_is_refused_with_its_line():
    text = described("delta", "  mass: 2.916 + 3*0.226\n  central_inertia: {xx: 0.015, yy: 0.015, zz: 0.03}\n", "")
    with pytest.raises(
        DescriptionError, match=r"line \d+, column \d+: platform 'platform' has no inertia: mass missing"
    ):
        load_robot(text)


def test_motors_that_do_not_control_the_platform_are_refused_with_their_rank():
    passive = "        role: passive\n        mdh: {alpha: -pi/2}\n"
    text = described("delta", "        mdh: {alpha: -pi/2}\n", passive).replace(
        "      - joint: left_swing\n        link: left_bar\n        role: passive\n",
        "      - joint: left_swing\n        link: left_bar\n",
    )  # the lateral motion of the bars is actuated instead of the arms
    with pytest.raises(DescriptionError, match=r"mobility 3 and 3 motors: .*\(they control \d of 3 motions: the rank"):
        Dynamics(load_robot(text))
    for robot, free in (("gough_stewart", "pitch"), ("navaro", "x")):
        shipped = shipped_robots()[robot].read_text(encoding="utf-8")
        motor = {"gough_stewart": "        type: prismatic\n", "navaro": "        link: crank "}[robot]
        held = shipped.replace(motor, "        role: passive\n" + motor)
        count = len(load_robot(shipped).platform.free)
        with pytest.raises(DescriptionError, match=rf"mobility {count} and 0 motors: .*control 0 of {count} motions"):
            Dynamics(load_robot(held))
        assert free in load_robot(shipped).platform.free


@pytest.mark.parametrize(
    ("free", "message"),
    [
        ("[x, y, z, yaw]", r"mobility 3\), which x, y, z, yaw do not determine: write free: \[x, y, z\]"),
        ("[x, y]", r"mobility 3\), which x, y do not determine: write free: \[x, y, z\]"),
        ("[x, y, yaw]", r"mobility 3\), which x, y, yaw do not determine: write free: \[x, y, z\]"),
    ],
)
def test_wrong_free_coordinates_are_refused_with_the_right_ones(free, message):
    dynamics = Dynamics(load_robot(described("delta", "free: [x, y, z]", f"free: {free}")), compiled=False)
    with pytest.raises(DescriptionError, match=message):
        _ = dynamics.platform
