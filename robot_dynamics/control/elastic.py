"""Elastic gears: a reference of the link beyond a motor and its spring, turned into one of the motor.

A motor q_m turns one end of a spring, the other end of which carries the link at q_l = q_m + q_s. The spring bears
what the link needs, τ_s = -k (q_s - q₀), and that is known from the motion wanted alone: τ_s(q_l, q̇_l, q̈_l) of the
robot with rigid gears. So q_s, and with it q_m = q_l - (q_s - q₀), follows from the reference and its first two
derivatives; velocity and acceleration of q_s from those after these, which are differences in time here. The position
q₀ of the spring at rest is counted to the link: with the gear unloaded motor and reference agree. Source: the inverse
model of elastic joints of Khalil, section 6, for a motion of the links.
"""

from dataclasses import dataclass, replace

import numpy as np

STEP = 4e-3  # [s] between the motions that velocities and accelerations of springs are differences of
ALONG = 1e-9  # how far the axes of a motor and of its spring may be from each other


@dataclass(frozen=True, eq=False)
class Gears:
    """Springs behind motors, the same axis for both.

    motors: their places among the joints that get efforts; springs: numbers in dynamics.joint_names; stiffness, rest:
    of the springs.
    """

    motors: np.ndarray
    springs: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray


def gears_of(dynamics, joints):
    """The Gears of a robot that lie behind those of its motors that are controlled."""
    robot, found = dynamics.robot, []
    for number, joint in enumerate(robot.joints):
        motor = joint.antecedent - 1
        if joint.role != "elastic" or joint.name not in dynamics.joint_names or motor < 0 or not joint.spring.stiffness:
            continue
        if robot.joints[motor].name in joints and _same_axis(robot.joints[motor], robot.joints[number]):
            place = joints.index(robot.joints[motor].name)
            spring = dynamics.joint_names.index(joint.name)
            found.append((place, spring, joint.spring.stiffness, joint.spring.rest))
    motors, springs, stiffness, rest = np.array(found, dtype=float).reshape(-1, 4).T
    return Gears(motors.astype(int), springs.astype(int), stiffness, rest)


def _same_axis(motor, spring):
    R, P = spring.placement[:3, :3], spring.placement[:3, 3]
    off = 0.0 if motor.prismatic else np.abs(P[:2]).max()
    return motor.prismatic == spring.prismatic and abs(R[2, 2] - 1) < ALONG and off < ALONG


def with_rigid_gears(robot, dynamics, gears):
    """The robot in which the springs of gears are joints with motors: their efforts are what the springs must bear."""
    names = {dynamics.joint_names[number] for number in gears.springs}
    joints = [replace(joint, actuated=True, spring=None) if joint.name in names else joint for joint in robot.joints]
    return replace(robot, joints=tuple(joints))


class Deflections:
    """What the springs do while the links move as wanted: `motion` (3, springs), positions, velocities, accelerations.

    demand: a function of references (3, joints) that gives efforts (n,) of the robot with rigid gears.
    """

    def __init__(self, gears, demand, joints):
        self._gears, self._demand = gears, demand
        self._samples = np.zeros((3, 3, joints))  # before, at and after the time asked
        self.motion = np.zeros((3, len(gears.springs)))

    def motor_side(self, followed, time, reference):
        """Write into reference (3, joints) what the motors should do, that the links do as `followed` says."""
        positions = []
        for k, sample in enumerate(self._samples):
            followed.sample(time + (k - 1) * STEP, sample)
            demanded = self._demand(sample)[self._gears.springs]
            positions.append(self._gears.rest - demanded / self._gears.stiffness)
        before, now, after = positions
        self.motion[:] = now, (after - before) / (2 * STEP), (after - 2 * now + before) / STEP**2
        np.copyto(reference, self._samples[1])
        reference[:, self._gears.motors] -= self.motion
        reference[0, self._gears.motors] += self._gears.rest
