"""States of robots over the whole range of their motors, on straight lines, and the rank of their efforts."""

import numpy as np

from robot_dynamics import Base
from robot_dynamics.errors import SingularModelError

from .loop_states import loop_gaps
from .reachable import closed_at_poses, free_coordinates

REACH = 3.0  # [rad or m] to both sides of joints without limits
MOST = 60  # positions on the line of a single motor


def positions_of_platforms(dynamics, samples, rng):
    """Positions (N, all joints) at random poses of the platforms, joints outside of loops within ±1."""
    numbers, (lower, upper) = free_coordinates(dynamics.robot)
    home = dynamics.initial_joint_positions[numbers]
    size = np.where([dynamics.robot.joints[number].prismatic for number in numbers],
                    0.15 * dynamics.robot.characteristic_length, 0.4)  # fmt: skip
    poses = rng.uniform(np.maximum(lower, home - size), np.minimum(upper, home + size), (2 * samples, len(numbers)))
    q = closed_at_poses(dynamics, poses)
    outside_loops = [number for number in range(q.shape[1]) if number not in dynamics.robot.joints_in_loops]
    q[:, outside_loops] += rng.uniform(-1, 1, (len(q), len(outside_loops)))
    closed = [k for k in range(len(q)) if np.abs(loop_gaps(dynamics.robot, q[k])).max() < 1e-11]
    return q[closed[:samples]]


def scanned_positions(dynamics, samples, rng):
    """Positions (N, all joints), N >= samples, on straight lines of the independent joints from the initial positions
    as far as limits let them and loops close."""
    joints = [dynamics.robot.joints[dynamics.robot.joint_numbers[name]] for name in dynamics.joint_names]
    home = dynamics.initial_joint_positions
    start = np.array([home[dynamics.robot.joint_numbers[name]] for name in dynamics.joint_names])
    lower, upper = (np.array([getattr(joint.limits, side) for joint in joints]) for side in ("lower", "upper"))
    lower = np.where(np.isfinite(lower), lower, start - REACH)
    upper = np.where(np.isfinite(upper), upper, start + REACH)
    lines = []
    while sum(map(len, lines)) < samples:
        is_single = len(joints) == 1
        end = (lower, upper)[len(lines) % 2] if is_single else rng.uniform(lower, upper)
        count = min(samples, MOST) if is_single else 12
        lines.append(_followed(dynamics, start + np.linspace(0, 1, count)[:, None] * (end - start)))
        if is_single and len(lines) > 1:
            break
    return np.concatenate(lines)


def _followed(dynamics, line):
    """Positions (N, all joints) along a line (M, n), up to where the loops do not close any more."""
    if not dynamics.robot.loops:
        return dynamics.expand_positions(line)
    numbers = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    lines = [dynamics.initial_joint_positions]
    for motors in line:
        next_positions = np.full(len(lines[-1]), np.nan)
        next_positions[numbers] = motors
        try:
            lines.append(dynamics.expand_trajectory(np.stack([lines[-1], next_positions]))[1])
        except SingularModelError:
            break
    return np.array(lines)


def rank_of_efforts(dynamics, samples, seed):
    """(rank of the regressor at random rates and accelerations of scanned positions, its last singular value that
    counts over the next)."""
    rng = np.random.default_rng(seed)
    q = (positions_of_platforms if dynamics.robot.platforms else scanned_positions)(dynamics, samples, rng)
    q = np.repeat(q, max(1, -(-samples // len(q))), axis=0)
    qd, qdd = rng.uniform(-2, 2, (2, len(q), len(dynamics.joint_names)))
    base = None
    if dynamics.robot.moving_base:
        orthogonal = np.linalg.qr(rng.normal(size=(len(q), 3, 3)))[0]
        poses = np.tile(np.eye(4), (len(q), 1, 1))
        poses[:, :3, :3] = orthogonal * np.sign(np.linalg.det(orthogonal))[:, None, None]
        base = Base(poses, *rng.uniform(-2, 2, (2, len(q), 6)))
    if not dynamics.robot.loops:
        q = q[:, [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]]
    Y = dynamics.regressor(q, qd, qdd, base=base)
    # near dead points rates are large: all rows count the same, then all columns
    Y = Y.reshape(-1, Y.shape[-1])
    Y = Y / np.maximum(np.linalg.norm(Y, axis=1, keepdims=True), 1e-300)
    lengths = np.linalg.norm(Y, axis=0)
    Y = Y[:, lengths > 1e-11 * lengths.max()]
    s = np.linalg.svd(Y / np.linalg.norm(Y, axis=0), compute_uv=False)
    s = np.maximum(np.append(s, 0.0), 1e-14 * s[0])
    gaps = np.where(s[1:] < 1e-9 * s[0], s[:-1] / s[1:], 0)
    rank = int(np.argmax(gaps)) + 1
    return rank, gaps[rank - 1]
