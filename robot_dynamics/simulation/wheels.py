"""Wheels that roll without slipping: which velocities they allow.

The material point of a wheel that touches the plane is at rest there: v(c) + ω_wheel × (-r z) has no component in the
plane, where c is the centre of the wheel and the plane is that of x and y of the base. Rollers on the rim free the
component across their axes. These are rows C ν = 0 for ν = [V0; q̇], the twist of the base in the base frame and the
joint velocities, beside the three by which the base stays in its plane.
"""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import DescriptionError, InvalidInputError, describe_unknown_name
from robot_dynamics.model.inertia import skew
from robot_dynamics.newton_euler.kinematics import joint_placement
from robot_dynamics.newton_euler.screw import cross

VERTICAL = np.array([0.0, 0.0, 1.0])
PLANAR_BASE_ROWS = np.eye(6)[[2, 3, 4]]  # rows of V0 that a base in its plane has not: z, and turning about x and y
AXLE_TOLERANCE = 1e-6  # how far the axle may point out of the plane
COMPLEX_STEP = 1e-30  # of the complex step, by which derivatives have no rounding


@dataclass(frozen=True)
class Wheel:
    """A wheel: the joint that it turns about, whose link has its origin in the centre of the wheel; its radius [m].

    roller_angle: None for a plain wheel; else the angle [rad] about the vertical from where the wheel heads to the axes
    of the rollers that touch the ground: 0 for an omnidirectional wheel, ±π/4 for mecanum wheels.
    """

    joint: str
    radius: float
    roller_angle: float | None = None

    def __post_init__(self):
        if not (isinstance(self.radius, int | float) and np.isfinite(self.radius) and self.radius > 0):
            raise DescriptionError(f"wheel {self.joint!r}: radius is {self.radius!r}, a positive length [m] is needed")
        if self.roller_angle is not None and not np.isfinite(self.roller_angle):
            raise DescriptionError(f"wheel {self.joint!r}: roller_angle is {self.roller_angle!r}, an angle is needed")


class RollingConstraints:
    """The rows C (m, 6 + all joints) that the wheels of a robot stand for.

    joints: numbers of those that the wheels turn about; constant: whether C is the same wherever the joints are, as no
    wheel is steered. Raises DescriptionError for wheels that do not fit the robot.
    """

    def __init__(self, robot, wheels):
        self._robot, self._wheels = robot, tuple(wheels)
        self._ways = [self._way(wheel) for wheel in self._wheels]
        self.joints = [way[-1] for way in self._ways]
        self.is_constant = all(len(way) == 1 for way in self._ways)
        names = [wheel.joint for wheel in self._wheels]
        if len(set(names)) < len(names):
            raise DescriptionError(f"wheels {', '.join(names)}: each joint is one wheel at most")

    def _way(self, wheel):
        numbers = self._robot.joint_numbers
        if wheel.joint not in numbers:
            raise DescriptionError(f"wheel: {describe_unknown_name('joint', wheel.joint, numbers)}")
        joint = self._robot.joints[numbers[wheel.joint]]
        if joint.prismatic:
            raise DescriptionError(f"wheel {wheel.joint!r}: the joint slides, a wheel turns")
        return sorted(self._robot.path_to_base(numbers[wheel.joint] + 1))

    def constraint_rows(self, q, qd=None):
        """(C, Ċ) (m, 6 + joints) at positions q and velocities qd (joints,) of all joints, Ċ by a complex step."""
        placed = self._placed(q if qd is None else q + 1j * COMPLEX_STEP * qd)
        rows = [np.concatenate([PLANAR_BASE_ROWS, np.zeros((3, len(q)))], axis=1)]
        rows += [self._wheel_rows(wheel, way, placed) for wheel, way in zip(self._wheels, self._ways, strict=True)]
        rows = np.concatenate(rows)
        return rows.real.copy(), rows.imag / COMPLEX_STEP

    def _placed(self, q):
        """{link: (R (3, 3), P (3,))} of the links between wheels and base, in frame 0."""
        placed = {0: (np.eye(3), np.zeros(3))}
        for number in sorted(set().union(*self._ways)):
            joint = self._robot.joints[number]
            R, P = joint_placement(joint, q[number : number + 1])
            R_i, P_i = placed[joint.antecedent]
            placed[number + 1] = R_i @ R, P_i + R_i @ P
        return placed

    def _wheel_rows(self, wheel, way, placed):
        robot = self._robot
        link = way[-1] + 1
        R, P = placed[link]
        axle = R[:, 2]
        if abs(axle[2]) > AXLE_TOLERANCE:
            raise InvalidInputError(f"wheel {wheel.joint!r}: its axle points out of the plane of the base")
        touching = P + R @ robot.frame(robot.links[link].name).placement[:3, 3] - wheel.radius * VERTICAL
        rows = np.zeros((3, 6 + len(robot.joints)), dtype=R.dtype)
        rows[:, :3], rows[:, 3:6] = np.eye(3), -skew(touching)
        for number in way:
            R_k, P_k = placed[number + 1]
            z = R_k[:, 2]
            rows[:, 6 + number] = z if robot.joints[number].prismatic else cross(z, touching - P_k)
        if wheel.roller_angle is None:
            return rows[:2]
        heading = cross(axle, VERTICAL)
        cosine, sine = np.cos(wheel.roller_angle), np.sin(wheel.roller_angle)
        return (cosine * heading + sine * cross(VERTICAL, heading))[None] @ rows
