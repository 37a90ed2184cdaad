"""Bound models: the results and errors of the methods of Dynamics, with names and constants resolved once."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

from robot_dynamics import Base, Dynamics, InvalidInputError, load_robot


def state(dynamics, seed=0):
    q, qd, last = np.random.default_rng(seed).uniform(-1, 1, (3, len(dynamics.joint_names)))
    return q, qd, last


@pytest.mark.parametrize("model", ["inverse", "direct"])
def test_external_wrench_of_a_bound_model(model):
    dynamics, recursion = Dynamics(load_robot("panda")), Dynamics(load_robot("panda"), compiled=False)
    link = dynamics.robot.links[-1].name
    wrench = np.array([1.0, 2, 3, 4, 5, 6])
    bound = dynamics.bind(model, external_wrenches={link: wrench})
    arguments = state(dynamics)
    expected = getattr(recursion, model)(*arguments, external_wrenches={link: wrench})
    np.testing.assert_allclose(bound(*arguments), expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    wrench[:] = 0  # the caller's array is not the constant
    np.testing.assert_allclose(bound(*arguments), expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    batch = [np.tile(argument, (4, 1)) for argument in arguments]
    np.testing.assert_allclose(bound(*batch), np.tile(expected, (4, 1)), rtol=1e-9)


@pytest.mark.parametrize("has_acceleration", [False, True])
@pytest.mark.parametrize("model", ["inverse", "direct", "gravity", "coriolis", "inertia_matrix"])
def test_moving_base_of_a_bound_model(model, has_acceleration):
    robot = replace(load_robot("panda"), moving_base=True)
    dynamics, recursion = Dynamics(robot), Dynamics(robot, compiled=False)
    acceleration = np.arange(6.0) if has_acceleration and model in ("inverse", "direct") else None
    base = Base(twist=np.linspace(-1, 1, 6), acceleration=acceleration)
    options = {} if model == "inertia_matrix" else {"base": base}
    bound = dynamics.bind(model, **options)
    arguments = state(dynamics)[: {"inverse": 3, "direct": 3, "coriolis": 2}.get(model, 1)]
    expected = getattr(recursion, model)(*arguments, **options)
    np.testing.assert_allclose(bound(*arguments), expected, rtol=0, atol=1e-9 * (1 + np.abs(expected).max()))


def test_constants_that_do_not_fit_are_refused():
    dynamics = Dynamics(load_robot("panda"))
    link = dynamics.robot.links[-1].name
    with pytest.raises(InvalidInputError, match="nowhere"):
        dynamics.bind("inverse", external_wrenches={"nowhere": np.zeros(6)})
    with pytest.raises(InvalidInputError, match="no part in gravity"):
        dynamics.bind("gravity", external_wrenches={link: np.zeros(6)})
    with pytest.raises(InvalidInputError, match="one sample"):
        dynamics.bind("inverse", external_wrenches={link: np.zeros((3, 6))})
    with pytest.raises(InvalidInputError, match="finite"):
        dynamics.bind("inverse", external_wrenches={link: np.full(6, np.nan)})
    with pytest.raises(InvalidInputError, match="model"):
        dynamics.bind("regressor")
    with pytest.raises(InvalidInputError, match="base"):
        dynamics.bind("inverse", base=Base(twist=np.ones(6)))


def test_a_bound_model_raises_the_errors_of_dynamics():
    dynamics = Dynamics(load_robot("panda"))
    bound = dynamics.bind("inverse")
    q, qd, qdd = state(dynamics)
    with pytest.raises(InvalidInputError, match="velocities"):
        bound(q, qd[:-1], qdd)
    qdd[2] = np.nan
    with pytest.raises(InvalidInputError, match="accelerations"):
        bound(q, qd, qdd)


def test_constants_are_copies():
    robot = replace(load_robot("panda"), moving_base=True)
    dynamics = Dynamics(robot)
    pose = np.eye(4)
    bound = dynamics.bind("gravity", base=Base(pose=pose))
    q = np.zeros(len(dynamics.joint_names))
    before = bound(q)
    pose[:3, :3] = np.diag([1.0, -1, -1])
    np.testing.assert_allclose(bound(q), before)
    np.testing.assert_allclose(bound(q.tolist()), before, atol=1e-10)


def test_states_of_the_base_that_have_no_part_are_refused():
    dynamics = Dynamics(replace(load_robot("panda"), moving_base=True))
    for model in ("gravity", "coriolis"):
        with pytest.raises(InvalidInputError, match="no part"):
            dynamics.bind(model, base=Base(acceleration=np.ones(6)))
    with pytest.raises(InvalidInputError, match="no part"):
        dynamics.bind("inertia_matrix", base=Base())
    with pytest.raises(InvalidInputError, match="mapping"):
        dynamics.bind("inverse", external_wrenches=[1, 2])
    with pytest.raises(InvalidInputError, match="panda_link8"):
        dynamics.bind("inverse", external_wrenches={"panda_link8": "abc"})


@pytest.mark.parametrize("copy_object", [copy.copy, copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_bound_models_are_copied_and_pickled(copy_object):
    robot = replace(load_robot("panda"), moving_base=True)
    dynamics = Dynamics(robot)
    link = robot.links[-1].name
    base = Base(twist=np.linspace(-1, 1, 6), acceleration=np.arange(6.0))
    bound = dynamics.bind("inverse", base=base, external_wrenches={link: np.arange(6.0)})
    arguments = state(dynamics)
    np.testing.assert_array_equal(copy_object(bound)(*arguments), bound(*arguments))
