"""Procedures: the machine code does what Python does with the same function, and broken rules are refused."""

from typing import NamedTuple

import numpy as np
import pytest

pytest.importorskip("llvmlite")
from robot_dynamics.codegen.jit.procedure_code import compile_procedure
from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface
from robot_dynamics.procedures import is_finite, largest, magnitude, procedure, rounded, select, zeros


class Pair(NamedTuple):
    """Two arrays that change together in a loop."""

    first: object
    second: object


def compiled(function, inputs, outputs):
    return compile_procedure(function.__name__, function, ProcedureInterface(inputs, outputs))


def assert_same_results(function, inputs, outputs, samples, seed=0):
    """The machine code and Python agree for random inputs of 1e-2 to 1e2."""
    program = compiled(function, inputs, outputs)
    rng = np.random.default_rng(seed)
    for _ in range(samples):
        arrays = [rng.normal(size=size) * 10.0 ** rng.uniform(-2, 2) for size in inputs.values()]
        expected = function(*arrays)
        expected = expected if isinstance(expected, tuple) else (expected,)
        results = program.evaluate(*arrays)
        results = results if isinstance(results, tuple) else (results,)
        for result, value in zip(results, expected, strict=True):
            np.testing.assert_allclose(result, value, rtol=1e-13, atol=1e-13)


@procedure
def square_root(x):
    root = 1.0 * x
    for _ in range(60):
        step = (root * root - x) / (2 * root)
        if magnitude(step) <= 1e-15 * root:
            break
        root = root - step
    return root


@procedure
def roots(x):
    return np.array([square_root(magnitude(x[0])), square_root(x[1] * x[1])])


def test_a_loop_with_break_in_a_called_procedure_computes_square_roots():
    program = compiled(roots, {"x": 2}, {"roots": (2,)})
    for x in ([4.0, -3.0], [2.0, 1e-3], [1e6, 7.0]):
        np.testing.assert_allclose(program.evaluate(np.array(x)), [np.sqrt(x[0]), abs(x[1])], rtol=1e-14)


@procedure
def fibonacci(x):
    pair = Pair(x, 2 * x)
    for _ in range(10):
        pair = Pair(pair.second, pair.first + pair.second)
    a = x * 1.0
    b = x + 1
    for _ in range(5):
        a, b = b, a
    return pair.first, pair.second, a - b


def test_arrays_that_exchange_their_names_in_a_loop_keep_their_values():
    program = compiled(fibonacci, {"x": 3}, {"first": (3,), "second": (3,), "difference": (3,)})
    x = np.array([1.0, -2.0, 0.5])
    first, second, difference = program.evaluate(x)
    np.testing.assert_allclose(first, 144 * x, rtol=1e-15)  # Fibonacci numbers with 1, 2 at the start
    np.testing.assert_allclose(second, 233 * x, rtol=1e-15)
    np.testing.assert_allclose(difference, 1, rtol=1e-15)


def test_branches_agree_with_python():
    @procedure
    def branches(x):
        y = x * 1.0
        count = 0
        if (x[0] > 0 and x[1] > 0) or not x[2] > 0:
            y = y + 1
            count = 1
        elif x[0] > x[1]:
            if x[2] > 1:
                y = np.array([x[2], x[1], x[0]])
            count = 2
        else:
            z = x * x
            y = y - z
        total = 0.0
        for k in range(5):
            if k == count:
                continue
            total = total + y[0]
        return y, np.array([total, largest(y), rounded(x[1]), select(count == 2, 1.0, 0.0)])

    assert_same_results(branches, {"x": 3}, {"y": (3,), "numbers": (4,)}, 200)


def test_matrices_are_read_and_assigned_by_counters():
    @procedure
    def product(A, B):
        result = zeros(3, 3)
        for i in range(3):
            for j in range(3):
                for k in range(0, 9, 3):
                    result[i, j] = result[i, j] + A[3 * i + j] * B[k]
        rows = zeros(2, 3)
        rows[1] = A[:3] * 2
        for i in range(1, 2):
            rows[0] = rows[i] + B[:3]
        return result, rows, np.sin(A[:2]) @ np.cos(B[:2]) + 0 * A[:1]

    assert_same_results(product, {"A": 9, "B": 9}, {"result": (3, 3), "rows": (2, 3), "sum": (1,)}, 20)


def test_a_while_loop_with_a_condition_of_two_parts_agrees_with_python():
    @procedure
    def halve(x):
        length = np.sqrt(x @ x)
        count = 0
        while length > 1 and not count >= 4:
            length /= 2
            count += 1
        return np.array([length, select(count >= 4, 1.0, 0.0)])

    assert_same_results(halve, {"x": 2}, {"result": (2,)}, 100)


def test_values_that_are_not_finite_are_seen():
    @procedure
    def finite(x):
        return np.array([select(is_finite(x), 1.0, 0.0), largest(x)])

    program = compiled(finite, {"x": 2}, {"result": (2,)})
    assert program.evaluate(np.array([1.0, -2.0])).tolist() == [1.0, 1.0]
    for value in (np.inf, -np.inf, np.nan):
        assert program.evaluate(np.array([1.0, value]))[0] == 0
    assert np.isnan(program.evaluate(np.array([np.nan, 1.0]))[1])


def test_outputs_may_overlap_inputs_and_batches_equal_single_samples():
    @procedure
    def exchange(x, y):
        return y * 1.0, x

    program = compiled(exchange, {"x": 3, "y": 3}, {"y": (3,), "x": (3,)})
    x, y = np.arange(3.0), np.arange(3.0) + 10
    program.evaluate(x, y, x, y)
    assert (x.tolist(), y.tolist()) == ([10, 11, 12], [0, 1, 2])
    many = np.random.default_rng(0).normal(size=(101, 3))
    first, second = program.batch(many, y, threads=2)
    np.testing.assert_array_equal(first, np.broadcast_to(y, many.shape))
    np.testing.assert_array_equal(second, many)


def assign_entry_of_a_constant(x):
    y = np.array([0.0, 0.0])
    y[0] = x[0]
    return y


def change_shape(x):
    y = x
    for _ in range(2):
        y = np.concatenate([y, y])
    return y


def change_type(x):
    count = 1
    for _ in range(2):
        count = x[0]
    return x * count


def return_early(x):
    if x[0] > 0:
        return x
    return -x


def take_truth_value(x):
    return x * (1 if x[0] > 0 else 2)


def use_else_of_a_loop(x):
    for _ in range(2):
        x = x * 2
    else:
        x = x + 1
    return x


def add_in_place(x):
    x += 1
    return x


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (assign_entry_of_a_constant, "y is not from `zeros`"),
        (change_shape, "'y' is assigned in a loop or branch: its shape changes from"),
        (change_type, "'count' is assigned in a loop or branch"),
        (return_early, r"cannot contain Return here \(return_early, test_staging.py:\d+\)"),
        (take_truth_value, "no truth value before the procedure runs"),
        (use_else_of_a_loop, "cannot contain `else` of a loop"),
        (add_in_place, "'x' is an array: write x = x \\+ y"),
    ],
)
def test_a_broken_rule_is_refused_with_its_reason(function, message):
    with pytest.raises(TypeError, match=message):
        compiled(procedure(function), {"x": 2}, {"y": (2,)})
