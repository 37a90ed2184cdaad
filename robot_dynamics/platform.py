"""A parallel robot asked in the coordinates of its platform: geometry, rates, and both dynamic models (Khalil, 5).

The pose of the platform is that of its frame in frame 0; its twist and acceleration are those of its origin, true and
classical, expressed in its own frame, as those of a moving base are.

    V_p = J_p q̇_a,   Γ = J_pᵀ [F_p + Σ J_viᵀ J_i⁻ᵀ Γ_i]

Legs and platform are branches of one tree. With the platform's coordinates given, each leg is closed by itself, which
is J_i⁻¹ J_vi; with the motors' given, all of it together, which is J_p besides.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from robot_dynamics.answer import filled
from robot_dynamics.configuration import Configurations
from robot_dynamics.errors import QuestionError
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.newton_euler.screw import apply
from robot_dynamics.question import checked_pose, common_batch, finite

AXES = "linear and angular components"


class PlatformDynamics:
    """The platform of a Dynamics; `Dynamics.platform` gives it.

    free: the coordinates that the legs let the platform move by; the others follow from these, and are not read from a
    pose. Motors and elastic joints are asked for as in Dynamics: vectors (..., n) in the order of its joint_names.
    """

    def __init__(self, dynamics, programs=None):
        self._dynamics, robot = dynamics, dynamics.robot
        self.free = tuple(robot.platform.free)
        self._numbers = list(robot.platform.joints)
        self._free = [self._numbers[COORDINATES.index(name)] for name in self.free]
        joints = [replace(joint, actuated=number in self._free) for number, joint in enumerate(robot.joints)]
        # whom the platform leads: its coordinates are given, the motors follow
        self._led = Configurations(replace(robot, joints=tuple(joints), platform=None))
        self._link = robot.links[robot.platform.link].name

    def joints(self, pose, seed=None):
        """Positions (..., all joints) of all joints where the platform has the pose (..., 4, 4): inverse geometry.

        What comes out is what Dynamics takes as q. seed: (..., all joints), from where the legs are closed to the
        nearest, each in its assembly mode; else they are in those of the initial positions.

        Raises SingularModelError where a leg cannot reach.
        """
        return self._led.closed(self._given(coordinates(checked_pose(pose, "pose of the platform")), seed))

    def reach(self, pose):
        """(positions (N, all joints), reached (N,)): as `joints` for poses (N, 4, 4), telling which of them the legs
        reach; positions of the others mean nothing."""
        return self._led.attempted(self._given(coordinates(checked_pose(pose, "pose of the platform")), None))

    def condition(self, q):
        """(...) condition number of J_p between motors and free coordinates, at positions that `joints` gives.

        Angles count by the characteristic length of the robot; infinite where the motors do not hold the platform.
        """
        led = self._led.of_all(q).G
        motors = [self._dynamics.robot.joint_numbers[name] for name in self._dynamics.joint_names]
        unit = self._dynamics.robot.characteristic_length
        sizes = [unit if self._dynamics.robot.joints[number].prismatic else 1.0 for number in self._led.independent]
        drives = [unit if self._dynamics.robot.joints[number].prismatic else 1.0 for number in motors]
        with np.errstate(all="ignore"):
            return np.linalg.cond(led[..., motors, :] * np.array(sizes) / np.array(drives)[:, None])

    def pose(self, q):
        """The pose (..., 4, 4) of the platform at motor positions q (..., n): direct geometry. Where q has all joints,
        those tell where the search begins, and so which assembly mode comes out."""
        return self._dynamics.link_pose(self._link, q)

    def jacobian(self, q):
        """J_p (..., 6, n): the twist of the platform for unit rates of the motors."""
        q = self._dynamics.expand(q)
        columns = [self._dynamics.expand_rates(unit, q) for unit in np.eye(len(self._dynamics.joint_names))]
        rates = np.stack(columns, axis=-1)[..., self._numbers, :]
        return twist_matrix(q[..., self._numbers]) @ rates

    def motion(self, pose, twist=None, acceleration=None, seed=None):
        """(q, qd, qdd), (..., all joints) each, of all joints for a motion of the platform.

        twist, acceleration: (..., 6), zero if left out. Of these too, only what the legs leave free is read.
        """
        pose = checked_pose(pose, "pose of the platform")
        twist, acceleration = (
            np.zeros(6) if value is None else finite(f"{what} of the platform", value, 6, AXES)
            for what, value in (("twist", twist), ("acceleration", acceleration))
        )
        q = self.joints(pose, seed)
        configuration, x = self._led.of_all(q), q[..., self._numbers]
        rates = np.linalg.solve(twist_matrix(x), twist[..., None])[..., 0]
        second = np.linalg.solve(twist_matrix(x), (acceleration - twist_drift(x, rates))[..., None])[..., 0]
        places = [self._numbers.index(number) for number in self._free]
        qd = configuration.rates(self._among_led(rates[..., places]))
        qdd = configuration.rates(self._among_led(second[..., places])) + configuration.drift(qd)
        batch = common_batch(q, qd, qdd)
        return tuple(filled(values, batch) for values in (q, qd, qdd))

    def inverse(self, pose, twist=None, acceleration=None, *, seed=None, external_wrenches=None):
        """Efforts (..., n) [N m or N] of the motors for a motion of the platform: the inverse dynamic model."""
        q, qd, qdd = self.motion(pose, twist, acceleration, seed)
        numbers = [self._dynamics.robot.joint_numbers[name] for name in self._dynamics.joint_names]
        undriven = [not self._dynamics.robot.joints[number].actuated for number in numbers]
        asked = np.where(undriven, 0.0, qdd[..., numbers])
        return self._dynamics.inverse(q, qd[..., numbers], asked, external_wrenches=external_wrenches)

    def direct(self, pose, twist, efforts, *, seed=None, external_wrenches=None):
        """The acceleration (..., 6) of the platform that motor efforts (..., n) cause: the direct dynamic model."""
        q, qd, _ = self.motion(pose, twist, None, seed)
        numbers = [self._dynamics.robot.joint_numbers[name] for name in self._dynamics.joint_names]
        answer = self._dynamics.solve(q, qd[..., numbers], efforts=efforts, external_wrenches=external_wrenches)
        return self.acceleration(answer.motion)

    def acceleration(self, motion):
        """The acceleration (..., 6) of the platform in a JointMotion."""
        x, rates, second = (values[..., self._numbers] for values in motion)
        return apply(twist_matrix(x), second) + twist_drift(x, rates)

    def twist(self, motion):
        """The twist (..., 6) of the platform in a JointMotion."""
        return apply(twist_matrix(motion.positions[..., self._numbers]), motion.velocities[..., self._numbers])

    def _given(self, x, seed):
        """What the led Configurations take: coordinates x (..., 6), and a seed (..., all joints) or none."""
        if seed is None:
            return self._among_led(x[..., [COORDINATES.index(name) for name in self.free]])
        joints = len(self._dynamics.all_joint_names)
        seed = finite("seed", seed, joints, f"joints ({', '.join(self._dynamics.all_joint_names)})")
        seed = np.array(np.broadcast_to(seed, (*np.broadcast_shapes(x.shape[:-1], seed.shape[:-1]), joints)))
        seed[..., self._free] = x[..., [COORDINATES.index(name) for name in self.free]]
        return seed

    def _among_led(self, values):
        """Values of the free coordinates among those of the joints that are given, elastic ones at their rest."""
        led = list(self._led.independent)
        if len(led) == len(self._free):
            order = [self._free.index(number) for number in led]
            return values[..., order]
        raise QuestionError("a platform whose legs have elastic joints is asked by its joints: use Dynamics")


def coordinates(pose):
    """(..., 6) x, y, z, yaw, pitch, roll of poses (..., 4, 4)."""
    angles = Rotation.from_matrix(pose[..., :3, :3].reshape(-1, 3, 3)).as_euler("ZYX").reshape(*pose.shape[:-2], 3)
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
