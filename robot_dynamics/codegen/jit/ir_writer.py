"""Writes steps of a program as lines of LLVM IR, for numbers of one kind: doubles, or vectors of them."""

from robot_dynamics.codegen.jit.schedule import LOAD, SINCOS, STORE
from robot_dynamics.codegen.jit.sincos import double_literal, splat, vector_type
from robot_dynamics.codegen.trace.scalar import ADD, DIVIDE, MULTIPLY, SIGN, SQUARE_ROOT, SUBTRACT

# `contract` allows a b + c to be rounded once; nothing is reordered, and nan and inf are what they are
INSTRUCTIONS = {ADD: "fadd contract", SUBTRACT: "fsub contract", MULTIPLY: "fmul contract", DIVIDE: "fdiv"}


class IRWriter:
    """The lines of one function, and which nodes have a value there.

    known: {node: float}. slots: {node: place} in %scratch of what passes from one part of a program to another. lanes:
    samples in a number, 1 for plain doubles. Subclasses write how inputs come in and outputs go out, and sines and
    cosines.
    """

    def __init__(self, program, known, slots, lanes):
        self.program, self.known, self.slots, self.lanes = program, known, slots, lanes
        self.type, self.intrinsic = ("double", "f64") if lanes == 1 else (vector_type(lanes), f"v{lanes}f64")
        self.available, self.lines = set(), []

    def write(self, part):
        """The lines of a Part."""
        special = {
            LOAD: self.load,
            STORE: self.store,
            SINCOS: self.sincos,
            SQUARE_ROOT: self.square_root,
            SIGN: self.sign,
        }
        for place, step in enumerate(part.steps, start=1):
            special.get(step.operation, self.arithmetic)(step)
            self.available.update(step.results)
            self.emit_prefetches(place / len(part.steps))
        for node in part.live_out:
            self.lines.append(f"store {self.type} {self.value(node)}, ptr {self.slot(node)}, align 8")
        return self.lines

    def emit_prefetches(self, done):
        """Write what goes on beside the steps, once so much of a part, up to 1, is written."""

    def literal(self, value):
        return double_literal(value) if self.lanes == 1 else splat(double_literal(value))

    def slot(self, node):
        self.lines.append(
            f"%slot{len(self.lines)} = getelementptr inbounds {self.type}, ptr %scratch, i64 {self.slots[node]}"
        )
        return f"%slot{len(self.lines) - 1}"

    def value(self, node):
        """The node as an operand."""
        if node in self.known:
            return self.literal(self.known[node])
        if node not in self.available:
            self.lines.append(f"%v{node} = load {self.type}, ptr {self.slot(node)}, align 8")
            self.available.add(node)
        return f"%v{node}"

    def signed(self, node, sign):
        """The node or its negative as an operand."""
        if node in self.known:
            return self.literal(sign * self.known[node])
        if sign > 0:
            return self.value(node)
        name = f"%minus{len(self.lines)}"
        self.lines.append(f"{name} = fneg {self.type} {self.value(node)}")
        return name

    def arithmetic(self, step):
        a, b = (self.value(node) for node in step.operands)
        self.lines.append(f"%v{step.results[0]} = {INSTRUCTIONS[step.operation]} {self.type} {a}, {b}")

    def square_root(self, step):
        a = self.value(step.operands[0])
        self.lines.append(f"%v{step.results[0]} = call {self.type} @llvm.sqrt.{self.intrinsic}({self.type} {a})")

    def sign(self, step):
        """1, -1 or 0 as the number is positive, negative or zero; nan of nan."""
        a, name = self.value(step.operands[0]), f"%v{step.results[0]}"
        bits = "i1" if self.lanes == 1 else f"<{self.lanes} x i1>"
        result = a
        for relation, value in (("oeq", 0.0), ("olt", -1.0), ("ogt", 1.0)):
            last = name if relation == "ogt" else f"{name}.{relation}"
            self.lines += [
                f"{name}.is.{relation} = fcmp {relation} {self.type} {a}, {self.literal(0.0)}",
                f"{last} = select {bits} {name}.is.{relation}, {self.type} {self.literal(value)}, {self.type} {result}",
            ]
            result = last
