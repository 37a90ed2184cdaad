"""Poses and velocities of the links of a robot in the world, as sums over the joints between each link and the base."""

from typing import NamedTuple

import numpy as np


class LinkMotion(NamedTuple):
    """Of every link 0..n, in the world.

    poses: (n + 1, 4, 4) of the link frames. velocities: (n + 1, 6), [velocity of the frame's origin; angular velocity].
    jacobians: (n + 1, 6, n), derivatives of link velocities by joint rates, the base at rest.
    """

    poses: np.ndarray
    velocities: np.ndarray
    jacobians: np.ndarray


def joint_displacement(joint, position):
    """(4, 4): displacement of a joint's frame by its position [rad or m], about or along its z axis."""
    displacement = np.eye(4)
    if joint.prismatic:
        displacement[2, 3] = position
    else:
        cosine, sine = np.cos(position), np.sin(position)
        displacement[:2, :2] = [[cosine, -sine], [sine, cosine]]
    return displacement


def link_motion(robot, q, qd=None, pose=None, twist=None):
    """LinkMotion at positions q (n,) [rad or m] and velocities qd (n,) of all joints, zero if None.

    pose: (4, 4) of the base in the world, the identity if None; twist: (6,) of the base in its own frame, at rest if
    None. The velocity of a point p is v₀ + ω₀ × (p − p₀) + Σ q̇ₖ zₖ × (p − pₖ), the sum over the joints between the
    link and the base, or q̇ₖ zₖ for joints that slide.
    """
    n = len(robot.joints)
    poses = [np.eye(4) if pose is None else np.asarray(pose, dtype=float)]
    is_moved = np.zeros((n + 1, n), dtype=bool)  # of a link by a joint
    for number, (joint, position) in enumerate(zip(robot.joints, q, strict=True)):
        poses.append(poses[joint.antecedent] @ joint.placement @ joint_displacement(joint, position))
        is_moved[number + 1] = is_moved[joint.antecedent]
        is_moved[number + 1, number] = True
    poses = np.array(poses)
    turns = np.array([not joint.prismatic for joint in robot.joints], dtype=bool)[:, None]
    axes, origins = poses[1:, :3, 2], poses[1:, :3, 3]
    linear = np.where(turns, np.cross(axes, poses[:, None, :3, 3] - origins), axes)
    angular = np.broadcast_to(np.where(turns, axes, 0.0), linear.shape)
    jacobians = np.swapaxes(np.concatenate([linear, angular], axis=2) * is_moved[:, :, None], 1, 2)
    velocities = jacobians @ (np.zeros(n) if qd is None else np.asarray(qd, dtype=float))
    if twist is not None:
        R = poses[0, :3, :3]
        v, omega = R @ twist[:3], R @ twist[3:]
        velocities[:, :3] += v + np.cross(omega, poses[:, :3, 3] - poses[0, :3, 3])
        velocities[:, 3:] += omega
    return LinkMotion(poses, velocities, jacobians)
