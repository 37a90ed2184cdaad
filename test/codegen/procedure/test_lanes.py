"""Procedures in lanes: batches have the results of single samples, whatever samples are beside them."""

from typing import NamedTuple

import numpy as np
import pytest

pytest.importorskip("llvmlite")
from robot_dynamics.codegen.jit import engine
from robot_dynamics.codegen.jit.compiled_program import compile_program
from robot_dynamics.codegen.jit.procedure_code import ProcedureCode, compile_procedure
from robot_dynamics.codegen.procedure.kernels import Kernel
from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace
from robot_dynamics.procedures import as_array, largest, magnitude, procedure, rounded, select, solve, zeros


class Pair(NamedTuple):
    """A number and an array that change together."""

    count: object
    entries: object


@procedure
def leave_loops(x):
    """Loops that samples leave in different rounds, by `break`, `continue` and a condition, one inside another."""
    total = 0.0
    rounds = 0.0
    last = x * 1.0
    for k in range(12):
        if x[0] > 1.5:
            if x[1] > 0 and k >= 3:
                break
            total = total + 0.5
        else:
            if total > 2 * magnitude(x[2]):
                continue
            total = total + magnitude(x[1]) / 4
        while rounds < 3 * magnitude(x[2]):
            rounds = rounds + 1
            if rounds > 5:
                break
        last = last * 0.5 + total
    return np.array([total, rounds]), last


@procedure
def newton_root(x):
    """The cube root, by Newton's method with halved steps."""
    root = 1.0
    is_improving = True
    for _ in range(60):
        error = root * root * root - x[0]
        if not (is_improving and magnitude(error) > 1e-12):
            break
        step = error / (3 * root * root + 1e-3)
        is_improving = False
        fraction = 1.0
        for _ in range(4):
            trial = root - fraction * step
            if magnitude(trial * trial * trial - x[0]) < magnitude(error):
                root = trial
                is_improving = True
                break
            fraction = fraction / 2
    return np.array([root])


@procedure
def branches(x):
    pair = Pair(0, x * 1.0)
    if x[0] > 0:
        pair = Pair(pair.count + 1, pair.entries + x[1])
        if x[1] > 0:
            z = np.sin(x[:]) * np.cos(x[:])
            pair = Pair(pair.count + 2, z)
    elif x[1] > x[2]:
        pair = Pair(5, rounded(x))
    table = zeros(3)
    table[1] = x[2]
    if pair.count == 3 or pair.count == 5:
        table[0] = 1.0
        table[2] = largest(pair.entries)
    is_large = largest(magnitude(x)) > 1
    count = select(is_large, pair.count, 7)
    total = 0.0
    for k in range(9):
        if k == 4:
            continue
        if k == count:
            total = total + table[0]
    return pair.entries, table, np.array([total, select(is_large, 1.0, 2.0)])


@procedure
def solution(matrix, right_side):
    return solve(matrix.reshape(4, 4), right_side.reshape(4, 1)).reshape(4) * 1.0


@procedure
def largest_entries(x):
    """Reads and assigns with a counter that is not the same in all samples."""
    entries = as_array(x)
    order = zeros(7)
    for k in range(7):
        best = k
        for i in range(k, 7):
            if entries[i] > entries[best]:
                best = i
        exchanged = entries[k]
        entries[k] = entries[best]
        entries[best] = exchanged
        order[best] = order[best] + 1.0
    return entries, order


@procedure
def long_arrays(x):
    """Arrays of more entries than are copied one by one."""
    first = zeros(70)
    second = zeros(70)
    for k in range(70):
        first[k] = x[0]
        second[k] = x[1]
    chosen = first
    length = 0.0
    while length < magnitude(x[2]) and length < 9:
        length = length + 1
        if x[1] > length:
            chosen = second
    return chosen, np.array([length])


@procedure
def count_to_different_ends(x):
    end = 2
    if x[0] > 0:
        end = 5
    total = 0.0
    for k in range(end):
        for i in range(select(x[1] > 0, end, 1)):
            total = total + x[k] * x[i]
        if total > 3:
            continue
        total = total + 1.0
    return np.array([total])


CASES = [
    (count_to_different_ends, {"x": 5}, {"total": (1,)}),
    (leave_loops, {"x": 3}, {"numbers": (2,), "last": (3,)}),
    (newton_root, {"x": 1}, {"root": (1,)}),
    (branches, {"x": 3}, {"entries": (3,), "table": (3,), "numbers": (2,)}),
    (solution, {"matrix": 16, "right_side": 4}, {"solution": (4,)}),
    (largest_entries, {"x": 7}, {"entries": (7,), "order": (7,)}),
    (long_arrays, {"x": 3}, {"chosen": (70,), "length": (1,)}),
]


