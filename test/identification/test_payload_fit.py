"""Payloads of a Panda: efforts of Pinocchio with a body of known mass, centre and inertia at the flange, and noise."""

import os
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from peers.recorded import Motion, loaded_panda, panda_model, panda_motion, write_table

from robot_dynamics import Dynamics, Inertia, load_robot
from robot_dynamics.identification import payload_fit
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.payload_fit import fit_payload
from robot_dynamics.identification.payload_model import (
    PayloadModel,
    parameter_transformation,
    to_inertia,
    to_parameters,
)
from robot_dynamics.identification.physical_consistency import nearest_consistent_parameters
from robot_dynamics.identification.samples import Samples
from robot_dynamics.model.placement import placement
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.recording import open_recording

pytest.importorskip("clarabel", reason="clarabel, which computes physically consistent inertias, is not installed")
LINK = "panda_link8"
FLANGE = np.array([0, 0, 0.107])  # [m] LINK in the last link of the model of Pinocchio
CENTRE = np.array([0.02, -0.03, 0.093])  # [m] in LINK
NOISE = 0.3  # [N m]
RUNS = int(os.environ.get("NOISY_RUNS", "4"))
DYNAMICS = Dynamics(load_robot("panda"))
MODEL = build_identification_model(DYNAMICS, direct_drives(DYNAMICS.joint_names))


def recording(folder, mass, *, seed=1, noise=NOISE, moment=0.0, name="run", **motion):
    """A recording with a payload of a mass [kg], and moments of inertia [kg m^2] about its centre."""
    model = motion.pop("model", None) or loaded_panda(mass, CENTRE + FLANGE, moment)
    run = panda_motion(seed=seed, viscous=0.2, coulomb=0.2, model=model, **{"duration": 8.0, "rate": 50.0, **motion})
    efforts = run.efforts + np.random.default_rng(seed).normal(scale=noise, size=run.efforts.shape)
    return open_recording(write_table(folder / f"{name}.csv", run._replace(efforts=efforts)), MODEL.drives)


def fit(recordings, empty=(), model=MODEL, **settings):
    empty_names = frozenset(each.name for each in empty)
    payload_model = PayloadModel(model, LINK, model, empty_recordings=empty_names)
    return fit_payload(lambda each: Samples([*recordings, *empty], each), payload_model, **settings)


def errors(result, mass, moment):
    """Errors (10,) of inertia about the centre, centre, and mass."""
    true = np.r_[moment * np.array([1, 0, 0, 1, 0, 1]), CENTRE, mass]
    return np.r_[result.central_inertia[np.triu_indices(3)], result.centre, result.inertia.mass] - true


@pytest.mark.parametrize("mass", [1.0, 2.5, 5.0])
def test_payloads_of_1_to_5_kg_are_found_within_their_deviations(tmp_path, mass):
    moment = 0.002 * mass
    result = fit([recording(tmp_path, mass, moment=moment)])
    error = errors(result, mass, moment)
    assert result.determined[6:].all() and result.is_determined
    assert abs(error[9]) < min(0.05 * mass, 2 * result.deviations[9])
    assert (np.abs(error) < 3 * result.deviations).all()
    assert 0.029 * mass < result.deviations[9] < 0.05 * mass
    assert result.inertia.find_inconsistencies() == []
    assert (result.quality.rms < 0.2).all() and (result.empty_quality.rms > 1.2 * result.quality.rms).all()


@pytest.mark.slow
def test_errors_agree_with_deviations(tmp_path):
    """There are 4 runs here, and 200 in `make soak`. Noise alone is less than what deviations allow for."""
    normalised, masses = [], []
    for seed in range(RUNS):
        mass = 1.0 + seed % 5
        result = fit([recording(tmp_path, mass, seed=seed, moment=0.002 * mass)], effort_accuracy=0.0)
        normalised.append(errors(result, mass, 0.002 * mass) / result.deviations)
        masses.append(abs(result.inertia.mass / mass - 1))
    rms = np.sqrt(np.square(normalised).mean(axis=0))
    print(
        f"{RUNS} runs: errors of masses up to {100 * max(masses):.1f} %, RMS of errors in deviations: inertia "
        f"{np.sqrt(np.mean(rms[:6] ** 2)):.2f}, centre {np.sqrt(np.mean(rms[6:9] ** 2)):.2f}, mass {rms[9]:.2f}; 95 % "
        f"intervals cover {100 * np.mean(np.abs(normalised) < 1.96):.1f} %"
    )
    assert max(masses) < 0.05
    assert 0.3 < np.sqrt(np.mean(np.square(normalised))) < 1.1
    assert np.mean(np.abs(normalised) < 1.96) > 0.93


