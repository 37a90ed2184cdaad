"""Poses of the named frames of a robot in the world."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.newton_euler.kinematics import link_placements

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.robot import Robot


def frame_poses(robot: Robot, q: ScalarArray, base_pose: ScalarArray | None = None) -> ScalarArray:
    """Return the poses of all named frames in the world.

    Parameters
    ----------
    robot : Robot
        The robot.
    q : (..., n) array
        Positions of all joints [rad or m]: the caller closes loops and computes mimic joints.
    base_pose : (..., 4, 4) array, optional
        Pose of frame 0 in the world. Default: the identity.

    Returns
    -------
    (..., n_frames, 4, 4) array
        Poses in the order of `robot.frames`; the pose of a visual is that of its frame times its placement.
    """
    links = link_matrices(robot, q, base_pose)
    placements = np.stack([frame.placement for frame in robot.frames])
    poses: ScalarArray = links[..., [frame.link for frame in robot.frames], :, :] @ placements
    return poses


def link_matrices(robot: Robot, q: ScalarArray, base_pose: ScalarArray | None = None) -> ScalarArray:
    """Return the poses (..., n + 1, 4, 4) of the link frames 0..n in the world, with the arguments of `frame_poses`."""
    placements = link_placements(robot, q)
    matrices = np.zeros((*q.shape[:-1], len(placements), 4, 4), dtype=np.result_type(q, float))
    matrices[..., 3, 3] = 1
    for number, (rotation, position) in enumerate(placements):
        matrices[..., number, :3, :3] = rotation
        matrices[..., number, :3, 3] = position
    return matrices if base_pose is None else base_pose[..., None, :, :] @ matrices


def visual_poses(robot: Robot, q: ScalarArray, base_pose: ScalarArray | None = None) -> ScalarArray:
    """Return the poses (..., n_visuals, 4, 4) of `robot.visuals` in the world, with the arguments of `frame_poses`."""
    numbers = {frame.name: number for number, frame in enumerate(robot.frames)}
    placements = np.array([visual.placement for visual in robot.visuals]).reshape(-1, 4, 4)
    frames = [numbers[visual.frame] for visual in robot.visuals]
    poses: ScalarArray = frame_poses(robot, q, base_pose)[..., frames, :, :] @ placements
    return poses
