"""Programs of the shipped robots: no more operations than recorded, and the same statements where counts are equal.

`shipped_programs.json` has the counts and a digest of each program. Run this file as a script to record them again
after a change that is meant to change programs.
"""

import contextlib
import hashlib
import json
from pathlib import Path

import pytest
from peers.traced_models import shipped_program, shipped_robot

from robot_dynamics import shipped_robots
from robot_dynamics.codegen.jit.compiled_models import available_models
from robot_dynamics.codegen.trace import scalar

RECORD = Path(__file__).with_name("shipped_programs.json")
RECORDED = json.loads(RECORD.read_text(encoding="ascii"))
SLOW_ROBOTS = {"gough_stewart", "hexapod_stack"}
"""Robots whose models take more than 3 s to trace."""
SLOW_DERIVATIVES = {*SLOW_ROBOTS, "delta_wrist", "orthoglide", "navaro"}
"""Robots whose derivatives take more than 1.5 s to trace; they are not recorded."""

OPERATION_NAMES = {
    scalar.INPUT: "INPUT",
    scalar.PARAMETER: "PARAMETER",
    scalar.CONSTANT: "CONSTANT",
    scalar.ADD: "ADD",
    scalar.SUBTRACT: "SUBTRACT",
    scalar.MULTIPLY: "MULTIPLY",
    scalar.DIVIDE: "DIVIDE",
    scalar.SINE: "SINE",
    scalar.COSINE: "COSINE",
    scalar.SQUARE_ROOT: "SQUARE_ROOT",
    scalar.SIGN: "SIGN",
}


def structural_digest(program):
    """A hash of the statements and outputs of a program, in order.

    Nodes are numbered by their first occurrence, so that unused nodes of the trace do not count. Constants are rounded
    to 7 digits: the last digits of closed positions depend on the processor.
    """
    numbers = {}

    def number(node):
        return numbers.setdefault(node, len(numbers))

    def operand_texts(statement):
        if statement.operation == scalar.CONSTANT:
            return [rounded_text(value) for value in statement.operands]
        if statement.operation in scalar.LEAVES:
            return [str(operand) for operand in statement.operands]
        return [number(node) for node in statement.operands]

    rows = []
    for statement in (*program.leaves, *program.setup, *program.statements):
        result = number(statement.number)
        rows.append((result, OPERATION_NAMES[statement.operation], operand_texts(statement)))
    rows.append([(output.shape, output_entries(output, number)) for output in program.outputs])
    return hashlib.sha256(json.dumps(rows).encode()).hexdigest()[:16]


def output_entries(output, number):
    """The nodes of an output with their signs; of a matrix its rows in any order, with signs relative to the first one.

    How the rows of the matrix are ordered whose determinant tells assembly modes apart depends on the processor.
    """
    entries = [(number(node), sign) for node, sign in output.entries]
    if len(output.shape) != 2:
        return entries
    columns = output.shape[-1]
    rows = [entries[start : start + columns] for start in range(0, len(entries), columns)]
    return sorted([(node, sign * row[0][1]) for node, sign in row] for row in rows)


def rounded_text(value):
    return "0" if abs(value) < 1e-9 else f"{float(value):.7g}"


def programs_of(name, models):
    """The programs of models of a shipped robot, without those that are singular in every state."""
    programs = {}
    for model in models:
        with contextlib.suppress(ZeroDivisionError):
            programs[model] = shipped_program(name, model)
    return programs


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW_ROBOTS)) for name in shipped_robots()]
)
def test_programs_of_shipped_robots_are_unchanged_or_smaller(name):
    models = [model for model in available_models(shipped_robot(name)) if not model.endswith("derivatives")]
    programs = programs_of(name, models)
    assert list(programs) == [model for model in RECORDED[name] if not model.endswith("derivatives")]
    require_unchanged_or_smaller(name, programs)


@pytest.mark.parametrize("name", [name for name in shipped_robots() if name not in SLOW_DERIVATIVES])
def test_programs_of_derivatives_are_unchanged_or_smaller(name):
    programs = programs_of(name, ["inverse_derivatives", "direct_derivatives"])
    assert list(programs) == [model for model in RECORDED[name] if model.endswith("derivatives")]
    require_unchanged_or_smaller(name, programs)


def require_unchanged_or_smaller(name, programs):
    """Fail where a program has more operations than recorded, or other statements with as many."""
    for model, program in programs.items():
        counts, digest = RECORDED[name][model]
        operations = list(program.operations)
        assert sum(operations[:2]) <= sum(counts[:2]), (model, operations)  # × and +
        assert all(count <= recorded for count, recorded in zip(operations[2:], counts[2:], strict=True)), model
        if operations == counts:
            assert structural_digest(program) == digest, f"{model}: other statements with the same counts"


def test_record_has_every_shipped_robot():
    assert sorted(RECORDED) == sorted(shipped_robots())


def recorded_models(name):
    """Names of the models of a shipped robot that are recorded."""
    models = available_models(shipped_robot(name))
    return [model for model in models if name not in SLOW_DERIVATIVES or not model.endswith("derivatives")]


def main():
    """Write {robot: {model: [operation counts, digest]}}, a line for each program."""
    blocks = []
    for name in sorted(shipped_robots()):
        lines = [
            f"    {json.dumps(model)}: {json.dumps([program.operations, structural_digest(program)])}"
            for model, program in programs_of(name, recorded_models(name)).items()
        ]
        blocks.append(f"  {json.dumps(name)}: {{\n" + ",\n".join(lines) + "\n  }")
    RECORD.write_text("{\n" + ",\n".join(blocks) + "\n}\n", encoding="ascii")


if __name__ == "__main__":
    main()