def test_all_ten_parameters_are_right_without_noise(tmp_path):
    result = fit([recording(tmp_path, 3.0, noise=0.0, moment=0.02, speed=2.0)], effort_accuracy=0.0)
    error = errors(result, 3.0, 0.02)
    assert result.determined.all()
    assert np.abs(error[:6]).max() < 0.004 and np.abs(error[6:9]).max() < 5e-4 and abs(error[9]) < 0.01
    assert result.deviations[9] < 0.01


def test_inertia_that_the_motion_does_not_show_is_that_of_a_point_mass(tmp_path):
    """A slow motion: gravity shows mass and centre."""
    mass = 2.0
    result = fit([recording(tmp_path, mass, moment=0.004, speed=0.2, duration=20.0)])
    assert result.is_determined and not result.determined[[0, 3, 5]].any()
    assert np.abs(result.central_inertia).max() < 0.1 * mass * payload_fit.RADIUS_OF_GYRATION**2
    assert result.inertia.find_inconsistencies() == []
    assert abs(result.inertia.mass - mass) < 2 * result.deviations[9]


def test_a_motion_about_a_vertical_axis_does_not_determine_the_payload(tmp_path):
    run = panda_motion(10.0, model=loaded_panda(2.0, CENTRE + FLANGE))
    still = run._replace(q=run.q * (np.arange(7) == 0) + run.q[0], qd=run.qd * (np.arange(7) == 0))
    path = write_table(tmp_path / "run.csv", still._replace(efforts=run.efforts * 0 + 1.0))
    result = fit([open_recording(path, MODEL.drives)])
    assert not result.is_determined


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("joint", range(7))
def test_mass_from_the_motion_of_one_joint_is_right_or_not_determined(tmp_path, joint, seed):
    """One joint shows a mass times its distance: a light body far away needs the same efforts."""
    mass = 2.5
    model = loaded_panda(mass, CENTRE + FLANGE, 0.005)
    run = panda_motion(12.0, 50.0, model=model)
    moves = np.arange(7) == joint
    q, qd, qdd = np.where(moves, run.q, run.q[0]), run.qd * moves, run.qdd * moves
    data = model.createData()
    efforts = np.array([pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)])
    efforts += np.random.default_rng(seed).normal(scale=NOISE, size=efforts.shape)
    path = write_table(tmp_path / "run.csv", Motion(run.times, q, qd, qdd, efforts))
    result = fit([open_recording(path, MODEL.drives)])
    assert not result.is_determined
    assert abs(result.inertia.mass - mass) < 2 * result.deviations[9] or not result.determined[9]
    assert result.determined[9] or joint not in {1, 2, 3}


def test_recordings_without_payload_remove_errors_of_the_model(tmp_path):
    """The masses of the description are wrong by 10 %, and its last link lacks a tool of 0.5 kg."""
    robot = DYNAMICS.robot
    links = tuple(replace(link, inertia=_scaled(link.inertia, 1.1)) for link in robot.links)
    dynamics = Dynamics(replace(robot, links=links).with_payload(LINK, Inertia(0.5, [0, 0, 0.02], 0.001 * np.eye(3))))
    wrong = build_identification_model(dynamics, MODEL.drives)
    loaded = [recording(tmp_path, 2.0, name="loaded")]
    empty = [recording(tmp_path, 0.0, name="empty", model=panda_model())]
    biased = fit(loaded, model=wrong)
    corrected = fit(loaded, empty, model=wrong)
    assert abs(biased.inertia.mass - 2.0) > 0.2
    assert abs(corrected.inertia.mass - 2.0) < 0.05 and np.abs(corrected.centre - CENTRE).max() < 0.01
    assert abs(corrected.inertia.mass - 2.0) < 2 * corrected.deviations[9]


def _scaled(inertia, factor):
    return Inertia(factor * inertia.mass, factor * inertia.first_moments, factor * inertia.second_moments)


def test_friction_that_grows_with_the_load_is_not_counted_as_payload(tmp_path):
    joints = tuple(replace(joint, load_friction=0.15) for joint in DYNAMICS.robot.joints)
    dynamics = Dynamics(replace(DYNAMICS.robot, joints=joints))
    model = build_identification_model(dynamics, MODEL.drives)
    payload = Inertia.about_centre_of_mass(4.0, 0.008 * np.eye(3), CENTRE)
    run = panda_motion(6.0, 50.0, seed=2)
    run = run._replace(efforts=Dynamics(dynamics.robot.with_payload(LINK, payload)).inverse(run.q, run.qd, run.qdd))
    loaded = open_recording(write_table(tmp_path / "run.csv", run), MODEL.drives)
    result = fit([loaded], model=model, effort_accuracy=0.0)
    assert result.inertia.mass == pytest.approx(4.0, rel=0.005)
    assert result.quality.rms_unfiltered.max() < 0.4


