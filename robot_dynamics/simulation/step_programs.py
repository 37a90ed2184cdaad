"""Programs that take many steps of a simulation in one call."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np

from robot_dynamics.codegen.jit.procedure_code import compile_procedure
from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface
from robot_dynamics.codegen.trace.fingerprint import fingerprint
from robot_dynamics.errors import CompilationError
from robot_dynamics.simulation.compiled_steps import BEST_QUALITY
from robot_dynamics.simulation.part_motion import split
from robot_dynamics.simulation.runge_kutta import NODES
from robot_dynamics.simulation.step_limits import RECORDED_STEPS
from robot_dynamics.simulation.varied_inertias import ENTRIES, with_inertia_input

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
    from robot_dynamics.simulation.constrained_motion import LoopCoordinates
    from robot_dynamics.simulation.step_builder import StepBuilder
    from robot_dynamics.simulation.step_inputs import StepInputs

logger = logging.getLogger(__name__)

StepProcedure: TypeAlias = Literal["advance", "record"]

NOTHING = np.zeros(0)

OPERATIONS_PER_CALL = 3e7
"""Operations in one call of machine code, some 5 to 10 ms: between calls a process reacts to signals."""


class ProgramState(NamedTuple):
    """A state of a simulation as programs take it.

    Attributes
    ----------
    pose : ndarray, shape (4, 4)
        Pose of the base in the world.
    q : ndarray
        Positions as the programs of the plant take them.
    rates : ndarray, shape (m,)
        Twist of a moving base, and velocities of the independent joints.
    coordinates : LoopCoordinates or None
        The coordinates of the rates; None without loops.
    momentum : ndarray, shape (6,)
        Linear and angular momentum of a free base; (0,) of other bases.
    """

    pose: Array
    q: Array
    rates: Array
    coordinates: LoopCoordinates | None
    momentum: Array


class Run(NamedTuple):
    """The end of some steps: their number, the state, and the length [s] of the shortest part of a step."""

    steps: int
    state: ProgramState
    shortest: float


class RecordedRun(NamedTuple):
    """Steps of M simulations.

    Attributes
    ----------
    is_complete : ndarray of bool, shape (M,)
        Whether all steps were taken.
    positions : ndarray, shape (M, K, ...)
        After each step, as the programs of the plant take them.
    rates : ndarray, shape (M, K, n)
    qualities : ndarray, shape (M, K, 2)
        Best and present quality of the coordinates.
    shortest : float
        Length [s] of the shortest part of a step.
    """

    is_complete: BoolArray
    positions: Array
    rates: Array
    qualities: Array
    shortest: float

    def coordinates(
        self, initial_coordinates: Sequence[LoopCoordinates | None], selected: BoolArray
    ) -> list[LoopCoordinates | None]:
        """Coordinates of the selected simulations after the steps, from those (M,) before them."""
        return [
            _with_qualities(coordinates, qualities)
            for coordinates, qualities, is_selected in zip(
                initial_coordinates, self.qualities[:, -1], selected, strict=True
            )
            if is_selected
        ]


class StepPrograms:
    """The programs of a robot, one for each kind of inputs and set of independent coordinates of its loops.

    Parameters
    ----------
    builder : StepBuilder
    """

    def __init__(self, builder: StepBuilder) -> None:
        self._builder = builder
        self._programs: dict[tuple[object, ...], CompiledProgram | None] = {}

    def advance(self, steps: int, state: ProgramState, inputs: StepInputs) -> Run | None:
        """Take steps.

        Parameters
        ----------
        steps : int
        state : ProgramState
        inputs : StepInputs
            Without prescribed motion.

        Returns
        -------
        Run or None
            None where no step could be taken: it needs what the machine code does not do.
        """
        coordinates = state.coordinates
        independent = None if coordinates is None else coordinates.independent
        program = self.program("advance", independent, inputs.drive is not None)
        if program is None:
            return None
        longest = max(1, int(OPERATIONS_PER_CALL / max(1.0, program.work)))
        parts = [
            state.pose[:3].ravel() if self._builder.has_pose else NOTHING,
            state.q,
            state.rates,
            _qualities(coordinates),
            state.momentum,
        ]
        held = [inputs.efforts, *inputs.wrenches, NOTHING if inputs.drive is None else inputs.drive]
        if len(state.momentum):
            held.append(np.array([float(inputs.is_undisturbed)]))
        limits = np.array([float(steps), float(longest)])
        end, progress = program.evaluate(np.concatenate(parts), np.concatenate(held), limits)
        done, shortest = progress.tolist()
        if not done:
            return None
        placement, q, rates, qualities, momentum = split(end, [len(part) for part in parts])
        end_pose = state.pose
        if self._builder.has_pose:
            end_pose = np.eye(4)
            end_pose[:3] = placement.reshape(3, 4)
        end_state = ProgramState(end_pose, q, rates, _with_qualities(coordinates, qualities), momentum)
        return Run(int(done), end_state, shortest)

    def with_varied_links(self, links: tuple[int, ...]) -> StepPrograms:
        """Programs that take inertias of some links as inputs."""
        return StepPrograms(self._builder.with_varied_links(links))

    def record(
        self,
        q: Array,
        rates: Array,
        efforts: Array,
        coordinates: Sequence[LoopCoordinates | None],
        threads: int,
        inertias: Array | None = None,
    ) -> RecordedRun:
        """Take K steps of M simulations with efforts (M, K, ...), as StepInputs has them; see TimeStepping.record."""
        samples, count, _ = efforts.shape
        first = coordinates[0]
        program = self.program("record", None if first is None else first.independent)
        assert program is not None
        held_efforts = np.zeros((samples, RECORDED_STEPS, efforts.shape[-1]))
        held_efforts[:, :count] = efforts
        qualities = np.array([_qualities(sample_coordinates) for sample_coordinates in coordinates])
        initial_states = np.concatenate([q, rates, qualities], axis=1)
        arrays = [initial_states, held_efforts.reshape(samples, -1), np.array([float(count)])]
        states, progress = program.batch(*arrays, *([] if inertias is None else [inertias]), threads=threads)
        positions, end_rates, end_qualities = split(states[:, :count], [q.shape[1], rates.shape[1], 2])
        is_complete = progress[:, 0] == count
        return RecordedRun(is_complete, positions, end_rates, end_qualities, float(progress[:, 1].min()))

    def program(
        self, procedure: StepProcedure, independent: tuple[int, ...] | None, is_driven: bool = False
    ) -> CompiledProgram | None:
        """The program of a procedure of CompiledSteps, compiled now if it is not ready.

        Parameters
        ----------
        procedure : {"advance", "record"}
        independent : tuple of int or None
            Numbers of the independent joints of a robot with loops; None without loops.
        is_driven : bool
            Whether a drive moves the base.

        Returns
        -------
        CompiledProgram or None
            None where nothing compiles, or where the machine code does not support the robot.
        """
        key = procedure, independent, is_driven, self._builder.wrench_links
        if key not in self._programs:
            self._programs[key] = self._compile(procedure, independent, is_driven)
        return self._programs[key]

    def _compile(
        self, procedure: StepProcedure, independent: tuple[int, ...] | None, is_driven: bool
    ) -> CompiledProgram | None:
        builder = self._builder
        if not builder.is_supported:
            return None
        try:
            steps, kernels = builder.build(independent, is_driven)
            is_recorded = procedure == "record"
            recorded = RECORDED_STEPS if is_recorded else 1
            size = sum(steps.state_sizes)
            limits = 1 if is_recorded else 2
            inputs = {"state": size, "inputs": recorded * sum(steps.input_sizes), "limits": limits}
            outputs: dict[str, tuple[int, ...]] = {"state": (recorded, size) if is_recorded else (size,)}
            key = fingerprint(procedure, *builder.fingerprint_values(independent, is_driven))
            function = getattr(steps, procedure)
            if builder.varied_links:
                function = with_inertia_input(function, kernels)
                inputs["inertias"] = ENTRIES * len(builder.varied_links)
            interface = ProcedureInterface(inputs, outputs | {"progress": (2,)})
            return compile_procedure(procedure, function, interface, kernels, key, len(NODES) * recorded)
        except CompilationError as error:
            logger.debug("steps run as Python: %s", error)
            return None


def _qualities(coordinates: LoopCoordinates | None) -> Array:
    """Best and present quality (2,), as states have them."""
    if coordinates is None:
        return np.full(2, BEST_QUALITY)
    return np.array([coordinates.best_quality, coordinates.quality])


def _with_qualities(coordinates: LoopCoordinates | None, qualities: Array) -> LoopCoordinates | None:
    """The coordinates with the best and the present quality of a state."""
    if coordinates is None:
        return None
    best_quality, quality = qualities.tolist()
    return coordinates._replace(best_quality=best_quality, quality=quality)
