"""How far the loops of a robot are open in what is drawn: from the poses of nodes in the scene alone."""

import numpy as np
from scipy.spatial.transform import Rotation


def drawn_link_poses(scene):
    """{link: (4, 4)} poses of the nodes of the links, as they were sent to the browser."""
    poses = {}
    for link, node in scene.link_frames.items():
        pose = np.eye(4)
        w, x, y, z = node.wxyz
        pose[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
        pose[:3, 3] = node.position
        poses[link] = pose
    return poses


def largest_gap(robot, poses):
    """Largest distance [m] and angle [rad] between the two ends of a loop of which both links are drawn."""
    gaps = [0.0]
    for loop in robot.loops:
        if not all(end.link in poses for end in loop.ends):
            continue
        first, second = (poses[end.link] @ end.placement for end in loop.ends)
        gaps.append(np.linalg.norm(first[:3, 3] - second[:3, 3]))
        if not loop.is_spherical:
            gaps.append(np.linalg.norm(first[:3, :3] - second[:3, :3]))
    return max(gaps)
