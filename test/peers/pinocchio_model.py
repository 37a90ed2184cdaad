"""Dynamics by Pinocchio, in the conventions of `Dynamics`. Joints are matched by name."""

import numpy as np
import pinocchio as pin


class PinocchioModel:
    """The robot of a URDF text in Pinocchio, for one sample at a time.

    joints: names in the order of all joint vectors here, every moving joint of the URDF; moving_base: free-flyer root.
    base: (rotation, position, twist) as in `robot_dynamics.Base`, for a moving base.
    """

    def __init__(self, urdf, joints, moving_base=False, rotor_inertias=None):
        root = (pin.JointModelFreeFlyer(),) if moving_base else ()
        self.model = pin.buildModelFromXML(urdf, *root)
        self.data = self.model.createData()
        self.base_size = 6 if moving_base else 0
        self.joints = [self.model.joints[self.model.getJointId(name)] for name in joints]
        # rows of this project (base first, then `joints`) in Pinocchio's velocity vector
        self.rows = np.array([*range(self.base_size), *(joint.idx_v for joint in self.joints)], dtype=int)
        assert sorted(self.rows) == list(range(self.model.nv)), "the joints of Pinocchio's model are not those named"
        for joint, inertia in zip(self.joints, rotor_inertias if rotor_inertias is not None else (), strict=False):
            self.model.armature[joint.idx_v] = inertia

    def position(self, q, pose=None):
        full = pin.neutral(self.model)
        if self.base_size:
            full[:7] = pin.SE3ToXYZQUAT(pin.SE3(pose[:3, :3], pose[:3, 3]))
        for joint, value in zip(self.joints, q, strict=True):
            full[joint.idx_q : joint.idx_q + joint.nq] = [np.cos(value), np.sin(value)] if joint.nq == 2 else value
        return full

    def vector(self, values, base=()):
        full = np.zeros(self.model.nv)
        full[self.rows] = [*base, *values]
        return full

    def wrenches(self, q, external_wrenches):
        """Pinocchio's list of forces on joints, from {link: (6,) in the link's frame}."""
        forces = [pin.Force.Zero() for _ in self.model.joints]
        for name, wrench in external_wrenches.items():
            frame = self.model.frames[self.model.getFrameId(name, pin.FrameType.BODY)]
            forces[frame.parentJoint] += frame.placement.act(pin.Force(wrench[:3], wrench[3:]))
        vector = pin.StdVec_Force()
        vector.extend(forces)
        return vector

    def inertia_matrix(self, q):
        upper = np.triu(pin.crba(self.model, self.data, self.position(q, np.eye(4))))
        return (upper + np.triu(upper, 1).T)[np.ix_(self.rows, self.rows)]

    def bias(self, q, qd, pose=None, twist=(), external_wrenches=None):
        """H with classical base acceleration zero; gravity as in self.model.gravity."""
        velocity = self.vector(qd, twist)
        acceleration = self.vector(np.zeros(len(qd)), self.spatial(np.zeros(self.base_size), twist))
        forces = self.wrenches(q, external_wrenches or {})
        return pin.rnea(self.model, self.data, self.position(q, pose), velocity, acceleration, forces)[self.rows]

    def gravity(self, q, pose=None):
        return pin.computeGeneralizedGravity(self.model, self.data, self.position(q, pose))[self.rows]

    def coriolis(self, q, qd, twist=()):
        gravity = self.model.gravity.copy()
        self.model.gravity.setZero()  # subtracting it afterwards would leave rounding
        found = self.bias(q, qd, np.eye(4), twist)
        self.model.gravity = gravity
        return found

    def link_pose(self, name, q, pose=None):
        """Pose (4, 4) of a link frame in the world."""
        pin.forwardKinematics(self.model, self.data, self.position(q, pose))
        frame = self.model.getFrameId(name, pin.FrameType.BODY)
        return pin.updateFramePlacement(self.model, self.data, frame).homogeneous

    def reactions(self, q, qd, qdd, links, pose=None, twist=(), base_acceleration=(), external_wrenches=None):
        """Wrench of each joint on the link that it moves, (joints, 6), in the frames of `links` at their origins."""
        velocity = self.vector(qd, twist)
        acceleration = self.vector(qdd, self.spatial(np.array(base_acceleration), twist))
        forces = self.wrenches(q, external_wrenches or {})
        pin.rnea(self.model, self.data, self.position(q, pose), velocity, acceleration, forces)
        found = []
        for name, joint in zip(links, self.joints, strict=True):
            frame = self.model.frames[self.model.getFrameId(name, pin.FrameType.BODY)]
            assert frame.parentJoint == joint.id
            found.append(frame.placement.actInv(self.data.f[joint.id]).vector)
        return np.array(found)

    def direct(self, q, qd, forces, pose=None, twist=(), external_wrenches=None):
        """(accelerations, classical base acceleration) by the articulated-body algorithm."""
        velocity, push = self.vector(qd, twist), self.vector(forces, np.zeros(self.base_size))
        wrenches = self.wrenches(q, external_wrenches or {})
        found = pin.aba(self.model, self.data, self.position(q, pose), velocity, push, wrenches)[self.rows]
        return found[self.base_size :], self.classical(found[: self.base_size], twist)

    @staticmethod
    def spatial(acceleration, twist):
        """Pinocchio's body acceleration from the classical one of the origin."""
        if len(acceleration) == 0:
            return acceleration
        return acceleration - np.r_[np.cross(twist[3:], twist[:3]), 0, 0, 0]

    @staticmethod
    def classical(acceleration, twist):
        if len(acceleration) == 0:
            return acceleration
        return acceleration + np.r_[np.cross(twist[3:], twist[:3]), 0, 0, 0]

    def inverse_derivatives(self, q, qd, qdd, pose=None, twist=(), base_acceleration=()):
        """Derivatives (m, m) of the efforts by positions, velocities and accelerations."""
        velocity = self.vector(qd, twist)
        acceleration = self.vector(qdd, self.spatial(np.array(base_acceleration), twist))
        by_q, by_qd, by_qdd = (
            np.array(matrix)[np.ix_(self.rows, self.rows)]
            for matrix in pin.computeRNEADerivatives(
                self.model, self.data, self.position(q, pose), velocity, acceleration
            )
        )
        return by_q, by_qd - by_qdd[:, : self.base_size] @ self._drift_derivatives(twist, len(by_q)), by_qdd

    def direct_derivatives(self, q, qd, efforts, pose=None, twist=()):
        """Derivatives (m, m) of the accelerations by positions, velocities and generalized efforts."""
        velocity, torque = self.vector(qd, twist), self.vector(efforts, np.zeros(self.base_size))
        by_q, by_qd, by_efforts = (
            np.array(matrix)[np.ix_(self.rows, self.rows)]
            for matrix in pin.computeABADerivatives(self.model, self.data, self.position(q, pose), velocity, torque)
        )
        by_qd[: self.base_size] += self._drift_derivatives(twist, len(by_q))
        return by_q, by_qd, by_efforts

    def _drift_derivatives(self, twist, columns):
        """Derivatives (base, columns) by the velocities of classical less spatial acceleration, ω × v."""
        derivatives = np.zeros((self.base_size, columns))
        if self.base_size:
            derivatives[:3, :3] = pin.skew(np.array(twist[3:]))
            derivatives[:3, 3:6] = -pin.skew(np.array(twist[:3]))
        return derivatives
