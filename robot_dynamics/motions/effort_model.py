"""Efforts of a motion as a function of its speed along a path.

On a path q(σ) with q̇ = q' ṡ and q̈ = q' u + q'' x, where x = ṡ² and u = σ̈, the efforts are

    Γ = a u + b x + c + f(√x)

The inertia a, the velocity products b and the weight c are those of the robot without friction; f is friction, which
depends on the speed alone, in its direction too. Load-dependent friction multiplies the rest by 1 ± μ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.recordings.drives import Drives

STRIBECK_SPEEDS = np.geomspace(1e-4, 1e2, 61)
"""Speeds, relative to those of the Stribeck curves, between which their friction is interpolated."""
LINEAR_SPEEDS = np.array([1.0, 2.0])
"""Two speeds determine friction that is linear in the speed: viscous and Coulomb friction."""


@dataclass(frozen=True, eq=False)
class PathEfforts:
    """Efforts at N points of a path.

    Attributes
    ----------
    a, b, c : (N, n) coefficients of σ̈, of ṡ², and the constant [N m or N, with s and the unit of σ].
    speeds : (K,) values of ṡ of the table of friction.
    highest_friction, lowest_friction : (N, K, n) friction f at these speeds; linear between and beyond them. They
        differ where the velocity of a joint changes its sign in the neighbourhood of a point.
    load_friction : (n,) μ.
    directions : (N, n) signs of the joint velocities.
    is_turning : (N, n) whether the velocity of a joint changes its sign in the neighbourhood.
    """

    a: Array
    b: Array
    c: Array
    speeds: Array
    highest_friction: Array
    lowest_friction: Array
    load_friction: Array
    directions: Array
    is_turning: BoolArray


class EffortModel:
    """Efforts of the joints of a robot with its drives.

    Parameters
    ----------
    dynamics : Dynamics
        Model of a robot on a fixed base, whose independent joints are all actuated.
    drives : Drives
        Offsets and coupling of motors, which add efforts to those of the robot.

    Raises
    ------
    InvalidInputError
        The base moves, or no motor drives an independent joint.
    """

    def __init__(self, dynamics: Dynamics, drives: Drives) -> None:
        robot = dynamics.robot
        if robot.moving_base:
            raise InvalidInputError(f"the base of {robot.name!r} moves: efforts of motions need a fixed base")
        if dynamics.unactuated_joint_names:
            names = ", ".join(dynamics.unactuated_joint_names)
            raise InvalidInputError(f"{robot.name!r}: no motor drives {names}: a motion does not determine efforts")
        self.dynamics = dynamics
        self.drives = drives
        rotors: dict[str, tuple[float, ...]] = {
            name: (values[0], 0.0, 0.0) for name, values in drives.coupling_parameters.items()
        }
        self._inertial_drives = replace(
            drives, coupling_parameters=rotors, effort_offsets=np.zeros_like(drives.effort_offsets)
        )
        self._frictionless = Dynamics(_with_joints(robot, _without_dissipation))
        self._dry = Dynamics(_with_joints(robot, lambda joint: replace(joint, load_friction=0.0)))
        self._joints = [robot.joints[robot.joint_numbers[name]] for name in dynamics.joint_names]

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.dynamics.robot

    def close_loops(self, q: Array) -> Array:
        """Positions (N, all joints) of a motion of the independent joints (N, n), which other methods take."""
        return self.dynamics.expand_trajectory(q) if self.robot.loops else q

    def efforts(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Efforts (N, n) [N m or N] of joint motions."""
        return self.dynamics.inverse(q, qd, qdd) + self.drives.drive_efforts(qd, qdd)

    def friction(self, q: Array, qd: Array, qdd: Array) -> Array:
        """The part (N, n) of `efforts` that is lost by friction and dampers [N m or N]."""
        return self.efforts(q, qd, qdd) - self._rigid_efforts(q, qd, qdd) - self.drives.effort_offsets

    def _rigid_efforts(self, q: Array, qd: Array, qdd: Array) -> Array:
        return self._frictionless.inverse(q, qd, qdd) + self._inertial_drives.drive_efforts(qd, qdd)

    def along_path(self, q: Array, first: Array, second: Array, is_turning: BoolArray) -> PathEfforts:
        """Efforts along a path.

        Parameters
        ----------
        q : (N, all joints) positions.
        first, second : (N, n) derivatives by σ.
        is_turning : (N, n) whether the first derivative changes its sign in the neighbourhood of a point.
        """
        zero = np.zeros_like(first)
        c = self._rigid_efforts(q, zero, zero)
        a = self._rigid_efforts(q, zero, first) - c
        b = self._rigid_efforts(q, first, second) - c
        speeds = self._friction_speeds(first)
        frictions = [self._friction_table(q, first, speeds)]
        if is_turning.any():
            frictions.append(self._friction_table(q, np.where(is_turning, -first, first), speeds))
        load_friction = np.array([joint.load_friction for joint in self._joints])
        highest, lowest = np.max(frictions, axis=0), np.min(frictions, axis=0)
        return PathEfforts(a, b, c, speeds, highest, lowest, load_friction, np.sign(first), is_turning)

    def _friction_table(self, q: Array, first: Array, speeds: Array) -> Array:
        """Friction (N, K, n) at speeds (K,) that does not depend on load, and offsets of drives."""
        zero = np.zeros_like(first)
        table = np.empty((len(q), len(speeds), first.shape[1]))
        for column, speed in enumerate(speeds):
            losses = self._dry.inverse(q, speed * first, zero) + self.drives.drive_efforts(speed * first, zero)
            table[:, column] = losses - self._rigid_efforts(q, speed * first, zero)
        return table

    def _friction_speeds(self, first: Array) -> Array:
        """Speeds ṡ (K,) of the table of friction."""
        velocities = [joint.stribeck_velocity for joint in self.robot.joints if joint.stribeck_friction]
        if not velocities:
            return LINEAR_SPEEDS
        fastest = max(float(np.abs(first).max(initial=0.0)), 1e-9)
        return min(velocities) / fastest * STRIBECK_SPEEDS


def _with_joints(robot: Robot, change: Callable[[Joint], Joint]) -> Robot:
    """Return a robot with changed joints."""
    return replace(robot, joints=tuple(map(change, robot.joints)))


def _without_dissipation(joint: Joint) -> Joint:
    """Return a joint without friction and damping."""
    spring = None if joint.spring is None else replace(joint.spring, damping=0.0)
    return replace(joint.without_friction(), spring=spring)
