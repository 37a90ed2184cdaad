"""Fitted friction of a Panda whose friction is known: efforts of Pinocchio and friction in closed form."""

import os
from dataclasses import replace

import numpy as np
import pytest
from peers.frictional_panda import COULOMB, PLAIN, VARIED, VISCOUS, FrictionalPanda
from peers.recorded import JOINTS, panda_motion

from robot_dynamics import Dynamics, Inertia, load_robot
from robot_dynamics.identification.fitting import fit_parameters
from robot_dynamics.identification.friction_fit import choose_friction_model
from robot_dynamics.identification.friction_terms import PARAMETER_OF_MODEL, STRIBECK_PARAMETER
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.physical_consistency import fit_consistent_robot
from robot_dynamics.identification.samples import Samples
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.recordings.drives import direct_drives

RUNS = int(os.environ.get("NOISY_RUNS", "12"))
MODEL = build_identification_model(Dynamics(load_robot("panda")), direct_drives(JOINTS))


def fit_friction(recording, model=MODEL):
    """The fit with the chosen friction."""
    plain = fit_parameters(Samples([recording], model))
    chosen, _ = choose_friction_model(
        plain, lambda model: Samples([recording], model), tuple(PARAMETER_OF_MODEL), required=False
    )
    return fit_parameters(Samples([recording], chosen))


def true_friction(fit):
    """Values of Fv, Fs and the terms of friction, by name; the shift of Stribeck velocities follows from vs."""
    values = {}
    for joint, name in enumerate(JOINTS):
        values |= {f"Fv.{name}": VISCOUS[joint], f"Fs.{name}": COULOMB[joint]}
    for term in fit.model.terms:
        further = VARIED[term.joint]
        name = f"{term.parameter}.{JOINTS[term.joint]}"
        if term.parameter == "vs":
            values[name] = further["Fst"] * np.log(further["vs"] / term.velocity)
        else:
            values[name] = further[term.parameter]
    return values


def test_friction_with_little_noise_is_that_of_the_robot():
    fit = fit_friction(FrictionalPanda(VARIED, noise=0.05))
    velocities = {term.joint: term.velocity for term in fit.model.terms if term.parameter == STRIBECK_PARAMETER}
    assert velocities == pytest.approx({0: 0.1, 2: 0.2}, rel=0.03)
    values = dict(zip(fit.model.names, fit.values, strict=True))
    for name, expected in true_friction(fit).items():
        assert values[name] == pytest.approx(expected, abs=0.05), name


@pytest.mark.slow
def test_friction_is_within_its_deviations():
    """There are 6 runs here, and 100 in `make soak`; the motion is the same, the noise differs."""
    normalised = []
    for seed in range(RUNS // 2):
        fit = fit_friction(FrictionalPanda(VARIED, seed))
        truth = true_friction(fit)
        for name, value, deviation in zip(fit.model.names, fit.values, fit.standard_deviations, strict=True):
            if name in truth:
                normalised.append((value - truth[name]) / deviation)
    normalised = np.array(normalised)
    covered = np.mean(np.abs(normalised) < 1.96)
    rms = np.sqrt((normalised**2).mean())
    print(f"{len(normalised)} values: RMS {rms:.2f}, 95 % intervals cover {100 * covered:.1f} %")
    assert 0.9 < covered < 0.995 and rms == pytest.approx(1, abs=0.2)


def test_other_motions_are_predicted_better():
    recording = FrictionalPanda(VARIED)
    other = FrictionalPanda(VARIED, motion_seed=5)
    plain = fit_parameters(Samples([recording], MODEL), validation=Samples([other], MODEL))
    fit = fit_friction(recording)
    validated = Samples([other], fit.model).quality(fit.values).rms
    has_more = np.array([bool(further) for further in VARIED])
    assert (validated[has_more] < 0.9 * plain.validation_quality.rms[has_more]).all()


def test_written_robot_has_the_efforts_that_were_validated():
    pytest.importorskip("clarabel", reason="clarabel, which computes physically consistent inertias, is not installed")
    recording = FrictionalPanda(VARIED)
    fit = fit_friction(recording)
    consistent = fit_consistent_robot(fit)
    b = len(fit.model.parameter_indices)
    model = fit.model.with_terms(fit.model.terms, consistent.values[:b])
    motion = panda_motion(5.0, 50.0, seed=9)
    columns = model.regressor_at(motion.q, motion.qd, motion.qdd)
    validated = columns @ consistent.values - consistent.drives.effort_offsets
    written = Dynamics(load_robot(write_mdh_yaml(consistent.robot), strict=True))
    assert written.inverse(motion.q, motion.qd, motion.qdd) == pytest.approx(validated, abs=1e-5)
    for joint, further in zip(written.robot.joints, VARIED, strict=False):
        assert bool(joint.stribeck_friction) == ("Fst" in further) and bool(joint.load_friction) == ("mu" in further)
        assert joint.stribeck_velocity == pytest.approx(further.get("vs", 0.0), rel=0.5)
        assert joint.load_friction == pytest.approx(further.get("mu", 0.0), abs=0.05)


def test_nothing_is_added_where_nothing_is_chosen():
    fit = fit_friction(FrictionalPanda(PLAIN, duration=30.0))
    assert fit.model.terms == () and fit.model.load_values is not None


def test_loads_are_those_of_the_identified_robot_not_of_the_description():
    robot = MODEL.dynamics.robot
    links = tuple(replace(link, inertia=Inertia(0, np.zeros(3), np.zeros((3, 3)))) for link in robot.links)
    massless = Dynamics(replace(robot, links=links))
    fit = fit_friction(FrictionalPanda(VARIED, noise=0.05), build_identification_model(massless, direct_drives(JOINTS)))
    values = dict(zip(fit.model.names, fit.values, strict=True))
    assert values["mu.panda_joint2"] == pytest.approx(0.2, abs=0.003)
    assert values["mu.panda_joint4"] == pytest.approx(0.25, abs=0.003)
