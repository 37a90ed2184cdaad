"""Steps of a program as lines of LLVM IR, for doubles or vectors of doubles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from robot_dynamics.codegen.jit.schedule import LOAD, SINCOS, STORE
from robot_dynamics.codegen.jit.sincos import double_literal, splat, vector_type
from robot_dynamics.codegen.trace.scalar import ADD, DIVIDE, MULTIPLY, SIGN, SQUARE_ROOT, SUBTRACT

if TYPE_CHECKING:
    from robot_dynamics.codegen.jit.schedule import Part, Step, StepOperation
    from robot_dynamics.codegen.trace.program import Program

INSTRUCTIONS: dict[StepOperation, str] = {
    ADD: "fadd contract",
    SUBTRACT: "fsub contract",
    MULTIPLY: "fmul contract",
    DIVIDE: "fdiv",
}
"""`contract` allows a b + c to be rounded once; nothing is reordered, and nan and inf keep their meaning."""


class IRWriter:
    """The lines of one function, and the nodes that have a value there.

    Subclasses emit loads, stores, sines and cosines.

    Parameters
    ----------
    program : Program
    constants : mapping of int to float
        Value of each node that is known before a call.
    slots : mapping of int to int
        Index in %scratch of each node that one part of the program computes for later parts.
    lanes : int
        Samples in a value; 1 for plain doubles.
    """

    return_type: str
    """LLVM type that the function returns."""

    def __init__(self, program: Program, constants: Mapping[int, float], slots: Mapping[int, int], lanes: int) -> None:
        self.program = program
        self.constants = constants
        self.slots = slots
        self.lanes = lanes
        self.type = "double" if lanes == 1 else vector_type(lanes)
        self.intrinsic_suffix = "f64" if lanes == 1 else f"v{lanes}f64"
        self.available: set[int | None] = set()
        self.lines: list[str] = []

    def write(self, part: Part) -> list[str]:
        """The lines of a Part."""
        emitters: dict[StepOperation, Callable[[Step], None]] = {
            LOAD: self.load,
            STORE: self.store,
            SINCOS: self.sincos,
            SQUARE_ROOT: self.square_root,
            SIGN: self.sign,
        }
        for count, step in enumerate(part.steps, start=1):
            emitters.get(step.operation, self.arithmetic)(step)
            self.available.update(step.results)
            self.emit_prefetches(count / len(part.steps))
        for node in part.live_out:
            self.lines.append(f"store {self.type} {self.value(node)}, ptr {self.slot(node)}, align 8")
        return self.lines

    def load(self, step: Step) -> None:
        """Emit the loads of the inputs."""
        raise NotImplementedError

    def store(self, step: Step) -> None:
        """Emit the stores of the outputs."""
        raise NotImplementedError

    def sincos(self, step: Step) -> None:
        """Emit the sines and cosines of a step."""
        raise NotImplementedError

    def result(self) -> str:
        """The operand that the function returns, empty if it returns nothing."""
        raise NotImplementedError

    def combine_results(self, lines: list[str], results: Sequence[str]) -> str:
        """Append lines that combine the results of all parts, and return the operand with the combination."""
        raise NotImplementedError

    def emit_prefetches(self, done: float) -> None:
        """Emit prefetches up to the fraction `done` of the part."""

    def literal(self, value: float) -> str:
        """A number as an operand."""
        return double_literal(value) if self.lanes == 1 else splat(double_literal(value))

    def slot(self, node: int) -> str:
        """The address of a node in %scratch."""
        name = f"%slot{len(self.lines)}"
        self.lines.append(f"{name} = getelementptr inbounds {self.type}, ptr %scratch, i64 {self.slots[node]}")
        return name

    def value(self, node: int) -> str:
        """A node as an operand."""
        if node in self.constants:
            return self.literal(self.constants[node])
        if node not in self.available:
            self.lines.append(f"%v{node} = load {self.type}, ptr {self.slot(node)}, align 8")
            self.available.add(node)
        return f"%v{node}"

    def signed(self, node: int, sign: int) -> str:
        """A node or its negative as an operand."""
        if node in self.constants:
            return self.literal(sign * self.constants[node])
        if sign > 0:
            return self.value(node)
        name = f"%minus{len(self.lines)}"
        self.lines.append(f"{name} = fneg {self.type} {self.value(node)}")
        return name

    def arithmetic(self, step: Step) -> None:
        """Emit a binary operation."""
        a, b = (self.value(node) for node in step.operands)
        self.lines.append(f"%v{step.results[0]} = {INSTRUCTIONS[step.operation]} {self.type} {a}, {b}")

    def square_root(self, step: Step) -> None:
        """Emit a square root."""
        a = self.value(step.operands[0])
        self.lines.append(f"%v{step.results[0]} = call {self.type} @llvm.sqrt.{self.intrinsic_suffix}({self.type} {a})")

    def sign(self, step: Step) -> None:
        """Emit a sign: 1, -1 or 0 of a positive, negative or zero number; nan of nan."""
        a = self.value(step.operands[0])
        name = f"%v{step.results[0]}"
        bits = "i1" if self.lanes == 1 else f"<{self.lanes} x i1>"
        selected = a
        for relation, value in (("oeq", 0.0), ("olt", -1.0), ("ogt", 1.0)):
            result = name if relation == "ogt" else f"{name}.{relation}"
            operands = f"{self.type} {self.literal(value)}, {self.type} {selected}"
            self.lines += [
                f"{name}.is.{relation} = fcmp {relation} {self.type} {a}, {self.literal(0.0)}",
                f"{result} = select {bits} {name}.is.{relation}, {operands}",
            ]
            selected = result
