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
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from robot_dynamics.answer import filled
from robot_dynamics.configuration import Configurations
from robot_dynamics.errors import DescriptionError, QuestionError, unknown_name
from robot_dynamics.model.placement import as_rotation
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.newton_euler.linear import solve_each
from robot_dynamics.newton_euler.screw import apply
from robot_dynamics.platform_springs import accelerated, at_rest
from robot_dynamics.question import checked_pose, common_batch, finite
from robot_dynamics.symbolic.compiled_models import CompiledModels

AXES = "linear and angular components"
OPEN = "no motor drives it, so its acceleration is part of the answer"


class Platforms(dict):
    """{link: PlatformDynamics}; a link without a platform raises QuestionError."""

    def __missing__(self, link):
        raise QuestionError(unknown_name("platform", link, self))


class PlatformDynamics:
    """The platform of a Dynamics, or all of them together; `Dynamics.platform` and `Dynamics.platforms` give it.

    What is asked and answered of the platform is an array; of many platforms together {link: array}, by the names of
    their `links`. Motors and elastic joints are asked for as in Dynamics: vectors (..., n) in the order of its
    joint_names.

    free: the coordinates that the legs let the platform move by, of many platforms {link: coordinates}; the others
    follow from these, and are not read from a pose.

    other_joint_names: those of joint_names that the platform does not place: elastic joints of its legs, joints outside
    of them, and the motors of platforms that are not asked. Their motion is told as others=(positions, velocities,
    accelerations), (..., k) each, or the first ones alone. Left out, positions are those that a seed has, else the
    initial ones, and the rest is zero. As everywhere, accelerations of joints without motor are part of the answer, and
    0 or nan in the question.
    """

    def __init__(self, dynamics, platforms, alone):
        self._dynamics, robot = dynamics, dynamics.robot
        self._alone = alone
        self.links = tuple(robot.links[platform.link].name for platform in platforms)
        free = [tuple(platform.free) for platform in platforms]
        self.free = free[0] if alone else dict(zip(self.links, free, strict=True))
        self._numbers = np.array([platform.joints for platform in platforms])
        places = [(k, COORDINATES.index(name)) for k, names in enumerate(free) for name in names]
        self._places = tuple(np.array(places).T)  # of the free coordinates, among (platforms, 6)
        self._free = self._numbers[self._places].tolist()
        self._independent = [robot.joint_numbers[name] for name in dynamics.joint_names]
        led = _led_by_platforms(robot, self._numbers, self._free)
        try:
            self._led = Configurations(led, CompiledModels(led) if dynamics.compiles else None)
        except DescriptionError:
            raise DescriptionError(_wrong_coordinates(dynamics, self.links, self._numbers, free)) from None
        self._others = [number for number in self._led.independent if number not in self._free]
        self._motors = [number for number in self._independent if number not in self._led.independent]
        self.other_joint_names = tuple(robot.joints[number].name for number in self._others)
        if not {*self._others} <= {*self._independent}:
            names = ", ".join(repr(robot.joints[n].name) for n in self._others if n not in self._independent)
            raise QuestionError(f"the platform does not tell where {names} are, which the motors do: ask by joints")
        undriven = [number for number in self._others if not robot.joints[number].actuated]
        self._undriven = [self._independent.index(number) for number in undriven]  # places among joint_names

    def joints(self, pose, seed=None, others=None):
        """Positions (..., all joints) of all joints where the platform has the pose (..., 4, 4): inverse geometry.

        What comes out is what Dynamics takes as q. seed: (..., all joints), from where the legs are closed to the
        nearest, each in its assembly mode; nan says nothing of a joint. Without one they are in those of the initial
        positions. Of others, the positions count.

        Raises SingularModelError where a leg cannot reach.
        """
        return self._led.closed(self._given(coordinates(self._poses(pose)), seed, others))

    def reach(self, pose, others=None):
        """(positions (N, all joints), reached (N,)): as `joints` for poses (N, 4, 4), telling which of them the legs
        reach; positions of the others mean nothing."""
        return self._led.attempted(self._given(coordinates(self._poses(pose)), None, others))

    def condition(self, q):
        """(...) condition number of J_p between motors and free coordinates, at positions that `joints` gives.

        Angles count by the characteristic length of the robot; infinite where the motors do not hold the platform.
        """
        G, joints = self._led.of_all(q).G, self._dynamics.robot.joints
        unit = self._dynamics.robot.characteristic_length
        sizes, drives = (np.array([unit if joints[number].prismatic else 1.0 for number in numbers])
                         for numbers in (self._free, self._motors))  # fmt: skip
        columns = [self._led.independent.index(number) for number in self._free]
        with np.errstate(all="ignore"):
            return np.linalg.cond(G[..., self._motors, :][..., columns] * sizes / drives[:, None])

    def pose(self, q):
        """The pose (..., 4, 4) of the platform at motor positions q (..., n): direct geometry. Where q has all joints,
        those tell where the search begins, and so which assembly mode comes out."""
        return self._of_each(pose_of(self._dynamics.expand(q)[..., self._numbers]), 2)

    def jacobian(self, q):
        """J_p (..., 6, n): the twist of the platform for unit rates of the motors."""
        q = self._dynamics.expand(q)
        columns = [self._dynamics.expand_rates(unit, q) for unit in np.eye(len(self._dynamics.joint_names))]
        rates = np.stack(columns, axis=-1)[..., self._numbers, :]
        return self._of_each(twist_matrix(q[..., self._numbers]) @ rates, 2)

    def motion(self, pose, twist=None, acceleration=None, seed=None, others=None):
        """(q, qd, qdd), (..., all joints) each, of all joints for a motion of the platform and of the others.

        twist, acceleration: (..., 6), zero if left out. Of these too, only what the legs leave free is read.
        """
        x, (_, velocities, accelerations) = coordinates(self._poses(pose)), self._told_of_others(others)
        twist, acceleration = self._screws("twist", twist), self._screws("acceleration", acceleration)
        q = self._led.closed(self._given(x, seed, others))
        configuration, x = self._led.of_all(q), q[..., self._numbers]
        rates = solve_each(twist_matrix(x), twist)
        second = solve_each(twist_matrix(x), acceleration - twist_drift(x, rates))
        qd = configuration.rates(self._among_led(rates, velocities))
        qdd = configuration.rates(self._among_led(second, accelerations)) + configuration.drift(qd)
        batch = common_batch(q, qd, qdd)
        return tuple(filled(values, batch) for values in (q, qd, qdd))

    def inverse(self, pose, twist=None, acceleration=None, *, seed=None, others=None, external_wrenches=None):
        """Efforts (..., n) [N m or N] of the motors for a motion of the platform: the inverse dynamic model.

        Raises SingularModelError where springs stand between the motors and the platform: at given deflections it
        accelerates as the springs push it, whatever the motors do.
        """
        state = self._driven(pose, twist, acceleration, seed, others, external_wrenches)
        return self._dynamics.inverse(*state, external_wrenches=external_wrenches)

    def direct(self, pose, twist, efforts, *, seed=None, others=None, external_wrenches=None):
        """The acceleration (..., 6) of the platform that motor efforts (..., n) cause: the direct dynamic model."""
        told = {"seed": seed, "others": others, "external_wrenches": external_wrenches}
        return self.acceleration(self.solve(pose, twist, efforts=efforts, **told).motion)

    def solve(
        self, pose, twist=None, *, acceleration=None, efforts=None, seed=None, others=None, external_wrenches=None
    ):
        """The whole Answer of Dynamics for an acceleration of the platform or for efforts, whichever is given; see
        `inverse` and `direct`."""
        if (acceleration is None) == (efforts is None):
            raise QuestionError("give acceleration or efforts, one of the two: the other is the answer")
        if efforts is None:
            q, qd, qdd = self._driven(pose, twist, acceleration, seed, others, external_wrenches)
            return self._dynamics.solve(q, qd, qdd=qdd, external_wrenches=external_wrenches)
        q, qd, _ = self.motion(pose, twist, None, seed, others)
        qd = qd[..., self._independent]
        return self._dynamics.solve(q, qd, efforts=efforts, external_wrenches=external_wrenches)

    def equilibrium(self, pose, *, seed=None, others=None, external_wrenches=None):
        """The Equilibrium of Dynamics in which motors and springs hold the platform at a pose: the motors are where the
        springs need them. Seed and others say where the deflections of the springs are sought.

        Raises SingularModelError where none is found.
        """
        q = self.joints(pose, seed, others)
        if self._undriven:
            q = at_rest(self._led, self._motored, q, self._undriven, external_wrenches)
        return self._dynamics.equilibrium(q, external_wrenches=external_wrenches)

    def acceleration(self, motion):
        """The acceleration (..., 6) of the platform in a JointMotion."""
        x, rates, second = (values[..., self._numbers] for values in motion)
        return self._of_each(apply(twist_matrix(x), second) + twist_drift(x, rates))

    def twist(self, motion):
        """The twist (..., 6) of the platform in a JointMotion."""
        rates = motion.velocities[..., self._numbers]
        return self._of_each(apply(twist_matrix(motion.positions[..., self._numbers]), rates))

    def _driven(self, pose, twist, acceleration, seed, others, external_wrenches):
        """(q (..., all joints), qd, qdd (..., n)) of a motion, for Dynamics: joints without motor accelerate as they
        must."""
        q, qd, qdd = self.motion(pose, twist, acceleration, seed, others)
        if self._undriven:
            qdd = accelerated(self._led, self._motored, (q, qd, qdd), self._undriven, external_wrenches)
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
        if missing := [link for link in self.links if link not in told]:
            raise QuestionError(f"pose of platform {', '.join(map(repr, missing))} missing: each platform needs one")
        return _side_by_side([checked_pose(told[link], self._of("pose", link)) for link in self.links], 2)

    def _screws(self, what, told):
        """(..., platforms, 6) as they are told, checked, zero where they are not."""
        told = {} if told is None else self._by_link(what, told)
        screws = [finite(self._of(what, link), told.get(link, np.zeros(6)), 6, AXES) for link in self.links]
        return _side_by_side(screws, 1)

    def _by_link(self, what, told):
        if self._alone:
            return {self.links[0]: told}
        if not isinstance(told, Mapping):
            raise QuestionError(f"{what} of platforms {', '.join(self.links)}: a mapping by these names is needed")
        for link in told:
            if link not in self.links:
                raise QuestionError(f"{what}: {unknown_name('platform', link, self.links)}")
        return told

    def _of(self, what, link):
        return f"{what} of the platform" if self._alone else f"{what} of platform {link!r}"

    def _of_each(self, values, axes=1):
        """What (..., platforms, *axes) is answered of the platform, or of each."""
        each = np.moveaxis(values, -1 - axes, 0)
        return each[0] if self._alone else dict(zip(self.links, each, strict=True))

    def _told_of_others(self, others):
        """[positions or None, velocities, accelerations], (..., k) each, of the joints that the platform does not
        place."""
        told = [None] * 3 if others is None else [*others, None, None, None][:3]
        names = f"joints ({', '.join(self.other_joint_names)})"
        undriven = {self._independent[place] for place in self._undriven}
        open_ = {k: f"joint {self._dynamics.robot.joints[number].name!r}: {OPEN}"
                 for k, number in enumerate(self._others) if number in undriven}  # fmt: skip
        for place, what in enumerate(("positions", "velocities", "accelerations")):
            if told[place] is not None:
                left_open = open_ if what == "accelerations" else None
                told[place] = finite(f"{what} of others", told[place], len(self._others), names, left_open)
            elif place:
                told[place] = np.zeros(len(self._others))
        return told

    def _given(self, x, seed, others):
        """What the led Configurations take: coordinates x (..., platforms, 6), a seed (..., all joints) or none, and
        what is told of the others."""
        positions = self._told_of_others(others)[0]
        if seed is None:
            return self._among_led(x, self._led.known[self._others] if positions is None else positions)
        seed, joints = np.asarray(seed, dtype=float), len(self._dynamics.all_joint_names)
        if seed.shape[-1:] != (joints,):
            finite("seed", seed, joints, f"joints ({', '.join(self._dynamics.all_joint_names)})")
        if positions is None:
            told = seed[..., self._others]
            positions = np.where(np.isnan(told), self._led.known[self._others], told)
        batch = np.broadcast_shapes(x.shape[:-2], seed.shape[:-1], positions.shape[:-1])
        seed = np.array(np.broadcast_to(seed, (*batch, joints)))
        seed[..., self._free], seed[..., self._others] = x[(..., *self._places)], positions
        return seed

    def _among_led(self, coordinates, others):
        """Values (..., n) of the joints that are given: those of the free ones of coordinates (..., platforms, 6), and
        of the others (..., k)."""
        free, led = coordinates[(..., *self._places)], list(self._led.independent)
        values = np.empty((*np.broadcast_shapes(free.shape[:-1], others.shape[:-1]), len(led)))
        values[..., [led.index(number) for number in self._free]] = free
        values[..., [led.index(number) for number in self._others]] = others
        return values


