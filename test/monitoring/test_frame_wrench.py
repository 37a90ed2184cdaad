"""Wrenches from torques that Pinocchio's Jacobian gives, and what the joints do not determine."""

import numpy as np
import pinocchio as pin
import pytest
from peers.recorded import panda_model

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.monitoring.frame_wrench import COMPONENTS, WrenchEstimator

Q = np.array([0.1, -0.3, 0.2, -1.9, 0.1, 1.8, 0.5])
WRENCH = np.array([3.0, -8.0, 15.0, 0.4, -0.9, 1.3])
PLANAR = """<robot name="planar"><link name="base"/>
<link name="upper"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tip"/>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><axis xyz="0 0 1"/>
<origin xyz="0.5 0 0"/></joint>
<joint name="end" type="fixed"><parent link="lower"/><child link="tip"/><origin xyz="0.4 0 0"/></joint></robot>"""


@pytest.fixture(scope="module")
def panda():
    return Dynamics(load_robot("panda"))


def torques(q, wrench, frame="panda_link8"):
    model = panda_model()
    J = pin.computeFrameJacobian(model, model.createData(), q, model.getFrameId(frame), pin.LOCAL)
    return J.T @ wrench


@pytest.mark.parametrize("frame", ["panda_link8", "panda_link7"])
def test_wrench_of_seven_joints_is_exact_with_any_scales(panda, frame):
    for scales in (None, [3.0, 3.0, 2.0, 2.0, 0.5, 0.5, 0.2]):
        result = WrenchEstimator(panda, frame, scales=scales).estimate(Q, torques(Q, WRENCH, frame))
        np.testing.assert_allclose(result.wrench, WRENCH, rtol=0, atol=1e-9)
        assert result.condition < 50 and result.unexplained < 1e-9 and not result.undetermined


def test_scales_weigh_joints_and_inf_leaves_one_out(panda):
    disturbed = torques(Q, WRENCH) + np.array([5.0, 0, 0, 0, 0, 0, 0])
    plain = WrenchEstimator(panda, "panda_link8").estimate(Q, disturbed)
    weighed = WrenchEstimator(panda, "panda_link8", scales=[np.inf, *[1.0] * 6]).estimate(Q, disturbed)
    assert np.abs(plain.wrench - WRENCH).max() > 0.5
    np.testing.assert_allclose(weighed.wrench, WRENCH, rtol=0, atol=1e-8)
    assert plain.unexplained > 0.5


def test_force_without_torque_and_torques_that_do_not_fit_it(panda):
    estimator = WrenchEstimator(panda, "panda_link8", "force")
    force = np.r_[WRENCH[:3], np.zeros(3)]
    exact = estimator.estimate(Q, torques(Q, force))
    np.testing.assert_allclose(exact.wrench, force, atol=1e-9)
    assert exact.unexplained < 1e-9
    elsewhere = estimator.estimate(Q, torques(Q, np.r_[WRENCH[:3], 0.0, 0.0, 5.0]))
    assert elsewhere.unexplained > 0.3


def test_stretched_arm_leaves_components_out():
    """A planar arm determines two components at most; stretched, only that across it, and never a torque with it."""
    planar = Dynamics(load_robot(PLANAR))
    estimator = WrenchEstimator(planar, "tip", "force")
    bent = np.array([0.3, 1.2])
    J = planar.frame("tip").jacobian(bent)
    result = estimator.estimate(bent, J.T @ np.array([2.0, -3.0, 0, 0, 0, 0]))
    np.testing.assert_allclose(result.wrench, [2.0, -3.0, np.nan, 0, 0, 0], atol=1e-9)
    assert result.undetermined == ("force z",) and np.isinf(result.condition)
    straight = np.array([0.3, 0.0])
    J = planar.frame("tip").jacobian(straight)
    result = estimator.estimate(straight, J.T @ np.array([2.0, -3.0, 0, 0, 0, 0]))
    assert result.undetermined == ("force x", "force z") and result.wrench[1] == pytest.approx(-3.0)
    full = WrenchEstimator(planar, "tip").estimate(bent, J.T @ np.array([2.0, -3.0, 0, 0, 0, 0]))
    assert set(full.undetermined) >= {"force z", "torque x", "torque y", "torque z"}
    assert set(full.undetermined) <= set(COMPONENTS)


def test_frame_of_the_base_is_refused(panda):
    with pytest.raises(InvalidInputError, match="'panda_link0' is fixed to the base"):
        WrenchEstimator(panda, "panda_link0")
    with pytest.raises(InvalidInputError, match="hand"):
        WrenchEstimator(panda, "hand")


def test_moving_base_uses_the_joints_only():
    flyer = Dynamics(load_robot("free_flying_arm"))
    q = np.array([0.3, -0.8, 1.1, 0.4, 0.9, 0.2])
    J = flyer.frame("arm_tool0").jacobian(q)
    result = WrenchEstimator(flyer, "arm_tool0").estimate(q, J[:, 6:].T @ WRENCH)
    np.testing.assert_allclose(result.wrench, WRENCH, rtol=0, atol=1e-7)
