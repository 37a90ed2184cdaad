"""Control laws of robots with asymmetric, Stribeck and load-dependent friction, against the models of the robot."""

import numpy as np
import pytest
from peers.frictions import joint_friction, with_random_friction, without_friction

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.control.control_law import ControlLaw, actuated_joint_names

KP, KD = 150.0, 24.0


@pytest.fixture(scope="module", params=["ur5e", "sr400"])
def dynamics(request):
    return Dynamics(with_random_friction(load_robot(request.param), 8))


def law_in_motion(dynamics):
    law = ControlLaw(dynamics, actuated_joint_names(dynamics))
    rng = np.random.default_rng(4)
    law.q[:] = dynamics.initial_joint_positions[[dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]]
    law.q += rng.uniform(-0.1, 0.1, len(law.q))
    law.qd[:] = rng.uniform(-1, 1, len(law.q))
    return law, np.stack([law.q, *rng.uniform(-1, 1, (2, len(law.q)))]) + rng.uniform(-0.1, 0.1, len(law.q))


def test_feedforward_is_the_inverse_model_of_the_reference(dynamics):
    law, reference = law_in_motion(dynamics)
    out = np.zeros(len(law.joints))
    law.feedforward(reference, out)
    np.testing.assert_allclose(out, dynamics.inverse(*reference), rtol=1e-9, atol=1e-9)


def test_computed_torque_with_friction_of_the_measured_velocity_gives_the_error_dynamics(dynamics):
    law, reference = law_in_motion(dynamics)
    out = np.zeros(len(law.joints))
    law.computed_torque(reference, KP, KD, out, "measured")
    accelerations = dynamics.direct(law.q, law.qd, out)
    expected = reference[2] + KP * (reference[0] - law.q) + KD * (reference[1] - law.qd)
    np.testing.assert_allclose(accelerations, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())


def test_friction_of_the_reference_has_the_load_of_the_law(dynamics):
    """The effort is that at the measured velocity, but for the friction, which is that of the desired velocity."""
    law, reference = law_in_motion(dynamics)
    out = np.zeros(len(law.joints))
    law.computed_torque(reference, KP, KD, out)
    joints = [dynamics.robot.joints[dynamics.robot.joint_numbers[name]] for name in law.joints]
    loaded = [index for index, joint in enumerate(joints) if joint.load_friction]
    expected = reference[2] + KP * (reference[0] - law.q) + KD * (reference[1] - law.qd)
    frictionless = Dynamics(without_friction(dynamics.robot))
    load = frictionless.inverse(law.q, law.qd, expected)
    assert len(loaded) >= 4

    for index in loaded:
        friction = joint_friction(joints[index], reference[1, index], load[index])
        assert out[index] == pytest.approx(load[index] + friction, rel=1e-9)


def test_gravity_compensation_has_no_friction(dynamics):
    law, _ = law_in_motion(dynamics)
    out = np.zeros(len(law.joints))
    law.gravity_compensation(out)
    np.testing.assert_allclose(out, dynamics.gravity(law.q), rtol=1e-9, atol=1e-9)
