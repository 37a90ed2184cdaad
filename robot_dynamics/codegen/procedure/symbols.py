"""Symbols of a procedure: numbers, conditions and counters, as operands of LLVM IR.

Each operation on a symbol appends an instruction to the text of the function.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.codegen.jit.sincos import double_literal

if TYPE_CHECKING:
    from robot_dynamics.codegen.procedure.function_text import FunctionText


class Symbol:
    """A value that is known when the code runs: an operand in the text of a function."""

    __slots__ = ("operand", "text")

    def __init__(self, text: FunctionText, operand: str) -> None:
        self.text = text
        self.operand = operand

    def __bool__(self) -> bool:
        raise TypeError(f"{type(self).__name__} has no truth value before the procedure runs: use `if`, or `select`")


class Condition(Symbol):
    """True or false."""

    __slots__ = ()

    def _combine(self, operation: str, other: object) -> Condition:
        return Condition(self.text, self.text.assign(f"{operation} i1 {self.operand}, {condition_operand(other)}"))

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

    def _result(self, instruction: str) -> Number:
        return Number(self.text, self.text.assign(instruction))

    def _combine(self, operation: str, other: object, is_reversed: bool = False) -> Any:
        if not isinstance(other, NUMBERS):
            return NotImplemented  # an array combines each of its entries
        a, b = self.operand, number_operand(other)
        if is_reversed:
            a, b = b, a
        return self._result(f"{operation} double {a}, {b}")

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
        return self._result(f"fneg double {self.operand}")

    def __pos__(self) -> Number:
        return self

    def _compare(self, relation: str, other: object) -> Any:
        if not isinstance(other, NUMBERS):
            return NotImplemented
        return Condition(self.text, self.text.assign(f"fcmp {relation} double {self.operand}, {number_operand(other)}"))

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
        return self._result(f"call double @library(i64 0, double {self.operand})")

    def cos(self) -> Number:
        """The cosine."""
        return self._result(f"call double @library(i64 1, double {self.operand})")

    def signum(self) -> Number:
        """1, -1 or 0 of a positive, negative or zero number; nan of nan."""
        positive = self._result(f"select i1 {(self > 0).operand}, double 1.0, double {self.operand}")
        return self._result(f"select i1 {(self < 0).operand}, double -1.0, double {positive.operand}")

    def _intrinsic(self, name: str) -> Number:
        return self._result(f"call double @llvm.{name}.f64(double {self.operand})")


class Counter(Symbol):
    """A 64-bit integer: the number of a round, or an index."""

    __slots__ = ()

    def _combine(self, operation: str, other: object) -> Counter:
        return Counter(self.text, self.text.assign(f"{operation} i64 {self.operand}, {counter_operand(other)}"))

    def __add__(self, other: object) -> Counter:
        return self._combine("add", other)

    def __sub__(self, other: object) -> Counter:
        return self._combine("sub", other)

    def __rsub__(self, other: object) -> Counter:
        return Counter(self.text, self.text.assign(f"sub i64 {counter_operand(other)}, {self.operand}"))

    def __mul__(self, other: object) -> Counter:
        return self._combine("mul", other)

    __radd__ = __add__
    __rmul__ = __mul__

    def _compare(self, relation: str, other: object) -> Condition:
        return Condition(self.text, self.text.assign(f"icmp {relation} i64 {self.operand}, {counter_operand(other)}"))

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


def number_operand(value: object) -> str:
    """A Number or a constant as an operand."""
    if isinstance(value, Number):
        return value.operand
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return number_operand(value[()])
    if isinstance(value, Symbol):
        raise TypeError(f"a {type(value).__name__} is not a number")
    return double_literal(float(value))  # type: ignore[arg-type]  # float() refuses all but numbers


def condition_operand(value: object) -> str:
    """A Condition or a constant as an operand."""
    if isinstance(value, Condition):
        return value.operand
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    raise TypeError(f"{value!r:.40} is not a condition")


def counter_operand(value: object) -> str:
    """A Counter or a constant integer as an operand."""
    if isinstance(value, Counter):
        return value.operand
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        return str(int(value))
    raise TypeError(f"{value!r:.40} is not an integer")


def _is_constant(value: object, number: int) -> bool:
    return isinstance(value, int | float | np.number) and value == number
