"""The two functions of a program in LLVM IR: of one sample, and of as many samples as a vector has lanes.

Both read all inputs before they write an output. A long program is cut into parts, each a function of its own, because
the time to compile a function grows faster than its length; what a part leaves to later ones lies in memory.
"""

from robot_dynamics.codegen.jit.ir_writer import IRWriter
from robot_dynamics.codegen.jit.row_transpose import (
    next_block_pointer,
    prefetch_lines,
    read_columns,
    row_pointers,
    write_columns,
)
from robot_dynamics.codegen.jit.schedule import SINCOS, STORE, group_sincos, list_steps, split_into_parts
from robot_dynamics.codegen.jit.sincos import out_of_range_mask, vector_type
from robot_dynamics.codegen.trace.scalar import INPUT

MAX_PART_LENGTH = 5000
MAX_SINCOS_GROUP = 8


def input_nodes(program):
    """{name: {place: node}} of the entries of inputs that the program reads."""
    places = {name: {} for name in program.inputs}
    for leaf in program.leaves:
        if leaf.operation == INPUT:
            name, place = leaf.operands
            places[name][place] = leaf.number
    return places


class SampleWriter(IRWriter):
    """One sample: %pointers leads to the address of each input, then of each output."""

    def __init__(self, program, known, slots):
        super().__init__(program, known, slots, 1)
        self.return_type = "void"

    def array(self, place):
        self.lines += [
            f"%array{place}.at = getelementptr inbounds ptr, ptr %pointers, i64 {place}",
            f"%array{place} = load ptr, ptr %array{place}.at, align 8",
        ]
        return f"%array{place}"

    def load(self, step):
        for array, nodes in enumerate(input_nodes(self.program).values()):
            pointer = self.array(array)
            for place, node in nodes.items():
                self.lines += [
                    f"%v{node}.at = getelementptr inbounds double, ptr {pointer}, i64 {place}",
                    f"%v{node} = load double, ptr %v{node}.at, align 1",
                ]

    def store(self, step):
        values = [self.signed(node, sign) for output in self.program.outputs for node, sign in output.entries]
        values.reverse()
        for array, output in enumerate(self.program.outputs, start=len(self.program.inputs)):
            pointer = self.array(array)
            for place in range(len(output.entries)):
                at = f"%out{array}.{place}"
                self.lines += [
                    f"{at} = getelementptr inbounds double, ptr {pointer}, i64 {place}",
                    f"store double {values.pop()}, ptr {at}, align 1",
                ]

    def sincos(self, step):
        """All angles of the step in one vector, as wide as it takes."""
        lanes = vector_width(len(step.operands))
        V, name = vector_type(lanes), f"%angles{step.operands[0]}"
        packed = "zeroinitializer"
        for lane, node in enumerate(step.operands):
            self.lines.append(f"{name}.{lane} = insertelement {V} {packed}, double {self.value(node)}, i64 {lane}")
            packed = f"{name}.{lane}"
        self.lines.append(f"{name}.both = call {{{V}, {V}}} @sincos_anywhere{lanes}({V} {packed})")
        for which, nodes in enumerate((step.results[::2], step.results[1::2])):
            self.lines.append(f"{name}.{'sc'[which]} = extractvalue {{{V}, {V}}} {name}.both, {which}")
            self.lines += [
                f"%v{node} = extractelement {V} {name}.{'sc'[which]}, i64 {lane}"
                for lane, node in enumerate(nodes)
                if node is not None
            ]

    def result(self):
        return ""

    def combine_results(self, lines, results):
        return ""


