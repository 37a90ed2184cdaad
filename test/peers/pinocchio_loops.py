"""Pinocchio's constrained dynamics of a Robot with loops, in the conventions of this project.

Every loop is a contact of two frames, whole or in their origins. The link without inertia at which a loop is cut would
make the tree singular: it gets half of the inertia of the link that it is welded to, or an inertia of its own where
that is the ground. The two are one body, so that no motion changes; the cut joint may be prismatic, and have a rotor,
friction and a spring, as any other joint.

Source: Carpentier, Budhiraja, Mansard, Proximal and sparse resolution of constrained dynamic equations (RSS 2021).
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from robot_dynamics.model.inertia import Inertia

from .maximal_coordinates import cut_links
from .pinocchio_model import PinocchioModel

ON_THE_GROUND = Inertia(1.0, np.zeros(3), np.diag([0.1, 0.1, 0.1]))
PROXIMAL = 1e-9  # μ of the proximal method, which redundant contacts need


class LoopResult(NamedTuple):
    """accelerations, efforts: (n,) of all joints of the tree; base_acceleration: (6,) classical, in the base frame;
    base_wrench: (6,) on a base with prescribed motion; both () where the base is fixed."""

    accelerations: np.ndarray
    efforts: np.ndarray
    base_acceleration: np.ndarray
    base_wrench: np.ndarray


class PinocchioLoops(PinocchioModel):
    """A Robot, with or without loops, in Pinocchio; one sample at a time.

    Arguments as of MaximalCoordinates: q, qd (n,) of all joints of the tree, closed; efforts (n,) of motors; pose,
    twist, base_acceleration of a moving base; external_wrenches {number of a link: (6,)}.
    """

    def __init__(self, robot):
        self.robot, self.model = robot, pin.Model()
        self.base_size = 6 if robot.moving_base else 0
        root = self.model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base") if robot.moving_base else 0
        self.numbers = [root] + [None] * len(robot.joints)  # Pinocchio's joint of each link
        self._add_joints_of(0)
        for link, number, inertia in zip(robot.links, self.numbers, inertias_with_cut_links(robot), strict=True):
            self.model.appendBodyToJoint(number, body_of(inertia), pin.SE3.Identity())
            self.model.addFrame(pin.Frame(link.name, number, 0, pin.SE3.Identity(), pin.FrameType.BODY))
        self.model.gravity.linear = robot.gravity
        self.joints = [self.model.joints[number] for number in self.numbers[1:]]
        self.rows = np.array([*range(self.base_size), *(joint.idx_v for joint in self.joints)], dtype=int)
        for joint, described in zip(self.joints, robot.joints, strict=True):
            self.model.armature[joint.idx_v] = described.rotor_inertia
        self.weightless = pin.Model(self.model)
        self.weightless.gravity.setZero()
        self.data = self.model.createData()
        self.contacts, self.contact_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for loop in robot.loops:
            self.contacts.append(self._contact(loop))
            self.contact_data.append(self.contacts[-1].createData())
        self.follows_none = all(joint.mimic is None for joint in robot.joints)

    def _add_joints_of(self, link):
        """Branch by branch: Pinocchio numbers the subtree of a joint right after it."""
        for number, joint in enumerate(self.robot.joints, start=1):
            if joint.antecedent == link:
                kind = pin.JointModelPZ() if joint.prismatic else pin.JointModelRZ()
                placement_of_joint = pin.SE3(joint.placement[:3, :3], joint.placement[:3, 3])
                self.numbers[number] = self.model.addJoint(self.numbers[link], kind, placement_of_joint, joint.name)
                self._add_joints_of(number)

    def _contact(self, loop):
        (link_1, placement_1), (link_2, placement_2) = loop.ends
        kind = pin.ContactType.CONTACT_3D if loop.is_spherical else pin.ContactType.CONTACT_6D
        ends = [
            (self.numbers[link], pin.SE3(T[:3, :3], T[:3, 3]))
            for link, T in ((link_1, placement_1), (link_2, placement_2))
        ]
        return pin.RigidConstraintModel(kind, self.model, *ends[0], *ends[1], pin.ReferenceFrame.LOCAL)

    def response(self, q, qd, *, pose=None, twist=(), external_wrenches=None):
        """(a₀, D): the accelerations are a₀ + D τ, rows of the base first, then of all joints of the tree.

        τ: the wrench on the base, and motor efforts. a₀ is the result of Pinocchio's constraintDynamics without them,
        the columns of D are those of unit forces. Accelerations of the base are Pinocchio's here, the spatial ones.
        """
        configuration, velocity = self.position(q, pose), self.vector(qd, twist)
        pin.computeJointJacobians(self.model, self.data, configuration)
        bias = self.vector(-passive_efforts(self.robot, q, qd), np.zeros(self.base_size))
        named = {self.robot.links[number].name: wrench for number, wrench in (external_wrenches or {}).items()}
        for number, force in enumerate(self.wrenches(q, named)):
            if number:
                J = pin.getJointJacobian(self.model, self.data, number, pin.ReferenceFrame.LOCAL)
                bias += J.T @ force.vector
        a_0 = self._accelerations(self.model, configuration, velocity, bias)
        # at rest and without weight, so that rounding of large accelerations has no effect
        moved = [
            self._accelerations(self.weightless, configuration, 0 * velocity, unit) for unit in np.eye(self.model.nv)
        ]
        return a_0[self.rows], np.array(moved).T[np.ix_(self.rows, self.rows)]

    def _accelerations(self, model, configuration, velocity, push):
        pin.initConstraintDynamics(model, self.data, self.contacts, self.contact_data)
        settings = pin.ProximalSettings(1e-14, PROXIMAL, 100)
        arguments = model, self.data, configuration, velocity, push, self.contacts, self.contact_data, settings
        return pin.constraintDynamics(*arguments).copy()

    def direct(self, q, qd, efforts, *, pose=None, twist=(), base_acceleration=None, external_wrenches=None):
        """(accelerations (n,), efforts (n,), classical base acceleration (6,) or (), base wrench (6,) or ())."""
        nothing = np.full(len(q), np.nan)
        state_arguments = {"pose": pose, "twist": twist, "external_wrenches": external_wrenches}
        return self._solved(q, qd, np.asarray(efforts, dtype=float), nothing, base_acceleration, state_arguments)

    def inverse(self, q, qd, accelerations, *, pose=None, twist=(), base_acceleration=None, external_wrenches=None):
        """As `direct`, for prescribed accelerations (n,), nan for joints without motor."""
        state_arguments = {"pose": pose, "twist": twist, "external_wrenches": external_wrenches}
        return self._solved(
            q, qd, np.zeros(len(q)), np.asarray(accelerations, dtype=float), base_acceleration, state_arguments
        )

    def _solved(self, q, qd, efforts, prescribed, base_acceleration, state_arguments):
        """Forces of prescribed accelerations: (C D Cᵀ) x = required − C (a₀ + D τ).

        Rows of C: the base, where its motion is prescribed; joints with a motor; mimic joints minus their leaders.
        """
        b, twist = self.base_size, state_arguments["twist"]
        a_0, D = self.response(q, qd, **state_arguments)
        a_0 = a_0 + D[:, b:] @ efforts
        required, rows = [], []
        if base_acceleration is not None:
            rows, required = list(np.eye(6, len(a_0))), list(self.spatial(np.array(base_acceleration), twist))
        actuated = np.flatnonzero(~np.isnan(prescribed))
        rows += list(np.eye(len(a_0))[b + actuated])
        required += list(prescribed[actuated])
        names = [joint.name for joint in self.robot.joints]
        for number, joint in enumerate(self.robot.joints):
            if joint.mimic is not None:
                row = np.eye(len(a_0))[b + number]
                row[b + names.index(joint.mimic.joint)] = -joint.mimic.multiplier
                rows.append(row)
                required.append(0.0)
        C = np.array(rows).reshape(len(rows), len(a_0))
        forces = np.linalg.solve(C @ D @ C.T, np.array(required) - C @ a_0)
        result = a_0 + D @ C.T @ forces
        base_wrench = forces[:6] if base_acceleration is not None else np.zeros(b)
        first = len(base_wrench) if base_acceleration is not None else 0
        efforts = efforts.copy()
        efforts[actuated] = forces[first : first + len(actuated)]
        return LoopResult(result[b:], efforts, self.classical(result[:b], twist), base_wrench)

    def projected(self, q, qd, independents, **state_arguments):
        """(A_c, H_c): A_c q̈ + H_c = Γ on the joints `independents`, numbers, for a fixed or a free base.

        H_c counts friction and springs of all joints; robots with mimic joints are not supported.
        """
        assert self.follows_none, "mimic joints are not supported here"
        a_0, D = self.response(q, qd, **state_arguments)
        rows = self.base_size + np.array(independents)
        A = np.linalg.inv(D[np.ix_(rows, rows)])
        return A, -A @ a_0[rows]


def passive_efforts(robot, q, qd):
    """(n,): Fv q̇ + Fs sign q̇ + k (q − q₀) + damping · q̇ at each joint [N m or N]."""
    result = np.zeros(len(robot.joints))
    for number, joint in enumerate(robot.joints):
        result[number] = joint.viscous_friction * qd[number] + joint.coulomb_friction * np.sign(qd[number])
        if joint.spring is not None:
            result[number] += (
                joint.spring.stiffness * (q[number] - joint.spring.rest) + joint.spring.damping * qd[number]
            )
    return result


def inertias_with_cut_links(robot):
    """The Inertia of each link, where cut links have half of that of the link that they are welded to."""
    inertias = [link.inertia for link in robot.links]
    for cut, loop in cut_links(robot).items():
        here, there = loop.ends if loop.moved.link == cut else loop.ends[::-1]
        if there.link == 0 and not robot.moving_base:
            inertias[cut] = ON_THE_GROUND
            continue
        assert inertias[there.link].mass > 0, "half of no inertia is none"
        inertias[there.link] = scaled(inertias[there.link], 0.5)
        inertias[cut] = inertias[there.link].transformed_by(here.placement @ np.linalg.inv(there.placement))
    return inertias


def scaled(inertia, factor):
    return Inertia(factor * inertia.mass, factor * inertia.first_moments, factor * inertia.second_moments)


def body_of(inertia):
    """Pinocchio's Inertia, which takes the centre of mass and moments about it."""
    if inertia.mass == 0:
        assert not np.any(inertia.spatial), "Pinocchio takes no moments without a mass"
        return pin.Inertia.Zero()
    centre = inertia.first_moments / inertia.mass
    arm = pin.skew(centre)
    return pin.Inertia(inertia.mass, centre, inertia.second_moments + inertia.mass * arm @ arm)
