"""Parallel robots that ship: wherever their platform may be the legs close, the platform is where its coordinates say,
and both models are those of multipliers on maximal coordinates."""

import numpy as np
import pytest
from peers.loop_states import loop_gaps, mobility
from peers.maximal_coordinates import MaximalCoordinates
from peers.reachable import closed_at_poses, free_coordinates, limits_of

from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw
from robot_dynamics.newton_euler.loops import loop_equations

PARALLEL = [name for name in shipped_robots() if load_robot(name).platform]


def in_ranges(dynamics, samples, seed=0):
    """Positions (samples, all joints) with the platform anywhere in its limits, and joints outside of the legs in
    theirs."""
    rng = np.random.default_rng(seed)
    _, limits = free_coordinates(dynamics.robot)
    q = closed_at_poses(dynamics, rng.uniform(*limits, (samples, limits.shape[1])))
    anywhere = rng.uniform(*limits_of(dynamics), (samples, len(dynamics.joint_names)))
    for place, name in enumerate(dynamics.joint_names):
        number = dynamics.robot.joint_numbers[name]
        if number not in dynamics.robot.looped:
            q[:, number] = anywhere[:, place]
    return q


def independent(dynamics):
    return [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]


@pytest.mark.parametrize("name", PARALLEL)
def test_legs_close_far_from_singular_wherever_the_platform_may_be(name):
    robot = load_robot(name, strict=True)
    dynamics = Dynamics(robot)
    q = in_ranges(dynamics, 1000)
    assert max(np.abs(loop_gaps(robot, sample)).max() for sample in q[::50]) < 1e-12
    lower, upper = limits_of(dynamics)
    motors = q[:, independent(dynamics)]
    assert np.all((lower <= motors) & (motors <= upper))
    np.testing.assert_allclose(dynamics.expand(motors), q, rtol=0, atol=1e-10)  # and in the same assembly mode
    jacobian = loop_equations(robot, q).jacobian
    dependent = [robot.joint_numbers[name] for name in dynamics.looped_joint_names]
    assert np.linalg.cond(jacobian[..., dependent]).max() < 1e3
    numbers, _ = free_coordinates(robot)
    legs = sorted(robot.looped - {*numbers})
    assert np.linalg.cond(jacobian[..., legs]).max() < 1e4


@pytest.mark.parametrize("name", PARALLEL)
def test_platform_is_where_its_coordinates_say(name):
    dynamics = Dynamics(load_robot(name))
    robot = dynamics.robot
    numbers, _ = free_coordinates(robot)
    held = [number for number in robot.platform.joints if number not in numbers]
    q = in_ranges(dynamics, 50)
    np.testing.assert_allclose(q[:, held], np.tile(q[:1, held], (50, 1)), rtol=0, atol=1e-12)
    poses = dynamics.link_pose(robot.links[robot.platform.link].name, q)
    for pose, (x, y, z, yaw, pitch, roll) in zip(poses, q[:, robot.platform.joints], strict=True):
        expected = placement(rotation_from_roll_pitch_yaw(roll, pitch, yaw), [x, y, z])
        np.testing.assert_allclose(pose, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", PARALLEL)
def test_motors_are_as_many_as_the_mobility_and_move_all_that_is_free(name):
    dynamics = Dynamics(load_robot(name))
    robot, legs = dynamics.robot, [n for n in independent(dynamics) if n in dynamics.robot.looped]
    assert not dynamics.undriven_joint_names and len(legs) == len(robot.platform.free)
    numbers, _ = free_coordinates(robot)
    for q in in_ranges(dynamics, 5, seed=1):
        assert mobility(robot, q) == len(dynamics.joint_names)
        rates = dynamics.expand_rates(np.eye(len(dynamics.joint_names)), np.tile(q, (len(dynamics.joint_names), 1)))
        motors = [independent(dynamics).index(number) for number in legs]
        assert np.linalg.cond(rates[np.ix_(motors, numbers)]) < 1e3


@pytest.mark.parametrize("name", PARALLEL)
def test_both_models_are_those_of_multipliers_on_maximal_coordinates(name):
    robot = load_robot(name)
    dynamics, peer = Dynamics(robot, compiled=False), MaximalCoordinates(robot)
    driven, rng = independent(dynamics), np.random.default_rng(2)
    for q in in_ranges(dynamics, 5, seed=2):
        qd, qdd = rng.uniform(-1, 1, (2, len(driven)))
        told = np.full(len(q), np.nan)
        told[driven] = qdd
        found = peer.inverse(q, dynamics.expand_rates(qd, q), told)
        answer = dynamics.solve(q, qd, qdd=qdd)
        scale = np.abs(found.efforts).max()
        np.testing.assert_allclose(answer.efforts, found.efforts[driven], rtol=0, atol=1e-8 * scale)
        scale = max(1, np.abs(found.accelerations).max())
        np.testing.assert_allclose(answer.motion.accelerations, found.accelerations, rtol=0, atol=1e-8 * scale)
        np.testing.assert_allclose(dynamics.direct(q, qd, answer.efforts), qdd, rtol=0, atol=1e-8 * scale)


def platform_coordinates(dynamics, q):
    return q[:, dynamics.robot.platform.joints]


def legs_of(dynamics, q, name):
    return q[:, [number for joint, number in dynamics.robot.joint_numbers.items() if joint.startswith(f"{name}_")]]


def test_legs_of_the_gough_stewart_platform_are_as_long_as_the_way_between_their_joints():
    dynamics = Dynamics(load_robot("gough_stewart"))
    q = in_ranges(dynamics, 100)
    around = np.radians(np.arange(3) * 120)
    base = np.sort(np.concatenate([around - np.radians(2.5), around + np.radians(2.5)]))
    plate = np.sort(np.concatenate([around - np.radians(50), around + np.radians(50)]))
    poses = dynamics.link_pose("platform", q)
    for leg, (below, above) in enumerate(zip(base, plate, strict=True)):
        joint = [np.cos(above), np.sin(above), 0, 1]
        way = (poses @ joint)[:, :3] - 3 * np.array([np.cos(below), np.sin(below), 0])
        np.testing.assert_allclose(legs_of(dynamics, q, "leg")[:, leg], np.linalg.norm(way, axis=1), rtol=1e-13)
    masses = {link.name: link.inertia.mass for link in dynamics.robot.links}
    steel, length = 76e3 / 9.81 * np.pi, 0.75 * dynamics.closed_positions[dynamics.robot.joint_numbers["leg_1"]]
    assert [masses[name] for name in ("tube_3", "rod_3", "platform")] == pytest.approx(
        [steel * 0.0016 * length, steel * 0.0025 * length, steel * 0.05]
    )
