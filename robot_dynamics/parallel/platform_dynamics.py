"""A parallel robot asked in the coordinates of its platform: geometry, rates, and both dynamic models (Khalil, 5).

The pose of a platform is that of its frame in the frame on which it stands, frame 0 unless parallel modules stand on
each other; its twist and acceleration are those of its origin there, classical, expressed in its own frame, as those of
a moving base are.

    V_p = J_p q̇_a,   Γ = J_pᵀ [F_p + Σ J_viᵀ J_i⁻ᵀ Γ_i]

Legs and platform are branches of one tree. With the platform's coordinates given, each leg is closed by itself, which
is J_i⁻¹ J_vi; with the motors' given, all of it together, which is J_p besides.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from robot_dynamics.codegen.jit.compiled_models import CompiledModels
from robot_dynamics.constraints.attitude_charts import STEEP_PITCH_COSINE
from robot_dynamics.constraints.closure_solver import ClosureSolver
from robot_dynamics.errors import DescriptionError, InvalidInputError, describe_unknown_name
from robot_dynamics.inputs import common_batch_shape, require_finite, require_pose
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.parallel.leg_springs import solve_unactuated_accelerations, solve_unactuated_equilibrium
from robot_dynamics.parallel.platform_motion import (
    AngleRates,
    ChartRates,
    coordinates_from_pose,
    pose_from_coordinates,
    twist_drift,
    twist_matrix,
)
from robot_dynamics.results import broadcast_result

__all__ = [
    "PlatformDynamics",
    "Platforms",
    "check_coordinate",
    "coordinates_from_pose",
    "pose_from_coordinates",
    "twist_drift",
    "twist_matrix",
]

POSE_TOLERANCE = 1e-9  # [m, rad] by which a pose may differ from the one that is meant
TWIST_COMPONENTS = "linear and angular components"
UNACTUATED_REASON = "no motor drives it, so its acceleration is part of the answer"


class Platforms(dict):
    """{link: PlatformDynamics}; a link without a platform raises QuestionError."""

    def __missing__(self, link):
        raise InvalidInputError(describe_unknown_name("platform", link, self))


class PlatformDynamics:
    """The platform of a Dynamics, or all of them together; `Dynamics.platform` and `Dynamics.platforms` give it.

    What is asked and answered of the platform is an array; of many platforms together {link: array}, by the names of
    their `links`. Motors and elastic joints are asked for as in Dynamics: vectors (..., n) in the order of its
    joint_names.

    Poses and twists are those of rotations, and all works at every attitude. Positions of joints tell the attitude by
    yaw, pitch and roll: those nearest to the seed, or to the initial positions. Only what moves with the angles besides
    the platform, such as a body or a friction in a description of their joints, keeps pitch within ±90°.

    free: the coordinates that the legs let the platform move by, of many platforms {link: coordinates}; the others
    follow from these, and are not read from a pose.

    other_joint_names: those of joint_names that the platform does not place: elastic joints of its legs, joints outside
    of them, and the motors of platforms that are not asked. Their motion is told as others=(positions, velocities,
    accelerations), (..., k) each, or the first ones alone. Left out, positions are those that a seed has, else the
    initial ones, and the rest is zero. As everywhere, accelerations of joints without motor are part of the answer, and
    0 or nan in the question.
    """

    def __init__(self, dynamics, platforms, single):
        self._dynamics, robot = dynamics, dynamics.robot
        self._alone = single
        self.link_names = tuple(robot.links[platform.link].name for platform in platforms)
        free = [tuple(platform.free) for platform in platforms]
        self.free = free[0] if single else dict(zip(self.link_names, free, strict=True))
        self._numbers = np.array([platform.joints for platform in platforms])
        places = [(k, COORDINATES.index(name)) for k, names in enumerate(free) for name in names]
        self._places = tuple(np.array(places).T)  # of the free coordinates, among (platforms, 6)
        self._free = self._numbers[self._places].tolist()
        self._independent = [robot.joint_numbers[name] for name in dynamics.joint_names]
        led = _led_by_platforms(robot, self._numbers, self._free)
        try:
            self._led = ClosureSolver(led, CompiledModels(led) if dynamics.compiled else None)
        except DescriptionError:
            raise DescriptionError(_wrong_coordinates(dynamics, self.link_names, self._numbers, free)) from None
        self._others = [number for number in self._led.independent if number not in self._free]
        self._motors = [number for number in self._independent if number not in self._led.independent]
        self.other_joint_names = tuple(robot.joints[number].name for number in self._others)
        if not {*self._others} <= {*self._independent}:
            names = ", ".join(repr(robot.joints[n].name) for n in self._others if n not in self._independent)
            raise InvalidInputError(f"the platform does not tell where {names} are, which the motors do: ask by joints")
        unactuated = [number for number in self._others if not robot.joints[number].actuated]
        self._undriven = [self._independent.index(number) for number in unactuated]  # places among joint_names
        charted = {one.joints for one in self._led.attitudes}
        self._kinds = [ChartRates if tuple(joints[3:]) in charted else AngleRates for joints in self._numbers.tolist()]

    def joint_positions(self, pose, seed=None, other_joints=None):
        """Positions (..., all joints) of all joints where the platform has the pose (..., 4, 4): inverse geometry.

        Where the legs allow the pose, it is this one; else one with the same free coordinates.

        What comes out is what Dynamics takes as q. seed: (..., all joints), from where the legs are closed to the
        nearest, each in its assembly mode; nan says nothing of a joint. Without one they are in those of the initial
        positions. Of others, the positions count.

        Raises SingularModelError where a leg cannot reach.
        """
        return self._closed(self._poses(pose), seed, other_joints)

    def reach(self, pose, other_joints=None):
        """(positions (N, all joints), reached (N,)): as `joints` for poses (N, 4, 4), telling which of them the legs
        reach; positions of the others mean nothing."""
        return self._attempted(self._poses(pose), None, other_joints)[:2]

    def condition_number(self, q):
        """(...) condition number of J_p between motors and free coordinates, at positions that `joints` gives.

        Angles count by the characteristic length of the robot; infinite where the motors do not hold the platform.
        """
        G, joints = self._led.state_at_closed(q).G, self._dynamics.robot.joints
        unit = self._dynamics.robot.characteristic_length
        sizes, drives = (np.array([unit if joints[number].prismatic else 1.0 for number in numbers])
                         for numbers in (self._free, self._motors))  # fmt: skip
        columns = [self._led.independent.index(number) for number in self._free]
        with np.errstate(all="ignore"):
            return np.linalg.cond(G[..., self._motors, :][..., columns] * sizes / drives[:, None])

    def pose(self, q):
        """The pose (..., 4, 4) of the platform at motor positions q (..., n): direct geometry. Where q has all joints,
        those tell where the search begins, and so which assembly mode comes out."""
        return self._of_each(pose_from_coordinates(self._dynamics.expand_positions(q)[..., self._numbers]), 2)

    def jacobian(self, q):
        """J_p (..., 6, n): the twist of the platform for unit rates of the motors."""
        configuration = self._dynamics.constrained_state(q)
        x, G = configuration.q[..., self._numbers], configuration.G[..., self._numbers, :]
        columns = [self._each("twist", x, G[..., column]) for column in range(G.shape[-1])]
        return self._of_each(np.stack(columns, axis=-1), 2)

    def joint_motion(self, pose, twist=None, acceleration=None, seed=None, other_joints=None):
        """(q, qd, qdd), (..., all joints) each, of all joints for a motion of the platform and of the others.

        twist, acceleration: (..., 6), zero if left out. Of these too, only what the legs leave free is read.
        """
        configuration, rates, rate_derivatives = self._motion(pose, twist, acceleration, seed, other_joints)
        qdd = configuration.joint_accelerations(rates, rate_derivatives)
        return np.array(np.broadcast_to(configuration.q, qdd.shape)), configuration.joint_velocities(rates), qdd

    def _motion(self, pose, twist, acceleration, seed, other_joints):
        """(Configuration, rates, accelerations), (..., all joints) each, as its `joint_velocities` takes them."""
        poses, (_, velocities, accelerations) = self._poses(pose), self._told_of_others(other_joints)
        twist, acceleration = self._screws("twist", twist), self._screws("acceleration", acceleration)
        configuration = self._led.state_at_closed(self._closed(poses, seed, other_joints))
        x = configuration.q[..., self._numbers]
        rates = configuration.complete_rates(self._among_all(self._each("rates", x, twist), velocities))
        rate_derivatives = self._each("rate_derivatives", x, rates[..., self._numbers], acceleration)
        constraint_drift = configuration.constraint_drift(rates)
        rate_derivatives = configuration.complete_rates(
            self._among_all(rate_derivatives, accelerations), constraint_drift
        )
        batch = common_batch_shape(configuration.q, rates, rate_derivatives)
        return configuration, broadcast_result(rates, batch), broadcast_result(rate_derivatives, batch)

    def inverse(self, pose, twist=None, acceleration=None, *, seed=None, other_joints=None, external_wrenches=None):
        """Efforts (..., n) [N m or N] of the motors for a motion of the platform: the inverse dynamic model.

        Raises SingularModelError where springs stand between the motors and the platform: at given deflections it
        accelerates as the springs push it, whatever the motors do.
        """
        state = self._driven(pose, twist, acceleration, seed, other_joints, external_wrenches)
        return self._dynamics.inverse(*state, external_wrenches=external_wrenches)

    def direct(self, pose, twist, efforts, *, seed=None, other_joints=None, external_wrenches=None):
        """The acceleration (..., 6) of the platform that motor efforts (..., n) cause: the direct dynamic model."""
        told = {"seed": seed, "other_joints": other_joints, "external_wrenches": external_wrenches}
        return self.acceleration(self.solve(pose, twist, efforts=efforts, **told).motion)

    def solve(
        self, pose, twist=None, *, acceleration=None, efforts=None, seed=None, other_joints=None, external_wrenches=None
    ):
        """The whole Answer of Dynamics for an acceleration of the platform or for efforts, whichever is given; see
        `inverse` and `direct`."""
        if (acceleration is None) == (efforts is None):
            raise InvalidInputError("give acceleration or efforts, one of the two: the other is the answer")
        if efforts is None:
            q, qd, qdd = self._driven(pose, twist, acceleration, seed, other_joints, external_wrenches)
            return self._dynamics.solve(q, qd, qdd=qdd, external_wrenches=external_wrenches)
        configuration, rates, _ = self._motion(pose, twist, None, seed, other_joints)
        q, qd = configuration.q, rates[..., self._independent]
        return self._dynamics.solve(q, qd, efforts=efforts, external_wrenches=external_wrenches)

    def equilibrium(self, pose, *, seed=None, other_joints=None, external_wrenches=None):
        """The Equilibrium of Dynamics in which motors and springs hold the platform at a pose: the motors are where the
        springs need them. Seed and others say where the deflections of the springs are sought.

        Raises SingularModelError where none is found.
        """
        q = self.joint_positions(pose, seed, other_joints)
        if self._undriven:
            q = solve_unactuated_equilibrium(self._led, self._motored, q, self._undriven, external_wrenches)
        return self._dynamics.equilibrium(q, external_wrenches=external_wrenches)

    def acceleration(self, motion):
        """The acceleration (..., 6) of the platform in a JointMotion."""
        x, rates, rate_derivatives = self._moved(motion)
        return self._of_each(self._each("acceleration", x, rates, rate_derivatives))

    def twist(self, motion):
        """The twist (..., 6) of the platform in a JointMotion."""
        x, rates, _ = self._moved(motion)
        return self._of_each(self._each("twist", x, rates))

    def _moved(self, motion):
        """(x, rates, their derivatives), (..., platforms, 6) each, of a JointMotion."""
        q, velocities, accelerations = motion
        x = q[..., self._numbers]
        if ChartRates in self._kinds and np.abs(np.cos(x[..., 4])).min(initial=1) < STEEP_PITCH_COSINE:
            # the angles' rates are large there, or none: those of the independent joints tell as much
            configuration = self._dynamics.constrained_state(q)
            rates = configuration.expand_rates(velocities[..., self._independent])
            constraint_drift = configuration.constraint_drift(rates)
            rate_derivatives = configuration.expand_rates(accelerations[..., self._independent], constraint_drift)
            return x, rates[..., self._numbers], rate_derivatives[..., self._numbers]
        rates, rate_derivatives = velocities[..., self._numbers], accelerations[..., self._numbers]
        twist = AngleRates.twist(x, rates)
        acceleration = AngleRates.acceleration(x, rates, rate_derivatives)
        rates = self._each("rates", x, twist)
        return x, rates, self._each("rate_derivatives", x, rates, acceleration)

    def _each(self, function, *values):
        """(..., platforms, 6) what a function of AngleRates or ChartRates gives, of each platform that of its kind."""
        columns = zip(*(np.moveaxis(value, -2, 0) for value in values), strict=True)
        found = [getattr(kind, function)(*of_one) for kind, of_one in zip(self._kinds, columns, strict=True)]
        return np.stack(np.broadcast_arrays(*found), axis=-2)

    def _among_all(self, of_platforms, of_others):
        """(..., all joints) values of the platforms (..., platforms, 6) and of the others (..., k), zero elsewhere."""
        batch = np.broadcast_shapes(of_platforms.shape[:-2], of_others.shape[:-1])
        values = np.zeros((*batch, len(self._dynamics.all_joint_names)))
        values[..., self._numbers] = of_platforms
        values[..., self._others] = of_others
        return values

    def _driven(self, pose, twist, acceleration, seed, other_joints, external_wrenches):
        """(q (..., all joints), qd, qdd (..., n)) of a motion, for Dynamics: joints without motor accelerate as they
        must."""
        configuration, qd, qdd = self._motion(pose, twist, acceleration, seed, other_joints)
        q = configuration.q
        if self._undriven:
            qdd = solve_unactuated_accelerations(
                self._led, self._motored, (q, qd, qdd), self._undriven, external_wrenches
            )
            qdd[..., [self._independent[place] for place in self._undriven]] = 0  # part of the answer
        return q, qd[..., self._independent], qdd[..., self._independent]

    @cached_property
    def _motored(self):
        """The Dynamics of the same robot with a motor too at each of the other joints that has none."""
        numbers, robot = {self._independent[place] for place in self._undriven}, self._dynamics.robot
        joints = [replace(joint, actuated=joint.actuated or k in numbers) for k, joint in enumerate(robot.joints)]
        return type(self._dynamics)(replace(robot, joints=tuple(joints)), compiled=False)

    def _poses(self, pose):
        """(..., platforms, 4, 4) as they are told, checked."""
        told = self._by_link("pose", pose)
        if missing := [link for link in self.link_names if link not in told]:
            raise InvalidInputError(
                f"pose of platform {', '.join(map(repr, missing))} missing: each platform needs one"
            )
        return _side_by_side([require_pose(told[link], self._of("pose", link)) for link in self.link_names], 2)

    def _screws(self, what, told):
        """(..., platforms, 6) as they are told, checked, zero where they are not."""
        told = {} if told is None else self._by_link(what, told)
        screws = [
            require_finite(self._of(what, link), told.get(link, np.zeros(6)), 6, TWIST_COMPONENTS)
            for link in self.link_names
        ]
        return _side_by_side(screws, 1)

    def _by_link(self, what, told):
        if self._alone:
            return {self.link_names[0]: told}
        if not isinstance(told, Mapping):
            raise InvalidInputError(
                f"{what} of platforms {', '.join(self.link_names)}: a mapping by these names is needed"
            )
        for link in told:
            if link not in self.link_names:
                raise InvalidInputError(f"{what}: {describe_unknown_name('platform', link, self.link_names)}")
        return told

    def _of(self, what, link):
        return f"{what} of the platform" if self._alone else f"{what} of platform {link!r}"

    def _of_each(self, values, axes=1):
        """What (..., platforms, *axes) is answered of the platform, or of each."""
        each = np.moveaxis(values, -1 - axes, 0)
        return each[0] if self._alone else dict(zip(self.link_names, each, strict=True))

    def _told_of_others(self, other_joints):
        """[positions or None, velocities, accelerations], (..., k) each, of the joints that the platform does not
        place."""
        told = [None] * 3 if other_joints is None else [*other_joints, None, None, None][:3]
        names = f"joints ({', '.join(self.other_joint_names)})"
        unactuated = {self._independent[place] for place in self._undriven}
        open_ = {k: f"joint {self._dynamics.robot.joints[number].name!r}: {UNACTUATED_REASON}"
                 for k, number in enumerate(self._others) if number in unactuated}  # fmt: skip
        for place, what in enumerate(("positions", "velocities", "accelerations")):
            if told[place] is not None:
                ignored_columns = open_ if what == "accelerations" else None
                told[place] = require_finite(
                    f"{what} of others", told[place], len(self._others), names, ignored_columns
                )
            elif place:
                told[place] = np.zeros(len(self._others))
        return told

    def _closed(self, poses, seed, other_joints):
        """Positions (..., all joints) with the platforms at poses (..., platforms, 4, 4)."""
        if self._all_free:
            return self._led.close_loops(self._given(self._coordinates(poses, seed), seed, other_joints))
        q, good, asked = self._attempted(poses, seed, other_joints)
        if good.all():
            return q
        reached = q if asked.shape[-1] == q.shape[-1] else q[..., self._led.independent]
        return self._led.close_loops(np.where(good[..., None], reached, asked))  # which refuses the others

    def _attempted(self, poses, seed, other_joints):
        """(positions (..., all joints), whether the legs reach (...), what the led Configurations were given) for poses
        (..., platforms, 4, 4).

        Where the legs do not leave all coordinates free, more than one pose may have those that are. The pose that is
        meant is sought besides from where it is, and from its other angles.
        """
        x = self._coordinates(poses, seed)
        asked = self._given(x, seed, other_joints)
        q, good = self._led.try_close_loops(asked)
        if self._all_free:
            return q, good, asked
        ways = [partial(self._given, x, self._at(x, seed), other_joints)]
        if seed is None:
            ways.append(partial(self._given, self._turned_over(x), None, other_joints))
        for way in ways:
            meant = good & self._are_at(q, poses)
            if meant.all():
                break
            tried, closed = self._led.try_close_loops(way())
            better = ~meant & closed & self._are_at(tried, poses)
            q, good = np.where(better[..., None], tried, q), good | better
        return q, good, asked

    @property
    def _all_free(self):
        return len(self._free) == self._numbers.size

    def _coordinates(self, poses, seed):
        """(..., platforms, 6) of poses (..., platforms, 4, 4), the angles nearest to those of a seed, or to those that
        are known."""
        near = self._led.closed_positions[self._numbers]
        if seed is not None and np.shape(seed)[-1:] == (len(self._dynamics.all_joint_names),):
            seeded = np.asarray(seed, dtype=float)[..., self._numbers]
            near = np.where(np.isnan(seeded), near, seeded)
        return coordinates_from_pose(poses, near)

    @staticmethod
    def _turned_over(x):
        """The other coordinates (..., 6) of the same pose: with pitch on the other side of ±90°."""
        return np.concatenate([x[..., :3], x[..., 3:] * [1, -1, 1] + np.pi], axis=-1)

    def _at(self, x, seed):
        """A seed (..., all joints) with the platforms at coordinates (..., platforms, 6)."""
        batch = np.broadcast_shapes(x.shape[:-2], () if seed is None else np.shape(seed)[:-1])
        found = np.full((*batch, len(self._dynamics.all_joint_names)), np.nan)
        if seed is not None:
            found[...] = seed
        found[..., self._numbers] = x
        return found

    def _are_at(self, q, poses):
        """(...) whether the platforms are at poses (..., platforms, 4, 4)."""
        apart = np.abs(pose_from_coordinates(q[..., self._numbers]) - poses)
        apart[..., :3, 3] /= self._dynamics.robot.characteristic_length
        return apart.max(axis=(-3, -2, -1)) <= POSE_TOLERANCE

    def _given(self, x, seed, other_joints):
        """What the led Configurations take: coordinates x (..., platforms, 6), a seed (..., all joints) or none, and
        what is told of the others."""
        positions = self._told_of_others(other_joints)[0]
        if seed is None:
            return self._among_led(x, self._led.closed_positions[self._others] if positions is None else positions)
        seed, joints = np.asarray(seed, dtype=float), len(self._dynamics.all_joint_names)
        if seed.shape[-1:] != (joints,):
            require_finite("seed", seed, joints, f"joints ({', '.join(self._dynamics.all_joint_names)})")
        if positions is None:
            told = seed[..., self._others]
            positions = np.where(np.isnan(told), self._led.closed_positions[self._others], told)
        batch = np.broadcast_shapes(x.shape[:-2], seed.shape[:-1], positions.shape[:-1])
        seed = np.array(np.broadcast_to(seed, (*batch, joints)))
        seed[..., self._free], seed[..., self._others] = x[(..., *self._places)], positions
        return seed

    def _among_led(self, coordinates, other_joints):
        """Values (..., n) of the joints that are given: those of the free ones of coordinates (..., platforms, 6), and
        of the others (..., k)."""
        free, led = coordinates[(..., *self._places)], list(self._led.independent)
        values = np.empty((*np.broadcast_shapes(free.shape[:-1], other_joints.shape[:-1]), len(led)))
        values[..., [led.index(number) for number in self._free]] = free
        values[..., [led.index(number) for number in self._others]] = other_joints
        return values


def _led_by_platforms(robot, coordinates, free):
    """The robot whose platforms lead: joints `free` (numbers) are given, and the motors of their legs follow.

    coordinates: (platforms, 6) numbers of their coordinates. Raises QuestionError where legs hold other platforms too.
    """
    legs = {*coordinates.ravel().tolist()}
    loops = [{robot.mimic_relations[number][0] for number in {*robot.path_to_base(a.link)} ^ {*robot.path_to_base(b.link)}}
             for a, b in (loop.ends for loop in robot.loops)]  # fmt: skip
    while more := [loop for loop in loops if loop & legs and not loop <= legs]:
        legs = legs.union(*more)
    for name, platform in zip(robot.platform_links, robot.platforms, strict=True):
        if legs & {*platform.joints} and platform.joints[0] not in coordinates:
            raise InvalidInputError(f"these legs hold platform {name!r} too: ask both together, by Dynamics.platform")
    joints = [
        replace(joint, actuated=number in free, spring=None if joint.actuated else joint.spring)
        if number in legs and joint.mimic is None
        else joint
        for number, joint in enumerate(robot.joints)
    ]
    platforms = tuple(replace(platform, is_virtually_actuated=True) for platform in robot.platforms)
    return replace(robot, joints=tuple(joints), platforms=platforms)


def _wrong_coordinates(dynamics, links, numbers, free):
    """A sentence on free coordinates (names of each platform) that do not tell where platforms are, and on those that
    would: by the rank of their rates for unit rates of the motors."""
    motors = len(dynamics.joint_names)
    rates = np.nan_to_num(
        dynamics.expand_velocities(np.eye(motors), np.tile(dynamics.initial_joint_positions, (motors, 1)))
    )
    told = []
    for link, joints, names in zip(links, numbers, free, strict=True):
        chosen = []
        for place in range(len(COORDINATES)):
            if np.linalg.matrix_rank(rates[:, joints[[*chosen, place]]], tol=1e-6) > len(chosen):
                chosen.append(place)
        if set(names) != {COORDINATES[place] for place in chosen}:
            right = ", ".join(COORDINATES[place] for place in chosen)
            told.append(
                f"platform {link!r}: its legs let it move by {len(chosen)} coordinates (mobility {len(chosen)}), and "
                f"{', '.join(names)} do not tell them: write free: [{right}]"
            )
    return "; ".join(told) or f"the coordinates of platforms {', '.join(links)} do not tell where their legs are"


def _side_by_side(arrays, axes):
    """Arrays (..., *axes), one for each platform, as one (..., platforms, *axes)."""
    batch = np.broadcast_shapes(*(array.shape[: array.ndim - axes] for array in arrays))
    whole = [np.broadcast_to(array, (*batch, *array.shape[array.ndim - axes :])) for array in arrays]
    return np.stack(whole, axis=-1 - axes)


def check_coordinate(name, free):
    """Raise QuestionError for the name of a coordinate that platforms have not, or that is not among the free ones."""
    if name not in COORDINATES:
        raise InvalidInputError(describe_unknown_name("coordinate of a platform", name, COORDINATES))
    if name not in free:
        raise InvalidInputError(f"the legs do not leave {name} of the platform free, only {', '.join(free)}")
