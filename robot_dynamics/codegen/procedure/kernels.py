"""Kernels: compiled straight-line programs that procedures call."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.codegen.procedure.staging import ProcedureStage
from robot_dynamics.procedures import active_stage

if TYPE_CHECKING:
    from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
    from robot_dynamics.codegen.trace.program import Interface


class Kernel:
    """A compiled program as a function of procedures.

    Called with arrays it runs the program; called while a procedure is staged it becomes a call in machine code.

    Parameters
    ----------
    name : str
        Name of its function in machine code: letters, digits and underscores.
    program : CompiledProgram

    Attributes
    ----------
    name, program
        As passed.
    """

    def __init__(self, name: str, program: CompiledProgram) -> None:
        self.name = name
        self.program = program

    @property
    def interface(self) -> Interface:
        """The Interface of the program."""
        return self.program.interface

    def __call__(self, *arguments: Any) -> Any:
        stage = active_stage.get()
        if isinstance(stage, ProcedureStage):
            return stage.call_kernel(self, arguments)
        return self.program.evaluate(*(np.ascontiguousarray(argument, dtype=float) for argument in arguments))
