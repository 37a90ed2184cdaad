"""Friction of joints against its definition for each direction, and the loads that follow from efforts."""

import numpy as np
import pytest
from peers.frictions import all_friction, joint_friction, with_random_friction, without_friction

from robot_dynamics import load_robot
from robot_dynamics.model.joint import Joint
from robot_dynamics.newton_euler.friction import (
    FRICTION_PARAMETERS,
    friction,
    friction_columns,
    friction_parameter,
    further_friction_parameters,
    load_friction,
    loads_from_net_efforts,
)

RNG = np.random.default_rng(18)
VELOCITIES = np.concatenate([RNG.uniform(-3, 3, (200, 6)), np.zeros((1, 6)), RNG.uniform(-1e-6, 1e-6, (5, 6))])
LOADS = RNG.uniform(-40, 40, VELOCITIES.shape)


@pytest.fixture(scope="module")
def arm():
    return with_random_friction(load_robot("ur5e"), 3)


def test_friction_is_that_of_the_definition(arm):
    efforts = friction(arm, VELOCITIES) + load_friction(arm.joints, VELOCITIES, LOADS)
    np.testing.assert_allclose(efforts, all_friction(arm, VELOCITIES, LOADS), rtol=1e-13, atol=1e-13)
    assert not efforts[200].any()


def test_columns_times_parameters_are_the_friction(arm):
    columns = friction_columns(VELOCITIES, LOADS, [joint.stribeck_velocity for joint in arm.joints])
    assert columns.shape == (*VELOCITIES.shape, len(FRICTION_PARAMETERS))
    values = [[friction_parameter(joint, parameter) for parameter in FRICTION_PARAMETERS] for joint in arm.joints]
    efforts = (columns * np.array(values)).sum(axis=-1)
    np.testing.assert_allclose(efforts, all_friction(arm, VELOCITIES, LOADS), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("parameter", FRICTION_PARAMETERS)
def test_each_column_is_the_friction_of_one_parameter(parameter):
    field = {
        "Fv": "viscous_friction",
        "Fs": "coulomb_friction",
        "Fva": "viscous_asymmetry",
        "Fsa": "coulomb_asymmetry",
        "Fst": "stribeck_friction",
        "mu": "load_friction",
    }[parameter]
    joint = Joint("joint", 0, False, np.eye(4), stribeck_velocity=0.4, **{field: 1.0})
    column = friction_columns(VELOCITIES[:, :1], LOADS[:, :1], 0.4)[:, 0, FRICTION_PARAMETERS.index(parameter)]
    expected = [
        joint_friction(joint, *sample) for sample in zip(VELOCITIES[:, 0].tolist(), LOADS[:, 0].tolist(), strict=True)
    ]
    np.testing.assert_allclose(column, expected, rtol=1e-13)


def test_stribeck_curve_is_full_at_rest_and_half_at_its_velocity():
    curve = friction_columns(np.array([[1e-12], [0.2], [-0.2], [2e3]]), np.zeros((4, 1)), 0.2)
    np.testing.assert_allclose(curve[:, 0, FRICTION_PARAMETERS.index("Fst")], [1, 0.5, -0.5, 1e-8], rtol=1e-6)


def test_loads_follow_from_net_efforts(arm):
    net_efforts = LOADS + load_friction(arm.joints, VELOCITIES, LOADS)
    np.testing.assert_allclose(loads_from_net_efforts(arm.joints, VELOCITIES, net_efforts), LOADS, rtol=1e-13)
    plain = without_friction(arm).joints
    assert loads_from_net_efforts(plain, VELOCITIES, net_efforts) is net_efforts


def test_parameters_beside_viscous_and_coulomb_friction_are_those_that_are_not_zero(arm):
    assert further_friction_parameters(without_friction(arm)) == []
    shipped = load_robot("puma560")
    assert any(joint.coulomb_friction for joint in shipped.joints) and further_friction_parameters(shipped) == []
    partial = with_random_friction(shipped, 1, joints=[2], load_friction=False)
    assert further_friction_parameters(partial) == [("Fva", 2), ("Fsa", 2), ("Fst", 2)]
