"""The order of the steps of a program, and the parts into which long programs are divided."""

import numpy as np
import pytest
from peers.traced_models import shipped_program

from robot_dynamics.codegen.jit.schedule import (
    GROUP_SIZE,
    LOAD,
    SINCOS,
    STORE,
    even_bounds,
    group_bounds,
    group_sincos,
    insert_stores,
    list_steps,
    list_stores,
    split_into_parts,
)
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace


@pytest.mark.parametrize("size", range(12))
def test_groups_of_stores_cover_all_entries(size):
    bounds = group_bounds(size)
    assert {k for start, end in bounds for k in range(start, end)} == set(range(size))
    assert all(0 <= start < end <= size and end - start == min(size, GROUP_SIZE) for start, end in bounds)


@pytest.mark.parametrize("model", ["inverse", "regressor"])
def test_each_step_follows_those_that_it_reads_and_stores_follow_the_loads(model):
    program = shipped_program("panda", model)
    stores = list_stores(program)
    steps = insert_stores(group_sincos(list_steps(program), 8), stores)
    assert steps[0].operation == LOAD
    assert [step for step in steps if step.operation == STORE] != []
    assert sorted(step.target for step in steps if step.operation == STORE) == sorted(step.target for step in stores)
    computed = {leaf.number for leaf in program.leaves} | {statement.number for statement in program.setup}
    for step in steps:
        assert computed.issuperset(step.operands)
        computed.update(step.results)


def test_stores_follow_the_last_of_their_values_at_once():
    program = shipped_program("panda", "regressor")
    last: set[int | None] = set()
    for step in insert_stores(list_steps(program), list_stores(program)):
        if step.operation != STORE:
            last = set(step.results)
        elif last.isdisjoint(step.operands):
            assert not program_results(program) & set(step.operands)  # known before all steps


def program_results(program):
    return {statement.number for statement in program.statements}


def test_sines_of_shifted_inputs_are_computed_with_those_of_inputs():
    trace = Trace()
    q = trace.input("q", 3) + np.array([0.0, 0.5, -0.5])
    program = build_program(trace, "sines", {"q": 3}, {"out": np.sin(q) * np.cos(q)})
    steps = group_sincos(list_steps(program), 8)
    assert [len(step.operands) for step in steps if step.operation == SINCOS] == [3]


def test_parts_have_nearly_equal_length_and_the_nodes_that_later_parts_read():
    program = shipped_program("panda", "regressor")
    steps = [*list_steps(program), *list_stores(program)]
    parts = split_into_parts(steps, even_bounds(len(steps), 400))
    assert [step for part in parts for step in part.steps] == steps
    assert [part.is_last for part in parts] == [False] * (len(parts) - 1) + [True]
    assert {len(part.steps) // 10 for part in parts} == {36}
    for number, part in enumerate(parts):
        later = {node for following in parts[number + 1 :] for step in following.steps for node in step.operands}
        results = {node for step in part.steps for node in step.results if node is not None}
        assert set(part.live_out) == results & later


def test_bounds_of_parts():
    assert even_bounds(0, 5) == [0]
    assert even_bounds(5, 5) == [0, 5]
    assert even_bounds(6, 5) == [0, 3, 6]
