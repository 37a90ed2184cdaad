"""LLVM IR text to addresses of functions, by llvmlite: compiled for this processor or loaded from the cache."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import llvmlite
import llvmlite.binding as llvm

from robot_dynamics.codegen.jit.cache import load, store

OPTIMIZATION_LEVEL = 2


@cache
def host_target() -> tuple[str, str, str]:
    """Triple, name and features of this processor, as LLVM writes them."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.get_process_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def has_fused_multiply_add() -> bool:
    """Whether the processor has a fused multiply-add."""
    triple, _, features = host_target()
    return triple.startswith(("aarch64", "arm64")) or "+fma" in features.split(",")


def vector_lanes() -> int:
    """Samples in a vector: eight with AVX-512, else four."""
    return 8 if "+avx512f" in host_target()[2].split(",") else 4


def target_machine() -> Any:
    """The llvmlite TargetMachine of this processor."""
    # all references are relative to the code, so that constants need no instruction of their own
    triple, processor, features = host_target()
    target = llvm.Target.from_triple(triple)
    return target.create_target_machine(
        cpu=processor, features=features, opt=OPTIMIZATION_LEVEL, reloc="pic", codemodel="small"
    )


class Module(NamedTuple):
    """LLVM IR to compile.

    Attributes
    ----------
    key : str
        Stands for the text in the cache.
    text : callable
        Returns the text; called only if it must be compiled.
    optimization : int
        Level of LLVM's passes, 0 to 3. At 0 only forced inlining runs: a trace has nothing left to simplify.
    is_shared : bool
        Whether many programs link the module: its object code then stays in memory.
    """

    key: str
    text: Callable[[], str]
    optimization: int = 0
    is_shared: bool = False

    @classmethod
    def from_text(cls, text: str, optimization: int = 0, is_shared: bool = False) -> Module:
        """A Module whose text is its own key."""
        return cls(text, lambda: text, optimization, is_shared)


shared_object_code: dict[str, bytes] = {}
"""Object code of shared modules, by the key of the cache."""


def object_code(module: Module, recompile: bool = False) -> bytes:
    """Object code of a Module, from the cache unless it is missing there or `recompile` is set."""
    versions = llvmlite.__version__, str(llvm.llvm_version_info), str(OPTIMIZATION_LEVEL)
    key = "\n".join([*versions, str(module.optimization), *host_target(), module.key])
    image = None if recompile else shared_object_code.get(key) or load(key)
    if image is None:
        image = compile_ir(module.text(), module.optimization)
        store(key, image)
    if module.is_shared:
        shared_object_code[key] = image
    return image


def compile_ir(text: str, optimization: int = 0) -> bytes:
    """Object code of IR text, with a level of LLVM's passes as in Module."""
    machine = target_machine()
    module = llvm.parse_assembly(text)
    module.triple = host_target()[0]
    module.data_layout = str(machine.target_data)
    options = llvm.create_pipeline_tuning_options(speed_level=optimization)
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    image: bytes = machine.emit_object(module)
    return image


class Library:
    """Modules that are linked in memory for the lifetime of this object; `library[name]` is the address of an export.

    Parameters
    ----------
    modules : iterable of Module
    exports : iterable of str
        Names of functions and variables of the modules.
    imports : mapping of str to int
        Addresses of names that the modules use and do not define.
    owners : sequence of object
        Kept as long as this object: what has the code at these addresses.
    """

    def __init__(
        self,
        modules: Iterable[Module],
        exports: Iterable[str],
        imports: Mapping[str, int] | None = None,
        owners: Sequence[object] = (),
    ) -> None:
        self._owners = owners
        modules = list(modules)
        imports = dict(imports or {})
        try:
            self._link([object_code(module) for module in modules], exports, imports)
        except RuntimeError:  # a complete file in the cache that is not valid object code
            self._link([object_code(module, recompile=True) for module in modules], exports, imports)

    def _link(self, images: Iterable[bytes], exports: Iterable[str], imports: Mapping[str, int]) -> None:
        self._jit = llvm.create_lljit_compiler(target_machine(), use_jit_link=True, suppress_errors=True)
        builder = llvm.JITLibraryBuilder()
        for image in images:
            builder.add_object_img(image)
        for name in exports:
            builder.export_symbol(name)
        for name, address in imports.items():
            builder.import_symbol(name, address)
        self._tracker = builder.link(self._jit, "program")

    def __getitem__(self, name: str) -> int:
        address: int = self._tracker[name]
        return address
