"""Statements of procedures: names and `and`, `or` mean what they mean in Python, or are refused."""

import numpy as np
import pytest

pytest.importorskip("llvmlite")
from robot_dynamics.codegen.jit.procedure_code import compile_procedure
from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface
from robot_dynamics.procedures import largest, procedure, zeros

offset = 100.0  # a global name that procedures below also assign


def compiled(function):
    return compile_procedure(function.__name__, function, ProcedureInterface({"x": 2}, {"y": (2,)}))


@procedure
def store_and_compare(y, value):
    y[0] = y[0] + value
    return y[0] > 1


def call_on_the_right_of_and(x):
    y = zeros(2)
    if x[0] > 0 and store_and_compare(y, x[1]):
        y[1] = 1.0
    return y


def call_on_the_right_of_or(x):
    y = zeros(2)
    if x[0] > 0 or not store_and_compare(y, x[1]):
        y[1] = 1.0
    return y


def calls_in_several_sides(x):
    y = zeros(2)
    is_large = (x[0] > 0 and store_and_compare(y, x[1])) or (x[1] > 0 and store_and_compare(y, 2 * x[1]))
    if is_large and largest(x) > 1:
        y[1] = 1.0
    return y


def call_in_the_condition_of_a_loop(x):
    y = zeros(2)
    rounds = 0.0
    while rounds < 4 and not store_and_compare(y, x[1]):
        rounds = rounds + 1
    y[1] = rounds
    return y


@pytest.mark.parametrize(
    "function",
    [
        call_on_the_right_of_and,
        call_on_the_right_of_or,
        calls_in_several_sides,
        call_in_the_condition_of_a_loop,
    ],
)
def test_a_call_on_the_right_side_is_made_where_python_makes_it(function):
    """For one sample, and in lanes, of which some make the call."""
    program = compiled(procedure(function))
    samples = np.random.default_rng(0).normal(size=(40, 2))
    expected = np.array([function(sample) for sample in samples])
    for sample, values in zip(samples, expected, strict=True):
        np.testing.assert_allclose(program.evaluate(sample), values, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(program.batch(samples), expected, rtol=1e-14, atol=1e-14)


def global_name_assigned_in_one_branch(x):
    if x[0] > 0:
        offset = 1.0
    return x + offset


def name_assigned_in_one_branch(x):
    if x[0] > 0:
        shift = 1.0
    else:
        x = x * 2
    return x + shift


def name_assigned_in_a_loop(x):
    for k in range(2):
        offset = x[k]
    return x + offset


def number_of_a_loop_after_it(x):
    k = 5
    for k in range(2):
        x = x + x[k]
    return x * k


def number_of_a_loop_in_another_loop(x):
    k = 1
    for _ in range(2):
        x = x * x[k]
        for k in range(2):
            x = x + x[k]
    return x


def name_of_a_function_assigned_in_a_branch(x):
    if x[0] > 0:
        offset = 1.0

    def shifted(value):
        return value + offset

    return shifted(x)


def name_assigned_in_an_expression(x):
    y = (z := x * 2) + 1
    return y + z


def condition_combined_with_a_number(x):
    y = x * 1.0
    if x[0] > 0 and 3.0:
        y = x * 2
    return y


@pytest.mark.parametrize(
    ("function", "message", "line"),
    [
        (global_name_assigned_in_one_branch, "'offset' has no value here", 3),
        (name_assigned_in_one_branch, "'shift' has no value here", 5),
        (name_assigned_in_a_loop, "'offset' has no value here", 3),
        (number_of_a_loop_after_it, "'k' has no value here", 4),
        (number_of_a_loop_in_another_loop, "'k' has a value before a loop or branch, and may have none after it", 2),
        (name_of_a_function_assigned_in_a_branch, "'offset' has no value here", 4),
        (name_assigned_in_an_expression, "cannot contain `:=`", 1),
        (condition_combined_with_a_number, "3.0 is not a condition", 2),
    ],
)
def test_what_would_not_mean_the_same_as_in_python_is_refused_with_its_line(function, message, line):
    expected = f"{message}.*{function.__name__}, test_frames.py:{function.__code__.co_firstlineno + line}"
    with pytest.raises(TypeError, match=expected):
        compiled(procedure(function))


def test_a_name_that_both_branches_assign_is_known_after_them():
    @procedure
    def both(x):
        if x[0] > 0:
            offset = 1.0
        else:
            offset = -1.0
        offsets = [offset * number for number in (1, 2)]
        return x + np.array(offsets)

    program = compiled(both)
    for x in (np.array([0.5, 2.0]), np.array([-0.5, 2.0])):
        np.testing.assert_allclose(program.evaluate(x), both(x), rtol=1e-15)