def _led_by_platforms(robot, coordinates, free):
    """The robot whose platforms lead: joints `free` (numbers) are given, and the motors of their legs follow.

    coordinates: (platforms, 6) numbers of their coordinates. Raises QuestionError where legs hold other platforms too.
    """
    legs = {*coordinates.ravel().tolist()}
    loops = [{robot.leaders[number][0] for number in {*robot.way(a.link)} ^ {*robot.way(b.link)}}
             for a, b in (loop.ends for loop in robot.loops)]  # fmt: skip
    while more := [loop for loop in loops if loop & legs and not loop <= legs]:
        legs = legs.union(*more)
    for name, platform in zip(robot.platform_links, robot.platforms, strict=True):
        if legs & {*platform.joints} and platform.joints[0] not in coordinates:
            raise QuestionError(f"these legs hold platform {name!r} too: ask both together, by Dynamics.platform")
    joints = [
        replace(joint, actuated=number in free, spring=None if joint.actuated else joint.spring)
        if number in legs and joint.mimic is None
        else joint
        for number, joint in enumerate(robot.joints)
    ]
    return replace(robot, joints=tuple(joints), platforms=())


def _wrong_coordinates(dynamics, links, numbers, free):
    """A sentence on free coordinates (names of each platform) that do not tell where platforms are, and on those that
    would: by the rank of their rates for unit rates of the motors."""
    motors = len(dynamics.joint_names)
    rates = dynamics.expand_rates(np.eye(motors), np.tile(dynamics.closed_positions, (motors, 1)))
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
        raise QuestionError(unknown_name("coordinate of a platform", name, COORDINATES))
    if name not in free:
        raise QuestionError(f"the legs do not leave {name} of the platform free, only {', '.join(free)}")


