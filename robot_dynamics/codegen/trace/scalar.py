"""A scalar that records what is done with it, so that a recursion run once leaves a straight-line program behind.

Nothing is computed that is known: 0 and ±1 fold, constants meet constants, a term that is added and taken away goes,
and an operation that was recorded before, up to its sign, is found again by its name (hash-consing). A sign costs
nothing: a Scalar is a node and a sign, and sums and products are recorded for positive operands in one order, so that
a - b and b - a are one node.
"""

import math

import numpy as np

INPUT, PARAMETER, CONSTANT = "input", "parameter", "constant"
ADD, SUBTRACT, MULTIPLY, DIVIDE = "add", "subtract", "multiply", "divide"
SINE, COSINE, SQUARE_ROOT, SIGN = "sin", "cos", "sqrt", "sign"
LEAVES = (INPUT, PARAMETER, CONSTANT)


class Trace:
    """The nodes that were recorded, in the order of their first use: each (operation, operands).

    Operands are numbers of nodes, of which the greatest is less than the node's own; of an input (name, place) they
    are its name and the place in its array, of a parameter its name, of a constant its value, positive.
    """

    def __init__(self):
        self.nodes = []
        self._numbers = {}

    def input(self, name, size):
        """An object array (size,) of Scalars: an array that is given anew in each call."""
        return self._array([self._leaf((INPUT, (name, place))) for place in range(size)])

    def parameters(self, names):
        """An object array of Scalars: numbers of the robot that have a name instead of a value."""
        return self._array([self._leaf((PARAMETER, (name,))) for name in names])

    def parameter(self, name):
        return self._leaf((PARAMETER, (name,)))

    def constant(self, value):
        """The Scalar of a number."""
        value = float(value)
        return Scalar(self, self._number((CONSTANT, (abs(value),))), -1 if math.copysign(1.0, value) < 0 else 1)

    @staticmethod
    def _array(scalars):
        array = np.empty(len(scalars), dtype=object)
        array[:] = scalars
        return array

    def _leaf(self, node):
        return Scalar(self, self._number(node), 1)

    def _number(self, node):
        number = self._numbers.get(node)
        if number is None:
            number = self._numbers[node] = len(self.nodes)
            self.nodes.append(node)
        return number

    def constant_value(self, number):
        """The value of a node that is a constant, None of any other."""
        operation, operands = self.nodes[number]
        return operands[0] if operation == CONSTANT else None

    def sum(self, a, b):
        """a + b, for Scalars."""
        x, y = self.constant_value(a.node), self.constant_value(b.node)
        if x is not None and y is not None:
            return self.constant(a.sign * x + b.sign * y)
        if x == 0:
            return b
        if y == 0:
            return a
        if a.node == b.node and a.sign != b.sign:
            return self.constant(0)
        for one, other in ((a, b), (b, a)):
            rest = self._rest(one, other)
            if rest is not None:
                return rest
        if b.node < a.node:
            a, b = b, a
        operation = ADD if a.sign == b.sign else SUBTRACT
        return Scalar(self, self._number((operation, (a.node, b.node))), a.sign)

    def _rest(self, one, other):
        """What is left of `other`, a sum, when `one` takes a term of it away, as in a - (a + b); else None."""
        operation, operands = self.nodes[other.node]
        if operation not in (ADD, SUBTRACT):
            return None
        signs = other.sign, other.sign if operation == ADD else -other.sign
        for here, there in ((0, 1), (1, 0)):
            if operands[here] == one.node and signs[here] == -one.sign:
                return Scalar(self, operands[there], signs[there])
        return None

    def product(self, a, b):
        """a b, for Scalars."""
        x, y = self.constant_value(a.node), self.constant_value(b.node)
        sign = a.sign * b.sign
        if x is not None and y is not None:
            return self.constant(sign * x * y)
        if x == 0 or y == 0:
            return self.constant(0)
        if x == 1:
            return Scalar(self, b.node, sign)
        if y == 1:
            return Scalar(self, a.node, sign)
        return Scalar(self, self._number((MULTIPLY, (min(a.node, b.node), max(a.node, b.node)))), sign)

    def quotient(self, a, b):
        """a / b, for Scalars; by a constant it is a product."""
        x, y = self.constant_value(a.node), self.constant_value(b.node)
        sign = a.sign * b.sign
        if y is not None:
            if y == 0:
                raise ZeroDivisionError("division by what is zero whatever is given")
            return self.product(a, self.constant(b.sign / y))
        if x == 0:
            return self.constant(0)
        if a.node == b.node:
            return self.constant(sign)
        return Scalar(self, self._number((DIVIDE, (a.node, b.node))), sign)

    def function(self, operation, a):
        """A function of one Scalar."""
        value = self.constant_value(a.node)
        if value is not None:
            exact = {SINE: math.sin, COSINE: math.cos, SQUARE_ROOT: math.sqrt, SIGN: np.sign}[operation]
            return self.constant(exact(a.sign * value))
        if operation == COSINE:
            return Scalar(self, self._number((operation, (a.node,))), 1)
        if operation in (SINE, SIGN):  # odd
            return Scalar(self, self._number((operation, (a.node,))), a.sign)
        if a.sign < 0:
            raise ValueError("the square root of a negated expression is not recorded")
        return Scalar(self, self._number((operation, (a.node,))), 1)


class Scalar:
    """A node of a Trace and a sign. Has the operations that the recursions use and no other; no value, no order."""

    __slots__ = ("node", "sign", "trace")

    def __init__(self, trace, node, sign):
        self.trace, self.node, self.sign = trace, node, sign

    def _with(self, other, record):
        """What `record` makes of this Scalar and another one, or a number."""
        if isinstance(other, np.ndarray):
            return NotImplemented  # the array does it for each of its entries
        if not isinstance(other, Scalar):
            return record(self, self.trace.constant(other))
        if other.trace is not self.trace:
            raise ValueError("scalars of two traces do not go together")
        return record(self, other)

    def __add__(self, other):
        return self._with(other, self.trace.sum)

    def __sub__(self, other):
        return self._with(other, lambda a, b: self.trace.sum(a, -b))

    def __rsub__(self, other):
        return self._with(other, lambda a, b: self.trace.sum(b, -a))

    def __mul__(self, other):
        return self._with(other, self.trace.product)

    def __truediv__(self, other):
        return self._with(other, self.trace.quotient)

    def __rtruediv__(self, other):
        return self._with(other, lambda a, b: self.trace.quotient(b, a))

    def __neg__(self):
        return Scalar(self.trace, self.node, -self.sign)

    def __pos__(self):
        return self

    __radd__, __rmul__ = __add__, __mul__

    def sin(self):
        return self.trace.function(SINE, self)

    def cos(self):
        return self.trace.function(COSINE, self)

    def sqrt(self):
        return self.trace.function(SQUARE_ROOT, self)

    def signum(self):
        return self.trace.function(SIGN, self)

    def __bool__(self):
        raise TypeError("a recorded scalar has no value to decide on: the recursion must not branch on it")

    def __repr__(self):
        return f"{'-' if self.sign < 0 else ''}v{self.node}"
