"""Checked models: Dynamics gives the same results with them, and the same errors."""

import threading
import time

import numpy as np
import pytest
from peers.large_robots import LARGE_ROBOTS, each_robot

pytest.importorskip("llvmlite")
from robot_dynamics import Dynamics, InvalidInputError, SingularModelError, load_robot, shipped_robots
from robot_dynamics.codegen.jit.background import THREAD_NAME
from robot_dynamics.codegen.procedure.checked_models import BOUND_MODELS

pytestmark = pytest.mark.slow  # compiles models of all robots that ship

ROBOTS = [name for name in shipped_robots() if not load_robot(name).moving_base]


def ready_dynamics(robot, models=BOUND_MODELS):
    """Dynamics of which all checked models are compiled."""
    dynamics = Dynamics(robot)
    q, qd, last = arguments_near_start(dynamics, np.random.default_rng(1))
    for model in models:
        dynamics.bind(model)  # compiles the program with pivots, too
        getattr(dynamics, model)(q, *{"inverse": (qd, last), "direct": (qd, last), "coriolis": (qd,)}.get(model, ()))
    end = time.monotonic() + 60
    while any(thread.name == THREAD_NAME for thread in threading.enumerate()):
        assert time.monotonic() < end
        time.sleep(0.01)
    return dynamics


def arguments_near_start(dynamics, rng):
    """Positions (n,) near the initial ones, velocities and accelerations; zero where joints are not actuated."""
    numbers = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    q = dynamics.initial_joint_positions[numbers] + 0.02 * rng.normal(size=len(numbers))
    last = rng.normal(size=len(numbers))
    last[[dynamics.joint_names.index(name) for name in dynamics.unactuated_joint_names]] = 0
    return q, rng.normal(size=len(numbers)), last


@pytest.mark.parametrize("name", each_robot(ROBOTS, (*LARGE_ROBOTS, "andrews_squeezer", "bricard")))
def test_checked_models_agree_with_the_recursions(name):
    dynamics, recursion = ready_dynamics(load_robot(name)), Dynamics(load_robot(name), compiled=False)
    assert dynamics._attempts.keys() <= {*BOUND_MODELS}
    assert "inertia_matrix" in dynamics._attempts
    rng = np.random.default_rng(0)
    for _ in range(5):
        q, qd, last = arguments_near_start(dynamics, rng)
        for positions in (q, recursion.expand_positions(q)) if dynamics.robot.loops else (q,):
            for model in dynamics._attempts:
                arguments = {"inverse": (qd, last), "direct": (qd, last), "coriolis": (qd,)}.get(model, ())
                expected = getattr(recursion, model)(positions, *arguments)
                result = dynamics._attempt(model, positions, *arguments)
                assert result is not None
                np.testing.assert_allclose(result, expected, rtol=0, atol=1e-8 * (1 + np.abs(expected).max()))
                np.testing.assert_array_equal(getattr(dynamics, model)(positions, *arguments), result)


def test_arguments_of_all_other_kinds_take_the_other_way():
    dynamics = ready_dynamics(load_robot("panda"), ["inverse"])
    q, qd, qdd = arguments_near_start(dynamics, np.random.default_rng(0))
    expected = dynamics.inverse(q, qd, qdd)
    assert dynamics._attempt("inverse", q, qd, qdd) is not None
    np.testing.assert_allclose(dynamics.inverse(q.tolist(), qd, qdd), expected, rtol=1e-14)
    np.testing.assert_allclose(dynamics.inverse(q[::-1][::-1], qd, qdd), expected, rtol=1e-14)
    strided = np.stack([q, q], axis=1)[:, 0]
    assert dynamics._attempt("inverse", strided, qd, qdd) is None
    np.testing.assert_allclose(dynamics.inverse(strided, qd, qdd), expected, rtol=1e-14)
    assert dynamics.inverse(np.tile(q, (3, 1)), qd, qdd).shape == (3, len(q))
    assert dynamics._attempt("inverse", q[None], qd, qdd) is None
    assert dynamics.inverse(np.zeros(len(q), dtype=int), qd, qdd).shape == q.shape
    with pytest.raises(InvalidInputError, match="positions"):
        dynamics.inverse(q[:-1], qd, qdd)
    with pytest.raises(TypeError):
        dynamics.inverse(q, qd)


@pytest.mark.parametrize("position", range(3))
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_are_refused_by_name(position, value):
    dynamics = ready_dynamics(load_robot("panda"), ["inverse", "gravity"])
    arguments = list(arguments_near_start(dynamics, np.random.default_rng(0)))
    arguments[position][0] = value  # gravity and inverse may not depend on the first joint
    label = ("positions", "velocities", "accelerations")[position]
    with pytest.raises(InvalidInputError, match=label):
        dynamics.inverse(*arguments)
    if position == 0:
        with pytest.raises(InvalidInputError, match=label):
            dynamics.gravity(arguments[0])


def test_positions_that_do_not_close_raise_the_error_that_names_the_loop():
    dynamics = ready_dynamics(load_robot("gough_stewart"), ["gravity"])
    q = dynamics.initial_joint_positions[[dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]]
    assert dynamics._attempt("gravity", q) is not None
    with pytest.raises(SingularModelError, match="loop"):
        dynamics.gravity(q + 5 * np.arange(len(q)))


def test_unactuated_joints_take_no_accelerations():
    robots = [robot for robot in map(load_robot, ROBOTS) if Dynamics(robot, compiled=False).unactuated_joint_names]
    for robot in robots:
        dynamics = ready_dynamics(robot, ["inverse"])
        q, qd, qdd = arguments_near_start(dynamics, np.random.default_rng(0))
        expected = dynamics.inverse(q, qd, qdd)
        column = dynamics.joint_names.index(dynamics.unactuated_joint_names[0])
        qdd[column] = np.nan
        np.testing.assert_allclose(dynamics.inverse(q, qd, qdd), expected, rtol=1e-12)
        qdd[column] = 1.0
        with pytest.raises(InvalidInputError, match=dynamics.unactuated_joint_names[0]):
            dynamics.inverse(q, qd, qdd)
    assert robots