def test_a_palletizer_does_not_need_the_height_of_the_centre(tmp_path):
    """A robot with closed loops, whose flange stays horizontal."""
    dynamics = Dynamics(load_robot("irb460"))
    names = dynamics.joint_names
    times = np.arange(0, 12, 0.02)
    rng = np.random.default_rng(0)
    q, qd, qdd = np.zeros((3, len(times), len(names)))
    for frequency in 2 * np.pi * np.array([0.15, 0.3, 0.6]):
        amplitude, phase = rng.uniform(0.03, 0.1, len(names)), rng.uniform(0, 6, len(names))
        angles = frequency * times[:, None] + phase
        q += amplitude * np.sin(angles)
        qd += amplitude * frequency * np.cos(angles)
        qdd -= amplitude * frequency**2 * np.sin(angles)
    q += [dynamics.robot.joints[dynamics.robot.joint_numbers[name]].initial_position for name in names]
    payload = Inertia.about_centre_of_mass(2.0, 0.004 * np.eye(3), [0.05, 0.02, 0.03])
    efforts = Dynamics(dynamics.robot.with_payload("flange", payload)).inverse(q, qd, qdd)
    efforts = efforts + rng.normal(scale=0.001 * np.abs(efforts).max(), size=q.shape)
    run = Motion(times, q, qd, qdd, efforts)
    drives = direct_drives(names)
    loaded = open_recording(write_table(tmp_path / "run.csv", run, names), drives)
    model = PayloadModel(robot_model := build_identification_model(dynamics, drives), "flange", robot_model)
    result = fit_payload(lambda each: Samples([loaded], each), model)
    assert abs(result.inertia.mass - 2.0) < 2 * result.deviations[9] < 0.3
    assert result.determined[6:].tolist() == [True, True, False, True]
    assert result.is_determined and result.prediction_error < 0.1


def test_the_scale_of_efforts_is_a_part_of_the_deviation_of_the_mass(tmp_path):
    loaded = recording(tmp_path, 3.0)
    exact, scaled = (fit([loaded], effort_accuracy=accuracy) for accuracy in (0.0, 0.04))
    assert scaled.deviations[9] == pytest.approx(np.hypot(exact.deviations[9], 0.04 * 3), rel=0.02)
    assert scaled.deviations[6:9] == pytest.approx(exact.deviations[6:9], rel=0.05)


def test_short_recordings_are_warned_of(tmp_path):
    result = fit([recording(tmp_path, 2.0, duration=4.0)])
    assert any("s of different motion" in warning for warning in result.warnings)


def test_an_effort_that_no_body_needs_is_warned_of(tmp_path):
    """The description has a payload that the robot lacks: a negative mass."""
    loaded = DYNAMICS.robot.with_payload(LINK, Inertia.about_centre_of_mass(3.0, 0.01 * np.eye(3), CENTRE))
    model = build_identification_model(Dynamics(loaded), MODEL.drives)
    result = fit([recording(tmp_path, 0.0, model=panda_model())], model=model)
    assert result.unconstrained[9] == pytest.approx(-3.0, abs=0.1) and 0 <= result.inertia.mass < 0.5
    assert not result.is_determined
    assert any("of any body" in warning for warning in result.warnings)


def test_parameters_in_another_frame_are_those_of_the_transformed_inertia():
    rng = np.random.default_rng(0)
    inertia = Inertia.about_centre_of_mass(2.0, np.diag([0.01, 0.02, 0.025]), rng.normal(size=3))
    frame = placement(np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3))
    moved = parameter_transformation(frame) @ to_parameters(inertia)
    assert moved == pytest.approx(to_parameters(inertia.transformed_by(frame)), abs=1e-12)
    assert to_parameters(to_inertia(moved)) == pytest.approx(moved)


def test_nearest_consistent_parameters_are_nearer_than_other_bodies():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(10, 10))
    scale = np.array([0.04] * 6 + [0.2] * 3 + [1.0])
    covariance = scale[:, None] * (root @ root.T) * scale
    values = to_parameters(Inertia.about_centre_of_mass(1.0, np.diag([0.02, 0.002, -0.003]), [0.1, 0.0, 0.05]))
    nearest = nearest_consistent_parameters(values, covariance, scale)
    assert to_inertia(nearest).find_inconsistencies() == []

    def distance(parameters):
        difference = parameters - values
        return difference @ np.linalg.solve(covariance, difference)

    changes = [nearest + 0.01 * scale * change for change in rng.normal(size=(3000, 10))]
    bodies = [change for change in changes if not to_inertia(change).find_inconsistencies()]
    assert len(bodies) > 20 and min(map(distance, bodies)) > distance(nearest) * (1 - 1e-6)
