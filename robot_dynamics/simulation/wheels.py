"""Wheels that roll without slipping: the velocity constraints that they impose.

The material point of a wheel that touches the plane is at rest there: v(c) + ω_wheel × (-r z) has no component in the
plane, where c is the centre of the wheel and the plane is that of x and y of the base. Rollers on the rim free the
component across their axes. These are rows C ν = 0 for ν = [V0; q̇], the twist of the base in the base frame and the
joint velocities. Three more rows keep the base in its plane.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import DescriptionError, InvalidInputError, describe_unknown_name
from robot_dynamics.model.vector_product import skew
from robot_dynamics.newton_euler.joint_placement import joint_placement
from robot_dynamics.newton_euler.screw import cross

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray
    from robot_dynamics.model.robot import Robot

VERTICAL = np.array([0.0, 0.0, 1.0])
PLANAR_BASE_ROWS = np.eye(6)[[2, 3, 4]]
"""Components of V0 that are zero for a base in its plane: translation along z, rotation about x and y."""
AXLE_TOLERANCE = 1e-6
"""Component along the vertical that the unit vector of an axle may have."""
COMPLEX_STEP = 1e-30
"""Imaginary step by which derivatives are computed without rounding."""


@dataclass(frozen=True)
class Wheel:
    """A wheel that carries a planar base.

    Parameters
    ----------
    joint : str
        Name of the joint that the wheel turns about. The origin of its link is the centre of the wheel.
    radius : float
        Radius [m].
    roller_angle : float, optional
        None for a plain wheel. Otherwise the angle [rad] about the vertical from the heading of the wheel to the axes
        of the rollers that touch the ground: 0 for an omnidirectional wheel, ±π/4 for mecanum wheels.

    Raises
    ------
    DescriptionError
        The radius is not positive, or a number is not finite.
    """

    joint: str
    radius: float
    roller_angle: float | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.radius, int | float) and np.isfinite(self.radius) and self.radius > 0):
            raise DescriptionError(f"wheel {self.joint!r}: radius is {self.radius!r}, it must be a positive length [m]")
        if self.roller_angle is not None and not np.isfinite(self.roller_angle):
            raise DescriptionError(f"wheel {self.joint!r}: roller_angle is {self.roller_angle!r}, it must be finite")


class RollingConstraints:
    """The constraint rows C (m, 6 + all joints) of the wheels of a robot.

    Parameters
    ----------
    robot : Robot
    wheels : iterable of Wheel

    Attributes
    ----------
    joints : list of int
        Numbers of the joints that the wheels turn about.
    is_constant : bool
        Whether C is the same at all joint positions, because no wheel is steered.

    Raises
    ------
    DescriptionError
        A wheel names an unknown or prismatic joint, or two wheels name the same one.
    """

    def __init__(self, robot: Robot, wheels: Iterable[Wheel]) -> None:
        self._robot = robot
        self._wheels = tuple(wheels)
        self._paths = [self._path(wheel) for wheel in self._wheels]
        self.joints = [path[-1] for path in self._paths]
        self.is_constant = all(len(path) == 1 for path in self._paths)
        names = [wheel.joint for wheel in self._wheels]
        if len(set(names)) < len(names):
            raise DescriptionError(f"wheels {', '.join(names)}: each joint is one wheel at most")

    def _path(self, wheel: Wheel) -> list[int]:
        """Numbers of the joints from the base to the wheel."""
        numbers = self._robot.joint_numbers
        if wheel.joint not in numbers:
            raise DescriptionError(f"wheel: {describe_unknown_name('joint', wheel.joint, numbers)}")
        joint = self._robot.joints[numbers[wheel.joint]]
        if joint.prismatic:
            raise DescriptionError(f"wheel {wheel.joint!r}: the joint is prismatic, a wheel needs a revolute joint")
        return sorted(self._robot.path_to_base(numbers[wheel.joint] + 1))

    def constraint_rows(self, q: Array, qd: Array | None = None) -> tuple[Array, Array]:
        """C and Ċ (m, 6 + all joints) at positions q and velocities qd (all joints,); Ċ by a complex step."""
        placements = self._link_placements(q if qd is None else q + 1j * COMPLEX_STEP * qd)
        blocks: list[ScalarArray] = [np.concatenate([PLANAR_BASE_ROWS, np.zeros((3, len(q)))], axis=1)]
        for wheel, path in zip(self._wheels, self._paths, strict=True):
            blocks.append(self._wheel_rows(wheel, path, placements))
        rows = np.concatenate(blocks)
        return rows.real.copy(), rows.imag / COMPLEX_STEP

    def _link_placements(self, q: ScalarArray) -> dict[int, tuple[ScalarArray, ScalarArray]]:
        """Orientation (3, 3) and position (3,) in frame 0 of the links between wheels and base, by number."""
        placements: dict[int, tuple[ScalarArray, ScalarArray]] = {0: (np.eye(3), np.zeros(3))}
        for number in sorted(set().union(*self._paths)):
            joint = self._robot.joints[number]
            R, P = joint_placement(joint, q[number : number + 1])
            R_i, P_i = placements[joint.antecedent]
            placements[number + 1] = R_i @ R, P_i + R_i @ P
        return placements

    def _wheel_rows(
        self, wheel: Wheel, path: list[int], placements: dict[int, tuple[ScalarArray, ScalarArray]]
    ) -> ScalarArray:
        """Rows (2, 6 + all joints) of a plain wheel, (1, 6 + all joints) of one with rollers."""
        robot = self._robot
        link = path[-1] + 1
        R, P = placements[link]
        axle = R[:, 2]
        if abs(axle[2]) > AXLE_TOLERANCE:
            raise InvalidInputError(f"wheel {wheel.joint!r}: its axle points out of the plane of the base")
        contact = P + R @ robot.frame(robot.links[link].name).placement[:3, 3] - wheel.radius * VERTICAL
        rows = np.zeros((3, 6 + len(robot.joints)), dtype=R.dtype)
        rows[:, :3] = np.eye(3)
        rows[:, 3:6] = -skew(contact)
        for number in path:
            R_k, P_k = placements[number + 1]
            z = R_k[:, 2]
            rows[:, 6 + number] = z if robot.joints[number].prismatic else cross(z, contact - P_k)
        if wheel.roller_angle is None:
            return rows[:2]
        heading = cross(axle, VERTICAL)
        cosine, sine = np.cos(wheel.roller_angle), np.sin(wheel.roller_angle)
        rolling_direction = cosine * heading + sine * cross(VERTICAL, heading)
        row: ScalarArray = rolling_direction[None] @ rows
        return row
