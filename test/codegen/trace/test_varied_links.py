"""Models with inertias as arguments agree with models of robots that have these inertias."""

import numpy as np
import pytest

from robot_dynamics import Dynamics, Inertia, load_robot
from robot_dynamics.codegen.jit.python_functions import python_function
from robot_dynamics.codegen.trace import models
from robot_dynamics.model.inertia import symmetric_entries

PAYLOAD = Inertia.about_centre_of_mass(2.0, np.diag([0.01, 0.02, 0.03]), np.array([0.1, 0.05, 0.2]))


def entries(inertia):
    return np.array([inertia.mass, *inertia.first_moments, *symmetric_entries(inertia.second_moments)], dtype=float)


def as_list(results):
    return results if isinstance(results, tuple) else (results,)


@pytest.mark.parametrize("name", ["panda", "puma560", "irb460", "gough_stewart"])
@pytest.mark.parametrize("varies_all", [False, True])
def test_inertias_are_arguments(name, varies_all):
    robot = load_robot(name)
    loaded = robot.with_payload(robot.frames[-1].name, PAYLOAD)
    last = loaded.frame(robot.frames[-1].name).link
    links = [
        number
        for number, link in enumerate(loaded.links)
        if number == last or (varies_all and number > 0 and link.inertia.mass > 0)
    ]
    inertias = [entries(loaded.links[number].inertia) for number in links]
    rng = np.random.default_rng(0)
    q = Dynamics(robot).initial_joint_positions
    for model in (models.state_derivative_model if robot.loops else models.direct_model, models.inertia_matrix_model):
        expected_program = model(loaded)
        arguments = [q, *(rng.normal(size=size) for size in list(expected_program.inputs.values())[1:])]
        program = model(robot, varied_links=links)
        assert list(program.inputs.values())[len(arguments) :] == [10] * len(links)
        results = as_list(python_function(program)(*arguments, *inertias))
        for result, expected in zip(results, as_list(python_function(expected_program)(*arguments)), strict=True):
            np.testing.assert_allclose(result, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["panda", "free_flying_arm", "irb460"])
@pytest.mark.parametrize("model", ["inverse", "direct", "inertia_matrix", "gravity", "coriolis", "bias"])
def test_payloads_are_arguments(name, model):
    robot = load_robot(name)
    frame = robot.frames[-1].name
    loaded = robot.with_payload(frame, PAYLOAD)
    trace = getattr(models, f"{model}_model")
    expected_program = trace(loaded)
    program = trace(robot, payloads=[frame])
    assert program.inputs == {**expected_program.inputs, f"payload on {frame}": 10}
    rng = np.random.default_rng(1)
    arguments = [rng.normal(size=size) for size in expected_program.inputs.values()]
    if robot.loops:
        arguments[0] = Dynamics(robot).expand_positions(Dynamics(robot).initial_joint_positions)
    for payload, expected_of in ((entries(PAYLOAD), expected_program), (np.zeros(10), trace(robot))):
        results = as_list(python_function(program)(*arguments, payload))
        expected_results = as_list(python_function(expected_of)(*arguments))
        for result, expected in zip(results, expected_results, strict=True):
            np.testing.assert_allclose(result, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
