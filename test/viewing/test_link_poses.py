"""Poses of frames and visuals in batches, with a moving base; test_visuals.py compares all visuals with Pinocchio."""

import numpy as np
import pytest
from peers.pinocchio_model import PinocchioModel
from peers.random_robots import random_states, random_urdf

from robot_dynamics import load_robot
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.viewing.link_poses import frame_poses, visual_poses


@pytest.mark.parametrize("seed", range(5))
def test_poses_of_frames_are_those_of_pinocchio(seed):
    urdf = random_urdf(seed)
    robot = read_urdf(urdf, moving_base=True)
    names = [joint.name for joint in robot.joints]
    peer = PinocchioModel(urdf, names, moving_base=True)
    states = random_states(robot, len(names), 4, seed)
    base_poses = np.tile(np.eye(4), (4, 1, 1))
    for sample in range(4):
        base_poses[sample] = states.base_of(sample)[0]
    poses = frame_poses(robot, states.q, base_poses)
    assert poses.shape == (4, len(robot.frames), 4, 4)
    for sample in range(4):
        for number, frame in enumerate(robot.frames):
            expected = peer.link_pose(frame.name, states.q[sample], base_poses[sample])
            np.testing.assert_allclose(poses[sample, number], expected, rtol=0, atol=1e-12)


def test_batch_axes_broadcast():
    robot = load_robot("panda")
    q = np.random.default_rng(0).uniform(-1, 1, (2, 3, 7))
    base_poses = np.tile(np.eye(4), (2, 1, 1, 1))
    base_poses[1, 0, :3, 3] = [1, 2, 3]
    poses = frame_poses(robot, q, base_poses)
    assert poses.shape == (2, 3, len(robot.frames), 4, 4)
    np.testing.assert_array_equal(poses[0, 1], frame_poses(robot, q[0, 1]))
    np.testing.assert_allclose(poses[1, 2, :, :3, 3], frame_poses(robot, q[1, 2])[:, :3, 3] + [1, 2, 3], atol=1e-15)


def test_robot_without_visuals_has_no_poses_of_visuals():
    assert visual_poses(load_robot("rx90"), np.zeros((5, 6))).shape == (5, 0, 4, 4)
