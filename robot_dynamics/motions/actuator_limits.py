"""Limits of actuators: efforts, speeds and torque-speed curves of joints and of motors behind gears.

Motors turn with R q̇, where R are their ratios. Their torques are Rᵀ⁻¹ Γ, by the virtual work of the joint efforts Γ.
Limits of joints are those of the description; limits of motors are those of a file of drives. Both hold at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.recordings.drives import Drives


@dataclass(frozen=True, eq=False)
class ActuatorLimits:
    """Limits of c actuators: the n independent joints, and the motors that have limits of their own.

    Attributes
    ----------
    names : (c,) names of the joints and motors.
    effort_rows : (c, n) their efforts for unit efforts of the joints.
    speed_rows : (c, n) their speeds for unit speeds of the joints.
    max_speeds : (c,) [rad/s or m/s], infinite without a limit.
    curves : for each actuator speeds (k,), ascending from 0, and the largest efforts (k,) there [N m or N]. Efforts
        are interpolated, and constant beyond the last speed. They hold for both directions of speed and effort.
    """

    names: tuple[str, ...]
    effort_rows: Array
    speed_rows: Array
    max_speeds: Array
    curves: tuple[tuple[Array, Array], ...]

    def efforts(self, joint_efforts: Array) -> Array:
        """Efforts (..., c) of the actuators from those (..., n) of the joints."""
        efforts: Array = joint_efforts @ self.effort_rows.T
        return efforts

    def speeds(self, qd: Array) -> Array:
        """Magnitudes (..., c) of the speeds of the actuators from joint velocities (..., n)."""
        speeds: Array = np.abs(qd @ self.speed_rows.T)
        return speeds

    @cached_property
    def _constant_limits(self) -> Array | None:
        """Largest efforts (c,) where none depends on the speed."""
        if any(len(speeds) > 1 for speeds, _ in self.curves):
            return None
        return np.array([efforts[0] for _, efforts in self.curves])

    def effort_limits(self, speeds: Array) -> Array:
        """Largest efforts (..., c) at speeds (..., c) of the actuators."""
        if self._constant_limits is not None:
            return np.broadcast_to(self._constant_limits, speeds.shape)
        limits = np.empty_like(speeds)
        for column, (curve_speeds, curve_efforts) in enumerate(self.curves):
            limits[..., column] = np.interp(speeds[..., column], curve_speeds, curve_efforts)
        return limits

    def usage(self, joint_efforts: Array, qd: Array) -> tuple[Array, Array]:
        """Parts of the limits that efforts (..., n) at velocities (..., n) use: of efforts, and of speeds (..., c)."""
        speeds = self.speeds(qd)
        limits = self.effort_limits(speeds)
        efforts = np.abs(self.efforts(joint_efforts))
        with np.errstate(divide="ignore", invalid="ignore"):
            of_efforts = np.where(efforts > 0, efforts / limits, 0.0)
            of_speeds = np.where(speeds > 0, speeds / self.max_speeds, 0.0)
        return of_efforts, of_speeds


def find_actuator_limits(robot: Robot, drives: Drives) -> ActuatorLimits:
    """Return the limits of the joints of `drives`, which are all independent joints of the robot, and of its motors."""
    count = len(drives.joint_names)
    limits = [robot.joints[robot.joint_numbers[name]].limits for name in drives.joint_names]
    curves = [(np.zeros(1), np.array([limit.effort])) for limit in limits]
    max_speeds = [limit.velocity for limit in limits]
    names = list(drives.joint_names)
    motor_efforts = np.linalg.inv(drives.ratios).T
    rows = [*range(count)]
    for number, name in enumerate(drives.names):
        motor = drives.limits.get(name)
        if motor is not None:
            names.append(name)
            rows.append(count + number)
            max_speeds.append(motor.velocity)
            curves.append((np.array(motor.speeds), np.array(motor.efforts)))
    return ActuatorLimits(
        tuple(names),
        np.vstack([np.eye(count), motor_efforts])[rows],
        np.vstack([np.eye(count), drives.ratios])[rows],
        np.array(max_speeds),
        tuple(curves),
    )
