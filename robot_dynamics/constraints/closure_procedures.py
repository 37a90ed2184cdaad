"""The programs of a ClosureSolver: Newton's step, and procedures that close the loops at one sample.

Programs are compiled in the background by their source. Until they are ready, and for samples that they leave open,
the ClosureSolver takes the functions for many samples.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias

import numpy as np

from robot_dynamics.procedures import procedure

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.constraints.sample_continuation import SampleContinuation
    from robot_dynamics.constraints.topology import ConstraintTopology

StepFunction: TypeAlias = Callable[[Any], Sequence[Any]]
"""Evaluates the NewtonStep at positions t (m,), of numbers or symbols."""


class SampleProcedure(NamedTuple):
    """A procedure for one sample.

    Attributes
    ----------
    function : callable
        Returns its result and a status (1,), which is not zero where the result is not valid.
    inputs : mapping of str to int
        Names and sizes of its arguments.
    output : str
        Name of the result.
    shape : tuple of int
        Shape of the result.
    """

    function: Callable[..., Any]
    inputs: Mapping[str, int]
    output: str
    shape: tuple[int, ...]


class StepProgram(Protocol):
    """A compiled program of the model `closure`, with the results of NewtonStep."""

    def evaluate(self, t: Array, /) -> Sequence[Array]:
        """At one sample t (m,)."""

    def batch(self, t: Array, /) -> Sequence[Array]:
        """At samples t (N, m)."""


class ProcedureProgram(Protocol):
    """A compiled SampleProcedure."""

    attempt: Callable[..., Array | None] | None
    """The result for arrays (size,), None where they do not fit or the status is not zero."""

    def batch(self, *arrays: Array) -> Any:
        """Results (N, size) and status (N, 1) for arrays (N, size)."""


class StraightLineProgram(Protocol):
    """A compiled straight-line program."""

    def evaluate(self, *arrays: Array) -> Any:
        """Its results for one sample."""


class ProgramSource(Protocol):
    """Compiles programs in the background, as ClosurePrograms does."""

    def get_ready(self, model: str, /) -> StepProgram | None:
        """The program of a model if it is compiled."""

    def record_time(self, seconds: float, model: str, /) -> None:
        """Record the time [s] spent without the program."""

    def get_ready_procedure(
        self, name: str, make_procedure: Callable[[StepFunction], SampleProcedure], /
    ) -> ProcedureProgram | None:
        """A procedure if it is compiled; else it is compiled in the background once Newton's step is."""

    def compile_procedure(self, name: str, make_procedure: Callable[[StepFunction], SampleProcedure], /) -> None:
        """Compile a procedure now if Newton's step is compiled."""

    def get_ready_program(self, name: str, trace: Callable[[], Any], /) -> StraightLineProgram | None:
        """A straight-line program if it is compiled, else as `get_ready_procedure`."""


CLOSURE_PROCEDURES = {
    "close_near": ("all",),
    "close_from_reference": ("independent",),
    "continue_along_tangent": ("independent", "all"),
    "continue_with_velocities": ("independent", "all", "all"),
    "continue_sequence": ("independent", "all", "all"),
}
"""Methods of SampleContinuation, with the joints of which their arguments are the positions or velocities."""


class ClosureProcedures:
    """The compiled procedures of a ClosureSolver.

    Parameters
    ----------
    topology : ConstraintTopology
    programs : ProgramSource or None
        None: nothing is compiled.
    """

    def __init__(self, topology: ConstraintTopology, programs: ProgramSource | None) -> None:
        self._topology = topology
        self._programs = programs if topology.robot.loops else None
        self._makers = {name: partial(closure_procedure, topology, name) for name in CLOSURE_PROCEDURES}

    def attempt(self, name: str, *arguments: Any) -> Array | None:
        """Positions (all joints,) by an entry of CLOSURE_PROCEDURES.

        None where it is not ready, where arguments, which nothing checked, do not fit, or where the status is not zero.
        """
        return self.attempt_other(name, self._makers[name], *arguments)

    def compile(self, *names: str) -> None:
        """Compile entries of CLOSURE_PROCEDURES now, if Newton's step is compiled: no later call waits for them."""
        if self._programs is not None:
            for name in names:
                self._programs.compile_procedure(name, self._makers[name])

    def attempt_other(
        self, name: str, make_procedure: Callable[[StepFunction], SampleProcedure], *arguments: Any
    ) -> Array | None:
        """`attempt` for another SampleProcedure; `name` stands for all but the robot that it depends on."""
        if self._programs is None:
            return None
        program = self._programs.get_ready_procedure(name, make_procedure)
        return None if program is None or program.attempt is None else program.attempt(*arguments)

    def evaluate_program(self, name: str, trace: Callable[[], Any], *arguments: Array) -> tuple[Array, ...] | None:
        """Results of a straight-line program for checked arguments; None where it is not ready or they are not finite.

        name: stands for all but the robot that the program depends on; trace: returns the program.
        """
        program = None if self._programs is None else self._programs.get_ready_program(name, trace)
        if program is None:
            return None
        results = program.evaluate(*arguments)
        results = results if isinstance(results, tuple) else (results,)
        return results if all(np.isfinite(result).all() for result in results) else None

    def close_batch(self, samples: Array, seeds: Array | None) -> tuple[Array, BoolArray] | None:
        """Positions (N, all joints) for samples (N, n) and seeds (N, dependent), and where the status is zero (N,).

        None where nothing is compiled.
        """
        if self._programs is None:
            return None
        name = "close_from_reference" if seeds is None else "close_near"
        program = self._programs.get_ready_procedure(name, self._makers[name])
        if program is None:
            return None
        if seeds is not None:
            joint_positions = np.empty((len(samples), len(self._topology.robot.joints)))
            joint_positions[:, self._topology.independent] = samples
            joint_positions[:, self._topology.dependent] = seeds
            samples = joint_positions
        positions, status = program.batch(samples)
        return positions, status[:, 0] == 0


def closure_procedure(topology: ConstraintTopology, name: str, newton_step: StepFunction) -> SampleProcedure:
    """The SampleProcedure of an entry of CLOSURE_PROCEDURES; its result are positions (all joints,)."""
    from robot_dynamics.constraints.sample_continuation import SampleContinuation  # programs come from the cache

    sizes = {"all": len(topology.robot.joints), "independent": len(topology.independent)}
    closure = SampleContinuation(topology, newton_step)
    inputs = {f"argument_{number}": sizes[joints] for number, joints in enumerate(CLOSURE_PROCEDURES[name])}
    function = partial(_close, closure, getattr(closure, name))
    return SampleProcedure(function, inputs, "positions", (sizes["all"],))


@procedure
def _close(closure: SampleContinuation, method: Callable[..., Any], *arguments: Any) -> Any:
    """Positions (all joints,) of a method of SampleContinuation, and the status (1,)."""
    closed = method(*arguments)
    return closure.joint_positions(closed.t), np.array([closed.status])
