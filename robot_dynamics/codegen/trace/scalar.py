"""Scalars that record the operations on them: a recursion run once with them leaves a straight-line program.

Known values are not computed: 0 and ±1 are folded, operations on constants give constants, a term that is added and
subtracted cancels, and an operation that was recorded before, up to its sign, is reused (hash-consing). A sign costs
nothing: a Scalar is a node and a sign, and sums and products are recorded for positive operands in one order, so that
a - b and b - a are one node.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray

Operation: TypeAlias = Literal[
    "input", "parameter", "constant", "add", "subtract", "multiply", "divide", "sin", "cos", "sqrt", "sign"
]
"""The operation of a node."""

INPUT: Literal["input"] = "input"
PARAMETER: Literal["parameter"] = "parameter"
CONSTANT: Literal["constant"] = "constant"
ADD: Literal["add"] = "add"
SUBTRACT: Literal["subtract"] = "subtract"
MULTIPLY: Literal["multiply"] = "multiply"
DIVIDE: Literal["divide"] = "divide"
SINE: Literal["sin"] = "sin"
COSINE: Literal["cos"] = "cos"
SQUARE_ROOT: Literal["sqrt"] = "sqrt"
SIGN: Literal["sign"] = "sign"
LEAVES = (INPUT, PARAMETER, CONSTANT)

Operands: TypeAlias = tuple[Any, ...]
"""Node numbers; of an input its name and position in the array, of a parameter its name, of a constant its value."""

Node: TypeAlias = tuple[Operation, Operands]
"""An operation and its operands."""

Number: TypeAlias = "float | np.floating[Any] | np.integer[Any]"
"""A real number."""

NUMBERS = (float, int)  # and numpy.float64, which is a float

CONSTANT_FUNCTIONS: dict[str, Callable[[float], float]] = {
    SINE: math.sin,
    COSINE: math.cos,
    SQUARE_ROOT: math.sqrt,
    SIGN: np.sign,
}


class Trace:
    """The recorded nodes, in the order of their first use.

    Attributes
    ----------
    nodes : list of (operation, operands)
        Operands are numbers of earlier nodes; those of leaves see `Operands`. Constants are not negative.
    """

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._numbers: dict[Node, int] = {}
        self._is_fixed: list[bool] = []
        self.zero = self.constant(0)
        """The constant zero."""

    def input(self, name: str, size: int) -> ScalarArray:
        """Scalars (size,) of an array that is an argument of each call."""
        return self._array([self._leaf((INPUT, (name, position))) for position in range(size)])

    def parameters(self, names: Sequence[str]) -> ScalarArray:
        """Scalars (len(names),) of numbers of the robot that have a name instead of a value."""
        return self._array([self._leaf((PARAMETER, (name,))) for name in names])

    def parameter(self, name: str) -> Scalar:
        """The Scalar of one named number of the robot."""
        return self._leaf((PARAMETER, (name,)))

    def constant(self, value: Number) -> Scalar:
        """The Scalar of a number."""
        value = float(value)
        return Scalar(self, self._number((CONSTANT, (abs(value),))), -1 if math.copysign(1.0, value) < 0 else 1)

    @staticmethod
    def _array(scalars: Sequence[Scalar]) -> ScalarArray:
        array = np.empty(len(scalars), dtype=object)
        array[:] = scalars
        return array

    def _leaf(self, node: Node) -> Scalar:
        return Scalar(self, self._number(node), 1)

    def _number(self, node: Node) -> int:
        """The number of a node, recorded if it is new."""
        number = self._numbers.get(node)
        if number is None:
            number = self._numbers[node] = len(self.nodes)
            self.nodes.append(node)
            operation, operands = node
            is_fixed = operation != INPUT if operation in LEAVES else all(self._is_fixed[k] for k in operands)
            self._is_fixed.append(is_fixed)
        return number

    def constant_value(self, number: int) -> float | None:
        """The value of a node that is a constant, None of any other."""
        operation, operands = self.nodes[number]
        if operation != CONSTANT:
            return None
        value: float = operands[0]
        return value

    def sum(self, a: Scalar, b: Scalar) -> Scalar:
        """a + b."""
        x = self.constant_value(a.node)
        y = self.constant_value(b.node)
        if x is not None and y is not None:
            return self.constant(a.sign * x + b.sign * y)
        if x == 0:
            return b
        if y == 0:
            return a
        if a.node == b.node and a.sign != b.sign:
            return self.constant(0)
        for term, total in ((a, b), (b, a)):
            remainder = self._cancel_term(term, total)
            if remainder is not None:
                return remainder
        common = self._sum_with_common_factor(a, b)
        if common is not None:
            return common
        if b.node < a.node:
            a, b = b, a
        operation: Operation = ADD if a.sign == b.sign else SUBTRACT
        return Scalar(self, self._number((operation, (a.node, b.node))), a.sign)

    def _cancel_term(self, term: Scalar, total: Scalar) -> Scalar | None:
        """The other term of `total`, a sum of which `term` is the negative of a term, as in a - (a + b); else None."""
        operation, operands = self.nodes[total.node]
        if operation not in (ADD, SUBTRACT):
            return None
        signs = total.sign, total.sign if operation == ADD else -total.sign
        for cancelled, remaining in ((0, 1), (1, 0)):
            if operands[cancelled] == term.node and signs[cancelled] == -term.sign:
                return Scalar(self, operands[remaining], signs[remaining])
        return None

    def _sum_with_common_factor(self, a: Scalar, b: Scalar) -> Scalar | None:
        """(h + k) x for h x + k x with numbers h and k that are known before a call; None for other terms."""
        x, h = self._factor_and_coefficient(a)
        y, k = self._factor_and_coefficient(b)
        if x != y or h == k or self._is_fixed[x]:
            return None
        coefficients = (self.constant(1) if node is None else Scalar(self, node, 1) for node in (h, k))
        total = self.sum(*(node if term.sign > 0 else -node for node, term in zip(coefficients, (a, b), strict=True)))
        return self.product(Scalar(self, x, 1), total)

    def _factor_and_coefficient(self, term: Scalar) -> tuple[int, int | None]:
        """Two nodes of which a term is the product but for its sign, the second known before a call; None means 1."""
        operation, operands = self.nodes[term.node]
        if operation == MULTIPLY:
            first, second = operands
            if self._is_fixed[first]:
                return second, first
            if self._is_fixed[second]:
                return first, second
        return term.node, None

    def product(self, a: Scalar, b: Scalar) -> Scalar:
        """a b."""
        x = self.constant_value(a.node)
        y = self.constant_value(b.node)
        sign = a.sign * b.sign
        if x is not None and y is not None:
            return self.constant(sign * x * y)
        if x == 0 or y == 0:
            return self.zero
        if x == 1:
            return Scalar(self, b.node, sign)
        if y == 1:
            return Scalar(self, a.node, sign)
        return Scalar(self, self._number((MULTIPLY, (min(a.node, b.node), max(a.node, b.node)))), sign)

    def quotient(self, a: Scalar, b: Scalar) -> Scalar:
        """a / b; by a constant it is a product. Raises ZeroDivisionError where b is the constant zero."""
        x = self.constant_value(a.node)
        y = self.constant_value(b.node)
        sign = a.sign * b.sign
        if y is not None:
            if y == 0:
                raise ZeroDivisionError("division by an expression that is always zero")
            return self.product(a, self.constant(b.sign / y))
        if x == 0:
            return self.constant(0)
        if a.node == b.node:
            return self.constant(sign)
        return Scalar(self, self._number((DIVIDE, (a.node, b.node))), sign)

    def function(self, operation: Operation, a: Scalar) -> Scalar:
        """The sine, cosine, square root or sign of a Scalar."""
        value = self.constant_value(a.node)
        if value is not None:
            return self.constant(CONSTANT_FUNCTIONS[operation](a.sign * value))
        if operation == COSINE:
            return Scalar(self, self._number((operation, (a.node,))), 1)
        if operation in (SINE, SIGN):  # odd
            return Scalar(self, self._number((operation, (a.node,))), a.sign)
        if a.sign < 0:
            raise ValueError("the square root of a negated expression is not recorded")
        return Scalar(self, self._number((operation, (a.node,))), 1)


class Scalar:
    """A node of a Trace and a sign, with the operations that the recursions use. It has no value and no order."""

    __slots__ = ("node", "sign", "trace")

    def __init__(self, trace: Trace, node: int, sign: int) -> None:
        self.trace = trace
        self.node = node
        self.sign = sign

    @property
    def is_zero(self) -> bool:
        """Whether the Scalar is the constant zero."""
        return self.trace.constant_value(self.node) == 0

    def _combine(self, other: object, record: Callable[[Scalar, Scalar], Scalar]) -> Any:
        """The result of `record` for this Scalar and another Scalar or number."""
        if isinstance(other, np.ndarray):
            return NotImplemented  # the array combines each of its entries
        if not isinstance(other, Scalar):
            return record(self, self.trace.constant(other))  # type: ignore[arg-type]  # float() refuses all but numbers
        if other.trace is not self.trace:
            raise ValueError("scalars of two traces cannot be combined")
        return record(self, other)

    def __add__(self, other: object) -> Any:
        if isinstance(other, NUMBERS) and other == 0:  # most terms that are numbers are zeros of constant matrices
            return self
        return self._combine(other, self.trace.sum)

    def __sub__(self, other: object) -> Any:
        return self._combine(other, lambda a, b: self.trace.sum(a, -b))

    def __rsub__(self, other: object) -> Any:
        return self._combine(other, lambda a, b: self.trace.sum(b, -a))

    def __mul__(self, other: object) -> Any:
        if isinstance(other, NUMBERS):
            if other == 0:
                return self.trace.zero
            if other == 1:
                return self
        return self._combine(other, self.trace.product)

    def __truediv__(self, other: object) -> Any:
        return self._combine(other, self.trace.quotient)

    def __rtruediv__(self, other: object) -> Any:
        return self._combine(other, lambda a, b: self.trace.quotient(b, a))

    def __neg__(self) -> Scalar:
        return Scalar(self.trace, self.node, -self.sign)

    def __pos__(self) -> Scalar:
        return self

    __radd__ = __add__
    __rmul__ = __mul__

    def sin(self) -> Scalar:
        return self.trace.function(SINE, self)

    def cos(self) -> Scalar:
        return self.trace.function(COSINE, self)

    def sqrt(self) -> Scalar:
        return self.trace.function(SQUARE_ROOT, self)

    def signum(self) -> Scalar:
        return self.trace.function(SIGN, self)

    def __bool__(self) -> bool:
        raise TypeError("a recorded scalar has no truth value: a recursion must not branch on it")

    def __repr__(self) -> str:
        return f"{'-' if self.sign < 0 else ''}v{self.node}"
