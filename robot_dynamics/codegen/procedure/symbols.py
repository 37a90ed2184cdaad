"""Symbols of a procedure: numbers, conditions and counters, as operands of LLVM IR.

Each operation on a symbol appends an instruction to the text of the function. In a function that computes several
samples at once, numbers are vectors with one entry for each sample, its lane. Conditions and counters are vectors too,
unless they are the same for all samples.
"""

from __future__ import annotations

from operator import add, mul, sub
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from robot_dynamics.codegen.jit.sincos import double_literal, splat
from robot_dynamics.codegen.procedure.counter_ranges import ANY_INTEGER, Interval, combined
from robot_dynamics.codegen.procedure.ir_types import ir_type
from robot_dynamics.codegen.procedure.procedure_errors import LanesError

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot_dynamics.codegen.procedure.counter_ranges import CounterRange
    from robot_dynamics.codegen.procedure.function_text import FunctionText


class Symbol:
    """A value that is known when the code runs: an operand in the text of a function.

    Attributes
    ----------
    text : FunctionText
    operand : str
    lanes : int
        Entries of the operand: those of the function, or 1 for a value that is the same in all of its lanes.
    """

    __slots__ = ("lanes", "operand", "text")

    ELEMENT: ClassVar[str]
    """The type of an entry."""

    def __init__(self, text: FunctionText, operand: str, lanes: int | None = None) -> None:
        self.text = text
        self.operand = operand
        self.lanes = text.lanes if lanes is None else lanes

    def __bool__(self) -> bool:
        raise TypeError(f"{type(self).__name__} has no truth value before the procedure runs: use `if`, or `select`")

    @property
    def type(self) -> str:
        """The type of the operand."""
        return ir_type(self.ELEMENT, self.lanes)

    def widened(self, lanes: int) -> str:
        """The operand with a number of entries."""
        if lanes == self.lanes:
            return self.operand
        if self.lanes > 1:
            raise LanesError(f"a {type(self).__name__} that is not the same in all lanes, where it must be")
        vector = ir_type(self.ELEMENT, lanes)
        first = self.text.assign(f"insertelement {vector} poison, {self.type} {self.operand}, i64 0")
        mask = f"<{lanes} x i32> zeroinitializer"
        return self.text.assign(f"shufflevector {vector} {first}, {vector} poison, {mask}")


class Condition(Symbol):
    """True or false."""

    __slots__ = ()
    ELEMENT = "i1"

    def _combine(self, operation: str, other: object) -> Condition:
        lanes = common_lanes(self, other)
        operands = f"{self.widened(lanes)}, {condition_operand(other, lanes)}"
        return Condition(self.text, self.text.assign(f"{operation} {ir_type('i1', lanes)} {operands}"), lanes)

    def __and__(self, other: object) -> Condition:
        return self._combine("and", other)

    def __or__(self, other: object) -> Condition:
        return self._combine("or", other)

    def __invert__(self) -> Condition:
        return self._combine("xor", True)

    __rand__ = __and__
    __ror__ = __or__

    def __eq__(self, other: object) -> Any:
        raise TypeError("a Condition is not compared: use it, or `not`")

    __hash__ = None  # type: ignore[assignment]  # it has no value before the procedure runs


