"""Recorded expressions have the values of the same expressions in exact rational arithmetic."""

from fractions import Fraction

import numpy as np
import pytest

from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import ADD, CONSTANT, INPUT, MULTIPLY, PARAMETER, SUBTRACT, Trace

STEPS = 60
INPUTS = 4


def rational_value(program, inputs, parameters):
    """The outputs of a program of sums and products, as Fractions."""
    values = {}
    for number, operation, operands in program.leaves:
        if operation == INPUT:
            values[number] = inputs[operands[1]]
        else:
            values[number] = {PARAMETER: parameters.get, CONSTANT: Fraction}[operation](operands[0])
    rules = {ADD: Fraction.__add__, SUBTRACT: Fraction.__sub__, MULTIPLY: Fraction.__mul__}
    for number, operation, operands in (*program.setup, *program.statements):
        values[number] = rules[operation](*(values[operand] for operand in operands))
    return [sign * values[node] for output in program.outputs for node, sign in output.entries]


@pytest.mark.parametrize("seed", range(100))
def test_random_expressions_have_their_exact_values(seed):
    """Sums and products of inputs, parameters and small integers, many of which have common terms and factors."""
    rng = np.random.default_rng(seed)
    trace = Trace()
    inputs = [Fraction(int(value)) for value in rng.integers(-9, 10, INPUTS)]
    parameters = {"h": Fraction(3), "k": Fraction(-5)}
    recorded = [*trace.input("x", INPUTS), *trace.parameters(list(parameters)), *(trace.constant(n) for n in (0, 1, 3))]
    exact = [*inputs, *parameters.values(), *map(Fraction, (0, 1, 3))]
    for _ in range(STEPS):
        a, b = rng.integers(0, len(exact), 2)
        operation = rng.choice(["__add__", "__sub__", "__mul__"])
        result = getattr(exact[a], operation)(exact[b])
        if abs(result) < 2**40:  # constants of the trace are doubles
            recorded.append(getattr(recorded[a], operation)(recorded[b]))
            exact.append(result)
    program = build_program(trace, "random", {"x": INPUTS}, {"out": np.array(recorded, dtype=object)})
    assert rational_value(program, inputs, parameters) == exact


def operation_count(expression):
    """× and + of an expression of inputs x, y and a parameter p."""
    trace = Trace()
    x, y = trace.input("x", 2)
    program = build_program(trace, "sum", {"x": 2}, {"out": np.array([expression(x, y, trace.parameter("p"))])})
    return program.operations[:2]


def test_known_factors_of_a_common_term_are_added_before_the_call():
    assert operation_count(lambda x, y, p: x * 3.0 + x * 4.0) == (1, 0)
    assert operation_count(lambda x, y, p: x * 3.0 - x) == (1, 0)
    assert operation_count(lambda x, y, p: x * p + x * 2.0) == (1, 0)
    assert operation_count(lambda x, y, p: p * x - x * p) == (0, 0)
    assert operation_count(lambda x, y, p: x * 3.0 + y * 3.0) == (2, 1)
    assert operation_count(lambda x, y, p: x * y + x) == (1, 1)  # y is an input
    assert operation_count(lambda x, y, p: x + x) == (0, 1)
