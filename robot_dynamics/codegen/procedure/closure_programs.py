"""Programs that close the loops of one robot: Newton's step, and procedures around it, compiled in the background."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robot_dynamics.codegen.jit.background_compilation import BackgroundCompilation
from robot_dynamics.codegen.jit.compiled_program import STATUS, CompiledProgram, compile_program, load_program
from robot_dynamics.codegen.trace.fingerprint import fingerprint
from robot_dynamics.errors import CompilationError, SingularModelError

if TYPE_CHECKING:
    from robot_dynamics.codegen.jit.compiled_models import CompiledModels, RunnableProgram
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.constraints.closure_procedures import SampleProcedure, StepFunction
    from robot_dynamics.model.robot import Robot

    ProcedureMaker: TypeAlias = Callable[[StepFunction], SampleProcedure]
    """Makes a procedure from the function that evaluates Newton's step."""


@dataclass
class ProgramSwitch:
    """Whether programs are used, for all that belongs to one Dynamics."""

    is_on: bool


class ClosurePrograms:
    """The programs that a ClosureSolver uses.

    Parameters
    ----------
    robot : Robot
    programs : CompiledModels
        Where the program of Newton's step comes from.
    switch : ProgramSwitch
        Whether programs are used.
    """

    def __init__(self, robot: Robot, programs: CompiledModels, switch: ProgramSwitch) -> None:
        self._robot = robot
        self._programs = programs
        self._switch = switch
        self._compilations: dict[str, BackgroundCompilation[CompiledProgram]] = {}
        self._straight_line: dict[str, BackgroundCompilation[CompiledProgram]] = {}

    def get_ready(self, model: str) -> RunnableProgram | None:
        """The program of a model if it is compiled."""
        return self._programs.get_ready(model) if self._switch.is_on else None

    def record_time(self, seconds: float, model: str) -> None:
        """Record the time [s] spent without the program."""
        if self._switch.is_on:
            self._programs.record_time(seconds, model)

    def get_ready_procedure(self, name: str, make_procedure: ProcedureMaker) -> CompiledProgram | None:
        """A procedure as a program, if it is compiled. Else it is compiled once the program `closure` is.

        Parameters
        ----------
        name : str
            Name of the procedure; together with the robot it stands for everything that the procedure depends on.
        make_procedure : callable
        """
        if not self._switch.is_on:
            return None
        compilation = self._compilations.get(name)
        if compilation is not None:
            return compilation.program
        compilation = self._create_compilation(name, make_procedure)
        if compilation is not None:
            compilation.start()
        return None

    def compile_procedure(self, name: str, make_procedure: ProcedureMaker) -> None:
        """Compile a procedure now if the program `closure` is compiled. Where it does not compile, NumPy stays in use.

        name, make_procedure: as of `get_ready_procedure`.
        """
        compilation = self._compilations.get(name) or self._create_compilation(name, make_procedure)
        if compilation is not None:
            compilation.is_started = True
            with suppress(SingularModelError, CompilationError):
                compilation.get()

    def _create_compilation(
        self, name: str, make_procedure: ProcedureMaker
    ) -> BackgroundCompilation[CompiledProgram] | None:
        """The compilation of a procedure, not started; None where the program `closure` is not compiled."""
        step_program = self._programs.get_ready("closure")
        if not isinstance(step_program, CompiledProgram):
            return None
        created = BackgroundCompilation(
            partial(_compile_procedure, self._robot, step_program, name, make_procedure),
            np.inf,
            f"the procedure {name} of {self._robot.name!r}",
            expected_errors=(SingularModelError, CompilationError),
            prepare=CompiledProgram.compile_batch,
        )
        return self._compilations.setdefault(name, created)

    def get_ready_program(self, name: str, trace: Callable[[], Program]) -> RunnableProgram | None:
        """A straight-line program if it is compiled. Else it is compiled once the program `closure` is.

        name: stands, together with the robot, for everything that the program depends on.
        """
        if not self._switch.is_on:
            return None
        compilation = self._straight_line.get(name)
        if compilation is not None:
            return compilation.program
        if self._programs.get_ready("closure") is not None:
            created = BackgroundCompilation(
                partial(_compile_trace, fingerprint(self._robot, "closure program", name), trace),
                np.inf,
                f"the program {name} of {self._robot.name!r}",
                expected_errors=(SingularModelError, CompilationError),
            )
            self._straight_line.setdefault(name, created).start()
        return None


def _compile_trace(key: str | None, trace: Callable[[], Program]) -> CompiledProgram:
    return (key and load_program(key, trace)) or compile_program(trace(), key=key)


def _compile_procedure(
    robot: Robot, step_program: CompiledProgram, name: str, make_procedure: ProcedureMaker
) -> CompiledProgram:
    from robot_dynamics.codegen.jit.procedure_code import compile_procedure
    from robot_dynamics.codegen.procedure.kernels import Kernel
    from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface

    kernel = Kernel("closure", step_program)
    function, inputs, output, shape = make_procedure(kernel)
    interface = ProcedureInterface(inputs, {output: shape, STATUS: (1,)})
    return compile_procedure(name, function, interface, [kernel], fingerprint(robot, "closure procedure", name))