class Number(Symbol):
    """A double."""

    __slots__ = ()
    ELEMENT = "double"

    def _result(self, instruction: str) -> Number:
        return Number(self.text, self.text.assign(instruction))

    def _combine(self, operation: str, other: object, is_reversed: bool = False) -> Any:
        if not isinstance(other, NUMBERS):
            return NotImplemented  # an array combines each of its entries
        a, b = self.operand, number_operand(other, self.lanes)
        if is_reversed:
            a, b = b, a
        return self._result(f"{operation} {self.type} {a}, {b}")

    def __add__(self, other: object) -> Any:
        return self if _is_constant(other, 0) else self._combine("fadd contract", other)

    def __sub__(self, other: object) -> Any:
        return self if _is_constant(other, 0) else self._combine("fsub contract", other)

    def __rsub__(self, other: object) -> Any:
        return -self if _is_constant(other, 0) else self._combine("fsub contract", other, is_reversed=True)

    def __mul__(self, other: object) -> Any:
        if _is_constant(other, 0):
            return 0.0
        return self if _is_constant(other, 1) else self._combine("fmul contract", other)

    def __truediv__(self, other: object) -> Any:
        return self if _is_constant(other, 1) else self._combine("fdiv", other)

    def __rtruediv__(self, other: object) -> Any:
        return 0.0 if _is_constant(other, 0) else self._combine("fdiv", other, is_reversed=True)

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> Number:
        return self._result(f"fneg {self.type} {self.operand}")

    def __pos__(self) -> Number:
        return self

    def _compare(self, relation: str, other: object) -> Any:
        if not isinstance(other, NUMBERS):
            return NotImplemented
        operands = f"{self.operand}, {number_operand(other, self.lanes)}"
        return Condition(self.text, self.text.assign(f"fcmp {relation} {self.type} {operands}"))

    def __lt__(self, other: object) -> Any:
        return self._compare("olt", other)

    def __le__(self, other: object) -> Any:
        return self._compare("ole", other)

    def __gt__(self, other: object) -> Any:
        return self._compare("ogt", other)

    def __ge__(self, other: object) -> Any:
        return self._compare("oge", other)

    def __eq__(self, other: object) -> Any:
        return self._compare("oeq", other)

    def __ne__(self, other: object) -> Any:
        return self._compare("une", other)

    __hash__ = None  # type: ignore[assignment]  # equality is not known before the procedure runs

    def __abs__(self) -> Number:
        return self._intrinsic("fabs")

    def rint(self) -> Number:
        """The nearest integer."""
        return self._intrinsic("rint")

    def sqrt(self) -> Number:
        """The square root."""
        return self._intrinsic("sqrt")

    def sin(self) -> Number:
        """The sine."""
        return self._angle_function("sine")

    def cos(self) -> Number:
        """The cosine."""
        return self._angle_function("cosine")

    def signum(self) -> Number:
        """1, -1 or 0 of a positive, negative or zero number; nan of nan."""
        sign: Number = choose(self < 0, -1.0, choose(self > 0, 1.0, self))
        return sign

    def maximum(self, other: object) -> Number:
        """The larger of two numbers, nan if one is nan."""
        operands = f"{self.type} {self.operand}, {self.type} {number_operand(other, self.lanes)}"
        return self._result(f"call {self.type} @llvm.maximum.{self.text.number_suffix}({operands})")

    def _intrinsic(self, name: str) -> Number:
        return self._result(f"call {self.type} @llvm.{name}.{self.text.number_suffix}({self.type} {self.operand})")

    def _angle_function(self, name: str) -> Number:
        """@sine or @cosine; a lane whose angle is too large for the vector functions is left to the one-sample code."""
        if self.lanes > 1:
            is_large = self.text.assign(f"call i{self.lanes} @is_large_angle({self.type} {self.operand})")
            self.text.reject(is_large)
        return self._result(f"call {self.type} @{name}({self.type} {self.operand})")


