"""Identification of a robot whose description has asymmetric, Stribeck and load-dependent friction."""

from dataclasses import replace

import numpy as np
import pytest
from peers.frictions import with_random_friction

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.identification.fitting import fit_parameters
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.physical_consistency import fit_consistent_robot
from robot_dynamics.identification.samples import Samples
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_motions import Motion

RATE = 50.0
SAMPLES = 1500


class Known:
    """A recording with exact motions and efforts of known friction."""

    name, notes = "known", ()

    def __init__(self, dynamics):
        rng = np.random.default_rng(8)
        times = np.arange(SAMPLES) / RATE
        count = len(dynamics.joint_names)
        pulsations, phases = 2 * np.pi * rng.uniform(0.1, 0.7, (2, count, 4, 1))
        amplitudes = rng.uniform(0.1, 0.5, (count, 4, 1))
        angles = pulsations * times + phases
        q = (amplitudes * np.sin(angles)).sum(axis=1).T
        qd = (amplitudes * pulsations * np.cos(angles)).sum(axis=1).T
        qdd = -(amplitudes * pulsations**2 * np.sin(angles)).sum(axis=1).T
        efforts = dynamics.inverse(q, qd, qdd)
        self.motion = Motion(
            0.0, RATE, 8.0, q, qd, qdd, efforts, efforts, np.ones(count, dtype=bool), np.ones(q.shape, dtype=bool)
        )

    source = part = message_count = None
    time_range = (-np.inf, np.inf)

    def motions(self, statistics, *, cutoff=None, progress=None):
        yield self.motion

    def signal_segments(self):
        return [self.motion]


@pytest.fixture(scope="module")
def known():
    robot = with_random_friction(load_robot("ur5e"), 11)
    # while a joint moves, its Coulomb asymmetry is a constant effort, as is the offset that is identified
    joints = tuple(replace(joint, coulomb_asymmetry=0.0) for joint in robot.joints)
    dynamics = Dynamics(replace(robot, joints=joints))
    return dynamics, build_identification_model(dynamics, direct_drives(dynamics.joint_names)), Known(dynamics)


def test_parameters_of_friction_are_identified(known):
    dynamics, model, recording = known
    truth = model.grouping_matrix @ dynamics.parameters
    fit = fit_parameters(Samples([recording], model), method="ordinary")
    keys = [name.partition(".")[0] for name in model.names[: len(truth)]]
    assert [keys.count(key) for key in ("Fv", "Fs", "Fva", "Fst", "mu")] == [6] * 5
    assert model.inertial_count == len(truth) - 30
    np.testing.assert_allclose(fit.values[: len(truth)], truth, atol=1e-6)


def test_consistent_robot_has_friction_that_drives_no_joint(known):
    pytest.importorskip("clarabel", reason="clarabel, which computes physically consistent inertias, is not installed")
    dynamics, model, recording = known
    fit = fit_parameters(Samples([recording], model), method="ordinary")
    consistent = fit_consistent_robot(fit).robot
    for joint, expected in zip(consistent.joints, dynamics.robot.joints, strict=True):
        assert joint.viscous_asymmetry == pytest.approx(expected.viscous_asymmetry, abs=1e-3)
        assert joint.stribeck_friction == pytest.approx(expected.stribeck_friction, abs=1e-3)
        assert joint.load_friction == pytest.approx(expected.load_friction, abs=1e-3)
    driven = Known(dynamics)
    driven.motion.efforts[:, 1] += 3 * np.abs(driven.motion.qd[:, 1])
    fit = fit_parameters(Samples([driven], model), method="ordinary")
    values = dict(zip(model.names, fit.values, strict=True))
    name = dynamics.joint_names[1]
    assert values[f"Fva.{name}"] > values[f"Fv.{name}"] + 0.5
    joint = fit_consistent_robot(fit).robot.joints[1]
    assert joint.viscous_asymmetry == pytest.approx(joint.viscous_friction, rel=1e-3)
    assert joint.viscous_asymmetry <= joint.viscous_friction
