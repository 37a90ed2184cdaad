"""Adaptive computed torque of a simulated Panda (MuJoCo) with friction and noise, and a model that is 30 % wrong."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from control.test_adaptive_law import wrong_robot
from peers.known_panda import COULOMB, VISCOUS
from peers.mujoco_plant import HOME, motion

from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.control.control_law import ControlLaw
from robot_dynamics.control.controller import Controller
from robot_dynamics.control.controller_settings import Settings
from robot_dynamics.control.natural_adaptation import AdaptationLimits, AdaptationSettings

STEP = 1e-3  # [s]
POSITION_NOISE, VELOCITY_NOISE = 1e-5, 2e-3  # [rad], [rad/s] standard deviations
LIMITS = 3 * np.array([87.0] * 4 + [12.0] * 3)


def with_friction(robot, viscous, coulomb):
    joints = zip(robot.joints, viscous, coulomb, strict=True)
    return replace(
        robot, joints=tuple(replace(joint, viscous_friction=fv, coulomb_friction=fs) for joint, fv, fs in joints)
    )


def track(robot, mode, seconds):
    """Position errors (steps, 7) [rad] of the controlled plant."""
    model = mujoco.MjModel.from_xml_string(shipped_robots()["panda"].read_text())
    model.dof_damping[:], model.dof_frictionloss[:] = VISCOUS, COULOMB
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    data = mujoco.MjData(model)
    data.qpos[:] = HOME
    dynamics = Dynamics(robot)
    adaptation = AdaptationLimits() if mode == "adaptive_computed_torque" else None
    law = ControlLaw(dynamics, dynamics.joint_names, adaptation)
    gains = {"kp": np.full(7, 100.0), "kd": np.full(7, 20.0), "adaptation": AdaptationSettings(gain=100.0)}
    controller = Controller(law, Settings(mode=mode, limits=LIMITS, reference_timeout=1.0, **gains))
    rng = np.random.default_rng(0)
    errors = np.empty((round(seconds / STEP), 7))
    for number in range(len(errors)):
        now = number * STEP
        reference = motion(now)
        controller.track_point(now, now, reference)
        law.q[:] = data.qpos + POSITION_NOISE * rng.standard_normal(7)
        law.qd[:] = data.qvel + VELOCITY_NOISE * rng.standard_normal(7)
        data.qfrc_applied[:] = controller.step(now)
        errors[number] = reference[0] - data.qpos
        mujoco.mj_step(model, data)
    return errors, law


def rms(errors):
    return np.sqrt((errors**2).sum(axis=1).mean())


@pytest.mark.slow
def test_wrong_model_tracks_as_the_right_one_after_eight_seconds():
    described = load_robot("panda")
    right = with_friction(described, VISCOUS, COULOMB)
    wrong = with_friction(wrong_robot(described, seed=0), 0.7 * VISCOUS, 1.3 * COULOMB)
    expected = rms(track(right, "computed_torque", 4.0)[0][2000:])
    assert rms(track(wrong, "computed_torque", 2.0)[0][1000:]) > 50 * expected
    errors, law = track(wrong, "adaptive_computed_torque", 9.0)
    assert rms(errors[8000:]) < 1.5 * expected
    assert 1.2 < law.adaptive.parameters.largest_ratio < 5
