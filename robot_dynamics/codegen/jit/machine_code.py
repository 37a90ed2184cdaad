"""The machine code of a program: compiled from its statements, or loaded without them where it was kept."""

import ctypes
import json
from functools import cached_property

from robot_dynamics.codegen.jit.batch_loop import batch_function
from robot_dynamics.codegen.jit.cache import load, store
from robot_dynamics.codegen.jit.entry_point import entry_point_text, signature
from robot_dynamics.codegen.jit.kernel import block_function, sample_function
from robot_dynamics.codegen.jit.runtime import runtime_table
from robot_dynamics.codegen.jit.sincos import sincos_functions
from robot_dynamics.codegen.trace.program import Interface, OperationCount

RUNTIME = "@runtime = external global ptr"


class MachineCode:
    """A program on this machine: its `interface`, its `program`, and libraries of functions.

    trace: a function that gives (Program, {node: float} known before a call), called when they are first needed. key:
    a text that stands for all that these depend on; None where there is none, and the code is kept by its own text.
    """

    def __init__(self, interface, trace, key=None):
        self.interface, self._trace, self._key = interface, trace, key

    @classmethod
    def from_cache(cls, key, trace):
        """The MachineCode that was kept for a key, None if there is none."""
        try:
            told = json.loads(load(_interface_key(key)) or b"")
            outputs = tuple((name, tuple(shape)) for name, shape in told["outputs"])
            interface = Interface(told["name"], dict(told["inputs"]), outputs, OperationCount(*told["operations"]))
        except (ValueError, LookupError, TypeError):
            return None
        return cls(interface, trace, key)

    def save_to_cache(self):
        """Keep the interface for the key; libraries are kept as they are made."""
        if self._key is not None:
            store(_interface_key(self._key), json.dumps(self.interface._asdict()).encode())

    @property
    def program(self):
        return self._traced[0]

    @cached_property
    def _traced(self):
        return self._trace()

    def sample_library(self):
        """The Library with `evaluate`, the Python function of one sample."""
        from robot_dynamics.codegen.jit.engine import Library, Module

        modules = [self._module("evaluate", self._sample_text), Module.from_text(entry_point_text())]
        library = Library(modules, ["evaluate", "sample", "runtime"])
        addresses = runtime_table()
        ctypes.memmove(library["runtime"], addresses, ctypes.sizeof(addresses))
        return library

    def batch_library(self, sample_library):
        """The Library with `batch`, the loop over samples; it calls `sample` of the Library that `one` gave."""
        from robot_dynamics.codegen.jit.engine import Library

        imports = {name: sample_library[name] for name in ("sample", "runtime")}
        return Library([self._module("batch", self._batch_text)], ["batch"], imports)

    def _module(self, what, text):
        from robot_dynamics.codegen.jit.engine import Module

        return Module.from_text(text()) if self._key is None else Module(f"{what} {self._key}", text)

    def _sample_text(self):
        from robot_dynamics.codegen.jit.engine import has_fused_multiply_add

        sample, widths = sample_function(*self._traced)
        described = signature(self.interface.name, self.interface.inputs, dict(self.interface.outputs))
        return "\n".join(
            [
                described,
                RUNTIME,
                *(sincos_functions(width, has_fused_multiply_add()) for width in sorted(widths)),
                sample,
            ]
        )

    def _batch_text(self):
        from robot_dynamics.codegen.jit.engine import has_fused_multiply_add, vector_lanes

        block = block_function(*self._traced, vector_lanes())
        loop = batch_function(len(self.interface.inputs) + len(self.interface.outputs), vector_lanes())
        return "\n".join([RUNTIME, sincos_functions(vector_lanes(), has_fused_multiply_add()), block, loop])


def _interface_key(key):
    return f"interface {key}"
