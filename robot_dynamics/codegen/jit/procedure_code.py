"""Machine code of a procedure and its kernels, as a program that is called as any other one."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from robot_dynamics.codegen.jit.batch_loop import batch_function
from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
from robot_dynamics.codegen.jit.entry_point import signature
from robot_dynamics.codegen.jit.machine_code import link_sample_library
from robot_dynamics.codegen.jit.sincos import RUNTIME, sincos_module
from robot_dynamics.codegen.trace.program import Interface, OperationCount

if TYPE_CHECKING:  # engine needs llvmlite, which may be missing
    from robot_dynamics.codegen.jit.engine import Library, Module
    from robot_dynamics.codegen.procedure.kernels import Kernel
    from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface

logger = logging.getLogger(__name__)

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
        from robot_dynamics.codegen.jit.engine import has_fused_multiply_add
        from robot_dynamics.codegen.procedure.procedure_text import SINCOS_WIDTH

        imports = {kernel.name: kernel.program.address for kernel in self._kernels}
        shared = [sincos_module(SINCOS_WIDTH, has_fused_multiply_add())]
        return link_sample_library(self._module("sample", self._sample_text), shared, imports, self._kernels)

    def batch_library(self, sample_library: Library) -> Library:
        """The Library with `batch`, the loop over samples: in lanes where the procedure has a form in lanes."""
        from robot_dynamics.codegen.jit.engine import Library, Module
        from robot_dynamics.codegen.procedure.procedure_errors import LanesError

        imports = {name: sample_library[name] for name in ("sample", "runtime")}
        owners = [sample_library, *self._kernels]
        try:
            lanes = {kernel.name: kernel.program.compile_lanes() for kernel in self._kernels}
            return Library([self._module("batch", self._lanes_text)], ["batch"], {**lanes, **imports}, owners)
        except LanesError as error:
            logger.debug("%s computes one sample after the other: %s", self.interface.name, error)
        return Library([Module.from_text(self.sample_loop_text())], ["batch"], imports, owners)

    def _sample_text(self) -> str:
        from robot_dynamics.codegen.procedure.procedure_text import procedure_text  # needed if the cache has no code

        text, kernels = procedure_text(self._function, self._procedure_interface)
        self._require_known(kernels.values())
        interface = self.interface
        return "\n".join([signature(interface.name, interface.inputs, dict(interface.outputs)), text])

    def _lanes_text(self) -> str:
        from robot_dynamics.codegen.jit.engine import has_fused_multiply_add, vector_lanes
        from robot_dynamics.codegen.procedure.block_text import block_text

        lanes = vector_lanes()
        text, kernels = block_text(self._function, self._procedure_interface, lanes, has_fused_multiply_add())
        self._require_known(kernels.values())
        return "\n".join([RUNTIME, text, batch_function(self._array_count, lanes)])

    def sample_loop_text(self) -> str:
        """IR of the loop that computes one sample after the other."""
        return EACH_SAMPLE + batch_function(self._array_count, lanes=2)

    @property
    def _array_count(self) -> int:
        return len(self.interface.inputs) + len(self.interface.outputs)

    def _require_known(self, kernels: Iterable[Kernel]) -> None:
        unknown = {*kernels} - {*self._kernels}
        if unknown:
            raise ValueError(
                f"{self.interface.name} calls {[kernel.name for kernel in unknown]}: not among its kernels"
            )

    def _module(self, function: str, text: Callable[[], str]) -> Module:
        from robot_dynamics.codegen.jit.engine import Module

        if self._key is None:
            return Module.from_text(text(), OPTIMIZATION)
        return Module(f"procedure {function} {self._key}", text, OPTIMIZATION)


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
