"""Parallel robots keep their assembly mode: what `expand` returns is where `follow` leads from home, or it refuses."""

import os
import tracemalloc

import numpy as np
import pytest
from peers.random_platforms import KINDS, random_platform
from peers.reachable import limits_of

from robot_dynamics import Dynamics, SingularModelError, load_robot, shipped_robots
from robot_dynamics.constraints.closure_solver import ClosureSolver

DRAWS = int(os.environ.get("MOTOR_DRAWS", 0)) or 40  # `make soak`: 1000
ALONE = 5  # of the draws that are expanded one by one, the others together
SAMPLES = 20  # of the straight way of the motors from home
# least parts of the draws that expand has positions for: about 0.8 of the measured ones, of few draws or many
PARALLEL = {"delta": 0.8, "delta_wrist": 0.8, "gough_stewart": 0.38, "hexapod_stack": 0.17, "navaro": 0.26,
            "orthoglide": 0.8}  # fmt: skip
KINDS_CLOSED = {"3-RPS": (0.2, 0.2), "3-PRS": (0.13, 0.32), "6-UPS": (0.76, 0.76), "3-UPU": (0.76, 0.8)}  # by seed
REACH = {"3-RPS": 0.25, "3-PRS": 0.25, "6-UPS": 0.12, "3-UPU": 0.06}  # [m] of the motors around home
SEEDS = range(2)


def expanded(dynamics, q):
    """(N, all joints) positions that expand returns for q (N, n), nan where it refuses."""
    found, closed = ClosureSolver(dynamics.robot).try_close_loops(q)
    found = np.where(closed[:, None], found, np.nan)
    for place in range(min(ALONE, len(q))):
        try:
            found[place] = dynamics.expand_positions(q[place])
        except SingularModelError:
            found[place] = np.nan
    return found


def followed(dynamics, q):
    """(all joints,) positions at q (n,) at the end of the straight way from home, None where the loops open."""
    numbers = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    way = np.linspace(dynamics.initial_joint_positions[numbers], q, SAMPLES)
    try:
        return dynamics.expand_trajectory(way)[-1]
    except SingularModelError:
        return None


def check_modes(dynamics, q, least):
    """Each of motor positions q (N, n) is refused by expand, or leads to where follow comes to; at least a part `least`
    of them does."""
    found = expanded(dynamics, q)
    closed = np.isfinite(found).all(axis=1)
    assert closed.mean() >= least
    for one, joints in zip(q[closed], found[closed], strict=True):
        expected = followed(dynamics, one)
        assert expected is not None, f"follow does not come to {one.tolist()}"
        np.testing.assert_allclose(joints, expected, rtol=0, atol=1e-8)
    print(f"{dynamics.robot.name}: {closed.sum()} of {len(q)} agree, {(~closed).sum()} are refused")


@pytest.mark.parametrize("name", PARALLEL)
def test_shipped_robots(name):
    """Motors anywhere within their limits."""
    dynamics = Dynamics(load_robot(name))
    dynamics.compile("closure")
    lower, upper = limits_of(dynamics)
    q = np.random.default_rng(0).uniform(lower, upper, (DRAWS, len(dynamics.joint_names)))
    check_modes(dynamics, q, PARALLEL[name])


def test_every_parallel_robot_is_shown():
    assert {name for name in shipped_robots() if load_robot(name).platforms} == {*PARALLEL}
    assert {*KINDS} == {*KINDS_CLOSED}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_random_robots(kind, seed):
    dynamics = Dynamics(random_platform(kind, seed))
    dynamics.compile("closure")
    numbers = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    rng = np.random.default_rng(seed)
    count = -(-DRAWS // len(SEEDS))
    q = dynamics.initial_joint_positions[numbers] + REACH[kind] * rng.uniform(-1, 1, (count, len(numbers)))
    check_modes(dynamics, q, KINDS_CLOSED[kind][seed])


def turned_over(dynamics, motors, platform):
    """(all joints,) closed positions with these motors and the platform near coordinates (6,)."""
    seed = np.full(len(dynamics.all_joint_names), np.nan)
    seed[[dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]] = motors
    seed[list(dynamics.robot.platform.joints)] = platform
    return dynamics.expand_positions(seed)


def test_a_platform_turned_over_is_another_mode():
    """A 3-PRS of which the way from home is singular: beyond it pitch is more than 90°, and the determinant of the
    loops has changed its sign twice where it is counted by rates of the angles."""
    dynamics = Dynamics(random_platform("3-PRS", 0))
    dynamics.compile("closure")
    motors = [0.3067215284076401, -0.10518782223341239, 0.24284711332882747]
    with pytest.raises(SingularModelError):
        dynamics.expand_positions(motors)


def test_joint_values_of_a_pose_are_those_of_the_pose():
    """Legs that leave z, pitch and roll free, pitch beyond 90°: folded, the angles are those of another pose too."""
    dynamics = Dynamics(random_platform("3-PRS", 0))
    motors = [0.3067215284076401, -0.10518782223341239, 0.24284711332882747]
    q = turned_over(dynamics, motors, [-0.0143, 0.0399, 0.237, 2.7415, -3.9737, 2.2521])
    pose, numbers = dynamics.platform.pose(q), [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    assert np.cos(q[dynamics.robot.platform.joints[4]]) < -0.5
    found = dynamics.platform.joint_positions(pose, seed=q)
    np.testing.assert_allclose(found, q, rtol=0, atol=1e-9)
    near = q + 0.02 * np.random.default_rng(0).uniform(-1, 1, len(q))
    np.testing.assert_allclose(dynamics.platform.joint_positions(pose, seed=near)[numbers], motors, rtol=0, atol=1e-9)
    rates, accelerations = np.random.default_rng(1).uniform(-1, 1, (2, 3))
    answer = dynamics.solve(q, rates, qdd=accelerations)
    motion = dynamics.platform.twist(answer.motion), dynamics.platform.acceleration(answer.motion)
    np.testing.assert_allclose(dynamics.platform.inverse(pose, *motion, seed=q), answer.efforts, rtol=0, atol=1e-8)


def test_blocks_of_samples_are_closed_one_after_the_other(monkeypatch):
    """What is known of a block, such as the determinants of its loops, goes before the next but one comes."""
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
    placing = 400 * len(dynamics.dependent_joint_names) ** 2 * 8
    assert peaks[1] - peaks[0] < placing / 2
    refused = np.concatenate([q[:20], q[:1] + 2.5, q[:20]])
    with pytest.raises(SingularModelError, match="at sample 20"):
        dynamics.expand_positions(refused)
    assert np.geterr() == before