def compiled(function, inputs, outputs, kernels=()):
    return compile_procedure(function.__name__, function, ProcedureInterface(inputs, outputs), kernels)


def as_tuple(results):
    return results if isinstance(results, tuple) else (results,)


def assert_batch_is_that_of_single_samples(program, arrays):
    batch = as_tuple(program.batch(*arrays))
    for sample in range(len(arrays[0])):
        single = as_tuple(program.evaluate(*(array[sample] for array in arrays)))
        for results, result in zip(batch, single, strict=True):
            np.testing.assert_array_equal(results[sample], result)
    return batch


@pytest.mark.parametrize(("lanes", "fused"), [(4, True), (8, True), (4, False)])
@pytest.mark.parametrize(("function", "inputs", "outputs"), CASES, ids=[case[0].__name__ for case in CASES])
def test_batches_have_the_results_of_python_and_of_single_samples(function, inputs, outputs, lanes, fused, monkeypatch):
    """On processors with vectors of 4 or 8 numbers, with and without a fused multiply-add."""
    monkeypatch.setattr(engine, "vector_lanes", lambda: lanes)
    monkeypatch.setattr(engine, "has_fused_multiply_add", lambda: fused)
    monkeypatch.setattr(ProcedureCode, "sample_loop_text", refuse)
    program = compiled(function, inputs, outputs)
    rng = np.random.default_rng(0)
    arrays = [rng.normal(size=(101, size)) * 10.0 ** rng.uniform(-1, 1, (101, 1)) for size in inputs.values()]
    batch = assert_batch_is_that_of_single_samples(program, arrays)
    for sample in range(101):
        expected = as_tuple(function(*(array[sample] for array in arrays)))
        for results, value in zip(batch, expected, strict=True):
            np.testing.assert_allclose(results[sample], value, rtol=1e-11, atol=1e-11)


def refuse(self):
    raise AssertionError("the procedure has no form in lanes")


def test_results_depend_neither_on_the_lane_nor_on_other_samples_nor_on_threads():
    program = compiled(*CASES[1])
    arrays = np.random.default_rng(1).normal(size=(203, 3)) * 2
    batch = program.batch(arrays)
    for first, end in ((0, 1), (5, 9), (100, 203)):
        for results, part in zip(batch, program.batch(arrays[first:end], threads=3), strict=True):
            np.testing.assert_array_equal(results[first:end], part)
    for results, rolled in zip(batch, program.batch(np.roll(arrays, 3, axis=0)), strict=True):
        np.testing.assert_array_equal(np.roll(results, 3, axis=0), rolled)


def test_samples_with_large_angles_are_computed_alone_and_nan_stays_in_its_lane():
    program = compiled(*CASES[3])
    x = np.random.default_rng(2).uniform(0.1, 1, (20, 3))
    plain = program.batch(x)
    x[3] *= 1e17
    x[12, 2] = np.nan
    batch = assert_batch_is_that_of_single_samples(program, [x])
    others = np.delete(np.arange(20), [3, 12])
    for results, before in zip(batch, plain, strict=True):
        np.testing.assert_array_equal(results[others], before[others])
    np.testing.assert_allclose(batch[0][3], np.sin(x[3]) * np.cos(x[3]), rtol=1e-12)


def wave_program():
    trace = Trace()
    x, y = trace.input("x", 2), trace.input("y", 2)
    values = np.array([np.sin(x[0]) * y[0] + x[1], np.sqrt(x[1] * x[1] + y[1] * y[1]), x[0] / y[0]])
    return compile_program(build_program(trace, "wave", {"x": 2, "y": 2}, {"values": values}))


def test_kernels_run_in_lanes_and_samples_with_large_angles_are_computed_alone():
    kernel = Kernel("wave", wave_program())

    @procedure
    def iterate(x):
        y = x * 1.0
        for _ in range(20):
            values = kernel(y, x + 3)
            if values[1] > 4:
                break
            y = np.array([values[0], values[1] + 0.1])
        return y

    program = compiled(iterate, {"x": 2}, {"y": (2,)}, [kernel])
    x = np.random.default_rng(3).normal(size=(50, 2))
    assert_batch_is_that_of_single_samples(program, [x])
    x[17, 0] = 1e17
    assert_batch_is_that_of_single_samples(program, [x])


def test_a_procedure_without_a_form_in_lanes_computes_one_sample_after_the_other():
    @procedure
    def choose_row(x):
        table = as_array(x).reshape(2, 2)
        row = 0
        if x[0] > 0:
            row = 1
        return table[row] * 2.0

    program = compiled(choose_row, {"x": 4}, {"row": (2,)})
    x = np.random.default_rng(4).normal(size=(30, 4))
    (rows,) = assert_batch_is_that_of_single_samples(program, [x])
    np.testing.assert_array_equal(rows, 2 * np.where(x[:, :1] > 0, x[:, 2:], x[:, :2]))
