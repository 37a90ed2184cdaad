"""Machine code of a procedure and its kernels, as a program that is called as any other one."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from robot_dynamics.codegen.jit.batch_loop import batch_function
from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
from robot_dynamics.codegen.jit.entry_point import entry_point_text, signature
from robot_dynamics.codegen.jit.runtime import runtime_table
from robot_dynamics.codegen.jit.sincos import RUNTIME
from robot_dynamics.codegen.procedure.procedure_text import procedure_text
from robot_dynamics.codegen.trace.program import Interface, OperationCount

if TYPE_CHECKING:  # engine needs llvmlite, which may be missing
    from robot_dynamics.codegen.jit.engine import Library, Module
    from robot_dynamics.codegen.procedure.kernels import Kernel
    from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface

OPTIMIZATION = 1
"""Level of LLVM's passes: they turn memory for names into registers."""

EACH_SAMPLE = """
define internal i2 @block(ptr %pointers, ptr %strides, i64 %first, i64 %last) alwaysinline { ret i2 3 }
"""
"""The block of two samples, as `batch_function` calls it: it leaves both to `@sample`."""


class ProcedureCode:
    """A procedure on this machine, with the libraries that a CompiledProgram needs.

    Parameters
    ----------
    name : str
    function : callable
        A procedure that takes the inputs and returns the outputs.
    interface : ProcedureInterface
    kernels : sequence of Kernel
        Those that the procedure calls.
    key : str, optional
        Stands in the cache for everything on which the code depends. Default: the code is stored by its own text.
    kernel_calls : int
        About how often a call of the procedure calls each kernel: batches are divided among threads by it.

    Attributes
    ----------
    interface : Interface
    work : float
        Operations of one sample, about.
    """

    def __init__(
        self,
        name: str,
        function: Callable[..., Any],
        interface: ProcedureInterface,
        kernels: Sequence[Kernel] = (),
        key: str | None = None,
        kernel_calls: int = 1,
    ) -> None:
        outputs = tuple((output, tuple(shape)) for output, shape in interface.outputs.items())
        self.interface = Interface(name, dict(interface.inputs), outputs, OperationCount(0, 0, 0, 0, 0, 0))
        self._function = function
        self._procedure_interface = interface
        self._kernels = kernels
        self._key = key
        self.work: float = kernel_calls * sum(sum(kernel.interface.operations) for kernel in kernels)

    def sample_library(self) -> Library:
        """The Library with `evaluate`, the Python function of one sample."""
        from robot_dynamics.codegen.jit.engine import Library, Module

        exports = ["evaluate", "attempt", "sample", "runtime"]
        imports = {kernel.name: kernel.program.address for kernel in self._kernels}
        entry_point = Module.from_text(entry_point_text(), is_shared=True)
        library = Library([self._module(), entry_point], exports, imports, self._kernels)
        addresses = runtime_table()
        ctypes.memmove(library["runtime"], addresses, ctypes.sizeof(addresses))
        return library

    def batch_library(self, sample_library: Library) -> Library:
        """The Library with `batch`, the loop over samples."""
        from robot_dynamics.codegen.jit.engine import Library, Module

        loop = batch_function(len(self.interface.inputs) + len(self.interface.outputs), lanes=2)
        return Library(
            [Module.from_text(EACH_SAMPLE + loop)], ["batch"], {"sample": sample_library["sample"]}, [sample_library]
        )

    def _text(self) -> str:
        text, kernels = procedure_text(self._function, self._procedure_interface)
        unknown = {*kernels.values()} - {*self._kernels}
        if unknown:
            raise ValueError(
                f"{self.interface.name} calls {[kernel.name for kernel in unknown]}: not among its kernels"
            )
        interface = self.interface
        return "\n".join([signature(interface.name, interface.inputs, dict(interface.outputs)), RUNTIME, text])

    def _module(self) -> Module:
        from robot_dynamics.codegen.jit.engine import Module

        if self._key is None:
            return Module.from_text(self._text(), OPTIMIZATION)
        return Module(f"procedure {self._key}", self._text, OPTIMIZATION)


def compile_procedure(
    name: str,
    function: Callable[..., Any],
    interface: ProcedureInterface,
    kernels: Sequence[Kernel] = (),
    key: str | None = None,
    kernel_calls: int = 1,
) -> CompiledProgram:
    """Compile a procedure.

    Parameters
    ----------
    name, function, interface, kernels, key, kernel_calls
        See ProcedureCode.

    Returns
    -------
    CompiledProgram

    Raises
    ------
    CompilationError
        If llvmlite is missing or fails.
    TypeError, ValueError
        The function breaks a rule for procedures.
    """
    code = ProcedureCode(name, function, interface, kernels, key, kernel_calls)
    return CompiledProgram(code)  # type: ignore[arg-type]  # it has what a CompiledProgram uses of MachineCode
