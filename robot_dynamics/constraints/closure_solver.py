"""Closure solver: positions of all joints from those of the independent ones, with all loops closed.

This module reads positions, solves them in blocks and refuses samples that do not close. The methods are in
`newton_iteration` (Newton's method), `branch_tracker` (continuation along a branch) and `assembly_modes` (seeds and
assembly modes).
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Protocol

import numpy as np

from robot_dynamics.array_checks import require_finite
from robot_dynamics.constraints.assembly_modes import solve_closure
from robot_dynamics.constraints.branch_tracker import BranchTracker
from robot_dynamics.constraints.closure_step import newton_step
from robot_dynamics.constraints.constrained_state import charted_state_at, state_at
from robot_dynamics.constraints.mobility import NEARLY_CLOSED_RESIDUAL, find_widest_loop
from robot_dynamics.constraints.newton_iteration import CLOSURE_TOLERANCE, MIN_QUALITY
from robot_dynamics.constraints.topology import build_topology
from robot_dynamics.errors import SingularModelError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, BoolArray
    from robot_dynamics.constraints.attitude_charts import AttitudeJoints
    from robot_dynamics.constraints.branch_tracker import ClosureResult
    from robot_dynamics.constraints.constrained_state import ConstrainedState
    from robot_dynamics.constraints.topology import ConstraintTopology
    from robot_dynamics.model.robot import Robot

BLOCK_SIZE = 2000
"""Samples whose loops are closed together: as many as fit into a cache."""


class StepProgram(Protocol):
    """A compiled program of the model `closure`, with the results of NewtonStep."""

    def evaluate(self, t: Array, /) -> Sequence[Array]:
        """At one sample t (m,)."""

    def batch(self, t: Array, /) -> Sequence[Array]:
        """At samples t (N, m)."""


class ProgramSource(Protocol):
    """Compiles programs in the background, as CompiledModels does."""

    def get_ready(self, model: str, /) -> StepProgram | None:
        """The program of a model if it is compiled."""

    def record_time(self, seconds: float, model: str, /) -> None:
        """Record the time [s] spent without the program."""


class ClosureSolver:
    """Positions and constrained states of a robot, from positions as users pass them.

    Users pass positions (..., n) of the independent joints, or with loops positions (..., all joints). Those of
    dependent joints are then a seed that chooses the assembly mode, nan where unknown.

    Parameters
    ----------
    robot : Robot
    programs : ProgramSource, optional
        Source of a compiled program for Newton's steps.

    Attributes
    ----------
    robot : Robot
    independent, dependent : list of int
        Numbers of the independent joints, and of the joints that the loops determine.
    """

    def __init__(self, robot: Robot, programs: ProgramSource | None = None) -> None:
        self.robot = robot
        self._topology = build_topology(robot)
        self._tracker = BranchTracker(self._topology, partial(newton_step, self._topology))
        self._programs = programs
        self.independent = self._topology.independent
        self.dependent = self._topology.dependent
        self._names = [joint.name for joint in robot.joints]

    @property
    def topology(self) -> ConstraintTopology:
        """Independent and dependent joints, and constants of the loops."""
        return self._topology

    @property
    def attitudes(self) -> tuple[AttitudeJoints, ...]:
        """Attitude joints of the platforms that have a chart."""
        return self._topology.attitudes

    @property
    def closed_positions(self) -> Array:
        """(all joints,) positions that close the loops, or the initial positions without loops."""
        return self._topology.joint_positions(self._topology.reference_positions)

    def close_loops(self, q: ArrayLike, name_sample: bool = True) -> Array:
        """Positions (..., all joints) of all joints.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)
        name_sample : bool
            Whether error messages name the sample.

        Raises
        ------
        InvalidInputError
            Wrong shapes or values.
        SingularModelError
            The loops do not close, or are singular.
        """
        positions, seed = self._read_positions(q)
        if not self.robot.loops:
            return self._topology.joint_positions(positions)
        batch = positions.shape[:-1]
        samples = positions.reshape(math.prod(batch), positions.shape[-1])
        t = np.empty((len(samples), len(self._topology.non_mimic_joints)))
        for block, result in self._solve_blocks(samples, seed):
            self._refuse_open(result, block.start, many=name_sample and positions.ndim > 1)
            t[block] = result.t
        return self._topology.joint_positions(t).reshape(*batch, len(self._names))

    def try_close_loops(self, q: ArrayLike) -> tuple[Array, BoolArray]:
        """Positions of all joints, and the samples at which the loops close.

        Parameters
        ----------
        q : array_like, shape (..., n) or (..., all joints)

        Returns
        -------
        positions : ndarray, shape (..., all joints)
        is_closed : ndarray of bool, shape (...)
            False where `close_loops` raises SingularModelError.
        """
        positions, seed = self._read_positions(q)
        batch = positions.shape[:-1]
        samples = positions.reshape(-1, positions.shape[-1])
        t = np.empty((len(samples), len(self._topology.non_mimic_joints)))
        is_closed = np.empty(len(samples), dtype=bool)
        for block, result in self._solve_blocks(samples, seed):
            t[block] = result.t
            is_closed[block] = _is_valid(result)
        return self._topology.joint_positions(t).reshape(*batch, len(self._names)), is_closed.reshape(batch)

    def close_trajectory(self, q: ArrayLike) -> Array:
        """Positions (N, all joints) along a trajectory q (N, n) or (N, all joints).

        The first sample is closed as by `close_loops`, each other one by continuation from the sample before it.
        Raises the errors of `close_loops`.
        """
        positions, seed = self._read_positions(q)
        if positions.ndim != 2 or not self.robot.loops:
            return self.close_loops(positions)
        samples = [np.zeros((0, len(self._topology.non_mimic_joints)))]
        with self._ready_tracker() as tracker:
            for number in range(len(positions)):
                if number == 0:
                    result = solve_closure(tracker, positions[:1], None if seed is None else seed[:1])
                else:
                    previous = samples[-2] if number > 1 else None
                    result = tracker.follow_path(samples[-1], positions[number, None], previous_positions=previous)
                self._refuse_open(result, number, many=True)
                samples.append(result.t)
        return self._topology.joint_positions(np.concatenate(samples))

    def continue_branch(self, q: ArrayLike, previous: ArrayLike, velocities: ArrayLike | None = None) -> Array:
        """Positions of all joints on the branch of previous positions.

        Parameters
        ----------
        q : array_like, shape (..., n)
        previous : array_like, shape (..., all joints)
            Positions that close the loops, near those sought.
        velocities : array_like, shape (..., all joints), optional
            Velocities at `previous`, by default along the tangent.

        Returns
        -------
        ndarray, shape (..., all joints)

        Raises
        ------
        InvalidInputError
            Wrong shapes or values.
        SingularModelError
            The loops do not close, are singular, or the branch bends.
        """
        positions = require_finite("positions", q, len(self.independent), self._describe_joints(self.independent))
        all_joints = len(self._names), self._describe_joints(range(len(self._names)))
        start = require_finite("previous", previous, *all_joints)
        rates = start[..., :0] if velocities is None else require_finite("velocities", velocities, *all_joints)
        if not self.robot.loops:
            return self.close_loops(positions)
        batch = np.broadcast_shapes(positions.shape[:-1], start.shape[:-1], rates.shape[:-1])
        samples = [
            np.broadcast_to(array, (*batch, array.shape[-1])).reshape(math.prod(batch), array.shape[-1])
            for array in (positions, start, rates)
        ]
        with self._ready_tracker() as tracker:
            result = tracker.continue_branch(*samples)
            self._refuse_open(result, many=bool(batch))
        return self._topology.joint_positions(result.t).reshape(*batch, len(self._names))

    def state_at(self, q: ArrayLike, name_sample: bool = True, use_charts: bool = True) -> ConstrainedState:
        """The ConstrainedState at positions as `close_loops` takes them; use_charts as for `state_at_closed`."""
        return self.state_at_closed(self.close_loops(q, name_sample), use_charts)

    def state_at_closed(self, q: Array, use_charts: bool = True) -> ConstrainedState:
        """The ConstrainedState at positions (..., all joints) that close the loops.

        use_charts: whether rates of platforms are those of the charts of their attitudes, or of yaw, pitch and roll.
        """
        with np.errstate(all="ignore"):
            return charted_state_at(self._topology, q) if use_charts else state_at(self._topology, q)

    def _read_positions(self, q: ArrayLike) -> tuple[Array, Array | None]:
        """Positions (..., n) of the independent joints, and the seed (..., dependent), None without a seed."""
        joints = self._describe_joints(self.independent)
        if self.robot.loops:
            try:
                all_positions = np.array(q, dtype=float)
            except (TypeError, ValueError):
                all_positions = np.zeros(0)  # refused below
            if all_positions.ndim and all_positions.shape[-1] == len(self._names):
                return self._split_seed(all_positions)
            joints += f", or (..., {len(self._names)}), one for each of all joints ({', '.join(self._names)})"
        return require_finite("positions", q, len(self.independent), joints), None

    def _split_seed(self, q: Array) -> tuple[Array, Array | None]:
        """`_read_positions` of positions of all joints, with nan where those of dependent joints are unknown."""
        seed = q[..., self.dependent]
        is_unknown = np.isnan(seed)
        q[..., self.dependent] = np.where(is_unknown, 0.0, seed)
        q = require_finite("positions", q, len(self._names), self._describe_joints(range(len(self._names))))
        return q[..., self.independent], None if is_unknown.all() else seed

    def _describe_joints(self, numbers: Sequence[int]) -> str:
        return f"joints ({', '.join(self._names[number] for number in numbers)})"

    def _solve_blocks(self, samples: Array, seed: Array | None) -> Iterator[tuple[slice, ClosureResult]]:
        """Solve samples (N, n) block by block, with a seed (..., dependent) or None."""
        seeds = None if seed is None else seed.reshape(len(samples), seed.shape[-1])
        for first in range(0, len(samples), BLOCK_SIZE):
            block = slice(first, first + BLOCK_SIZE)
            with self._ready_tracker() as tracker:  # ends before the yield: the caller keeps its NumPy error state
                result = solve_closure(tracker, samples[block], None if seeds is None else seeds[block])
            yield block, result

    @contextmanager
    def _ready_tracker(self) -> Iterator[BranchTracker]:
        """A BranchTracker with the compiled program if it is ready. Else the time spent is recorded."""
        program = None if self._programs is None else self._programs.get_ready("closure")
        started = time.perf_counter()
        with np.errstate(all="ignore"):  # samples that do not close are refused
            if program is None:
                yield self._tracker
            else:
                yield BranchTracker(self._topology, partial(_evaluate_program, program))
        if program is None and self._programs is not None:
            self._programs.record_time(time.perf_counter() - started, "closure")

    def _refuse_open(self, result: ClosureResult, first: int = 0, many: bool = False) -> None:
        """Raise SingularModelError for the first sample whose loops are open or singular.

        first: number of the first sample in messages; many: whether they name the sample.
        """
        is_valid = _is_valid(result)
        if is_valid.all():
            return
        sample = int(np.argmin(is_valid))
        residual = float(np.abs(result.residual[sample]).max())
        location = f" at sample {first + sample}" if many else ""
        with np.errstate(all="ignore"):
            condition = f"(condition number {self._topology.condition_number(result.t[sample]):.3g})"
            name, distance, angle = find_widest_loop(self.robot, result.residual[sample])
        if not residual <= CLOSURE_TOLERANCE:
            hint = ". These positions are out of reach, or need a seed of all joints nearer to where it closes"
            if residual < NEARLY_CLOSED_RESIDUAL:
                hint = "; if it is meant to close there, its axes or lengths are not exact"
            raise SingularModelError(
                f"loop {name!r} does not close{location}: its ends stay {distance:.3g} m and {angle:.3g} rad apart "
                f"{condition}{hint}"
            )
        if not result.quality[sample] > MIN_QUALITY:
            dependent = ", ".join(self._names[number] for number in self.dependent)
            raise SingularModelError(
                f"loop {name!r} is singular{location}: it closes (residual {residual:.2g}), but does not determine "
                f"{dependent} {condition}"
            )
        raise SingularModelError(
            f"the loops close{location} in another assembly mode than at the initial positions {condition}: a singular "
            "position lies between, or nearly. Give the positions of all joints, near the intended ones"
        )


def _is_valid(result: ClosureResult) -> BoolArray:
    """(N,) whether the loops are closed, regular, and in the assembly mode that was sought."""
    return result.is_closed & (result.quality > MIN_QUALITY) & ~result.has_crossed_singularity


def _evaluate_program(program: StepProgram, t: Array) -> Sequence[Array]:
    """Results of the program at one sample (m,) or many (N, m)."""
    return program.evaluate(t) if t.ndim == 1 else program.batch(t)
