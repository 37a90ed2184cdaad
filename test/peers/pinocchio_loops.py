"""Pinocchio's constrained dynamics of a Robot with loops, in the conventions of this project.

Every loop is a contact of two frames, whole or in their origins. The link without inertia at which a loop is cut would
leave the tree without an answer: it is given half of the inertia of the link that it is welded to, or of a body of its
own where that is the ground. As the two are one body, nothing moves otherwise; and the cut joint may slide, and have a
rotor, friction and a spring, as any other.

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


class Answer(NamedTuple):
    """accelerations, efforts: (n,) of all joints of the tree; base_acceleration: (6,) classical, in the base frame;
    base_wrench: (6,) what holds a base that moves as told; both () where the base is fixed."""

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
        """Branch by branch: Pinocchio takes what a joint carries to be what comes right after it."""
        for place, joint in enumerate(self.robot.joints, start=1):
            if joint.antecedent == link:
                kind = pin.JointModelPZ() if joint.prismatic else pin.JointModelRZ()
                stands = pin.SE3(joint.placement[:3, :3], joint.placement[:3, 3])
                self.numbers[place] = self.model.addJoint(self.numbers[link], kind, stands, joint.name)
                self._add_joints_of(place)

    def _contact(self, loop):
        (link_1, place_1), (link_2, place_2) = loop.ends
        kind = pin.ContactType.CONTACT_3D if loop.is_spherical else pin.ContactType.CONTACT_6D
        ends = [
            (self.numbers[link], pin.SE3(T[:3, :3], T[:3, 3])) for link, T in ((link_1, place_1), (link_2, place_2))
        ]
        return pin.RigidConstraintModel(kind, self.model, *ends[0], *ends[1], pin.ReferenceFrame.LOCAL)

    def response(self, q, qd, *, pose=None, twist=(), external_wrenches=None):
        """(a₀, D): the accelerations are a₀ + D τ, rows of the base first, then of all joints of the tree.

        τ: what acts on the base, and motor efforts; a₀ are the answer of Pinocchio's constraintDynamics to none, the
        columns of D what a unit of each adds. Accelerations of the base are Pinocchio's here, the spatial ones.
        """
        place, velocity = self.position(q, pose), self.vector(qd, twist)
        pin.computeJointJacobians(self.model, self.data, place)
        bias = self.vector(-losses(self.robot, q, qd), np.zeros(self.base_size))
        named = {self.robot.links[number].name: wrench for number, wrench in (external_wrenches or {}).items()}
        for number, force in enumerate(self.wrenches(q, named)):
            if number:
                J = pin.getJointJacobian(self.model, self.data, number, pin.ReferenceFrame.LOCAL)
                bias += J.T @ force.vector
        still = self._accelerations(self.model, place, velocity, bias)
        # at rest and without weight, lest small effects drown in large accelerations
        moved = [self._accelerations(self.weightless, place, 0 * velocity, unit) for unit in np.eye(self.model.nv)]
        return still[self.rows], np.array(moved).T[np.ix_(self.rows, self.rows)]

    def _accelerations(self, model, place, velocity, push):
        pin.initConstraintDynamics(model, self.data, self.contacts, self.contact_data)
        settings = pin.ProximalSettings(1e-14, PROXIMAL, 100)
        arguments = model, self.data, place, velocity, push, self.contacts, self.contact_data, settings
        return pin.constraintDynamics(*arguments).copy()

    def direct(self, q, qd, efforts, *, pose=None, twist=(), base_acceleration=None, external_wrenches=None):
        """(accelerations (n,), efforts (n,), classical base acceleration (6,) or (), base wrench (6,) or ())."""
        nothing = np.full(len(q), np.nan)
        question = {"pose": pose, "twist": twist, "external_wrenches": external_wrenches}
        return self._solved(q, qd, np.asarray(efforts, dtype=float), nothing, base_acceleration, question)

    def inverse(self, q, qd, accelerations, *, pose=None, twist=(), base_acceleration=None, external_wrenches=None):
        """As `direct`, of accelerations (n,) as told, nan for joints that have no motor."""
        question = {"pose": pose, "twist": twist, "external_wrenches": external_wrenches}
        return self._solved(
            q, qd, np.zeros(len(q)), np.asarray(accelerations, dtype=float), base_acceleration, question
        )

    def _solved(self, q, qd, efforts, told, base_acceleration, question):
        """The forces that make some accelerations what they are to be: (C D Cᵀ) x = wanted − C (a₀ + D τ).

        Rows of C: the base, where it moves as told; joints with a motor; followers, less their leaders.
        """
        b, twist = self.base_size, question["twist"]
        still, D = self.response(q, qd, **question)
        still = still + D[:, b:] @ efforts
        wanted, rows = [], []
        if base_acceleration is not None:
            rows, wanted = list(np.eye(6, len(still))), list(self.spatial(np.array(base_acceleration), twist))
        driven = np.flatnonzero(~np.isnan(told))
        rows += list(np.eye(len(still))[b + driven])
        wanted += list(told[driven])
        names = [joint.name for joint in self.robot.joints]
        for number, joint in enumerate(self.robot.joints):
            if joint.mimic is not None:
                row = np.eye(len(still))[b + number]
                row[b + names.index(joint.mimic.joint)] = -joint.mimic.multiplier
                rows.append(row)
                wanted.append(0.0)
        C = np.array(rows).reshape(len(rows), len(still))
        forces = np.linalg.solve(C @ D @ C.T, np.array(wanted) - C @ still)
        found = still + D @ C.T @ forces
        held = forces[:6] if base_acceleration is not None else np.zeros(b)
        first = len(held) if base_acceleration is not None else 0
        efforts = efforts.copy()
        efforts[driven] = forces[first : first + len(driven)]
        return Answer(found[b:], efforts, self.classical(found[:b], twist), held)

    def projected(self, q, qd, independents, **question):
        """(A_c, H_c): A_c q̈ + H_c = Γ on the joints `independents`, numbers, for a fixed or a free base.

        H_c counts friction and springs of all joints; where joints follow others these are no independents.
        """
        assert self.follows_none, "joints that follow others are not solved for here"
        still, D = self.response(q, qd, **question)
        rows = self.base_size + np.array(independents)
        A = np.linalg.inv(D[np.ix_(rows, rows)])
        return A, -A @ still[rows]


def losses(robot, q, qd):
    """(n,): Fv q̇ + Fs sign q̇ + k (q − q₀) + damping · q̇ at each joint [N m or N]."""
    found = np.zeros(len(robot.joints))
    for number, joint in enumerate(robot.joints):
        found[number] = joint.viscous_friction * qd[number] + joint.coulomb_friction * np.sign(qd[number])
        if joint.spring is not None:
            found[number] += (
                joint.spring.stiffness * (q[number] - joint.spring.rest) + joint.spring.damping * qd[number]
            )
    return found


def inertias_with_cut_links(robot):
    """The Inertia of each link, where cut links bear half of that of the link that they are one with."""
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
