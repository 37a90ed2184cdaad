"""Parallel robots keep their assembly mode: `expand_positions` agrees with `expand_trajectory` or refuses."""

import os
import tracemalloc

import numpy as np
import pytest
from peers.large_robots import each_robot
from peers.random_platforms import KINDS, random_platform
from peers.reachable import limits_of

from robot_dynamics import Dynamics, SingularModelError, load_robot, shipped_robots
from robot_dynamics.constraints.closure_solver import ClosureSolver

DRAWS = int(os.environ.get("MOTOR_DRAWS", 0)) or 20  # `make soak`: 1000
SHORT = 10  # draws of a robot with two platforms in `make test`
SINGLE_COUNT = 5  # of the draws are expanded one by one, the others in a batch
SAMPLES = 20  # of the straight path of the motors from home
# least fractions of the draws that expand_positions accepts: about 0.8 of the measured fractions
PARALLEL = {"delta": 0.8, "delta_wrist": 0.8, "gough_stewart": 0.38, "hexapod_stack": 0.17, "navaro": 0.26,
            "orthoglide": 0.8}  # fmt: skip
KINDS_CLOSED = {"3-RPS": (0.2, 0.2), "3-PRS": (0.13, 0.32), "6-UPS": (0.76, 0.76), "3-UPU": (0.76, 0.8)}  # by seed
REACH = {"3-RPS": 0.25, "3-PRS": 0.25, "6-UPS": 0.12, "3-UPU": 0.06}  # [m] of the motors around home
SEEDS = range(2)


def expanded(dynamics, q):
    """Return the positions (N, all joints) of expand_positions for q (N, n), nan where it refuses."""
    actual, closed = ClosureSolver(dynamics.robot).try_close_loops(q)
    actual = np.where(closed[:, None], actual, np.nan)
    for sample in range(min(SINGLE_COUNT, len(q))):
        try:
            actual[sample] = dynamics.expand_positions(q[sample])
        except SingularModelError:
            actual[sample] = np.nan
    return actual


def followed(dynamics, q):
    """Return positions (all joints,) at q (n,), the end of the straight path from home; None where the loops open."""
    numbers = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    path = np.linspace(dynamics.initial_joint_positions[numbers], q, SAMPLES)
    try:
        return dynamics.expand_trajectory(path)[-1]
    except SingularModelError:
        return None


def check_modes(dynamics, q, least):
    """Check that expand_positions refuses each of motor positions q (N, n) or agrees with expand_trajectory; at least a
    fraction `least` agrees."""
    actual = expanded(dynamics, q)
    closed = np.isfinite(actual).all(axis=1)
    assert closed.mean() >= least
    for sample, positions in zip(q[closed], actual[closed], strict=True):
        expected = followed(dynamics, sample)
        assert expected is not None, f"expand_trajectory does not reach {sample.tolist()}"
        np.testing.assert_allclose(positions, expected, rtol=0, atol=1e-8)
    print(f"{dynamics.robot.name}: {closed.sum()} of {len(q)} agree, {(~closed).sum()} are refused")


@pytest.mark.slow
@pytest.mark.parametrize("name", each_robot(PARALLEL))
def test_assembly_modes_of_shipped_robots(name):
    """Motors are at random positions within their limits."""
    dynamics = Dynamics(load_robot(name))
    dynamics.compile("closure")
    lower, upper = limits_of(dynamics)
    draws = min(DRAWS, SHORT) if len(dynamics.robot.platforms) > 1 and "MOTOR_DRAWS" not in os.environ else DRAWS
    q = np.random.default_rng(0).uniform(lower, upper, (draws, len(dynamics.joint_names)))
    check_modes(dynamics, q, PARALLEL[name])


def test_all_parallel_robots_are_covered():
    assert {name for name in shipped_robots() if load_robot(name).platforms} == {*PARALLEL}
    assert {*KINDS} == {*KINDS_CLOSED}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_assembly_modes_of_random_robots(kind, seed):
    dynamics = Dynamics(random_platform(kind, seed))
    dynamics.compile("closure")
    numbers = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    rng = np.random.default_rng(seed)
    count = -(-DRAWS // len(SEEDS))
    q = dynamics.initial_joint_positions[numbers] + REACH[kind] * rng.uniform(-1, 1, (count, len(numbers)))
    check_modes(dynamics, q, KINDS_CLOSED[kind][seed])


def turned_over(dynamics, motors, platform):
    """Return closed positions (all joints,) with these motor positions and the platform near coordinates (6,)."""
    seed = np.full(len(dynamics.all_joint_names), np.nan)
    seed[[dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]] = motors
    seed[list(dynamics.robot.platform.joints)] = platform
    return dynamics.expand_positions(seed)


def test_platform_turned_over_is_another_assembly_mode():
    """The path of this 3-PRS from home is singular: beyond it pitch exceeds 90°, and the determinant of the loops in
    rates of the angles has changed its sign twice."""
    dynamics = Dynamics(random_platform("3-PRS", 0))
    dynamics.compile("closure")
    motors = [0.3067215284076401, -0.10518782223341239, 0.24284711332882747]
    with pytest.raises(SingularModelError):
        dynamics.expand_positions(motors)


@pytest.mark.slow
def test_joint_positions_of_a_pose_have_that_pose():
    """Legs leave z, pitch and roll free, and pitch is beyond 90°: folded angles belong to another pose too."""
    dynamics = Dynamics(random_platform("3-PRS", 0))
    motors = [0.3067215284076401, -0.10518782223341239, 0.24284711332882747]
    q = turned_over(dynamics, motors, [-0.0143, 0.0399, 0.237, 2.7415, -3.9737, 2.2521])
    pose, numbers = dynamics.platform.pose(q), [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    assert np.cos(q[dynamics.robot.platform.joints[4]]) < -0.5
    actual = dynamics.platform.joint_positions(pose, seed=q)
    np.testing.assert_allclose(actual, q, rtol=0, atol=1e-9)
    near = q + 0.02 * np.random.default_rng(0).uniform(-1, 1, len(q))
    np.testing.assert_allclose(dynamics.platform.joint_positions(pose, seed=near)[numbers], motors, rtol=0, atol=1e-9)
    rates, accelerations = np.random.default_rng(1).uniform(-1, 1, (2, 3))
    result = dynamics.solve(q, rates, qdd=accelerations)
    motion = dynamics.platform.twist(result.motion), dynamics.platform.acceleration(result.motion)
    np.testing.assert_allclose(dynamics.platform.inverse(pose, *motion, seed=q), result.efforts, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_blocks_of_samples_are_closed_in_sequence(monkeypatch):
    """The memory of a block, such as the determinants of its loops, is released before the next but one."""
    monkeypatch.setattr("robot_dynamics.constraints.closure_solver.BLOCK_SIZE", 20)
    dynamics = Dynamics(load_robot("delta"))
    dynamics.compile("closure")
    numbers = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    peaks, before = [], np.geterr()
    for count in (20, 400):
        q = dynamics.initial_joint_positions[numbers] + np.linspace(-0.1, 0.1, count)[:, None]
        dynamics.expand_positions(q)
        tracemalloc.start()
        dynamics.expand_positions(q)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    matrix_bytes = 400 * len(dynamics.dependent_joint_names) ** 2 * 8
    assert peaks[1] - peaks[0] < matrix_bytes / 2
    samples = np.concatenate([q[:20], q[:1] + 2.5, q[:20]])
    with pytest.raises(SingularModelError, match="at sample 20"):
        dynamics.expand_positions(samples)
    assert np.geterr() == before
