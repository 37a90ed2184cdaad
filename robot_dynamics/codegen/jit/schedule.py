"""The steps in which a program is written as code: their order, sines with cosines, the parts of a long one."""

from itertools import pairwise
from typing import NamedTuple

from robot_dynamics.codegen.trace.scalar import COSINE, INPUT, SINE

LOAD, STORE, SINCOS = "load", "store", "sincos"


class Step(NamedTuple):
    """What is written at a time: `operation` (of a Statement, or one of the three above), nodes in, nodes out.

    SINCOS gives the sine and the cosine of each node that it takes, in this order; None is one that nothing reads.
    """

    operation: str
    operands: tuple
    results: tuple


class Part(NamedTuple):
    """A run of steps that becomes one function; `live_out`: the nodes that a later part takes."""

    steps: list
    live_out: list


def list_steps(program):
    """The Steps of a program: inputs are loaded first, outputs stored last, sine and cosine of a node are one step."""
    inputs = tuple(leaf.number for leaf in program.leaves if leaf.operation == INPUT)
    outputs = tuple(node for output in program.outputs for node, _ in output.entries)
    pairs = {}
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


def group_sincos(steps, max_group_size):
    """The steps in another order: up to `most` sines and cosines that do not wait for each other are one step.

    Each step gets a level: odd for sines and cosines, even for all others, above the levels of what it takes. Sines and
    cosines of inputs are so the first of all.
    """
    level, levels = {}, {}
    for step in steps:
        least = max((level.get(node, 0) for node in step.operands), default=-1) + (step.operation == SINCOS)
        odd = step.operation == SINCOS
        own = least + (least % 2 != odd)
        if not odd and step.operation not in (LOAD, STORE):
            own = max(own, 2)
        if step.operation == STORE:
            own = max(levels) + 1 if levels else 0
        level.update((node, own) for node in step.results)
        levels.setdefault(own, []).append(step)
    ordered = []
    for own in sorted(levels):
        ordered += _grouped(levels[own], max_group_size) if levels[own][0].operation == SINCOS else levels[own]
    return ordered


def _grouped(steps, max_group_size):
    for start in range(0, len(steps), max_group_size):
        group = steps[start : start + max_group_size]
        yield Step(
            SINCOS, tuple(step.operands[0] for step in group), tuple(node for step in group for node in step.results)
        )


def split_into_parts(steps, max_length):
    """The steps in Parts of nearly equal length, at most `longest`."""
    count = -(-len(steps) // max_length)
    bounds = [len(steps) * place // count for place in range(count + 1)]
    parts, taken = [], set()
    for start, end in reversed(list(pairwise(bounds))):
        run = steps[start:end]
        parts.append(Part(run, [node for step in run for node in step.results if node in taken]))
        taken.update(node for step in run for node in step.operands)
    return parts[::-1]
