"""Momentum of a robot and its known rate at measured states, of motors or of joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.control.program_positions import ProgramPositions
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.recordings.drives import direct_drives

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.recordings.drives import Drives


class MomentumBalance:
    """Generalized momentum and its rate without external efforts, by the compiled program `momentum`.

    Write the state into the attributes, then call `evaluate`.

    Parameters
    ----------
    dynamics : Dynamics
        The program is compiled now.
    drives : Drives, optional
        Conversion from measured signals to the joints. Default: the joints are measured themselves.

    Attributes
    ----------
    position, velocity, effort : ndarray, shape (n,)
        Measured signals, in the order of `Drives.names`. Efforts of unactuated joints are not read.
    dependent_positions : ndarray
        Measured positions of `Dynamics.dependent_joint_names`; nan where they are unknown.
    twist, gravity : ndarray, shape (6,) and (3,)
        Twist of a moving base and gravity [m/s²], both in the base frame.
    joint_velocities : ndarray, shape (n,)
        Velocities of the joints at the last call.
    program_positions : ndarray
        Positions at the last call as the programs of `Dynamics.compile` take them.

    Raises
    ------
    InvalidInputError
        The robot has no joints, or no masses.
    """

    def __init__(self, dynamics: Dynamics, drives: Drives | None = None) -> None:
        robot = dynamics.robot
        if robot.is_massless:
            raise InvalidInputError(
                f"{robot.name!r} has no masses: external torques are what its model does not explain. Identify it, or "
                "use a description with inertias"
            )
        n = len(dynamics.joint_names)
        self.dynamics = dynamics
        self.position = np.zeros(n)
        self.velocity = np.zeros(n)
        self.effort = np.zeros(n)
        self.dependent_positions = np.full(len(dynamics.dependent_joint_names), np.nan)
        self.twist = np.zeros(6)
        self.gravity = np.array(robot.gravity, dtype=float)
        self.joint_velocities = np.zeros(n)
        self.program_positions = np.zeros(n)
        self._drives = drives or direct_drives(dynamics.joint_names)
        self._is_direct = drives is None
        self._program = dynamics.compile("momentum")
        self._positions = ProgramPositions(dynamics)
        self._gravity_model = dynamics.compile("gravity") if self._drives.excludes_gravity else None
        self._base = [self.twist, self.gravity] if robot.moving_base else []
        self._base_rows = 6 if robot.moving_base else 0
        actuated = set(dynamics.joint_names) - set(dynamics.unactuated_joint_names)
        self._is_actuated = np.array([name in actuated for name in dynamics.joint_names], dtype=bool)
        self.size = n + self._base_rows
        # linear in the rates: rotors of motors that turn with several joints add to the momentum
        self._has_coupling = bool(self._drives.coupling_parameters)

    def evaluate(self) -> tuple[Array, Array]:
        """Momentum and rate (m,) at the state in the attributes, new arrays. The rows of a moving base come first.

        Raises
        ------
        InvalidInputError
            A value of the state is not finite; the message names the joint.
        SingularModelError
            The loops do not close.
        """
        q, qd, efforts = self._joint_signals()
        self.joint_velocities = qd
        self.program_positions = positions = self._positions.at_state(q, self.dependent_positions)
        drives = self._drives
        if self._gravity_model is not None:
            gravity = self._base[1:]
            efforts = efforts + self._gravity_model.evaluate(positions, *gravity)[self._base_rows :]
        if not self._is_direct:
            efforts = efforts - drives.drive_efforts(qd, np.zeros_like(qd))
        momentum, rate = self._program.evaluate(positions, qd, efforts, *self._base)
        if self._has_coupling:
            at_rest = np.zeros_like(qd)
            momentum[self._base_rows :] += drives.drive_efforts(at_rest, qd) - drives.drive_efforts(at_rest, at_rest)
        if not (np.isfinite(momentum).all() and np.isfinite(rate).all()):
            raise InvalidInputError(f"{self.dynamics.robot.name!r}: the momentum is not finite in this state")
        return momentum, rate

    def _joint_signals(self) -> tuple[Array, Array, Array]:
        """Positions, velocities and efforts (n,) of the joints; raises InvalidInputError where they are not finite."""
        effort = np.where(self._is_actuated, self.effort, 0.0)
        names = self._drives.names
        for what, values in (("position", self.position), ("velocity", self.velocity), ("effort", effort)):
            is_finite = np.isfinite(values)
            if not is_finite.all():
                column = int(np.argmin(is_finite))
                raise InvalidInputError(f"{what} of {names[column]!r} is {values[column]}: a finite number is needed")
        if self._is_direct:
            return self.position.copy(), self.velocity.copy(), effort
        q, qd, efforts = self._drives.to_joint_space(self.position[None], self.velocity[None], effort[None])
        return np.ascontiguousarray(q[0]), np.ascontiguousarray(qd[0]), np.ascontiguousarray(efforts[0])
