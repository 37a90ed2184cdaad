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
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.array_checks import require_finite
from robot_dynamics.constraints.assembly_modes import solve_closure
from robot_dynamics.constraints.branch_tracker import BranchTracker
from robot_dynamics.constraints.closure_errors import is_valid, refuse_open
from robot_dynamics.constraints.closure_procedures import ClosureProcedures
from robot_dynamics.constraints.closure_step import newton_step
from robot_dynamics.constraints.constrained_state import charted_state_at, state_at
from robot_dynamics.constraints.reach import Reach
from robot_dynamics.constraints.topology import build_topology

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, BoolArray, IntArray
    from robot_dynamics.constraints.attitude_charts import AttitudeJoints
    from robot_dynamics.constraints.branch_tracker import ClosureResult
    from robot_dynamics.constraints.closure_procedures import ProgramSource, StepProgram
    from robot_dynamics.constraints.constrained_state import ConstrainedState
    from robot_dynamics.constraints.topology import ConstraintTopology
    from robot_dynamics.model.robot import Robot

BLOCK_SIZE = 2000
"""Samples whose loops are closed together: as many as fit into a cache."""


class ClosureSolver:
    """Positions and constrained states of a robot, from positions as users pass them.

    Users pass positions (..., n) of the independent joints, or with loops positions (..., all joints). Those of
    dependent joints are then a seed that chooses the assembly mode, nan where unknown.

    Parameters
    ----------
    robot : Robot
    programs : ProgramSource, optional
        Source of compiled programs for Newton's steps and of compiled procedures.

    Attributes
    ----------
    robot : Robot
    independent, dependent : list of int
        Numbers of the independent joints, and of the joints that the loops determine.
    procedures : ClosureProcedures
        Closure at one sample in machine code.
    """

    def __init__(self, robot: Robot, programs: ProgramSource | None = None) -> None:
        self.robot = robot
        self._topology = build_topology(robot)
        self._tracker = BranchTracker(self._topology, partial(newton_step, self._topology))
        self._programs = programs
        self._reach = Reach(self._topology)
        self.independent = self._topology.independent
        self.dependent = self._topology.dependent
        self._names = [joint.name for joint in robot.joints]
        self.procedures = ClosureProcedures(self._topology, programs)
        self._independent_description = self._describe_joints(self.independent)  # for errors; made once
        self._description = self._describe_joints(range(len(self._names)))

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
        closed = self.procedures.attempt("close_near", q)
        if closed is None:
            closed = self.procedures.attempt("close_from_reference", q)
        if closed is not None:
            return closed
        positions, seed = self._read_positions(q)
        if not self.robot.loops:
            return self._topology.joint_positions(positions)
        batch = positions.shape[:-1]
        samples = positions.reshape(math.prod(batch), positions.shape[-1])
        many = name_sample and positions.ndim > 1
        joint_positions = np.empty((len(samples), len(self._names)))
        for numbers, block_positions, result in self._solve_blocks(samples, seed):
            if block_positions is None:
                self._reach.refuse_far(samples[numbers], numbers, many)
                continue
            if result is not None:
                refuse_open(self._topology, result, numbers, many)
            joint_positions[numbers] = block_positions
        return joint_positions.reshape(*batch, len(self._names))

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
        joint_positions = np.tile(self.closed_positions, (len(samples), 1))
        is_closed = np.ones(len(samples), dtype=bool)
        for numbers, block_positions, result in self._solve_blocks(samples, seed):
            if block_positions is None:
                is_closed[numbers] = False
                continue
            joint_positions[numbers] = block_positions
            if result is not None:
                is_closed[numbers] = is_valid(result)
        return joint_positions.reshape(*batch, len(self._names)), is_closed.reshape(batch)

    def close_trajectory(self, q: ArrayLike) -> Array:
        """Positions (N, all joints) along a trajectory q (N, n) or (N, all joints).

        The first sample is closed as by `close_loops`, each other one by continuation from the sample before it.
        Raises the errors of `close_loops`.
        """
        positions, seed = self._read_positions(q)
        if positions.ndim != 2 or not self.robot.loops:
            return self.close_loops(positions)
        joint_positions = np.empty((len(positions), len(self._names)))
        methods = (None, "continue_along_tangent", "continue_sequence")
        for number, sample in enumerate(np.ascontiguousarray(positions)):
            last = joint_positions[max(0, number - 2) : number]
            method = methods[len(last)]
            closed = None if method is None else self.procedures.attempt(method, sample, *last[::-1])
            if closed is None:
                closed = self._follow(last, sample, number, None if seed is None else seed[:1])
            joint_positions[number] = closed
        return joint_positions

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
        closed = (
            self.procedures.attempt("continue_along_tangent", q, previous)
            if velocities is None
            else self.procedures.attempt("continue_with_velocities", q, previous, velocities)
        )
        if closed is not None:
            return closed
        positions = require_finite("positions", q, len(self.independent), self._independent_description)
        all_joints = len(self._names), self._description
        start = require_finite("previous", previous, *all_joints)
        rates = start[..., :0] if velocities is None else require_finite("velocities", velocities, *all_joints)
        if not self.robot.loops:
            return self.close_loops(positions)
        batch = np.broadcast_shapes(positions.shape[:-1], start.shape[:-1], rates.shape[:-1])
        samples = [
            np.broadcast_to(array, (*batch, array.shape[-1])).reshape(math.prod(batch), array.shape[-1])
            for array in (positions, start, rates)
        ]
        self._reach.refuse_far(samples[0], range(len(samples[0])), many=bool(batch))
        with self._ready_tracker() as tracker:
            result = tracker.continue_branch(*samples)
            refuse_open(self._topology, result, range(len(samples[0])), many=bool(batch))
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
        joints = self._independent_description
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
        q = require_finite("positions", q, len(self._names), self._description)
        return q[..., self.independent], None if is_unknown.all() else seed

    def _describe_joints(self, numbers: Sequence[int]) -> str:
        return f"joints ({', '.join(self._names[number] for number in numbers)})"

    def _solve_blocks(
        self, samples: Array, seed: Array | None
    ) -> Iterator[tuple[IntArray, Array | None, ClosureResult | None]]:
        """Solve samples (N, n) block by block, with a seed (..., dependent) or None.

        Yields numbers (k,) of samples and their positions (k, all joints), with a ClosureResult for those which the
        procedures leave open. Samples far out of reach have no positions.
        """
        seeds = None if seed is None else seed.reshape(len(samples), seed.shape[-1])
        for first in range(0, len(samples), BLOCK_SIZE):
            numbers = np.arange(first, min(first + BLOCK_SIZE, len(samples)))
            closed = self.procedures.close_batch(samples[numbers], None if seeds is None else seeds[numbers])
            if closed is not None:
                positions, is_closed = closed
                yield numbers[is_closed], positions[is_closed], None
                numbers = numbers[~is_closed]
            is_far = self._reach.is_far(samples[numbers])
            if is_far.any():
                yield numbers[is_far], None, None
                numbers = numbers[~is_far]
            if not len(numbers):
                continue
            with self._ready_tracker() as tracker:  # ends before the yield: the caller keeps its NumPy error state
                result = solve_closure(tracker, samples[numbers], None if seeds is None else seeds[numbers])
            yield numbers, self._topology.joint_positions(result.t), result

    def _follow(self, last: Array, sample: Array, number: int, seed: Array | None) -> Array:
        """Positions (all joints,) of a sample (n,) of a trajectory, from the last ones (0 to 2, all joints).

        seed: (1, dependent) of the first sample, or None.
        """
        before = last[:, self._topology.non_mimic_joints]
        self._reach.refuse_far(sample[None], [number], many=True)
        with self._ready_tracker() as tracker:
            if number == 0:
                result = solve_closure(tracker, sample[None], seed)
            else:
                previous = before[:1] if len(before) == 2 else None
                result = tracker.follow_path(before[-1:], sample[None], previous_positions=previous)
        refuse_open(self._topology, result, [number], many=True)
        positions: Array = self._topology.joint_positions(result.t)[0]
        return positions

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


def _evaluate_program(program: StepProgram, t: Array) -> Sequence[Array]:
    """Results of the program at one sample (m,) or many (N, m)."""
    return program.evaluate(t) if t.ndim == 1 else program.batch(t)
