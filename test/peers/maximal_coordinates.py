"""Dynamics of robots with loops by Lagrange multipliers on bodies with six coordinates each.

There is no recursion and no projection: Newton and Euler hold for every link by itself, in the world, and every joint
and every loop is a constraint between two links. A link without inertia at which a loop is cut is no body: its joint is
then a constraint between its antecedent and the link on which the loop closes. Rotors, friction, springs and motors
are forces along the axes of the joints.

Source: Newton and Euler for each body with the multipliers of Lagrange, first kind; Featherstone, Rigid Body Dynamics
Algorithms, sections 3.2 and 8.2.
"""

from typing import NamedTuple

import numpy as np

from robot_dynamics.model.vector_product import skew

from .constrained_motion import constrained_motion
from .link_motion import link_motion
from .maximal_constraints import Handle, coincidence, joint_constraint, joint_variable, stacked, weld


class Reaction(NamedTuple):
    """wrench: (6,) [force; moment]; determinate: (6,) bool, components that rigid-body dynamics determines. With
    redundant constraints the others depend on the stiffness of the bodies."""

    wrench: np.ndarray
    determinate: np.ndarray


class Motion(NamedTuple):
    """Motion of the bodies, and the forces that cause it.

    accelerations: (n,) of all joints of the tree, cut ones too [rad/s² or m/s²]. efforts: (n,) of motors [N m or N].
    base_acceleration: (6,) classical, of the base frame's origin, in the base frame; zero where it is fixed.
    base_wrench: (6,) on a base with prescribed motion, in the base frame at its origin; zero where it is free.
    reactions: for each joint the wrench of its antecedent on the link that it moves, in frame j at its origin.
    loop_reactions: {loop: what the link of `closed_on` exerts on the link of `moved`, in frame k+B at its origin}.
    residual: the largest acceleration by which constraints are missed, large where positions or velocities given are
    not those of closed loops.
    """

    accelerations: np.ndarray
    efforts: np.ndarray
    base_acceleration: np.ndarray
    base_wrench: np.ndarray
    reactions: tuple
    loop_reactions: dict
    residual: float


class Energy(NamedTuple):
    """kinetic, potential (zero at the origin of the world) and elastic [J]; dissipation by friction and dampers [W]."""

    kinetic: float
    potential: float
    elastic: float
    dissipation: float


class MaximalCoordinates:
    """A Robot, with or without loops, as constrained bodies; one sample at a time.

    Arguments: q, qd (n,): positions [rad or m] and velocities of all joints of the tree, such that the loops are
    closed. pose (4, 4), twist (6,): of a moving base in the world and in its own frame; base_acceleration (6,): where
    the motion of the base is prescribed, classical, in its own frame. external_wrenches: {number of a link: (6,)}, the
    force and torque of the environment on it, in frame j at its origin.
    """

    def __init__(self, robot):
        self.robot = robot
        self.cut = cut_links(robot)  # {link: loop} of links that are no bodies

    def direct(self, q, qd, efforts, *, pose=None, twist=None, base_acceleration=None, external_wrenches=None):
        """Motion under motor efforts (n,) [N m or N] on the joints of the tree, zero for those without motor."""
        nothing = np.full(len(self.robot.joints), np.nan)
        bodies = _Bodies(self, q, qd, pose, twist, external_wrenches or {})
        return bodies.moved(np.asarray(efforts, dtype=float), nothing, base_acceleration)

    def inverse(self, q, qd, accelerations, *, pose=None, twist=None, base_acceleration=None, external_wrenches=None):
        """Motion with prescribed accelerations (n,) of some joints [rad/s² or m/s²], nan for joints without motor.

        The efforts of their motors are multipliers of constraints.
        """
        nothing = np.zeros(len(self.robot.joints))
        bodies = _Bodies(self, q, qd, pose, twist, external_wrenches or {})
        return bodies.moved(nothing, np.asarray(accelerations, dtype=float), base_acceleration)

    def energy(self, q, qd, *, pose=None, twist=None):
        return _Bodies(self, q, qd, pose, twist, {}).energy()

    def power_of_wrenches(self, q, qd, external_wrenches, *, pose=None, twist=None):
        """Power of external wrenches [W]."""
        bodies = _Bodies(self, q, qd, pose, twist, external_wrenches)
        return float(bodies.external_forces() @ bodies.velocity)


