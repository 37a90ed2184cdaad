"""Visual geometry of real robots as Pinocchio reads it, with its meshes and its poses."""

from functools import cache

import numpy as np
import pinocchio as pin

from peers.real_robots import REAL_ROBOTS, ROBOTS

PACKAGE_FOLDERS = [str(ROBOTS.parent.parent), str(ROBOTS)]


class PinocchioVisuals:
    """Pinocchio's visuals of a URDF with a fixed base."""

    def __init__(self, path):
        self.model = pin.buildModelFromUrdf(str(path))
        self.geometry = pin.buildGeomFromUrdf(self.model, str(path), pin.GeometryType.VISUAL, None, PACKAGE_FOLDERS)

    def on_frame(self, name):
        """Return the indices of the visuals of a link, in the order of the text."""
        visuals = enumerate(self.geometry.geometryObjects)
        return [index for index, visual in visuals if self.model.frames[visual.parentFrame].name == name]

    def configuration(self, positions):
        """Return Pinocchio's configuration vector for joint positions by name."""
        q = pin.neutral(self.model)
        for name, position in positions.items():
            joint = self.model.joints[self.model.getJointId(name)]
            q[joint.idx_q : joint.idx_q + joint.nq] = (
                position if joint.nq == 1 else [np.cos(position), np.sin(position)]
            )
        return q

    def world_poses(self, positions):
        """Return the poses (n, 4, 4) of all visuals in the world."""
        data, geometry_data = self.model.createData(), self.geometry.createData()
        pin.updateGeometryPlacements(self.model, data, self.geometry, geometry_data, self.configuration(positions))
        return np.array([pose.homogeneous for pose in geometry_data.oMg])


@cache
def pinocchio_visuals(name):
    return PinocchioVisuals(ROBOTS / REAL_ROBOTS[name])
