"""Shipped parallel robots: legs close in the whole workspace, pose and coordinates agree, and both models agree with
multipliers on maximal coordinates."""

import re
from pathlib import Path

import numpy as np
import pytest
from peers.large_robots import each_robot
from peers.loop_states import loop_gaps, mobility
from peers.maximal_coordinates import MaximalCoordinates
from peers.reachable import closed_at_poses, free_coordinates, limits_of

from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw

PARALLEL = [name for name in shipped_robots() if load_robot(name).platforms]


def in_ranges(dynamics, samples, seed=0):
    """Return positions (samples, all joints) with platform and other joints at random within their limits."""
    rng = np.random.default_rng(seed)
    _, limits = free_coordinates(dynamics.robot)
    q = closed_at_poses(dynamics, rng.uniform(*limits, (samples, limits.shape[1])))
    anywhere = rng.uniform(*limits_of(dynamics), (samples, len(dynamics.joint_names)))
    for column, name in enumerate(dynamics.joint_names):
        number = dynamics.robot.joint_numbers[name]
        if number not in dynamics.robot.joints_in_loops:
            q[:, number] = anywhere[:, column]
    return q


def independent(dynamics):
    return [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]


@pytest.mark.slow
@pytest.mark.parametrize("name", each_robot(PARALLEL))
def test_legs_close_far_from_singular_wherever_the_platform_may_be(name):
    robot = load_robot(name, strict=True)
    dynamics = Dynamics(robot)
    q = in_ranges(dynamics, 1000)
    assert max(np.abs(loop_gaps(robot, sample)).max() for sample in q[::50]) < 1e-12
    lower, upper = limits_of(dynamics)
    motors = q[:, independent(dynamics)]
    assert np.all((lower <= motors) & (motors <= upper))
    np.testing.assert_allclose(
        dynamics.expand_positions(motors), q, rtol=0, atol=1e-10
    )  # and in the same assembly mode
    jacobian = loop_equations(robot, q).jacobian
    dependent = [robot.joint_numbers[name] for name in dynamics.dependent_joint_names]
    assert np.linalg.cond(jacobian[..., dependent]).max() < 1e3
    numbers, _ = free_coordinates(robot)
    legs = sorted(robot.joints_in_loops - {*numbers})
    assert np.linalg.cond(jacobian[..., legs]).max() < 1e4


