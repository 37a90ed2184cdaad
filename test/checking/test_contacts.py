"""Contacts at rest against residuals of known shape."""

from dataclasses import replace

import numpy as np
import pytest

from robot_dynamics import load_robot
from robot_dynamics.checking.contacts import find_contact_at_rest
from robot_dynamics.checking.fault_signals import FaultSignals

STEP = 0.02
N = 1000
FRICTION = 2.0


def signals_of(residuals, resting):
    rows, joints = residuals.shape
    zero = np.zeros_like(residuals)
    return FaultSignals(
        times=STEP * np.arange(rows),
        step=STEP,
        band=4.0,
        residuals=residuals,
        predicted=zero,
        velocity_signs=zero,
        velocities=zero,
        payload_efforts=np.zeros((rows, joints, 4)),
        offset_efforts=np.zeros((rows, joints, joints)),
        valid=~resting,
        resting=resting,
        recorded=np.ones(rows),
    )


@pytest.fixture
def joints():
    return tuple(replace(joint, coulomb_friction=FRICTION) for joint in load_robot("rx90").joints[1:3])


def test_push_while_a_joint_rests_is_a_contact(joints):
    residuals = 0.05 * np.random.default_rng(0).normal(size=(N, 2))
    residuals[400:460, 1] += 3 * FRICTION
    contact = find_contact_at_rest(signals_of(residuals, np.ones((N, 2), dtype=bool)), joints)
    assert contact.joints == (1,) and contact.at_rest
    assert contact.start == pytest.approx(400 * STEP) and contact.end == pytest.approx(460 * STEP)


@pytest.mark.parametrize("begin", [0, 300])
def test_residual_that_is_there_when_a_joint_comes_to_rest_is_no_contact(joints, begin):
    """Nothing tells it from a wrong load or friction of the model; another joint is pushed all the same."""
    residuals = 0.05 * np.random.default_rng(0).normal(size=(N, 2))
    resting = np.ones((N, 2), dtype=bool)
    resting[:begin] = False
    residuals[begin:, 0] += 3 * FRICTION
    assert find_contact_at_rest(signals_of(residuals, resting), joints) is None
    residuals[600:660, 1] += 3 * FRICTION
    assert find_contact_at_rest(signals_of(residuals, resting), joints).joints == (1,)


@pytest.mark.parametrize("friction", [0.0, 1e-6])
def test_joint_whose_friction_is_not_seen_has_no_bound(joints, friction):
    residuals = 0.05 * np.random.default_rng(0).normal(size=(N, 2))
    residuals[400:460, 1] += 3 * FRICTION
    without = tuple(replace(joint, coulomb_friction=friction) for joint in joints)
    assert find_contact_at_rest(signals_of(residuals, np.ones((N, 2), dtype=bool)), without) is None
