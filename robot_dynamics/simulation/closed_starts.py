"""Positions at which many simulations of a robot with loops start, closed by machine code in one call."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
from robot_dynamics.codegen.jit.procedure_code import compile_procedure
from robot_dynamics.codegen.procedure.kernels import Kernel
from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface
from robot_dynamics.codegen.trace.fingerprint import fingerprint
from robot_dynamics.constraints.sample_closure import SampleClosure
from robot_dynamics.errors import CompilationError
from robot_dynamics.procedures import procedure, select

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.simulation.constrained_motion import ConstrainedMotion

CLOSING_ITERATIONS = 10
"""About how often loops are evaluated to close them: batches are divided among threads by it."""


class ClosedStarts(NamedTuple):
    """Positions of N simulations.

    Attributes
    ----------
    is_closed : ndarray of bool, shape (N,)
        Whether the machine code closed the loops. It leaves singular positions and those out of reach.
    positions : ndarray, shape (N, all joints)
    quality : ndarray, shape (N,)
        Quality of the coordinates of Dynamics.joint_names.
    """

    is_closed: BoolArray
    positions: Array
    quality: Array


class StartClosure:
    """Closes loops from positions of the joints of Dynamics.joint_names, as Dynamics.expand_positions does.

    Parameters
    ----------
    dynamics : Dynamics
    loops : ConstrainedMotion

    Raises
    ------
    CompilationError
        The model `closure` runs as Python.
    """

    def __init__(self, dynamics: Dynamics, loops: ConstrainedMotion) -> None:
        independent = loops.default_independent
        model = dynamics.compile("closure", independent=independent)
        if not isinstance(model, CompiledProgram):
            raise CompilationError("the model closure runs as Python")
        topology = loops.topology_of(independent)
        kernel = Kernel("closure", model)
        self._closure = SampleClosure(topology, kernel)
        outputs = {"positions": (len(topology.S),), "quality": (1,), "status": (1,)}
        interface = ProcedureInterface({"q": len(independent)}, outputs)
        key = fingerprint(dynamics.robot, "closed start")
        self._program = compile_procedure("close", self.close_sample, interface, [kernel], key, CLOSING_ITERATIONS)

    def close(self, q: Array, threads: int) -> ClosedStarts:
        """Close the loops at positions q (N, n)."""
        positions, quality, status = self._program.batch(q, threads=threads)
        return ClosedStarts(status[:, 0] == 0, positions, quality[:, 0])

    @procedure
    def close_sample(self, q: Any) -> Any:
        """Positions (all joints,), quality (1,) and status (1,), zero where the loops close, at positions q (n,)."""
        closed = self._closure.close_from_reference(q)
        t, quality, is_closed = self._closure.project(self._closure.joint_positions(closed.t))
        status = closed.status + select(is_closed, 0.0, 1.0)
        return self._closure.joint_positions(t), np.array([quality]), np.array([status])


_closures: WeakKeyDictionary[ConstrainedMotion, StartClosure] = WeakKeyDictionary()
"""The StartClosure of each simulation that has used one."""


def get_start_closure(dynamics: Dynamics, loops: ConstrainedMotion) -> StartClosure:
    """The StartClosure of a simulation, compiled when it is used first. Raises CompilationError."""
    closure = _closures.get(loops)
    if closure is None:
        closure = _closures[loops] = StartClosure(dynamics, loops)
    return closure