def coordinates(pose):
    """(..., 6) x, y, z, yaw, pitch, roll of poses (..., 4, 4)."""
    angles = as_rotation(pose[..., :3, :3].reshape(-1, 3, 3)).as_euler("ZYX").reshape(*pose.shape[:-2], 3)
    return np.concatenate([pose[..., :3, 3], angles], axis=-1)


def pose_of(x):
    """(..., 4, 4) poses of coordinates (..., 6)."""
    pose = np.zeros((*x.shape[:-1], 4, 4))
    pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = _rotation(x), x[..., :3], 1
    return pose


def _rotation(x):
    angles = x[..., 3:].reshape(-1, 3)
    return Rotation.from_euler("ZYX", angles).as_matrix().reshape(*x.shape[:-1], 3, 3)


def twist_matrix(x):
    """(..., 6, 6): from the rates of coordinates x (..., 6) to the twist of the platform in its own frame."""
    matrix = np.zeros((*x.shape[:-1], 6, 6))
    matrix[..., :3, :3] = np.swapaxes(_rotation(x), -1, -2)
    sine, cosine = np.sin(x[..., 4:]), np.cos(x[..., 4:])  # of pitch and roll
    matrix[..., 3, 3], matrix[..., 3, 5] = -sine[..., 0], 1
    matrix[..., 4, 3], matrix[..., 4, 4] = cosine[..., 0] * sine[..., 1], cosine[..., 1]
    matrix[..., 5, 3], matrix[..., 5, 4] = cosine[..., 0] * cosine[..., 1], -sine[..., 1]
    return matrix


def twist_drift(x, rates):
    """(..., 6): the classical acceleration of the platform at rates (..., 6) that do not change."""
    yaw, pitch, roll = (rates[..., k] for k in (3, 4, 5))
    (sp, sr), (cp, cr) = (np.moveaxis(of(x[..., 4:]), -1, 0) for of in (np.sin, np.cos))
    found = np.zeros(np.broadcast_shapes(x.shape, rates.shape))
    found[..., 3] = -yaw * pitch * cp
    found[..., 4] = -pitch * roll * sr + yaw * (roll * cp * cr - pitch * sp * sr)
    found[..., 5] = -pitch * roll * cr - yaw * (roll * cp * sr + pitch * sp * cr)
    return found
