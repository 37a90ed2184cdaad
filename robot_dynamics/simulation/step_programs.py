"""Programs that take many steps of a simulation in one call, compiled when a simulation first uses them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np

from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
from robot_dynamics.codegen.jit.procedure_code import compile_procedure
from robot_dynamics.codegen.procedure.kernels import Kernel
from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface
from robot_dynamics.codegen.trace.fingerprint import fingerprint
from robot_dynamics.constraints.sample_closure import SampleClosure
from robot_dynamics.errors import CompilationError
from robot_dynamics.simulation.compiled_loop_steps import CompiledLoopSteps
from robot_dynamics.simulation.compiled_steps import CompiledSteps
from robot_dynamics.simulation.runge_kutta import NODES
from robot_dynamics.simulation.step_limits import RECORDED_STEPS

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.simulation.constrained_motion import LoopCoordinates
    from robot_dynamics.simulation.friction_impulses import ImpulsiveFriction
    from robot_dynamics.simulation.plant import Plant

logger = logging.getLogger(__name__)

StepProcedure: TypeAlias = Literal["advance", "record"]

OPERATIONS_PER_CALL = 3e7
"""Operations in one call of machine code, some 5 to 10 ms: between calls a process reacts to signals."""


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


class RecordedRun(NamedTuple):
    """Steps of M simulations.

    Attributes
    ----------
    is_complete : ndarray of bool, shape (M,)
        Whether all steps were taken.
    positions : ndarray, shape (M, K, ...)
        After each step, as the programs of the plant take them.
    rates : ndarray, shape (M, K, n)
    quality : ndarray, shape (M, 2), or None
        Best and present quality of the coordinates; None without loops.
    """

    is_complete: BoolArray
    positions: Array
    rates: Array
    quality: Array | None

    def coordinates(
        self, before: Sequence[LoopCoordinates | None], selected: BoolArray
    ) -> list[LoopCoordinates | None]:
        """Coordinates of the selected simulations, from those (M,) before the steps."""
        if self.quality is None:
            return [None] * int(selected.sum())
        return [
            own and own._replace(best_quality=float(best), quality=float(present))
            for own, (best, present), is_selected in zip(before, self.quality, selected, strict=True)
            if is_selected
        ]


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
        self._programs: dict[tuple[str, tuple[int, ...] | None], CompiledProgram | None] = {}
        # the procedures take friction that does not depend on velocities or loads
        self._is_supported = friction.constant_limits is not None and not friction.viscous_asymmetries.any()
        if plant.loops is None:
            self.program("advance", None)

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
        program = self.program("advance", None if coordinates is None else coordinates.independent)
        if program is None:
            return None
        arguments = [q, rates, efforts]
        if coordinates is not None:
            arguments.append(np.array([coordinates.best_quality]))
        longest = max(1, int(OPERATIONS_PER_CALL / max(1.0, program.work)))
        arguments.append(np.array([float(min(steps, longest))]))
        results = program.evaluate(*map(np.ascontiguousarray, arguments))
        end_q, end_rates, done = results[:3]
        if not done[0]:
            return None
        if coordinates is not None:
            best_quality, quality = results[3].tolist()
            coordinates = coordinates._replace(best_quality=best_quality, quality=quality)
        return Run(int(done[0]), end_q, end_rates, coordinates)

    def record(
        self, q: Array, rates: Array, efforts: Array, coordinates: Sequence[LoopCoordinates | None], threads: int
    ) -> RecordedRun:
        """Take K steps of M simulations with efforts (M, K, ...), as StepInputs has them; see TimeStepping.record."""
        count = efforts.shape[1]
        first = coordinates[0]
        program = self.program("record", None if first is None else first.independent)
        assert program is not None
        held = np.zeros((len(q), RECORDED_STEPS, efforts.shape[-1]))
        held[:, :count] = efforts
        arguments = [q, rates, held.reshape(len(q), -1)]
        if first is not None:
            arguments.append(np.array([[own.best_quality] for own in coordinates if own is not None]))
        results = program.batch(*arguments, np.array([float(count)]), threads=threads)
        positions, end_rates, done = results[:3]
        quality = results[3] if first is not None else None
        return RecordedRun(done[:, 0] == count, positions[:, :count], end_rates[:, :count], quality)

    def program(self, procedure: StepProcedure, independent: tuple[int, ...] | None) -> CompiledProgram | None:
        """The program of a procedure of CompiledSteps or CompiledLoopSteps, compiled now if it is not ready.

        Parameters
        ----------
        procedure : {"advance", "record"}
        independent : tuple of int or None
            Numbers of the independent joints of a robot with loops; None without loops.

        Returns
        -------
        CompiledProgram or None
            None where nothing compiles, or where the machine code does not support the robot.
        """
        key = procedure, independent
        if key not in self._programs:
            self._programs[key] = self._compile(procedure, independent) if self._is_supported else None
        return self._programs[key]

    def _compile(self, procedure: StepProcedure, independent: tuple[int, ...] | None) -> CompiledProgram | None:
        size, joints = self._plant.size, len(self._plant.dynamics.all_joint_names)
        if not size:
            return None
        positions = size if independent is None else joints
        inputs = {"q": positions, "rates": size, "efforts": positions, "steps": 1}
        outputs: dict[str, tuple[int, ...]] = {"q": (positions,), "rates": (size,), "done": (1,)}
        if procedure == "record":
            inputs["efforts"] *= RECORDED_STEPS
            outputs = {"q": (RECORDED_STEPS, positions), "rates": (RECORDED_STEPS, size), "done": (1,)}
        try:
            if independent is None:
                kernels = self._kernels(None, "direct", "inertia_matrix")
                steps: CompiledSteps | CompiledLoopSteps | None = self._tree_steps(kernels)
            else:
                kernels = self._kernels(independent, "state_derivative", "inertia_matrix", "closure")
                steps = self._loop_steps(independent, kernels)
                del inputs["steps"]
                inputs |= {"best_quality": 1, "steps": 1}
                outputs["quality"] = (2,)
            if steps is None:
                return None
            interface = ProcedureInterface(inputs, outputs)
            return self._compile_procedure(procedure, getattr(steps, procedure), kernels, interface, independent)
        except CompilationError as error:
            logger.debug("steps of %r run as Python: %s", self._plant.dynamics.robot.name, error)
            return None

    def _kernels(self, independent: tuple[int, ...] | None, *names: str) -> dict[str, Any]:
        """Kernels of the models of these names. Raises CompilationError where they run as Python."""
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
        units = topology.joint_units[[*independent]]
        return CompiledLoopSteps(
            topology, sample_closure, state_derivative, inertia_matrix, self._friction, units, self._step
        )

    def _compile_procedure(
        self,
        name: str,
        function: Callable[..., Any],
        kernels: Mapping[str, Any],
        interface: ProcedureInterface,
        independent: tuple[int, ...] | None,
    ) -> CompiledProgram:
        friction = self._friction
        constants = [*(friction.constant_limits or ()), friction.viscous_gains, friction.joints]
        key = fingerprint(self._plant.dynamics.robot, name, self._step, independent, constants)
        calls = len(NODES) * (RECORDED_STEPS if name == "record" else 1)
        return compile_procedure(name, function, interface, [*kernels.values()], key, calls)
