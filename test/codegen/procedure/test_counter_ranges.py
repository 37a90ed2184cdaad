"""Indices of procedures: those that lie within their arrays are computed as by NumPy, all others are refused."""

import numpy as np
import pytest

pytest.importorskip("llvmlite")
from robot_dynamics.codegen.jit.procedure_code import compile_procedure
from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface
from robot_dynamics.procedures import procedure, select, zeros

SIZE = 6


def compiled(function):
    return compile_procedure(function.__name__, function, ProcedureInterface({"x": SIZE}, {"y": (SIZE,)}))


def every_second(x):
    y = zeros(6)
    for k in range(0, 5, 2):
        y[k] = x[k + 1]
        y[k + 1] = -x[k]
    return y


def from_the_end(x):
    y = zeros(6)
    for k in range(6):
        y[k] = x[5 - k]
    return y


def triangle(x):
    y = zeros(6)
    for i in range(6):
        for j in range(i + 1, 6):
            y[i] = y[i] + x[j] * x[j - 1]
    return y


def largest_entry_first(x):
    y = zeros(6)
    position = 0
    for i in range(1, 6):
        if x[i] > x[position]:
            position = i
    for i in range(6):
        y[i] = x[position]
    return y


def selected_entry(x):
    y = zeros(6)
    for i in range(6):
        y[i] = x[select(x[0] > 0, i, 5 - i)]
    return y


def rows_and_negative_constants(x):
    matrix = x.reshape(2, 3)
    y = zeros(2, 3)
    for i in range(2):
        y[i] = matrix[1 - i]
        y[i, 0] = matrix[i, -1]
    return y.reshape(6)


def count_that_another_loop_limits(x):
    y = zeros(6)
    count = 1
    for i in range(3):
        if x[i] > 0:
            count = i + 3
    for i in range(count):
        y[i] = x[i]
    return y


@pytest.mark.parametrize(
    "function",
    [
        every_second,
        from_the_end,
        triangle,
        largest_entry_first,
        selected_entry,
        rows_and_negative_constants,
        count_that_another_loop_limits,
    ],
)
def test_indices_within_their_arrays_are_those_of_numpy(function):
    program = compiled(procedure(function))
    samples = np.random.default_rng(0).normal(size=(40, SIZE))
    expected = np.array([function(sample) for sample in samples])
    for sample, values in zip(samples, expected, strict=True):
        np.testing.assert_allclose(program.evaluate(sample), values, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(program.batch(samples), expected, rtol=1e-14, atol=1e-14)


def read_behind_the_end(x):
    y = zeros(6)
    for k in range(6):
        y[k] = x[k + 1]
    return y


def read_before_the_beginning(x):
    y = zeros(6)
    for k in range(6):
        y[k] = x[k - 1]  # NumPy takes the last entry for k = 0
    return y


def assign_behind_the_end(x):
    y = zeros(6)
    for k in range(7):
        y[k] = x[0]
    return y


def read_where_a_count_has_no_end(x):
    count = 0
    total = 0.0
    while total < 10 and count < 6:
        total = total + x[count] * x[count]
        count = count + 1
    return x + total


def read_where_a_branch_leaves_the_array(x):
    y = zeros(6)
    position = 0
    for i in range(6):
        if x[i] > 0:
            position = i + 1
        y[i] = x[position]
    return y


def read_a_row_that_is_missing(x):
    matrix = x.reshape(2, 3)
    y = zeros(2, 3)
    for k in range(3):
        y[0] = matrix[k]
    return y.reshape(6)


def read_a_constant_behind_the_end(x):
    matrix = x.reshape(2, 3)
    y = zeros(6)
    for k in range(2):
        y[k] = matrix[k, 3]
    return y


def read_with_too_many_indices(x):
    y = zeros(6)
    for k in range(6):
        y[k] = x[k, 0]
    return y


def read_a_column(x):
    matrix = x.reshape(2, 3)
    y = zeros(6)
    for k in range(3):
        y[:2] = matrix[:, k]
    return y


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (read_behind_the_end, r"an index may be 1 to 6, and the array has entries 0 to 5"),
        (read_before_the_beginning, r"an index may be -1 to 4"),
        (assign_behind_the_end, r"an index may be 0 to 6"),
        (read_where_a_count_has_no_end, r"an index may be 0 to inf"),
        (read_where_a_branch_leaves_the_array, r"an index may be 0 to 6"),
        (read_a_row_that_is_missing, r"an index may be 0 to 2, and the array has entries 0 to 1"),
        (read_a_constant_behind_the_end, r"an index may be 3 to 3, and the array has entries 0 to 2"),
        (read_with_too_many_indices, r"an array of the shape \(6,\) has 1 indices, not 2"),
        (read_a_column, r"an index beside a number of a loop is slice\(None, None, None\): it must be an integer"),
    ],
)
def test_an_index_that_may_lie_outside_is_refused_with_its_line(function, message):
    line = function.__code__.co_firstlineno
    with pytest.raises(TypeError, match=message) as error:
        compiled(procedure(function))
    location = str(error.value).rpartition("test_counter_ranges.py:")
    assert function.__name__ in location[0]
    assert line < int(location[2].rstrip(")")) < line + 10