class BlockWriter(IRWriter):
    """A sample in each lane: lane i has sample %first + i, or %last if that is less, of arrays whose rows are samples.

    Gives the lanes of which some angle was out of range: there the outputs are wrong.
    """

    def __init__(self, program, known, slots, lanes):
        super().__init__(program, known, slots, lanes)
        self.return_type, self.out_of_range, self.prefetch_lines, self.prefetched = f"i{lanes}", [], [], 0

    def load(self, step):
        for array, (name, nodes) in enumerate(input_nodes(self.program).items()):
            if nodes:
                self.lines += row_pointers(array, self.lanes)
                self.lines += read_columns(array, self.program.inputs[name], nodes, self.lanes)

    def write(self, part):
        """The lines of a Part; the last one fetches what the next block reads.

        The processor foresees what is read in order, but not where a block takes as long as those of large robots.
        """
        if part.steps[-1].operation == STORE:
            for array, (name, nodes) in enumerate(input_nodes(self.program).items()):
                if nodes:
                    self.lines += next_block_pointer(array, self.lanes)
                    self.prefetch_lines += prefetch_lines(array, self.program.inputs[name], self.lanes)
        return super().write(part)

    def emit_prefetches(self, done):
        """A few fetches at a time, so that loads need not wait for them."""
        until = round(len(self.prefetch_lines) * done)
        for lines in self.prefetch_lines[self.prefetched : until]:
            self.lines += lines
        self.prefetched = until

    def store(self, step):
        values = [[self.signed(node, sign) for node, sign in output.entries] for output in self.program.outputs]
        for array, columns in enumerate(values, start=len(self.program.inputs)):
            if columns:
                self.lines += row_pointers(array, self.lanes)
                self.lines += write_columns(array, columns, self.lanes)

    def sincos(self, step):
        angle, V = self.value(step.operands[0]), self.type
        name = f"%angle{step.operands[0]}"
        self.lines += [
            *out_of_range_mask(f"{name[1:]}.wide", angle, self.lanes),
            f"{name}.both = call {{{V}, {V}}} @sincos{self.lanes}({V} {angle})",
        ]
        self.out_of_range.append(f"{name}.wide")
        for which, node in enumerate(step.results):
            if node is not None:
                self.lines.append(f"%v{node} = extractvalue {{{V}, {V}}} {name}.both, {which}")

    def result(self):
        return self.combine_results(self.lines, self.out_of_range)

    def combine_results(self, lines, results):
        """Appends lines for the bits that are set in any of the results, and gives the operand that has them."""
        joined = "0"
        for place, mask in enumerate(results):
            lines.append(f"%any{place} = or {self.return_type} {joined}, {mask}")
            joined = f"%any{place}"
        return joined


def vector_width(count):
    """The least power of two, from 2, that is not below a count."""
    return max(2, 1 << (count - 1).bit_length())


def sample_function(program, known):
    """IR of `@sample(ptr %pointers)`, and the widths of vectors that it takes sines and cosines of."""
    steps = group_sincos(list_steps(program), MAX_SINCOS_GROUP)
    widths = {vector_width(len(step.operands)) for step in steps if step.operation == SINCOS}
    parts = split_into_parts(steps, MAX_PART_LENGTH)
    return _function("sample", "ptr %pointers", parts, lambda slots: SampleWriter(program, known, slots)), widths


def block_function(program, known, lanes):
    """IR of `@block(ptr %pointers, ptr %strides, i64 %first, i64 %last)`, see BlockWriter. Strides are in bytes."""
    parts = split_into_parts(list_steps(program), MAX_PART_LENGTH)
    arguments = "ptr %pointers, ptr %strides, i64 %first, i64 %last"
    return _function("block", arguments, parts, lambda slots: BlockWriter(program, known, slots, lanes))


def _function(name, arguments, parts, writer_of):
    if len(parts) == 1:
        writer = writer_of({})
        return _defined("define", writer.return_type, f"@{name}({arguments})", writer.write(parts[0]), writer.result())
    slots = {node: place for place, node in enumerate(node for part in parts for node in part.live_out)}
    texts, calls, results = [], [], []
    for place, part in enumerate(parts):
        writer = writer_of(slots)
        head = f"@{name}.{place}({arguments}, ptr %scratch)"
        texts.append(_defined("define internal", writer.return_type, head, writer.write(part), writer.result()))
        calls.append(f"{'' if writer.return_type == 'void' else f'%part{place} = '}call {writer.return_type} {head}")
        results.append(f"%part{place}")
    lines = [f"%scratch = alloca [{len(slots)} x {writer.type}], align 64", *calls]
    result = writer.combine_results(lines, results)
    return "\n".join([*texts, _defined("define", writer.return_type, f"@{name}({arguments})", lines, result)])


def _defined(linkage, gives, head, lines, result):
    return "\n".join([f"{linkage} {gives} {head} noinline {{", *lines, f"ret {gives} {result}", "}"])
