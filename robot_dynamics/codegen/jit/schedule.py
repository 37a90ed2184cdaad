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


GROUP_SIZE = 4
"""Entries of an output that are stored together."""


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
    target : (int, int)
        Of a STORE: the number of the output, and the first of its entries that the step stores.
    """

    operation: StepOperation
    operands: tuple[int, ...]
    results: tuple[int | None, ...]
    target: tuple[int, int] = (0, 0)


class Part(NamedTuple):
    """Consecutive steps that become one function; `live_out` are the nodes that a later part reads."""

    steps: Sequence[Step]
    live_out: list[int]
    is_last: bool


def list_steps(program: Program) -> list[Step]:
    """The Steps of a program but its stores: LOAD of all inputs first, sine and cosine of a node in one."""
    inputs = tuple(leaf.number for leaf in program.leaves if leaf.operation == INPUT)
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
    return steps


def list_stores(program: Program) -> list[Step]:
    """A STORE for each group of entries of the outputs."""
    stores = []
    for number, output in enumerate(program.outputs):
        nodes = [node for node, _ in output.entries]
        for start, end in group_bounds(len(nodes)):
            stores.append(Step(STORE, tuple(nodes[start:end]), (), (number, start)))
    return stores


def insert_stores(steps: Sequence[Step], stores: Sequence[Step]) -> list[Step]:
    """The steps with each STORE as soon as its values are known: they need not be kept until the end.

    All inputs are read before, by the first step.
    """
    computed_by = {node: index for index, step in enumerate(steps) for node in step.results if node is not None}
    stores_after: dict[int, list[Step]] = {}
    for store in stores:
        position = max((computed_by[node] for node in store.operands if node in computed_by), default=len(steps) - 1)
        stores_after.setdefault(position, []).append(store)
    ordered: list[Step] = []
    for index, step in enumerate(steps):
        ordered += [step, *stores_after.get(index, [])]
    return ordered


def group_bounds(size: int) -> list[tuple[int, int]]:
    """(start, end) of the groups of four in which entries are stored; the last one may overlap the one before."""
    if size < GROUP_SIZE:
        return [(0, size)] if size else []
    return [(start, start + GROUP_SIZE) for start in sorted({min(k, size - 4) for k in range(0, size, GROUP_SIZE)})]


def group_sincos(steps: Sequence[Step], max_group_size: int) -> list[Step]:
    """The steps reordered, with up to `max_group_size` independent sines and cosines in one step.

    Each step has a level: odd for sines and cosines, even for all others, above the levels of its operands. Sines and
    cosines of inputs, and of inputs with a constant angle added, therefore come first.
    """
    angles = {node for step in steps if step.operation == SINCOS for node in step.operands}
    level: dict[int | None, int] = {}
    steps_by_level: dict[int, list[Step]] = {}
    for step in steps:
        is_sincos = step.operation == SINCOS
        minimum = max((level.get(node, 0) for node in step.operands), default=-1) + is_sincos
        step_level = minimum + (minimum % 2 != is_sincos)
        if not is_sincos and step.operation != LOAD and angles.isdisjoint(step.results):
            step_level = max(step_level, 2)
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


def split_into_parts(steps: Sequence[Step], bounds: Sequence[int]) -> list[Part]:
    """The steps in Parts between bounds, numbers of steps that begin with 0 and end with their count."""
    parts = []
    read_later: set[int | None] = set()
    for start, end in reversed(list(pairwise(bounds))):
        part = steps[start:end]
        live_out = [node for step in part for node in step.results if node is not None and node in read_later]
        parts.append(Part(part, live_out, is_last=end == len(steps)))
        read_later.update(node for step in part for node in step.operands)
    return parts[::-1]


def even_bounds(length: int, max_length: int) -> list[int]:
    """The bounds of parts of nearly equal length, at most `max_length`."""
    count = -(-length // max_length)
    return [length * k // count for k in range(count + 1)] if count else [0]