class Counter(Symbol):
    """A 64-bit integer: the number of a round, or an index.

    Attributes
    ----------
    range : callable
        The integers that it may be.
    """

    __slots__ = ("range",)
    ELEMENT = "i64"

    def __init__(
        self, text: FunctionText, operand: str, lanes: int | None = None, range: CounterRange = ANY_INTEGER
    ) -> None:
        super().__init__(text, operand, lanes)
        self.range = range

    def _combine(self, operation: Callable[[float, float], float], other: object, is_reversed: bool = False) -> Counter:
        lanes = common_lanes(self, other)
        a, b = self.widened(lanes), counter_operand(other, lanes)
        ranges = self.range, counter_range(other)
        if is_reversed:
            a, b = b, a
            ranges = ranges[::-1]
        operand = self.text.assign(f"{operation.__name__} {ir_type('i64', lanes)} {a}, {b}")
        return Counter(self.text, operand, lanes, combined(operation, *ranges))

    def __add__(self, other: object) -> Counter:
        return self._combine(add, other)

    def __sub__(self, other: object) -> Counter:
        return self._combine(sub, other)

    def __rsub__(self, other: object) -> Counter:
        return self._combine(sub, other, is_reversed=True)

    def __mul__(self, other: object) -> Counter:
        return self._combine(mul, other)

    __radd__ = __add__
    __rmul__ = __mul__

    def _compare(self, relation: str, other: object) -> Condition:
        lanes = common_lanes(self, other)
        operands = f"{self.widened(lanes)}, {counter_operand(other, lanes)}"
        return Condition(self.text, self.text.assign(f"icmp {relation} {ir_type('i64', lanes)} {operands}"), lanes)

    def __lt__(self, other: object) -> Condition:
        return self._compare("slt", other)

    def __le__(self, other: object) -> Condition:
        return self._compare("sle", other)

    def __gt__(self, other: object) -> Condition:
        return self._compare("sgt", other)

    def __ge__(self, other: object) -> Condition:
        return self._compare("sge", other)

    def __eq__(self, other: object) -> Any:
        return self._compare("eq", other)

    def __ne__(self, other: object) -> Any:
        return self._compare("ne", other)

    __hash__ = None  # type: ignore[assignment]  # equality is not known before the procedure runs


NUMBERS = (Number, int, float, np.number)
"""Types that a Number is combined with."""


def common_lanes(*values: object) -> int:
    """The entries of the result of an operation on Symbols and constants."""
    return max(value.lanes if isinstance(value, Symbol) else 1 for value in values)


def number_operand(value: object, lanes: int) -> str:
    """A Number or a constant as an operand with a number of entries."""
    if isinstance(value, Number):
        return value.widened(lanes)
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return number_operand(value[()], lanes)
    if isinstance(value, Symbol):
        raise TypeError(f"a {type(value).__name__} is not a number")
    literal = double_literal(float(value))  # type: ignore[arg-type]  # float() refuses all but numbers
    return literal if lanes == 1 else splat(literal)


def condition_operand(value: object, lanes: int) -> str:
    """A Condition or a constant as an operand with a number of entries."""
    if isinstance(value, Condition):
        return value.widened(lanes)
    if isinstance(value, bool | np.bool_):
        literal = "true" if value else "false"
        return literal if lanes == 1 else splat(literal, "i1")
    raise TypeError(f"{_described(value)} is not a condition")


def counter_operand(value: object, lanes: int = 1) -> str:
    """A Counter or a constant integer as an operand with a number of entries."""
    if isinstance(value, Counter):
        return value.widened(lanes)
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        return str(int(value)) if lanes == 1 else splat(int(value), "i64")
    raise TypeError(f"{_described(value)} is not an integer")


def counter_range(value: object) -> CounterRange:
    """The integers that a Counter or a constant may be."""
    if isinstance(value, Counter):
        return value.range
    assert isinstance(value, int | np.integer)
    return Interval(int(value), int(value))


OPERANDS = {Number: number_operand, Condition: condition_operand, Counter: counter_operand}


def choose(condition: Condition, chosen: object, otherwise: object, kind: type[Symbol] = Number) -> Any:
    """`chosen` where the condition holds, else `otherwise`; both of one kind."""
    text = condition.text
    lanes = text.lanes if kind is Number else common_lanes(condition, chosen, otherwise)
    value_type = ir_type(kind.ELEMENT, lanes)
    first, second = (OPERANDS[kind](value, lanes) for value in (chosen, otherwise))
    operands = f"{value_type} {first}, {value_type} {second}"
    operand = text.assign(f"select {condition.type} {condition.operand}, {operands}")
    if kind is Counter:
        values = text.index_checks.new_name()
        values.add(counter_range(chosen))
        values.add(counter_range(otherwise))
        return Counter(text, operand, lanes, values)
    return kind(text, operand, lanes)


def _described(value: object) -> str:
    return f"a {type(value).__name__}" if isinstance(value, Symbol) else f"{value!r:.40}"


def _is_constant(value: object, number: int) -> bool:
    return isinstance(value, int | float | np.number) and value == number
