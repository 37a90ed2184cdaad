"""The URDF that is written of a robot with loops, in Pinocchio: what robot_state_publisher shows of joint states."""

import numpy as np
import pinocchio

from robot_dynamics import write_urdf


class CutUrdf:
    """Poses of the links of a written URDF at joint positions by name, and the gaps at its cut joints."""

    def __init__(self, robot, text=None):
        self.robot = robot
        self.model = pinocchio.buildModelFromXML(text or write_urdf(robot, lossy=True))
        self.data = self.model.createData()

    @property
    def joint_names(self):
        return list(self.model.names)[1:]

    def move(self, positions):
        """Place all links. positions: {joint: [rad or m]}."""
        q = pinocchio.neutral(self.model)
        for name in self.joint_names:
            joint = self.model.joints[self.model.getJointId(name)]
            value = positions[name]
            q[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
        pinocchio.framesForwardKinematics(self.model, self.data, q)

    def pose(self, link):
        """(4, 4) of a link in the base."""
        return self.data.oMf[self.model.getFrameId(link, pinocchio.FrameType.BODY)].homogeneous

    def end_pose(self, end):
        """(4, 4) of a LoopEnd in the base."""
        link = self.robot.links[end.link].name
        return self.pose(link) @ np.linalg.inv(self.robot.frame(link).placement) @ end.placement

    def gaps(self):
        """(m,) [m, and entries of rotation matrices]: how far the ends of the loops are apart."""
        gaps = [np.zeros(0)]
        for loop in self.robot.loops:
            moved, closed_on = map(self.end_pose, loop.ends)
            difference = moved - closed_on
            gaps.append(difference[:3, 3] if loop.is_spherical else difference[:3].ravel())
        return np.concatenate(gaps)

    def centre_of_mass(self, link):
        """(3,) in the base, and mass, of a link with all that is fixed to it."""
        joint = self.model.frames[self.model.getFrameId(link, pinocchio.FrameType.BODY)].parentJoint
        inertia = self.model.inertias[joint]
        return self.data.oMi[joint].act(inertia.lever), inertia.mass

    def joint_axis(self, name):
        """(origin (3,), axis (3,)) of a joint in the base, the axis by the Jacobian at the last positions."""
        joint = self.model.getJointId(name)
        pinocchio.computeJointJacobians(self.model, self.data)
        jacobian = pinocchio.getJointJacobian(self.model, self.data, joint, pinocchio.LOCAL_WORLD_ALIGNED)
        linear, angular = np.split(jacobian[:, self.model.joints[joint].idx_v], 2)
        return self.data.oMi[joint].translation, angular if np.linalg.norm(angular) > 0.5 else linear
