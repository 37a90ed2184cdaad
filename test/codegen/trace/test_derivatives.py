"""Gradients of programs by reverse accumulation agree with finite differences."""

import numpy as np
import pytest
from peers.frictions import with_random_friction
from peers.random_loops import random_loops
from peers.real_robots import real_urdf

from robot_dynamics import load_robot
from robot_dynamics.codegen.trace.derivatives import DifferentiableProgram
from robot_dynamics.codegen.trace.models import closure_model, direct_model, inverse_model, regressor_model
from robot_dynamics.model.formats.urdf.reader import read_urdf

STEP = 1e-6
PROGRAMS = {
    "regressor of a Panda": lambda: regressor_model(load_robot("panda")),
    "regressor of an arm that flies": lambda: regressor_model(load_robot("free_flying_arm")),
    "inverse of an RX90": lambda: inverse_model(load_robot("rx90")),
    "inverse of a robot with joints that slide": lambda: inverse_model(read_urdf(real_urdf("tiago"))),
    "direct, with divisions": lambda: direct_model(load_robot("ur5e")),
    "inverse, with friction of all kinds": lambda: inverse_model(with_random_friction(load_robot("ur5e"), 2)),
    "closure, with square roots and signs": lambda: closure_model(random_loops(1, elastic=False).robot),
}


def differences(program, arrays, weights):
    """Central differences of the weighted sum by each input, {name: (N, size)}."""
    gradients = {}
    for index, name in enumerate(program._inputs):
        gradients[name] = np.zeros_like(arrays[index])
        for column in range(arrays[index].shape[1]):
            sums = []
            for sign in (1, -1):
                moved = [array.copy() for array in arrays]
                moved[index][:, column] += sign * STEP
                sums.append((weights * program.evaluate(*moved).outputs).sum(axis=1))
            gradients[name][:, column] = (sums[0] - sums[1]) / (2 * STEP)
    return gradients


@pytest.mark.slow
@pytest.mark.parametrize("name", PROGRAMS)
def test_gradient_agrees_with_finite_differences(name):
    program, rng = PROGRAMS[name](), np.random.default_rng(0)
    arrays = [rng.uniform(0.2, 1.0, (2, size)) for size in program.inputs.values()]
    differentiable = DifferentiableProgram(program)
    evaluation = differentiable.evaluate(*arrays)
    weights = rng.normal(size=evaluation.outputs.shape) / (1 + np.abs(evaluation.outputs))
    gradients = differentiable.gradient(evaluation, weights)
    for key, expected in differences(differentiable, arrays, weights).items():
        np.testing.assert_allclose(gradients[key], expected, rtol=0, atol=1e-6 * max(1.0, np.abs(expected).max()))


def test_gradient_of_selected_entries_and_smoothed_signs():
    """Coulomb friction of the Panda is a step at rest, which has a derivative if it is smoothed."""
    program, rng = regressor_model(load_robot("panda")), np.random.default_rng(1)
    arrays = list(rng.uniform(-0.1, 0.1, (3, 4, 7)))
    whole = DifferentiableProgram(program).evaluate(*arrays).outputs
    columns = whole.shape[1] // 7
    entries = [3 * columns + 3 * 13 + 12, 2 * columns + 5 * 13]  # Fs of joint 4, and a moment of inertia of link 6
    assert program.outputs[0].shape == (7, columns) and (np.abs(whole[:, entries[0]]) == 1).all()
    few = DifferentiableProgram(program, entries)
    assert np.array_equal(few.evaluate(*arrays).outputs, whole[:, entries])
    assert len(few._statements) < 0.3 * len(DifferentiableProgram(program)._statements)
    smooth = DifferentiableProgram(program, entries, {"qd": np.full(7, 0.05)})
    evaluation = smooth.evaluate(*arrays)
    qd = arrays[1][:, 3]
    np.testing.assert_allclose(evaluation.outputs[:, 0], qd / np.hypot(qd, 0.05), rtol=1e-12)
    weights = rng.normal(size=(4, 2))
    gradients = smooth.gradient(evaluation, weights)
    for key, expected in differences(smooth, arrays, weights).items():
        np.testing.assert_allclose(gradients[key], expected, rtol=0, atol=1e-7)
    of_friction = weights * [1, 0]
    assert smooth.gradient(evaluation, of_friction)["qd"][:, 3].all()
    assert not few.gradient(few.evaluate(*arrays), of_friction)["qd"].any()  # a step has no derivative
