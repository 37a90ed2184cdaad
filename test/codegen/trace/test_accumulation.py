"""Derivatives recorded in a trace agree with complex steps, with the regressor, and with each other."""

import numpy as np
import pytest
from peers.complex_programs import directional_derivatives, evaluate
from peers.traced_models import shipped_robot

from robot_dynamics import Dynamics
from robot_dynamics.codegen.trace.accumulation import forward_accumulation, reverse_accumulation, substitute
from robot_dynamics.codegen.trace.model_trace import ModelTrace, inertia_name
from robot_dynamics.codegen.trace.program import build_program, order_by_use
from robot_dynamics.codegen.trace.scalar import Trace

ACCUMULATIONS = [forward_accumulation, reverse_accumulation]
SAMPLE = {"x": np.array([0.7, -0.4, 1.3]), "p": np.array([0.2, 2.0])}


def traced():
    """A trace with all operations, its inputs x and p, and outputs."""
    trace = Trace()
    x, p = trace.input("x", 3), trace.input("p", 2)
    a = np.sin(x[0] * p[0]) * x[1] - x[2] / (x[0] + 3)
    b = np.sqrt(x[1] * x[1] + np.cos(x[2])) + a * a
    c = x[0].signum() * x[2] - b / a
    outputs = np.array([a, -b, c, x[2], -(x[0] - x[1]), p[0] * 1.0, trace.constant(3.0), 2.5], dtype=object)
    return trace, x, outputs


def program_of(trace, results):
    return build_program(trace, "results", {name: len(values) for name, values in SAMPLE.items()}, results)


def values_of(trace, array):
    """The numbers of an array of a trace at the SAMPLE."""
    return evaluate(program_of(trace, {"y": array}), {k: v[None] for k, v in SAMPLE.items()})["y"][0]


@pytest.mark.parametrize("accumulate", ACCUMULATIONS)
def test_directional_derivatives_of_all_operations(accumulate):
    trace, x, outputs = traced()
    directions = np.array([[1.0, 0.0, 2.0, 0.0], [0.5, 0.0, 0.0, 0.0], [0.0, 1.0, -1.0, 0.0]])
    expected = directional_derivatives(program_of(trace, {"y": outputs}), SAMPLE, {"x": directions})["y"]
    derivatives = accumulate(trace, outputs, x, directions)
    np.testing.assert_allclose(values_of(trace, derivatives), expected, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("accumulate", ACCUMULATIONS)
def test_directions_may_be_scalars_of_the_trace(accumulate):
    trace, x, outputs = traced()
    directions = np.array([[np.sin(x[1])], [0], [x[0] * x[2]]], dtype=object)
    values = values_of(trace, directions)
    expected = directional_derivatives(program_of(trace, {"y": outputs}), SAMPLE, {"x": values})["y"]
    derivatives = accumulate(trace, outputs, x, directions)
    np.testing.assert_allclose(values_of(trace, derivatives), expected, rtol=1e-14, atol=1e-15)


def test_substitution_records_expressions_of_other_scalars():
    trace, x, outputs = traced()
    replacement = x[1] * x[1] + 0.1
    (replaced,) = substitute(trace, [outputs], {x[0].node: replacement})
    moved = {**SAMPLE, "x": SAMPLE["x"].copy()}
    moved["x"][0] = SAMPLE["x"][1] ** 2 + 0.1
    program = program_of(trace, {"y": outputs})
    expected = evaluate(program, {name: values[None] for name, values in moved.items()})["y"][0]
    np.testing.assert_allclose(values_of(trace, replaced), expected, rtol=1e-15)


def test_order_by_use_keeps_the_program():
    trace, _, outputs = traced()
    program = program_of(trace, {"y": outputs, "matrix": outputs.reshape(2, 4), "empty": np.zeros((0, 0))})
    ordered = order_by_use(program)
    assert sorted(ordered.statements) == sorted(program.statements)
    position = {statement.number: index for index, statement in enumerate(ordered.statements)}
    for number, _, operands in ordered.statements:
        assert all(position.get(operand, -1) < position[number] for operand in operands)


@pytest.mark.parametrize("accumulate", ACCUMULATIONS)
def test_derivatives_by_inertias_are_the_regressor(accumulate):
    robot = shipped_robot("ur5e")
    model = ModelTrace("inverse", robot, ("q", "qd", "qdd"), varied_links=[2, 6], prepare=False)
    forces, _ = model.forces(model.inputs["qdd"], model.base_acceleration)
    variables = np.concatenate([model.inputs[inertia_name(link)] for link in (2, 6)])
    derivatives = accumulate(model.trace, model.projected(forces), variables, np.eye(20))
    program = build_program(
        model.trace, "by_inertias", {name: len(values) for name, values in model.inputs.items()}, {"y": derivatives}
    )
    state = dict(zip(("q", "qd", "qdd"), np.random.default_rng(0).uniform(-1, 1, (3, 6)), strict=True))
    inputs = {name: state[name] if name in state else np.ones(size) for name, size in program.inputs.items()}
    y = evaluate(program, {name: values[None] for name, values in inputs.items()})["y"][0]
    dynamics = Dynamics(robot, compiled=False)
    Y = dynamics.regressor(*state.values())
    labels = ("M", "MX", "MY", "MZ", "XX", "XY", "XZ", "YY", "YZ", "ZZ")
    names = [f"{label}.{robot.links[link].name}" for link in (2, 6) for label in labels]
    columns = [dynamics.parameter_names.index(name) for name in names]
    np.testing.assert_allclose(y, Y[:, columns], rtol=0, atol=1e-12)
