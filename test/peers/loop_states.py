"""Closed states of robots with loops: an independent Newton method, and rates that keep loops closed."""

import numpy as np
from scipy.spatial.transform import Rotation

from .link_motion import link_motion

CLOSED = 1e-13  # [m or rad] at which Newton's method stops
RANK = 1e-8  # part of the largest singular value below which others count as zero


def coupling(robot):
    """(S, offset): positions (n,) of all joints are S x + offset, x those of joints that mimic no other joint."""
    numbers = {joint.name: number for number, joint in enumerate(robot.joints)}
    non_mimic = [number for number, joint in enumerate(robot.joints) if joint.mimic is None]
    S, offset = np.zeros((len(robot.joints), len(non_mimic))), np.zeros(len(robot.joints))
    for number, joint in enumerate(robot.joints):
        if joint.mimic is None:
            S[number, non_mimic.index(number)] = 1
        else:
            S[number, non_mimic.index(numbers[joint.mimic.joint])] = joint.mimic.multiplier
            offset[number] = joint.mimic.offset
    return S, offset


def loop_gaps(robot, q):
    """(m,) [m, rad]: how far frames k are from frames k+B, three numbers for a spherical joint, else six."""
    poses = link_motion(robot, q).poses
    gaps = []
    for loop in robot.loops:
        k, opposite = (poses[end.link] @ end.placement for end in loop.ends)
        gaps.append(k[:3, 3] - opposite[:3, 3])
        if not loop.is_spherical:
            gaps.append(Rotation.from_matrix(k[:3, :3] @ opposite[:3, :3].T).as_rotvec())
    return np.concatenate([np.zeros(0), *gaps])


def loop_jacobian(robot, q):
    """(m, n): velocities of frames k less those of frames k+B, at closed positions, for unit rates of all joints."""
    motion = link_motion(robot, q)
    blocks = []
    for loop in robot.loops:
        k, opposite = (_velocity_of(motion, end) for end in loop.ends)
        blocks.append((k - opposite)[: 3 if loop.is_spherical else 6])
    return np.vstack([np.zeros((0, len(robot.joints))), *blocks])


def _velocity_of(motion, end):
    pose, jacobian = motion.poses[end.link], motion.jacobians[end.link]
    arm = pose[:3, :3] @ end.placement[:3, 3]
    return np.vstack([jacobian[:3] + np.cross(jacobian[3:], arm, axis=0), jacobian[3:]])


def rank_of(matrix):
    """(rank, gap): how many singular values count, and the first that does not, as part of the largest one."""
    s = np.append(np.linalg.svd(matrix, compute_uv=False), 0.0)
    rank = int(np.sum(s > RANK * s[0]))
    return rank, s[rank] / s[0] if s[0] else 0.0


def mobility(robot, q):
    """Number of joints that move independently near closed positions q (n,), by the rank of the loop equations."""
    S, _ = coupling(robot)
    return S.shape[1] - rank_of(loop_jacobian(robot, q) @ S)[0]


def closed_positions(robot, q, dependents):
    """The closed positions (n,) with all but the joints `dependents`, and mimic joints, at q (n,).

    Newton's method with least squares, as equations may be redundant. Raises ValueError where it does not converge.
    """
    S, offset = coupling(robot)
    non_mimic = [number for number, joint in enumerate(robot.joints) if joint.mimic is None]
    columns = [non_mimic.index(number) for number in dependents]
    x = np.asarray(q, dtype=float)[non_mimic]
    for _ in range(40):
        q = S @ x + offset
        gaps = loop_gaps(robot, q)
        if np.abs(gaps).max(initial=0) < CLOSED:
            break
        step = np.linalg.lstsq(loop_jacobian(robot, q) @ S[:, columns], -gaps, rcond=RANK)[0]
        x[columns] += step * min(1.0, 0.5 / np.abs(step).max(initial=1e-300))
    gaps = loop_gaps(robot, q)
    if np.abs(gaps).max(initial=0) > 10 * CLOSED:
        raise ValueError(f"the loops of {robot.name!r} stay open by {np.abs(gaps).max():.3g}")
    return q


def closed_rates(robot, q, qd, dependents):
    """The rates (n,) that keep loops closed, those of all but `dependents` and mimic joints as in qd (n,)."""
    S, _ = coupling(robot)
    non_mimic = [number for number, joint in enumerate(robot.joints) if joint.mimic is None]
    columns = [non_mimic.index(number) for number in dependents]
    x = np.asarray(qd, dtype=float)[non_mimic]
    x[columns] = 0
    J = loop_jacobian(robot, q) @ S
    x[columns] = -np.linalg.lstsq(J[:, columns], J @ x, rcond=RANK)[0]
    assert np.abs(J @ x).max(initial=0) < 1e-10 * max(1, np.abs(x).max(initial=0)), "a further joint is dependent"
    return S @ x


def condition_of(robot, q, dependents):
    """Of the equations for the dependent joints: the largest singular value over the smallest one."""
    s = np.linalg.svd(loop_jacobian(robot, q)[:, list(dependents)], compute_uv=False)[: len(dependents)]
    return s[0] / s[-1] if len(s) else 1.0


def random_closed_state(robot, q, dependents, rng, reach=0.3):
    """(q, q̇) each (n,), random and with loops closed: positions within `reach` [rad or m] of closed ones q (n,), but
    for the dependent joints; the equations for these are no worse there than 1e4."""
    while True:
        near = q + rng.uniform(-reach, reach, len(q))
        near[list(dependents)] = q[list(dependents)]
        try:
            closed = closed_positions(robot, near, dependents)
        except ValueError:
            reach /= 2
            continue
        if condition_of(robot, closed, dependents) < 1e4 and np.abs(closed - q)[list(dependents)].max(initial=0) < 2:
            return closed, closed_rates(robot, closed, rng.uniform(-2, 2, len(q)), dependents)
        reach *= 0.8
