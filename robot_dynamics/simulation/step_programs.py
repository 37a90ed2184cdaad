"""Programs that take many steps of a simulation in one call, compiled when a simulation first uses them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
from robot_dynamics.codegen.trace.fingerprint import fingerprint
from robot_dynamics.constraints.sample_closure import SampleClosure
from robot_dynamics.errors import CompilationError
from robot_dynamics.simulation.compiled_loop_steps import CompiledLoopSteps
from robot_dynamics.simulation.compiled_steps import CompiledSteps

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.constrained_motion import LoopCoordinates
    from robot_dynamics.simulation.friction_impulses import ImpulsiveFriction
    from robot_dynamics.simulation.plant import Plant

logger = logging.getLogger(__name__)

MAX_STEPS_PER_CALL = 10_000
"""Steps in one call of machine code, some 10 ms: between calls a process reacts to signals."""


class Run(NamedTuple):
    """The end of some steps.

    Attributes
    ----------
    steps : int
        Number of steps that were taken.
    q : ndarray
        Positions as the programs of the plant take them.
    rates : ndarray, shape (n,)
        Velocities of the independent joints.
    coordinates : LoopCoordinates or None
        The coordinates of the rates; None without loops.
    """

    steps: int
    q: Array
    rates: Array
    coordinates: LoopCoordinates | None


class StepPrograms:
    """The programs of a robot on a fixed base, one for each set of independent coordinates of its loops.

    Parameters
    ----------
    plant : Plant
    friction : ImpulsiveFriction
    step : float
        Length of a step [s].
    """

    def __init__(self, plant: Plant, friction: ImpulsiveFriction, step: float) -> None:
        self._plant = plant
        self._friction = friction
        self._step = step
        self._programs: dict[tuple[int, ...] | None, CompiledProgram | None] = {}
        # the procedures take friction that does not depend on velocities or loads, and platforms whose angles depend
        # on the loops
        self._is_supported = friction.constant_limits is not None and not friction.viscous_asymmetries.any()
        if plant.loops is None:
            self._program(None)

    def advance(
        self, steps: int, q: Array, rates: Array, efforts: Array, coordinates: LoopCoordinates | None
    ) -> Run | None:
        """Take steps.

        Parameters
        ----------
        steps : int
        q : ndarray
            Positions as the programs of the plant take them.
        rates : ndarray, shape (n,)
        efforts : ndarray
            As StepInputs has them.
        coordinates : LoopCoordinates or None

        Returns
        -------
        Run or None
            None where no step could be taken: it needs what the machine code does not do.
        """
        program = self._program(None if coordinates is None else coordinates.independent)
        if program is None:
            return None
        arguments = [q, rates, efforts]
        if coordinates is not None:
            arguments.append(np.array([coordinates.best_quality]))
        arguments.append(np.array([float(min(steps, MAX_STEPS_PER_CALL))]))
        results = program.evaluate(*map(np.ascontiguousarray, arguments))
        end_q, end_rates, done = results[:3]
        if not done[0]:
            return None
        if coordinates is not None:
            best_quality, quality = results[3].tolist()
            coordinates = coordinates._replace(best_quality=best_quality, quality=quality)
        return Run(int(done[0]), end_q, end_rates, coordinates)

    def _program(self, independent: tuple[int, ...] | None) -> CompiledProgram | None:
        """The program for a set of independent joints, compiled now if it is not ready; None where there is none."""
        if independent not in self._programs:
            self._programs[independent] = self._compile(independent) if self._is_supported else None
        return self._programs[independent]

    def _compile(self, independent: tuple[int, ...] | None) -> CompiledProgram | None:
        size, joints = self._plant.size, len(self._plant.dynamics.all_joint_names)
        if not size:
            return None
        try:
            if independent is None:
                kernels = self._kernels(None, "direct", "inertia_matrix")
                inputs = {"q": size, "rates": size, "efforts": size, "steps": 1}
                outputs: dict[str, tuple[int, ...]] = {"q": (size,), "rates": (size,), "done": (1,)}
                steps: Callable[..., Any] = self._tree_steps(kernels).advance
            else:
                kernels = self._kernels(independent, "state_derivative", "inertia_matrix", "closure")
                inputs = {"q": joints, "rates": size, "efforts": joints, "best_quality": 1, "steps": 1}
                outputs = {"q": (joints,), "rates": (size,), "done": (1,), "quality": (2,)}
                loop_steps = self._loop_steps(independent, kernels)
                if loop_steps is None:
                    return None
                steps = loop_steps.advance
            return self._compile_procedure(steps, kernels, inputs, outputs, independent)
        except CompilationError as error:
            logger.debug("steps of %r run as Python: %s", self._plant.dynamics.robot.name, error)
            return None

    def _kernels(self, independent: tuple[int, ...] | None, *names: str) -> dict[str, Any]:
        """Kernels of the models of these names. Raises CompilationError where they run as Python."""
        from robot_dynamics.codegen.procedure.kernels import Kernel  # needs llvmlite

        kernels = {}
        for name in names:
            program = self._plant.dynamics.compile(name, independent=independent)  # type: ignore[arg-type]
            if not isinstance(program, CompiledProgram):
                raise CompilationError(f"the model {name} runs as Python")
            kernels[name] = Kernel(name, program)
        return kernels

    def _tree_steps(self, kernels: Mapping[str, Any]) -> CompiledSteps:
        plant = self._plant
        G = plant.velocity_matrix(plant.dynamics.initial_joint_positions)
        shares = np.ascontiguousarray(G[self._friction.joints].T)
        direct, inertia_matrix = kernels.values()
        return CompiledSteps(direct, inertia_matrix, self._friction, shares, plant.units[6:], self._step)

    def _loop_steps(self, independent: tuple[int, ...], kernels: Mapping[str, Any]) -> CompiledLoopSteps | None:
        plant = self._plant
        assert plant.loops is not None
        topology = plant.loops.topology_of(independent)
        if topology.attitudes != topology.dependent_attitudes:
            return None
        state_derivative, inertia_matrix, closure = kernels.values()
        sample_closure = SampleClosure(topology, closure)
        return CompiledLoopSteps(
            topology, sample_closure, state_derivative, inertia_matrix, self._friction, plant.units[6:], self._step
        )

    def _compile_procedure(
        self,
        function: Callable[..., Any],
        kernels: Mapping[str, Any],
        inputs: Mapping[str, int],
        outputs: Mapping[str, tuple[int, ...]],
        independent: tuple[int, ...] | None,
    ) -> CompiledProgram:
        from robot_dynamics.codegen.jit.procedure_code import compile_procedure
        from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface

        friction = self._friction
        constants = [*(friction.constant_limits or ()), friction.viscous_gains, friction.joints]
        key = fingerprint(self._plant.dynamics.robot, "steps", self._step, independent, constants)
        return compile_procedure("advance", function, ProcedureInterface(inputs, outputs), [*kernels.values()], key)