def cut_links(robot):
    """{link: loop} of the links without inertia at the end of a branch that one loop welds to another link."""
    carriers = {joint.antecedent for joint in robot.joints}
    found = {}
    for loop in robot.loops:
        ends = [end.link for other in robot.loops for end in other.ends]
        for end in loop.ends:
            is_massless = (
                end.link > 0 and end.link not in carriers and not np.any(robot.links[end.link].inertia.spatial)
            )
            if is_massless and not loop.is_spherical and ends.count(end.link) == 1:
                found[end.link] = loop
                break
    return found


def turned(R, screw):
    """R (3, 3) applied to both halves of a screw (6,)."""
    return np.concatenate([R @ screw[:3], R @ screw[3:]])


class _Bodies:
    """All bodies in one state. Vectors of all velocities and forces have 6 entries for each link, link 0 first."""

    def __init__(self, model, q, qd, pose, twist, external_wrenches):
        self.robot, self.cut, self.wrenches = model.robot, model.cut, external_wrenches
        self.q, self.qd = np.asarray(q, dtype=float), np.asarray(qd, dtype=float)
        self.poses, velocities, _ = link_motion(self.robot, q, qd, pose, twist)
        self.velocity = velocities.ravel()
        self.count = len(self.robot.links)
        # bodies with coordinates: not the ground, and no cut link
        self.present = [link for link in range(self.count) if link not in self.cut and (link or self.robot.moving_base)]
        self.columns = np.concatenate([np.arange(6 * link, 6 * link + 6) for link in self.present] or [[]]).astype(int)
        self.sides = [self._sides(number) for number in range(len(self.robot.joints))]
        self.variables = [
            joint_variable(joint.prismatic, *sides) for joint, sides in zip(self.robot.joints, self.sides, strict=True)
        ]

    def handle(self, link, placement):
        frame = self.poses[link] @ placement
        velocity = self.velocity[6 * link : 6 * link + 6]
        return Handle(link, self.count, self.poses[link, :3, 3], frame[:3, :3], frame[:3, 3], velocity)

    def _sides(self, number):
        """The two Handles between which joint `number` lies: on its antecedent, and on the link that it moves."""
        joint = self.robot.joints[number]
        fixed = self.handle(joint.antecedent, joint.placement)
        link = number + 1
        if link not in self.cut:
            return fixed, self.handle(link, np.eye(4))
        here, there = self._own_end_first(self.cut[link], link)
        return fixed, self.handle(there.link, there.placement @ np.linalg.inv(here.placement))

    @staticmethod
    def _own_end_first(loop, link):
        return loop.ends if loop.moved.link == link else loop.ends[::-1]

    def inertia(self):
        """(6 N, 6 N) of all bodies about the origins of their frames, and rotors, which resist along joint axes."""
        M = np.zeros((6 * self.count, 6 * self.count))
        for link, (body, pose) in enumerate(zip(self.robot.links, self.poses, strict=True)):
            R = pose[:3, :3]
            first = skew(R @ body.inertia.first_moments)
            own = slice(6 * link, 6 * link + 6)
            second = R @ body.inertia.second_moments @ R.T
            M[own, own] = np.block([[body.inertia.mass * np.eye(3), -first], [first, second]])
        for joint, variable in zip(self.robot.joints, self.variables, strict=True):
            M += joint.rotor_inertia * variable.coefficients.T @ variable.coefficients
        return M

    def gravity_and_inertial_forces(self):
        """(6 N,): weights, and the velocity terms −ω × (ω × MS) and −ω × Jω."""
        forces = np.zeros(6 * self.count)
        for link, (body, pose) in enumerate(zip(self.robot.links, self.poses, strict=True)):
            R, omega = pose[:3, :3], self.velocity[6 * link + 3 : 6 * link + 6]
            MS, J = R @ body.inertia.first_moments, R @ body.inertia.second_moments @ R.T
            forces[6 * link : 6 * link + 3] = body.inertia.mass * self.robot.gravity
            forces[6 * link : 6 * link + 3] -= np.cross(omega, np.cross(omega, MS))
            forces[6 * link + 3 : 6 * link + 6] = np.cross(MS, self.robot.gravity) - np.cross(omega, J @ omega)
        for joint, variable in zip(self.robot.joints, self.variables, strict=True):
            forces -= joint.rotor_inertia * variable.coefficients[0] * variable.bias[0]
        return forces

    def external_forces(self):
        """(6 N,): external wrenches; one on a cut link acts on the link that it is welded to."""
        forces = np.zeros(6 * self.count)
        for link, wrench in self.wrenches.items():
            R, position = self.poses[link, :3, :3], self.poses[link, :3, 3]
            force, moment = R @ wrench[:3], R @ wrench[3:]
            if link in self.cut:
                link = self.sides[link - 1][1].body
            arm = position - self.poses[link, :3, 3]
            forces[6 * link : 6 * link + 6] += np.concatenate([force, moment + np.cross(arm, force)])
        return forces

    def joint_losses(self):
        """(n,): Fv q̇ + Fs sign q̇ + k (q − q₀) + damping · q̇, the passive efforts of each joint."""
        found = []
        for joint, q, qd in zip(self.robot.joints, self.q, self.qd, strict=True):
            loss = joint.viscous_friction * qd + joint.coulomb_friction * np.sign(qd)
            if joint.spring is not None:
                loss += joint.spring.stiffness * (q - joint.spring.rest) + joint.spring.damping * qd
            found.append(loss)
        return np.array(found)

    def constraints(self):
        """(joints, loops): Rows of each joint, and {loop: Rows} of loops without a cut joint."""
        joints = [
            joint_constraint(joint.prismatic, *sides)
            for joint, sides in zip(self.robot.joints, self.sides, strict=True)
        ]
        loops = {}
        for loop in self.robot.loops:
            if loop not in self.cut.values():
                closing = coincidence if loop.is_spherical else weld
                loops[loop.name] = closing(self.handle(*loop.moved), self.handle(*loop.closed_on))
        return joints, loops

    def _constraint_rows(self, prescribed, base_acceleration):
        """{(kind, number or name): (Rows, required second derivatives)} of all constraints with multipliers."""
        joints, loops = self.constraints()
        constraint_rows = {("joint", number): (rows, 0.0) for number, rows in enumerate(joints)}
        constraint_rows |= {("loop", name): (rows, 0.0) for name, rows in loops.items()}
        for number, joint in enumerate(self.robot.joints):
            if joint.mimic is not None:
                leader_variable = self.variables[self.leader(joint)].times([[joint.mimic.multiplier]])
                constraint_rows["follower", number] = self.variables[number] - leader_variable, 0.0
            if not np.isnan(prescribed[number]):
                constraint_rows["motor", number] = self.variables[number], prescribed[number]
        if base_acceleration is not None:
            frame = self.handle(0, np.eye(4))
            constraint_rows["base", 0] = (
                stacked([frame.point(), frame.turning()]),
                turned(frame.rotation, base_acceleration),
            )
        return constraint_rows

    def leader(self, joint):
        return next(number for number, other in enumerate(self.robot.joints) if other.name == joint.mimic.joint)

    def moved(self, efforts, prescribed, base_acceleration):
        """Motion under efforts (n,) with prescribed accelerations (n,) of some joints, nan for the others."""
        constraint_rows = self._constraint_rows(prescribed, base_acceleration)
        rows = stacked([rows for rows, _ in constraint_rows.values()])
        required = np.concatenate([np.broadcast_to(value, rows.bias.shape) for rows, value in constraint_rows.values()])
        axes = np.vstack([variable.coefficients for variable in self.variables])
        forces = self.gravity_and_inertial_forces() + self.external_forces() + axes.T @ (efforts - self.joint_losses())
        solution = constrained_motion(
            self.inertia()[np.ix_(self.columns, self.columns)],
            forces[self.columns],
            rows.coefficients[:, self.columns],
            required - rows.bias,
        )
        ends = np.cumsum([len(rows.bias) for rows, _ in constraint_rows.values()])[:-1]
        parts = zip(np.split(solution.multipliers, ends), np.split(solution.free_multipliers, ends), strict=True)
        parts = dict(zip(constraint_rows, parts, strict=True))

        acceleration = np.zeros(6 * self.count)
        acceleration[self.columns] = solution.x
        accelerations = axes @ acceleration + np.concatenate([variable.bias for variable in self.variables])
        efforts = efforts.copy()
        for number in np.flatnonzero(~np.isnan(prescribed)):
            efforts[number] = parts["motor", number][0][0]
        along, free_along = self._along_axes(parts, efforts, accelerations)
        reactions = self._reactions(constraint_rows, parts, along, free_along)
        R = self.poses[0, :3, :3]
        return Motion(
            accelerations,
            efforts,
            turned(R.T, acceleration[:6]),
            turned(R.T, parts["base", 0][0]) if base_acceleration is not None else np.zeros(6),
            reactions,
            self._loop_reactions(constraint_rows, parts, reactions),
            solution.residual,
        )

    def _along_axes(self, parts, efforts, accelerations):
        """(n,) force along each joint axis on the link that it moves [N m or N], and (n, free) its derivative by free
        multipliers: of motors, passive efforts, rotors and mimic constraints."""
        along = efforts - self.joint_losses()
        along = along - [joint.rotor_inertia for joint in self.robot.joints] * accelerations
        free = np.zeros((len(along), next(iter(parts.values()))[1].shape[1]))
        for (kind, number), (multipliers, loose) in parts.items():
            if kind in ("motor", "follower"):
                free[number] += loose[0]
            if kind == "follower":
                joint = self.robot.joints[number]
                along[number] += multipliers[0]
                along[self.leader(joint)] -= joint.mimic.multiplier * multipliers[0]
                free[self.leader(joint)] -= joint.mimic.multiplier * loose[0]
        return along, free

    def _reactions(self, constraint_rows, parts, along, free_along):
        """Reaction of each joint: the multipliers of its constraint, and the force along its axis."""
        found = []
        for number in range(len(self.robot.joints)):
            multipliers, free = parts["joint", number]
            both = np.vstack([constraint_rows["joint", number][0].coefficients, self.variables[number].coefficients])
            onto = self._wrench_of(both, self.sides[number][1], self.poses[number + 1])
            wrench = onto @ np.append(multipliers, along[number])
            found.append(Reaction(wrench, self._determinate(onto, np.vstack([free, free_along[number]]))))
        return tuple(found)

    def _loop_reactions(self, constraint_rows, parts, reactions):
        found = {}
        for loop in self.robot.loops:
            if ("loop", loop.name) not in constraint_rows:
                continue
            rows, _ = constraint_rows["loop", loop.name]
            multipliers, free = parts["loop", loop.name]
            pose = self.poses[loop.closed_on.link] @ loop.closed_on.placement
            onto = -self._wrench_of(rows.coefficients, self.handle(*loop.closed_on), pose)
            found[loop.name] = Reaction(onto @ multipliers, self._determinate(onto, free))
        for link, loop in self.cut.items():
            here, _ = self._own_end_first(loop, link)
            wrench, determinate = reactions[link - 1]  # of the joint on the link without inertia
            external = np.asarray(self.wrenches.get(link, np.zeros(6)))
            R, p = here.placement[:3, :3], here.placement[:3, 3]
            balance = -(wrench + external)
            there = np.concatenate([R.T @ balance[:3], R.T @ (balance[3:] - np.cross(p, balance[:3]))])
            sign = 1 if loop.moved.link == link else -1
            same = np.array_equal(here.placement, np.eye(4))
            found[loop.name] = Reaction(sign * there, determinate if same else np.full(6, determinate.all()))
        return found

    def _wrench_of(self, coefficients, handle, pose):
        """(6, m): wrenches of unit multipliers of rows (m, 6 N) on the body of a Handle, in the frame of a pose at its
        origin."""
        own = coefficients[:, 6 * handle.body : 6 * handle.body + 6].T
        R, arm = pose[:3, :3], handle.origin - pose[:3, 3]
        return np.vstack([R.T @ own[:3], R.T @ (own[3:] + skew(arm) @ own[:3])])

    @staticmethod
    def _determinate(onto, free):
        """(6,) bool: components of a wrench that free multipliers do not change."""
        return np.abs(onto @ free).max(axis=1, initial=0) < 1e-7

    def energy(self):
        """Energy, of whole bodies in the world, rotors, springs and frictions."""
        kinetic = self.velocity @ self.inertia() @ self.velocity / 2
        potential = elastic = dissipation = 0.0
        for body, pose in zip(self.robot.links, self.poses, strict=True):
            moment = body.inertia.mass * pose[:3, 3] + pose[:3, :3] @ body.inertia.first_moments
            potential -= self.robot.gravity @ moment
        for joint, q, qd in zip(self.robot.joints, self.q, self.qd, strict=True):
            dissipation += joint.viscous_friction * qd**2 + joint.coulomb_friction * abs(qd)
            if joint.spring is not None:
                elastic += joint.spring.stiffness * (q - joint.spring.rest) ** 2 / 2
                dissipation += joint.spring.damping * qd**2
        return Energy(float(kinetic), float(potential), float(elastic), float(dissipation))