@pytest.mark.slow
@pytest.mark.parametrize("name", PARALLEL)
def test_platform_pose_agrees_with_its_coordinates(name):
    dynamics = Dynamics(load_robot(name))
    robot = dynamics.robot
    numbers, _ = free_coordinates(robot)
    q = in_ranges(dynamics, 50)
    for platform in robot.platforms:
        held = [number for number in platform.joints if number not in numbers]
        np.testing.assert_allclose(q[:, held], np.tile(q[:1, held], (50, 1)), rtol=0, atol=1e-12)
        stand = np.eye(4) if platform.base is None else dynamics.link_pose(platform.base, q)
        poses = dynamics.link_pose(robot.links[platform.link].name, q)
        expected = [placement(rotation_from_roll_pitch_yaw(roll, pitch, yaw), [x, y, z])
                    for x, y, z, yaw, pitch, roll in q[:, platform.joints]]  # fmt: skip
        np.testing.assert_allclose(poses, stand @ expected, rtol=0, atol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("name", PARALLEL)
def test_number_of_motors_is_the_mobility(name):
    dynamics = Dynamics(load_robot(name))
    robot, legs = dynamics.robot, [n for n in independent(dynamics) if n in dynamics.robot.joints_in_loops]
    assert not dynamics.unactuated_joint_names and len(legs) == sum(len(platform.free) for platform in robot.platforms)
    numbers, _ = free_coordinates(robot)
    for q in in_ranges(dynamics, 5, seed=1):
        assert mobility(robot, q) == len(dynamics.joint_names)
        rates = dynamics.expand_velocities(
            np.eye(len(dynamics.joint_names)), np.tile(q, (len(dynamics.joint_names), 1))
        )
        motors = [independent(dynamics).index(number) for number in legs]
        assert np.linalg.cond(rates[np.ix_(motors, numbers)]) < 1e3


@pytest.mark.slow
@pytest.mark.parametrize("name", PARALLEL)
def test_both_models_agree_with_multipliers_on_maximal_coordinates(name):
    robot = load_robot(name)
    dynamics, peer = Dynamics(robot, compiled=False), MaximalCoordinates(robot)
    actuated, rng = independent(dynamics), np.random.default_rng(2)
    for q in in_ranges(dynamics, 5, seed=2):
        qd, qdd = rng.uniform(-1, 1, (2, len(actuated)))
        prescribed = np.full(len(q), np.nan)
        prescribed[actuated] = qdd
        expected = peer.inverse(q, dynamics.expand_velocities(qd, q), prescribed)
        result = dynamics.solve(q, qd, qdd=qdd)
        scale = np.abs(expected.efforts).max()
        np.testing.assert_allclose(result.efforts, expected.efforts[actuated], rtol=0, atol=1e-8 * scale)
        scale = max(1, np.abs(expected.accelerations).max())
        np.testing.assert_allclose(result.motion.accelerations, expected.accelerations, rtol=0, atol=1e-8 * scale)
        np.testing.assert_allclose(dynamics.direct(q, qd, result.efforts), qdd, rtol=0, atol=1e-8 * scale)


def platform_coordinates(dynamics, q):
    return q[:, dynamics.robot.platform.joints]


def legs_of(dynamics, q, name):
    return q[:, [number for joint, number in dynamics.robot.joint_numbers.items() if joint.startswith(f"{name}_")]]


def test_parallel_robot_of_the_documentation_closes():
    page = (Path(__file__).parents[2] / "docs" / "how_to" / "parallel_robots.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"```yaml\n(# hexapod.yaml\n.*?)```", page, re.DOTALL)
    dynamics = Dynamics(load_robot(table, strict=True))
    assert dynamics.joint_names == tuple(f"leg_{number}" for number in range(1, 7))
    q = dynamics.initial_joint_positions
    assert np.abs(loop_gaps(dynamics.robot, q)).max() < 1e-11
    masses = {link.name: link.inertia.mass for link in dynamics.robot.links}
    assert (masses["tube_5"], masses["tube_6"]) == (1, 1.1)
    assert np.all(dynamics.gravity(q[independent(dynamics)]) > 5)  # each leg bears its part


def test_legs_of_the_gough_stewart_platform_have_the_distance_between_their_joints():
    dynamics = Dynamics(load_robot("gough_stewart"))
    q = in_ranges(dynamics, 100)
    around = np.radians(np.arange(3) * 120)
    base = np.sort(np.concatenate([around - np.radians(2.5), around + np.radians(2.5)]))
    plate = np.sort(np.concatenate([around - np.radians(50), around + np.radians(50)]))
    poses = dynamics.link_pose("platform", q)
    for leg, (below, above) in enumerate(zip(base, plate, strict=True)):
        joint = [np.cos(above), np.sin(above), 0, 1]
        vector = (poses @ joint)[:, :3] - 3 * np.array([np.cos(below), np.sin(below), 0])
        np.testing.assert_allclose(legs_of(dynamics, q, "leg")[:, leg], np.linalg.norm(vector, axis=1), rtol=1e-13)
    masses = {link.name: link.inertia.mass for link in dynamics.robot.links}
    steel, length = 76e3 / 9.81 * np.pi, 0.75 * dynamics.initial_joint_positions[dynamics.robot.joint_numbers["leg_1"]]
    assert [masses[name] for name in ("tube_3", "rod_3", "platform")] == pytest.approx(
        [steel * 0.0016 * length, steel * 0.0009 * length, steel * 0.05]
    )


@pytest.mark.parametrize("name", ["delta", "delta_wrist"])
def test_bars_of_the_delta_have_the_distance_from_elbow_to_platform(name):
    dynamics = Dynamics(load_robot(name))
    q = in_ranges(dynamics, 100)
    x, y, z, *angles = platform_coordinates(dynamics, q).T
    np.testing.assert_allclose(angles, 0, atol=1e-13)
    for arm, direction in zip(legs_of(dynamics, q, "arm").T, np.radians([0, 120, 240]), strict=True):
        ahead = x * np.cos(direction) + y * np.sin(direction) + 0.125 - 0.33 - 0.42 * np.cos(arm)
        aside = y * np.cos(direction) - x * np.sin(direction)
        np.testing.assert_allclose(np.sqrt(ahead**2 + aside**2 + (z + 0.42 * np.sin(arm)) ** 2), 1.055, rtol=1e-13)


@pytest.mark.slow
def test_orthoglide_agrees_with_its_source():
    """Motor positions in closed form; velocity factors of the platform from 0.5 to 2 in the cube, 2 at two corners."""
    dynamics = Dynamics(load_robot("orthoglide"))
    q = in_ranges(dynamics, 100)
    p, angles = np.split(platform_coordinates(dynamics, q), 2, axis=1)
    np.testing.assert_allclose(angles, 0, atol=1e-13)
    across = np.sum(p**2, axis=1)[:, None] - p**2
    np.testing.assert_allclose(legs_of(dynamics, q, "motor"), p + np.sqrt(0.31025**2 - across), rtol=1e-13)
    corners = closed_at_poses(dynamics, np.array([[0.07321] * 3, [-0.12679] * 3]))
    rates = [dynamics.expand_velocities(np.eye(3), np.tile(sample, (3, 1)))[:, :3] for sample in [*corners, *q]]
    factors = np.linalg.svd(rates, compute_uv=False)
    np.testing.assert_allclose(factors[:2].max(axis=1), 2, rtol=2e-3)
    assert np.all((0.49 < factors) & (factors < 2.01))


def test_links_of_the_navaro_have_the_distance_from_motor_to_platform():
    dynamics = Dynamics(load_robot("navaro"))
    q = in_ranges(dynamics, 100)
    x, y, z, yaw, pitch, roll = platform_coordinates(dynamics, q).T
    np.testing.assert_allclose([z, pitch, roll], 0, atol=1e-13)
    for crank, angle in zip(legs_of(dynamics, q, "crank").T, np.radians([90, -150, -30]), strict=True):
        ahead = x + 0.2027 * np.cos(yaw + angle) - 0.7 / np.sqrt(3) * np.cos(angle) - 0.21 * np.cos(crank)
        aside = y + 0.2027 * np.sin(yaw + angle) - 0.7 / np.sqrt(3) * np.sin(angle) - 0.21 * np.sin(crank)
        np.testing.assert_allclose(np.hypot(ahead, aside), 0.21, rtol=1e-12)
    arm, b, c = (legs_of(dynamics, q, name) for name in ("arm", "b", "c"))
    np.testing.assert_allclose(arm + b, legs_of(dynamics, q, "crank"), atol=1e-12)  # a rhombus
    np.testing.assert_allclose(b + c, np.pi, atol=1e-12)


def test_wrist_of_the_hybrid_moves_with_the_platform_at_rest():
    dynamics = Dynamics(load_robot("delta_wrist"))
    q = in_ranges(dynamics, 20)
    turn, tilt = (q[:, dynamics.robot.joint_numbers[name]] for name in ("turn", "tilt"))
    ahead, down = 0.0632 - 0.135 * np.sin(tilt), 0.132 + 0.135 * np.cos(tilt)
    expected = q[:, :3] + np.stack([ahead * np.cos(turn), ahead * np.sin(turn), -down], axis=-1)
    np.testing.assert_allclose(dynamics.link_pose("tool", q)[:, :3, 3], expected, rtol=0, atol=1e-13)
