"""From LLVM IR text to addresses of functions, by llvmlite: compiled for this processor, or taken from the cache."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import llvmlite
import llvmlite.binding as llvm

from robot_dynamics.codegen.jit.cache import load, store

OPTIMIZATION_LEVEL = 2


@cache
def host_target():
    """(triple, name of the processor, its features as LLVM writes them)."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.get_process_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def has_fused_multiply_add():
    """Whether the processor has a fused multiply-add."""
    triple, _, features = host_target()
    return triple.startswith(("aarch64", "arm64")) or "+fma" in features.split(",")


def vector_lanes():
    """Samples in a vector: eight where a register holds as many, else four, which fill two of AVX2 or NEON's four."""
    return 8 if "+avx512f" in host_target()[2].split(",") else 4


def target_machine():
    # all references are relative to the code, so that constants take no instruction of their own
    triple, processor, features = host_target()
    target = llvm.Target.from_triple(triple)
    return target.create_target_machine(
        cpu=processor, features=features, opt=OPTIMIZATION_LEVEL, reloc="pic", codemodel="small"
    )


class Module(NamedTuple):
    """LLVM IR to compile. key: stands for the text, on this kind of machine; text: a function that gives it."""

    key: str
    text: Callable

    @classmethod
    def from_text(cls, text):
        return cls(text, lambda: text)


def object_code(module, recompile=False):
    """Object code of a Module, from the cache if it was compiled before and is not asked for anew."""
    versions = llvmlite.__version__, str(llvm.llvm_version_info), str(OPTIMIZATION_LEVEL)
    key = "\n".join([*versions, *host_target(), module.key])
    image = None if recompile else load(key)
    if image is None:
        image = compile_ir(module.text())
        store(key, image)
    return image


def compile_ir(text):
    """Object code of IR text. Of LLVM's passes only what must be inlined is: a trace has nothing left to simplify."""
    module, made = llvm.parse_assembly(text), target_machine()
    module.triple, module.data_layout = host_target()[0], str(made.target_data)
    options = llvm.create_pipeline_tuning_options(speed_level=0)
    builder = llvm.create_pass_builder(made, options)
    builder.getModulePassManager().run(module, builder)
    return made.emit_object(module)


class Library:
    """Modules in memory, linked, for as long as this lives: addresses by name of what is exported.

    modules: Modules. exports: names. imports: {name: address} of what lies elsewhere.
    """

    def __init__(self, modules, exports, imports=()):
        try:
            self._link([object_code(module) for module in modules], exports, dict(imports))
        except RuntimeError:  # something was kept that is whole and yet no good
            self._link([object_code(module, recompile=True) for module in modules], exports, dict(imports))

    def _link(self, images, exports, imports):
        self._jit = llvm.create_lljit_compiler(target_machine(), use_jit_link=True, suppress_errors=True)
        builder = llvm.JITLibraryBuilder()
        for image in images:
            builder.add_object_img(image)
        for name in exports:
            builder.export_symbol(name)
        for name, address in imports.items():
            builder.import_symbol(name, address)
        self._tracker = builder.link(self._jit, "program")

    def __getitem__(self, name):
        return self._tracker[name]
