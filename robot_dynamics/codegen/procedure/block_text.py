"""The text of LLVM IR of a procedure in lanes: the function `@block`, as straight-line programs have it."""

from __future__ import annotations

from collections.abc import Callable
from string import Template
from typing import TYPE_CHECKING, Any

from robot_dynamics.codegen.jit.lane_rows import row_functions
from robot_dynamics.codegen.jit.sincos import out_of_range_mask, sincos_function, vector_type
from robot_dynamics.codegen.procedure.function_text import FunctionText
from robot_dynamics.codegen.procedure.lane_frames import LaneFrame
from robot_dynamics.codegen.procedure.memory import Memory
from robot_dynamics.codegen.procedure.procedure_text import check_results, declare_functions
from robot_dynamics.codegen.procedure.staging import ProcedureStage

if TYPE_CHECKING:
    from robot_dynamics.codegen.procedure.kernels import Kernel
    from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface

LANE_FUNCTIONS = Template("""
declare $V @llvm.masked.gather.v${lanes}f64.v${lanes}p0(<$lanes x ptr>, i32, <$lanes x i1>, $V)
declare void @llvm.masked.scatter.v${lanes}f64.v${lanes}p0($V, <$lanes x ptr>, i32, <$lanes x i1>)
define internal $V @sine($V %x) alwaysinline {
  %both = call {$V, $V} @sincos$lanes($V %x)
  %sine = extractvalue {$V, $V} %both, 0
  ret $V %sine
}
define internal $V @cosine($V %x) alwaysinline {
  %both = call {$V, $V} @sincos$lanes($V %x)
  %cosine = extractvalue {$V, $V} %both, 1
  ret $V %cosine
}
define internal i$lanes @is_large_angle($V %x) alwaysinline {
$range
  ret i$lanes %is_large
}
define internal void @copy_lanes(ptr %source, ptr %target, <$lanes x i1> %mask, i64 %size) noinline {
entry:
  br label %entries
entries:
  %entry.number = phi i64 [0, %entry], [%next, %entries]
  %source.at = getelementptr $V, ptr %source, i64 %entry.number
  %target.at = getelementptr $V, ptr %target, i64 %entry.number
  %new = load $V, ptr %source.at, align $align
  %old = load $V, ptr %target.at, align $align
  %value = select <$lanes x i1> %mask, $V %new, $V %old
  store $V %value, ptr %target.at, align $align
  %next = add i64 %entry.number, 1
  %more = icmp slt i64 %next, %size
  br i1 %more, label %entries, label %done
done:
  ret void
}
""")
"""Functions that procedures in lanes use."""


def block_text(
    function: Callable[..., Any], interface: ProcedureInterface, lanes: int, fused: bool
) -> tuple[str, dict[str, Kernel]]:
    """IR of `@block(ptr %pointers, ptr %strides, i64 %first, i64 %last)` of a procedure, and the kernels that it calls.

    Lane i computes sample %first + i, or %last if that is less. The function returns a bit for each lane that it has
    not computed. The kernels are functions of vectors, as `kernel.lane_function` has them.

    Parameters
    ----------
    function, interface
        As for `procedure_text`.
    lanes : int
        Samples of a block.
    fused : bool
        Whether the processor has a fused multiply-add.

    Returns
    -------
    text : str
    kernels : dict of str to Kernel

    Raises
    ------
    LanesError
        The function does what has no form for several samples at once.
    TypeError, ValueError
        As `procedure_text`.
    """
    text = FunctionText(lanes)
    stage = ProcedureStage(text, LaneFrame)
    inputs = [Memory(text, text.allocate(size), (size,)) for size in interface.inputs.values()]
    for array, memory in enumerate(inputs):
        _move_rows(text, "read_rows", array, memory)
    results = check_results(stage.stage(function, inputs), interface)
    for array, (result, shape) in enumerate(zip(results, interface.outputs.values(), strict=True), start=len(inputs)):
        memory = result
        if not isinstance(result, Memory):
            memory = Memory(text, text.allocate(max(1, result.size)), shape)
            memory.copy_from(result)
        _move_rows(text, "write_rows", array, memory)
    rejected = text.assign(f"load i{lanes}, ptr %rejected, align 8")
    range_lines = "\n".join(out_of_range_mask("is_large", "%x", lanes))
    values = {"V": vector_type(lanes), "lanes": lanes, "align": 8 * lanes, "range": range_lines}
    lines = [
        sincos_function(lanes, fused),
        row_functions(lanes),
        declare_functions(text),
        LANE_FUNCTIONS.substitute(values),
        *(f"declare i{lanes} @{name}(ptr)" for name in stage.kernels),
        f"define i{lanes} @block(ptr %pointers, ptr %strides, i64 %first, i64 %last) noinline {{",
        f"%rejected = alloca i{lanes}, align 8",
        *text.allocations,
        f"store i{lanes} 0, ptr %rejected, align 8",
        *text.lines,
        f"ret i{lanes} {rejected}",
        "}",
    ]
    return "\n".join(lines), stage.kernels


def _move_rows(text: FunctionText, function: str, array: int, memory: Memory) -> None:
    """Call @read_rows or @write_rows for an array of the block."""
    pointer = text.assign(f"getelementptr ptr, ptr %pointers, i64 {array}")
    stride = text.assign(f"getelementptr i64, ptr %strides, i64 {array}")
    samples = f"i64 %first, i64 %last, i64 {memory.size}"
    text.append(f"call void @{function}(ptr {pointer}, ptr {stride}, {samples}, ptr {memory.address})")
