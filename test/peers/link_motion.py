"""Where the links of a robot are and how they move, in the world, as sums over the joints that carry each of them."""

from typing import NamedTuple

import numpy as np


class LinkMotion(NamedTuple):
    """Of every link 0..n, in the world.

    poses: (n + 1, 4, 4) of the link frames. velocities: (n + 1, 6), [velocity of the frame's origin; angular velocity].
    jacobians: (n + 1, 6, n), what each joint rate adds to the velocity of each link, the base at rest.
    """

    poses: np.ndarray
    velocities: np.ndarray
    jacobians: np.ndarray


def joint_displacement(joint, position):
    """(4, 4): what the variable of a joint [rad or m] does to its frame, about or along its z axis."""
    moved = np.eye(4)
    if joint.prismatic:
        moved[2, 3] = position
    else:
        cosine, sine = np.cos(position), np.sin(position)
        moved[:2, :2] = [[cosine, -sine], [sine, cosine]]
    return moved


def link_motion(robot, q, qd=None, pose=None, twist=None):
    """LinkMotion at positions q (n,) [rad or m] and velocities qd (n,) of all joints, zero if None.

    pose: (4, 4) of the base in the world, the identity if None; twist: (6,) of the base in its own frame, at rest if
    None. The velocity of a point p is v₀ + ω₀ × (p − p₀) + Σ q̇ₖ zₖ × (p − pₖ), the sum over the joints between the
    link and the base, or q̇ₖ zₖ for joints that slide.
    """
    n = len(robot.joints)
    poses = [np.eye(4) if pose is None else np.asarray(pose, dtype=float)]
    carried = np.zeros((n + 1, n), dtype=bool)  # whether a link is moved by a joint
    for number, (joint, position) in enumerate(zip(robot.joints, q, strict=True)):
        poses.append(poses[joint.antecedent] @ joint.placement @ joint_displacement(joint, position))
        carried[number + 1] = carried[joint.antecedent]
        carried[number + 1, number] = True
    poses = np.array(poses)
    turns = np.array([not joint.prismatic for joint in robot.joints], dtype=bool)[:, None]
    axes, feet = poses[1:, :3, 2], poses[1:, :3, 3]
    linear = np.where(turns, np.cross(axes, poses[:, None, :3, 3] - feet), axes)
    angular = np.broadcast_to(np.where(turns, axes, 0.0), linear.shape)
    jacobians = np.swapaxes(np.concatenate([linear, angular], axis=2) * carried[:, :, None], 1, 2)
    velocities = jacobians @ (np.zeros(n) if qd is None else np.asarray(qd, dtype=float))
    if twist is not None:
        R = poses[0, :3, :3]
        v, omega = R @ twist[:3], R @ twist[3:]
        velocities[:, :3] += v + np.cross(omega, poses[:, :3, 3] - poses[0, :3, 3])
        velocities[:, 3:] += omega
    return LinkMotion(poses, velocities, jacobians)
