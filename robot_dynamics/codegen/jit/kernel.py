"""The two functions of a program in LLVM IR: for one sample, and for as many samples as a vector has lanes.

Both read all inputs before they write an output. A long program is split into parts, each a function of its own,
because the time to compile a function grows faster than its length. %scratch has the values that later parts read. One
sample writes its outputs as soon as they are known. A block writes them last: its rows are far from each other in
memory, and each is written from start to end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from robot_dynamics.codegen.jit.ir_writer import IRWriter
from robot_dynamics.codegen.jit.row_transpose import (
    next_block_pointer,
    prefetch_lines,
    read_columns,
    row_pointers,
    write_columns,
)
from robot_dynamics.codegen.jit.schedule import (
    SINCOS,
    even_bounds,
    group_sincos,
    insert_stores,
    list_steps,
    list_stores,
    split_into_parts,
)
from robot_dynamics.codegen.jit.sincos import out_of_range_mask, vector_type
from robot_dynamics.codegen.trace.scalar import INPUT

if TYPE_CHECKING:
    from robot_dynamics.codegen.jit.schedule import Part, Step
    from robot_dynamics.codegen.trace.program import Program

MAX_LENGTH = 3000
"""Steps of a program of one sample that is not divided."""

PART_LENGTH = 300
"""Steps of a part of a longer program."""

MAX_BLOCK_LENGTH = 5000
"""Steps of a part of a block, whose vectors take longer to pass from part to part."""

MAX_BLOCK_STORES = 12
"""Groups of columns that a part of a block stores, at about 30 instructions each."""

MAX_SINCOS_GROUP = 8


def input_nodes(program: Program) -> dict[str, dict[int, int]]:
    """Nodes of the entries that the program reads, by name of the input and position in it."""
    nodes: dict[str, dict[int, int]] = {name: {} for name in program.inputs}
    for leaf in program.leaves:
        if leaf.operation == INPUT:
            name, position = leaf.operands
            nodes[name][position] = leaf.number
    return nodes


class ArrayWriter(IRWriter):
    """A function whose argument %pointers has the address of each input, then of each output.

    An array has a value for each of its entries: a double, or a vector with an entry for each sample.
    """

    alignment = 1
    """Bytes of which the address of each value is a multiple."""

    def __init__(self, program: Program, constants: Mapping[int, float], slots: Mapping[int, int], lanes: int) -> None:
        super().__init__(program, constants, slots, lanes)
        self.addressed: set[int] = set()

    def array(self, number: int) -> str:
        """The address of an array."""
        if number not in self.addressed:
            self.addressed.add(number)
            self.lines += [
                f"%array{number}.at = getelementptr inbounds ptr, ptr %pointers, i64 {number}",
                f"%array{number} = load ptr, ptr %array{number}.at, align 8",
            ]
        return f"%array{number}"

    def load(self, step: Step) -> None:
        for array, nodes in enumerate(input_nodes(self.program).values()):
            pointer = self.array(array)
            for position, node in nodes.items():
                self.lines += [
                    f"%v{node}.at = getelementptr inbounds {self.type}, ptr {pointer}, i64 {position}",
                    f"%v{node} = load {self.type}, ptr %v{node}.at, align {self.alignment}",
                ]

    def store(self, step: Step) -> None:
        number, start = step.target
        output = self.program.outputs[number]
        pointer = self.array(len(self.program.inputs) + number)
        for position in range(start, start + len(step.operands)):
            value = self.signed(*output.entries[position])
            address = f"%out{number}.{start}.{position}"
            self.lines += [
                f"{address} = getelementptr inbounds {self.type}, ptr {pointer}, i64 {position}",
                f"store {self.type} {value}, ptr {address}, align {self.alignment}",
            ]


class SampleWriter(ArrayWriter):
    """The function of one sample."""

    return_type = "void"

    def __init__(self, program: Program, constants: Mapping[int, float], slots: Mapping[int, int]) -> None:
        super().__init__(program, constants, slots, 1)

    def sincos(self, step: Step) -> None:
        """Emit the sines and cosines of all angles of the step in one vector of sufficient width."""
        lanes = vector_width(len(step.operands))
        V = vector_type(lanes)
        name = f"%angles{step.operands[0]}"
        packed = "zeroinitializer"
        for lane, angle in enumerate(step.operands):
            self.lines.append(f"{name}.{lane} = insertelement {V} {packed}, double {self.value(angle)}, i64 {lane}")
            packed = f"{name}.{lane}"
        self.lines.append(f"{name}.both = call {{{V}, {V}}} @sincos_anywhere{lanes}({V} {packed})")
        for index, letter, nodes in ((0, "s", step.results[::2]), (1, "c", step.results[1::2])):
            self.lines.append(f"{name}.{letter} = extractvalue {{{V}, {V}}} {name}.both, {index}")
            self.lines += [
                f"%v{node} = extractelement {V} {name}.{letter}, i64 {lane}"
                for lane, node in enumerate(nodes)
                if node is not None
            ]

    def result(self) -> str:
        return ""

    def combine_results(self, lines: list[str], results: Sequence[str]) -> str:
        return ""


class VectorWriter(IRWriter):
    """A function of several samples, whose values are vectors with an entry for each.

    It returns a bit for each lane in which some angle was out of range: the outputs of such lanes are wrong.
    """

    def __init__(self, program: Program, constants: Mapping[int, float], slots: Mapping[int, int], lanes: int) -> None:
        super().__init__(program, constants, slots, lanes)
        self.return_type = f"i{lanes}"
        self.out_of_range: list[str] = []

    def sincos(self, step: Step) -> None:
        angle = self.value(step.operands[0])
        V = self.type
        name = f"%angle{step.operands[0]}"
        self.lines += [
            *out_of_range_mask(f"{name[1:]}.wide", angle, self.lanes),
            f"{name}.both = call {{{V}, {V}}} @sincos{self.lanes}({V} {angle})",
        ]
        self.out_of_range.append(f"{name}.wide")
        for index, node in enumerate(step.results):
            if node is not None:
                self.lines.append(f"%v{node} = extractvalue {{{V}, {V}}} {name}.both, {index}")

    def result(self) -> str:
        return self.combine_results(self.lines, self.out_of_range)

    def combine_results(self, lines: list[str], results: Sequence[str]) -> str:
        """Append lines for the bits that are set in any result, and return the operand that has them."""
        combined = "0"
        for number, mask in enumerate(results):
            lines.append(f"%any{number} = or {self.return_type} {combined}, {mask}")
            combined = f"%any{number}"
        return combined


class LaneWriter(ArrayWriter, VectorWriter):
    """The function of several samples whose arrays are in memory as vectors."""

    def __init__(self, program: Program, constants: Mapping[int, float], slots: Mapping[int, int], lanes: int) -> None:
        super().__init__(program, constants, slots, lanes)
        self.alignment = 8 * lanes


class BlockWriter(VectorWriter):
    """The function of a block of samples: lane i computes sample %first + i, or %last if that is less.

    Each row of an array is a sample.
    """

    def __init__(self, program: Program, constants: Mapping[int, float], slots: Mapping[int, int], lanes: int) -> None:
        super().__init__(program, constants, slots, lanes)
        self.addressed: set[int] = set()
        self.prefetch_lines: list[list[str]] = []
        self.prefetched = 0

    def load(self, step: Step) -> None:
        for array, (name, nodes) in enumerate(input_nodes(self.program).items()):
            if nodes:
                self.lines += row_pointers(array, self.lanes)
                self.lines += read_columns(array, self.program.inputs[name], nodes, self.lanes)

    def write(self, part: Part) -> list[str]:
        """The lines of a Part; the last part prefetches the inputs of the next block.

        The processor itself prefetches what is read in order, but not over blocks as long as those of large robots.
        """
        if part.is_last:
            for array, (name, nodes) in enumerate(input_nodes(self.program).items()):
                if nodes:
                    self.lines += next_block_pointer(array, self.lanes)
                    self.prefetch_lines += prefetch_lines(array, self.program.inputs[name], self.lanes)
        return super().write(part)

    def emit_prefetches(self, done: float) -> None:
        """Emit prefetches evenly over the part, so that they do not delay loads."""
        end = round(len(self.prefetch_lines) * done)
        for lines in self.prefetch_lines[self.prefetched : end]:
            self.lines += lines
        self.prefetched = end

    def store(self, step: Step) -> None:
        number, start = step.target
        entries = self.program.outputs[number].entries[start : start + len(step.operands)]
        columns = [self.signed(node, sign) for node, sign in entries]
        array = len(self.program.inputs) + number
        if array not in self.addressed:
            self.addressed.add(array)
            self.lines += row_pointers(array, self.lanes)
        self.lines += write_columns(array, start, columns, self.lanes)


def vector_width(count: int) -> int:
    """The smallest power of two, from 2, that is not below a count."""
    return max(2, 1 << (count - 1).bit_length())


def sample_function(program: Program, constants: Mapping[int, float]) -> tuple[str, set[int]]:
    """IR of `@sample(ptr %pointers)`, and the widths of the vectors of which it computes sines and cosines."""
    steps = insert_stores(group_sincos(list_steps(program), MAX_SINCOS_GROUP), list_stores(program))
    widths = {vector_width(len(step.operands)) for step in steps if step.operation == SINCOS}
    length = len(steps) if len(steps) <= MAX_LENGTH else PART_LENGTH
    parts = split_into_parts(steps, even_bounds(len(steps), length))
    text = _function("sample", "ptr %pointers", parts, lambda slots: SampleWriter(program, constants, slots))
    return text, widths


def block_function(program: Program, constants: Mapping[int, float], lanes: int) -> str:
    """IR of `@block(ptr %pointers, ptr %strides, i64 %first, i64 %last)`, see BlockWriter. Strides are in bytes."""
    steps = list_steps(program)
    stores = list_stores(program)
    bounds = even_bounds(len(steps), MAX_BLOCK_LENGTH)
    if len(stores) <= MAX_BLOCK_STORES:
        bounds[-1] += len(stores)
    else:
        bounds += [len(steps) + bound for bound in even_bounds(len(stores), MAX_BLOCK_STORES)[1:]]
    parts = split_into_parts([*steps, *stores], bounds)
    arguments = "ptr %pointers, ptr %strides, i64 %first, i64 %last"
    return _function("block", arguments, parts, lambda slots: BlockWriter(program, constants, slots, lanes))


def lane_function(program: Program, constants: Mapping[int, float], lanes: int) -> str:
    """IR of `@lanes(ptr %pointers)`, see LaneWriter."""
    steps = insert_stores(list_steps(program), list_stores(program))
    parts = split_into_parts(steps, even_bounds(len(steps), MAX_BLOCK_LENGTH))
    return _function("lanes", "ptr %pointers", parts, lambda slots: LaneWriter(program, constants, slots, lanes))


def _function(
    name: str, arguments: str, parts: Sequence[Part], make_writer: Callable[[Mapping[int, int]], IRWriter]
) -> str:
    """IR of a function, with one internal function for each part if there are several."""
    if len(parts) == 1:
        writer = make_writer({})
        lines = writer.write(parts[0])
        return _definition("define", writer.return_type, f"@{name}({arguments})", lines, writer.result())
    slots = {node: index for index, node in enumerate(node for part in parts for node in part.live_out)}
    definitions, calls, results = [], [], []
    for number, part in enumerate(parts):
        writer = make_writer(slots)
        head = f"@{name}.{number}({arguments}, ptr %scratch)"
        lines = writer.write(part)
        definitions.append(_definition("define internal", writer.return_type, head, lines, writer.result()))
        assignment = "" if writer.return_type == "void" else f"%part{number} = "
        calls.append(f"{assignment}call {writer.return_type} {head}")
        results.append(f"%part{number}")
    lines = [f"%scratch = alloca [{len(slots)} x {writer.type}], align 64", *calls]
    result = writer.combine_results(lines, results)
    definitions.append(_definition("define", writer.return_type, f"@{name}({arguments})", lines, result))
    return "\n".join(definitions)


def _definition(linkage: str, return_type: str, head: str, lines: Sequence[str], result: str) -> str:
    return "\n".join([f"{linkage} {return_type} {head} noinline {{", *lines, f"ret {return_type} {result}", "}"])
