"""The machine code of a program: compiled from its statements, or loaded from the cache without them."""

from __future__ import annotations

import ctypes
import json
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

from robot_dynamics.codegen.jit.cache import load, store
from robot_dynamics.codegen.jit.entry_point import entry_point_text, signature
from robot_dynamics.codegen.jit.runtime import runtime_table
from robot_dynamics.codegen.jit.sincos import RUNTIME
from robot_dynamics.codegen.trace.program import Interface, OperationCount, Program

if TYPE_CHECKING:  # engine needs llvmlite, which may be missing
    from robot_dynamics.codegen.jit.engine import Library, Module

TracedProgram: TypeAlias = tuple[Program, dict[int, float]]
"""A Program, and the value of each node that is known before a call."""


class MachineCode:
    """A program on this machine: its interface, its statements, and libraries of functions.

    Parameters
    ----------
    interface : Interface
    trace : callable
        Returns the TracedProgram; called when it is needed first.
    key : str, optional
        Stands in the cache for everything on which the program depends. Default: the code is stored by its own text.
    sincos_widths : list of int, optional
        See the property, if they are known.
    """

    def __init__(
        self,
        interface: Interface,
        trace: Callable[[], TracedProgram],
        key: str | None = None,
        sincos_widths: list[int] | None = None,
    ) -> None:
        self.interface = interface
        self._trace = trace
        self._key = key
        self._sincos_widths = sincos_widths

    @classmethod
    def from_cache(cls, key: str, trace: Callable[[], TracedProgram]) -> MachineCode | None:
        """The MachineCode that was stored for a key, None if there is none."""
        try:
            fields = json.loads(load(_interface_key(key)) or b"")
            outputs = tuple((name, tuple(shape)) for name, shape in fields["outputs"])
            operations = OperationCount(*fields["operations"])
            interface = Interface(fields["name"], dict(fields["inputs"]), outputs, operations)
            sincos_widths = [int(width) for width in fields["sincos_widths"]]
        except (ValueError, LookupError, TypeError):
            return None
        return cls(interface, trace, key, sincos_widths)

    @property
    def work(self) -> float:
        """Operations of one sample."""
        return sum(self.interface.operations)

    def save_to_cache(self) -> None:
        """Store the interface for the key; libraries are stored when they are compiled."""
        if self._key is not None:
            fields = {**self.interface._asdict(), "sincos_widths": self.sincos_widths}
            store(_interface_key(self._key), json.dumps(fields).encode())

    @property
    def program(self) -> Program:
        """The Program; traced on first access if the code was loaded from the cache."""
        return self._traced[0]

    @cached_property
    def _traced(self) -> TracedProgram:
        return self._trace()

    def sample_library(self) -> Library:
        """The Library with `evaluate`, the Python function of one sample."""
        from robot_dynamics.codegen.jit.engine import has_fused_multiply_add
        from robot_dynamics.codegen.jit.sincos import sincos_module

        shared = [sincos_module(width, has_fused_multiply_add()) for width in self.sincos_widths]
        return link_sample_library(self._module("evaluate", self._sample_text), shared)

    def batch_library(self, sample_library: Library) -> Library:
        """The Library with `batch`, the loop over samples, which calls `sample` of the other library."""
        from robot_dynamics.codegen.jit.engine import Library

        imports = {name: sample_library[name] for name in ("sample", "runtime")}
        return Library([self._module("batch", self._batch_text)], ["batch"], imports)

    def lanes_library(self, sample_library: Library) -> Library:
        """The Library with `lanes`, the function of several samples in vectors, which procedures call."""
        from robot_dynamics.codegen.jit.engine import Library

        return Library([self._module("lanes", self._lanes_text)], ["lanes"], {"runtime": sample_library["runtime"]})

    def _module(self, function: str, text: Callable[[], str]) -> Module:
        from robot_dynamics.codegen.jit.engine import Module

        return Module.from_text(text()) if self._key is None else Module(f"{function} {self._key}", text)

    @property
    def sincos_widths(self) -> list[int]:
        """The widths of the vectors of which one sample computes sines and cosines."""
        if self._sincos_widths is None:
            self._sincos_widths = sorted(self._sample_function[1])
        return self._sincos_widths

    @cached_property
    def _sample_function(self) -> tuple[str, set[int]]:
        from robot_dynamics.codegen.jit.kernel import sample_function

        return sample_function(*self._traced)

    def _sample_text(self) -> str:
        from robot_dynamics.codegen.jit.sincos import sincos_declaration

        interface = self.interface
        head = signature(interface.name, interface.inputs, dict(interface.outputs))
        return "\n".join([head, *map(sincos_declaration, self.sincos_widths), self._sample_function[0]])

    def _batch_text(self) -> str:
        from robot_dynamics.codegen.jit.batch_loop import batch_function
        from robot_dynamics.codegen.jit.engine import has_fused_multiply_add, vector_lanes
        from robot_dynamics.codegen.jit.kernel import block_function
        from robot_dynamics.codegen.jit.sincos import sincos_function

        lanes = vector_lanes()
        block = block_function(*self._traced, lanes)
        loop = batch_function(len(self.interface.inputs) + len(self.interface.outputs), lanes)
        return "\n".join([RUNTIME, sincos_function(lanes, has_fused_multiply_add()), block, loop])

    def _lanes_text(self) -> str:
        from robot_dynamics.codegen.jit.engine import has_fused_multiply_add, vector_lanes
        from robot_dynamics.codegen.jit.kernel import lane_function
        from robot_dynamics.codegen.jit.sincos import sincos_function

        lanes = vector_lanes()
        function = lane_function(*self._traced, lanes)
        return "\n".join([RUNTIME, sincos_function(lanes, has_fused_multiply_add()), function])


def link_sample_library(
    module: Module, shared: Sequence[str] = (), imports: Mapping[str, int] | None = None, owners: Sequence[object] = ()
) -> Library:
    """The Library with `evaluate`, the Python function of one sample, and `sample`, which it calls.

    Parameters
    ----------
    module : Module
        With `sample` and the signature of the program.
    shared : sequence of str
        IR of functions that the module calls and that are the same for many programs.
    imports, owners
        See Library.
    """
    from robot_dynamics.codegen.jit.engine import Library, Module

    # what is the same for all programs is compiled once, apart
    shared_modules = [Module.from_text(text, is_shared=True) for text in (entry_point_text(), *shared)]
    library = Library([module, *shared_modules], ["evaluate", "attempt", "sample", "runtime"], imports, owners)
    addresses = runtime_table()
    ctypes.memmove(library["runtime"], addresses, ctypes.sizeof(addresses))
    return library


def _interface_key(key: str) -> str:
    return f"interface {key}"
