"""States of robots, and derivatives of their models by complex steps along motions that keep loops closed."""

import numpy as np

from robot_dynamics import Dynamics
from robot_dynamics.codegen.jit.compiled_models import MODELS

from .complex_programs import directional_derivatives, evaluate


def random_state(robot, seed=0, q=None, near=0.02):
    """Inputs {name: (size,)} of models of a robot; q: closed positions of all joints, by default near the initial ones
    of robots with loops.
    """
    rng = np.random.default_rng([seed, 22])
    dynamics = Dynamics(robot, compiled=False)
    n = len(dynamics.joint_names)
    if q is None and robot.loops:
        start = dynamics.initial_joint_positions[[robot.joint_numbers[name] for name in dynamics.joint_names]]
        q = dynamics.expand_positions(start + near * rng.uniform(-1, 1, n))
    values = {"q": rng.uniform(-1, 1, n) if q is None else q}
    values.update({name: rng.uniform(-1, 1, n) for name in ("qd", "qdd", "efforts")})
    for column in dynamics._unactuated:
        values["qdd"][column] = values["efforts"][column] = 0
    if robot.moving_base:
        values.update(twist=rng.uniform(-1, 1, 6), gravity=rng.uniform(-9, 9, 3))
        values["base_acceleration"] = rng.uniform(-1, 1, 6)
    return values


def directions(robot, state):
    """{input: (size, 3 m)} by positions, by velocities, by accelerations or efforts; the base first.

    The tangent of the constraints is that of the recursions.
    """
    dynamics = Dynamics(robot, compiled=False)
    n = len(dynamics.joint_names)
    base = 6 if robot.moving_base else 0
    m = base + n
    moved = {name: np.zeros((len(values), 3 * m)) for name, values in state.items()}
    tangent = [dynamics.expand_velocities(unit, state["q"]) for unit in np.eye(n)] if robot.loops else np.eye(n)
    moved["q"][:, base:m] = np.transpose(tangent)
    moved["qd"][:, m + base : 2 * m] = np.eye(n)
    for name in ("qdd", "efforts"):
        moved[name][:, 2 * m + base :] = np.eye(n)
    for column in dynamics._unactuated:
        moved["qdd"][column] = 0
    if base:
        moved["gravity"][:, 3:6] = np.cross(state["gravity"], np.eye(3)).T
        moved["twist"][:, m : m + 6] = np.eye(6)
        moved["base_acceleration"][:, 2 * m : 2 * m + 6] = np.eye(6)
    return moved


def complex_step(robot, model, state, **options):
    """(rows, 3 m) derivatives of the model inverse or direct; rows of the base of direct come first."""
    program = MODELS[model](robot, **options)
    moved = directions(robot, state)
    results = directional_derivatives(
        program, {name: state[name] for name in program.inputs}, {k: moved[k] for k in program.inputs if k in moved}
    )
    if model == "inverse":
        return results["efforts"]
    rows = results["accelerations"]
    if robot.moving_base:
        rows = np.concatenate([results.get("base_acceleration", np.zeros((6, rows.shape[1]))), rows])
    return rows


def program_derivatives(robot, model, state, program=None, **options):
    """Outputs {name: array} of the program of the derivatives of the model inverse or direct."""
    program = program or MODELS[f"{model}_derivatives"](robot, **options)
    outputs = evaluate(program, {name: np.asarray(state[name])[None] for name in program.inputs})
    return {name: values[0] for name, values in outputs.items()}


def relative_error(actual, expected):
    """Largest difference, relative to the largest entry."""
    return np.abs(actual - expected).max(initial=0) / max(np.abs(expected).max(initial=0), 1e-9)


def largest_errors(robot, state, programs=None, **options):
    """{model and output: relative error} of the derivatives of both models."""
    programs = programs or {}
    base = 6 if robot.moving_base else 0
    m = base + len(state["qd"])
    errors = {}
    for model in ("inverse", "direct"):
        expected = complex_step(robot, model, state, **options)
        actual = program_derivatives(robot, model, state, programs.get(model), **options)
        blocks = dict(zip(("by_positions", "by_velocities", "last"), np.split(expected, 3, axis=1), strict=True))
        last = blocks.pop("last")
        if model == "inverse":
            blocks["by_accelerations"] = last
            actual = {name: values[base:] for name, values in actual.items()}  # inverse does not return the wrench
        else:
            blocks["by_efforts"] = last[:, base:]
            if "by_base_acceleration" in actual:
                blocks["by_base_acceleration"] = np.concatenate([np.eye(6), last[6:, :6]])
        assert set(blocks) == set(actual)
        errors.update({f"{model} {name}": relative_error(actual[name], block) for name, block in blocks.items()})
    assert len(blocks["by_positions"]) == m
    return errors
