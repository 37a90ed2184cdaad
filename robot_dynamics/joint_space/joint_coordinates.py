"""Coordinates of a robot: independent joints, and conversions between these and all joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.array_checks import broadcast_result, require_finite
from robot_dynamics.constraints.attitude_charts import joint_velocities
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.inputs import UNACTUATED_REASON

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.constraints.closure_solver import ClosureSolver
    from robot_dynamics.constraints.constrained_state import ConstrainedState
    from robot_dynamics.constraints.topology import ConstraintTopology
    from robot_dynamics.model.robot import Robot


class JointCoordinates:
    """Independent and dependent joints of a robot, and conversions between them; base class of `Dynamics`."""

    def __init__(self, robot: Robot, closure_solver: ClosureSolver) -> None:
        self.robot = robot
        self._closure_solver = closure_solver
        # by model, functions that compute it for one sample and check everything; filled once they are compiled
        self._attempts: Mapping[str, tuple[Callable[..., Array | None], ...]] = {}
        self.all_joint_names: tuple[str, ...] = tuple(joint.name for joint in robot.joints)
        independent = self._closure_solver.independent
        self.joint_names: tuple[str, ...] = tuple(self.all_joint_names[number] for number in independent)
        self.dependent_joint_names: tuple[str, ...] = tuple(
            self.all_joint_names[number] for number in self._closure_solver.dependent
        )
        # columns of the unactuated joints in vectors (..., n)
        self._unactuated = [column for column, number in enumerate(independent) if not robot.joints[number].actuated]
        self.unactuated_joint_names: tuple[str, ...] = tuple(self.joint_names[column] for column in self._unactuated)

    @property
    def initial_joint_positions(self) -> Array:
        """(all joints,) positions that close the loops, from the initial positions of the description [rad or m]."""
        return self._closure_solver.closed_positions

    def expand_positions(
        self, q: ArrayLike, *, previous: ArrayLike | None = None, velocities: ArrayLike | None = None
    ) -> Array:
        """Return positions of all joints from those of the independent joints, with loops closed.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m]. Of all joints only without `previous`; positions of dependent joints are then a seed.
        previous : array_like, shape (..., all joints), optional
            Positions that close the loops, from which the motion leads to `q`.
        velocities : array_like, shape (..., all joints), optional
            Velocities at `previous` [rad/s or m/s], which select the branch. Default: its tangent.

        Returns
        -------
        ndarray, shape (..., all joints)

        Raises
        ------
        InvalidInputError
            An argument does not fit the robot.
        SingularModelError
            The loops do not close, are singular, or close only in another assembly mode.

        Notes
        -----
        With a seed, the loops close at the positions nearest to it. The positions of the previous sample of a motion
        can fail as a seed: where two assembly modes meet, as in a flat parallelogram, the nearest positions may belong
        to the other mode. Give them as `previous` instead, with the velocities of that sample, or use
        `expand_trajectory` for a whole trajectory.
        """
        if previous is None:
            if velocities is not None:
                raise InvalidInputError("velocities are those at previous positions: give previous too")
            return self._closure_solver.close_loops(q)
        return self._closure_solver.continue_branch(q, previous, velocities)

    def expand_trajectory(self, q: ArrayLike) -> Array:
        """Return positions of all joints along a trajectory, in one assembly mode.

        The loops of each sample are closed from the sample before it.

        Parameters
        ----------
        q : array_like, shape (N, n) or (N, all joints)
            Positions [rad or m]. Of all joints: the first sample is the seed.

        Returns
        -------
        ndarray, shape (N, all joints)
            Positions that the other methods take as `q`.

        Raises
        ------
        InvalidInputError, SingularModelError
            As `expand_positions`.
        """
        return self._closure_solver.close_trajectory(q)

    def expand_velocities(self, qd: ArrayLike, q: ArrayLike | None = None) -> Array:
        """Return velocities of all joints from those of the independent joints.

        Parameters
        ----------
        qd : array_like, shape (..., n)
            Velocities [rad/s or m/s].
        q : array_like, shape (..., n) or (..., all joints), optional
            Positions [rad or m]; required where the robot has loops.

        Returns
        -------
        ndarray, shape (..., all joints)
            Velocities. Those of yaw and roll of a platform are nan where they do not exist: at pitch ±90°.

        Raises
        ------
        InvalidInputError, SingularModelError
            As `expand_positions`.
        """
        qd = self._check_joints("velocities", qd)
        if qd.ndim == 1 and q is not None and self.robot.loops:
            closed = self._closure_solver.close_loops(q)
            velocities = self._compiled_velocities(closed, qd) if closed.ndim == 1 else None
            if velocities is not None:
                return velocities
            state = self._closure_solver.state_at_closed(closed)
        else:
            state = self._constrained_state_or_any(q)
        with np.errstate(all="ignore"):
            rates = state.expand_rates(qd)
        return state.joint_velocities(broadcast_result(rates, rates.shape[:-1]))

    def expand_accelerations(self, qdd: ArrayLike, q: ArrayLike | None = None, qd: ArrayLike | None = None) -> Array:
        """Return accelerations of all joints from those of the independent joints.

        Parameters
        ----------
        qdd : array_like, shape (..., n)
            Accelerations [rad/s² or m/s²].
        q : array_like, shape (..., n) or (..., all joints), optional
            Positions [rad or m]; required where the robot has loops.
        qd : array_like, shape (..., n), optional
            Velocities [rad/s or m/s]; required where the robot has loops.

        Returns
        -------
        ndarray, shape (..., all joints)

        Raises
        ------
        InvalidInputError, SingularModelError
            As `expand_positions`.
        """
        state = self._constrained_state_or_any(q)
        qdd = self._check_joints("accelerations", qdd)
        if not self.robot.loops:
            return broadcast_result(state.expand_rates(qdd), qdd.shape[:-1])
        if qd is None:
            raise InvalidInputError("accelerations of joints in loops depend on velocities: give qd")
        with np.errstate(all="ignore"):
            rates = state.expand_rates(self._check_joints("velocities", qd))
            rate_derivatives = state.expand_rates(qdd) + state.drift(rates)
        return state.joint_accelerations(rates, broadcast_result(rate_derivatives, rate_derivatives.shape[:-1]))

    def project_efforts(self, efforts: ArrayLike, q: ArrayLike | None = None) -> Array:
        """Project efforts at all joints onto the independent joints: G^T τ.

        Parameters
        ----------
        efforts : array_like, shape (..., all joints)
            Efforts [N m or N].
        q : array_like, shape (..., n) or (..., all joints), optional
            Positions [rad or m]; required where the robot has loops.

        Returns
        -------
        ndarray, shape (..., n)
            Efforts at the independent joints of the same power.

        Raises
        ------
        InvalidInputError, SingularModelError
            As `expand_positions`.
        """
        efforts = require_finite("efforts", efforts, len(self.all_joint_names), _list_joints(self.all_joint_names))
        state = self._constrained_state_or_any(q)
        return state.projected(state.chart_forces(efforts))

    def embed_efforts(self, efforts: ArrayLike) -> Array:
        """Return efforts at all joints: those of the independent joints, zero at the others.

        Parameters
        ----------
        efforts : array_like, shape (..., n)
            Efforts at the independent joints [N m or N].

        Returns
        -------
        ndarray, shape (..., all joints)

        Raises
        ------
        InvalidInputError
            The efforts do not fit the robot.
        """
        efforts = self._check_joints("efforts", efforts)
        embedded = np.zeros((*efforts.shape[:-1], len(self.all_joint_names)))
        embedded[..., self._closure_solver.independent] = efforts
        return embedded

    def constrained_state(self, q: ArrayLike) -> ConstrainedState:
        """Return the ConstrainedState at positions `q`: how all joints move together there.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
            Positions [rad or m].

        Returns
        -------
        ConstrainedState

        Raises
        ------
        InvalidInputError, SingularModelError
            As `expand_positions`.
        """
        return self._closure_solver.state_at(q)

    def _check_positions(self, q: ArrayLike) -> Array:
        """Return checked positions (..., n), or (..., all joints) where the robot has loops."""
        return self._closure_solver.close_loops(q) if self.robot.loops else self._check_joints("positions", q)

    def _compiled_velocities(self, q: Array, qd: Array) -> Array | None:
        """Velocities (all joints,) at closed positions q (all joints,), of those qd (n,) of the independent joints.

        None where the program of the rates is not ready, or rates are not finite.
        """
        solver = self._closure_solver
        trace = partial(_trace_joint_rates, solver.topology)
        results = solver.procedures.evaluate_program("joint_rates", trace, q, np.ascontiguousarray(qd))
        if results is None:
            return None
        velocities: Array = joint_velocities(q, results[0], solver.attitudes, solver.topology.offset)
        return velocities

    def _constrained_state_or_any(self, q: ArrayLike | None) -> ConstrainedState:
        """Return the constrained state at q; at zero if q is None and the robot has no loops."""
        if q is None and self.robot.loops:
            raise InvalidInputError(f"{self.robot.name!r} has loops: this depends on positions, give q")
        return self._closure_solver.state_at(np.zeros(len(self.joint_names)) if q is None else q)

    def _check_joints(self, label: str, values: ArrayLike, ignored_columns: Mapping[int, str] | None = None) -> Array:
        """Return checked values (..., n) of the independent joints."""
        return require_finite(label, values, len(self.joint_names), _list_joints(self.joint_names), ignored_columns)

    def _check_actuated(self, label: str, values: ArrayLike) -> Array:
        """Return checked accelerations or efforts (..., n), which unactuated joints do not take."""
        reasons = {column: f"joint {self.joint_names[column]!r}: {UNACTUATED_REASON}" for column in self._unactuated}
        return self._check_joints(label, values, reasons)


def _list_joints(names: tuple[str, ...]) -> str:
    return f"joints ({', '.join(names)})"


def _trace_joint_rates(topology: ConstraintTopology) -> Program:
    """Trace the program of the rates; it comes from the cache in most processes."""
    from robot_dynamics.codegen.trace.joint_rates import joint_rates_program

    return joint_rates_program(topology)
