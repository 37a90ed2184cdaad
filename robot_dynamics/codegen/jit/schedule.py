"""The steps in which a program is emitted: their order, sines paired with cosines, and the parts of a long program."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

from robot_dynamics.codegen.trace.scalar import COSINE, INPUT, SINE, Operation

if TYPE_CHECKING:
    from robot_dynamics.codegen.trace.program import Program

LOAD: Literal["load"] = "load"
STORE: Literal["store"] = "store"
SINCOS: Literal["sincos"] = "sincos"

StepOperation: TypeAlias = Operation | Literal["load", "store", "sincos"]
"""The operation of a Statement, or one of the three above."""


class Step(NamedTuple):
    """A unit of emitted code.

    Attributes
    ----------
    operation : str
    operands : tuple of int
        Nodes that the step reads.
    results : tuple of int or None
        Nodes that it computes. SINCOS computes the sine and the cosine of each operand, in this order; None stands for
        one that nothing reads.
    """

    operation: StepOperation
    operands: tuple[int, ...]
    results: tuple[int | None, ...]


class Part(NamedTuple):
    """Consecutive steps that become one function; `live_out` are the nodes that a later part reads."""

    steps: Sequence[Step]
    live_out: list[int]


def list_steps(program: Program) -> list[Step]:
    """The Steps of a program: LOAD of all inputs first, STORE of all outputs last, sine and cosine of a node in one."""
    inputs = tuple(leaf.number for leaf in program.leaves if leaf.operation == INPUT)
    outputs = tuple(node for output in program.outputs for node, _ in output.entries)
    pairs: dict[int, list[int | None]] = {}
    for number, operation, operands in program.statements:
        if operation in (SINE, COSINE):
            pairs.setdefault(operands[0], [None, None])[operation == COSINE] = number
    steps = [Step(LOAD, (), inputs)]
    for number, operation, operands in program.statements:
        if operation not in (SINE, COSINE):
            steps.append(Step(operation, operands, (number,)))
        elif operands[0] in pairs:
            steps.append(Step(SINCOS, operands, tuple(pairs.pop(operands[0]))))
    return [*steps, Step(STORE, outputs, ())]


def group_sincos(steps: Sequence[Step], max_group_size: int) -> list[Step]:
    """The steps reordered, with up to `max_group_size` independent sines and cosines in one step.

    Each step has a level: odd for sines and cosines, even for all others, above the levels of its operands. Sines and
    cosines of inputs therefore come first.
    """
    level: dict[int | None, int] = {}
    steps_by_level: dict[int, list[Step]] = {}
    for step in steps:
        is_sincos = step.operation == SINCOS
        minimum = max((level.get(node, 0) for node in step.operands), default=-1) + is_sincos
        step_level = minimum + (minimum % 2 != is_sincos)
        if not is_sincos and step.operation not in (LOAD, STORE):
            step_level = max(step_level, 2)
        if step.operation == STORE:
            step_level = max(steps_by_level) + 1 if steps_by_level else 0
        level.update((node, step_level) for node in step.results)
        steps_by_level.setdefault(step_level, []).append(step)
    ordered: list[Step] = []
    for step_level in sorted(steps_by_level):
        group = steps_by_level[step_level]
        ordered += _merge_sincos(group, max_group_size) if group[0].operation == SINCOS else group
    return ordered


def _merge_sincos(steps: Sequence[Step], max_group_size: int) -> Iterator[Step]:
    for start in range(0, len(steps), max_group_size):
        group = steps[start : start + max_group_size]
        operands = tuple(step.operands[0] for step in group)
        results = tuple(node for step in group for node in step.results)
        yield Step(SINCOS, operands, results)


def split_into_parts(steps: Sequence[Step], max_length: int) -> list[Part]:
    """The steps in Parts of nearly equal length, at most `max_length`."""
    count = -(-len(steps) // max_length)
    bounds = [len(steps) * k // count for k in range(count + 1)]
    parts = []
    read_later: set[int | None] = set()
    for start, end in reversed(list(pairwise(bounds))):
        part = steps[start:end]
        live_out = [node for step in part for node in step.results if node is not None and node in read_later]
        parts.append(Part(part, live_out))
        read_later.update(node for step in part for node in step.operands)
    return parts[::-1]
