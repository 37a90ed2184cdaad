"""Identification of real robots from recordings beside the checkout, if present: a UR10
(unisa-acg/inverse-dynamics-solver, BSD-3) and a Staubli TX40 (thanhndv212/figaroh-plus, Apache-2.0).

The expected residuals [N m] are those of an independent analysis of the same recordings with Pinocchio at the same
cut-offs; the expected frictions of the TX40 are published. Base parameters are counted as in the literature."""

from dataclasses import replace

import numpy as np
import pytest
from peers.recorded import REAL_DATA

from robot_dynamics import Dynamics, Inertia, load_robot
from robot_dynamics.checking.check import check
from robot_dynamics.checking.tolerances import load_tolerances
from robot_dynamics.identification.fitting import fit_parameters
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.payload_fit import fit_payload
from robot_dynamics.identification.payload_model import PayloadModel
from robot_dynamics.identification.physical_consistency import fit_consistent_robot
from robot_dynamics.identification.samples import Samples
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.model.loading import shipped_file
from robot_dynamics.recordings.drives import load_drives, write_drives
from robot_dynamics.recordings.recording import open_recording

pytestmark = pytest.mark.skipif(not REAL_DATA.is_dir(), reason=f"no real data in {REAL_DATA}")
FACTOR = 1.2


class Robot:
    """A robot with its recording."""

    def __init__(self, description, recording, drives, cutoff):
        self.dynamics = Dynamics(load_robot(str(REAL_DATA / description)))
        self.drives = load_drives(drives, self.dynamics.joint_names)
        self.recording = open_recording(REAL_DATA / recording, self.drives)
        self.cutoff = cutoff

    def fit(self, held_out=0.0, rotor_inertia=True):
        model = build_identification_model(self.dynamics, self.drives, rotor_inertia=rotor_inertia)
        training = Samples([self.recording], model, cutoff=self.cutoff, end_fraction=1 - held_out)
        validation = (
            Samples([self.recording], model, cutoff=self.cutoff, start_fraction=1 - held_out) if held_out else None
        )
        return fit_parameters(training, validation=validation)


@pytest.fixture(scope="module")
def ur10():
    pytest.importorskip("rosbags", reason="rosbags, which reads bags, is not installed")
    return Robot("ur10/ur10.urdf", "ur10/ur10_unisa_mcap", None, 8.0)


@pytest.fixture(scope="module")
def tx40():
    return Robot("tx40/tx40_mdh_modified.urdf", "tx40", shipped_file("drives/tx40.yaml"), 100.0)


@pytest.mark.slow
def test_ur10_without_rotors_fits_with_36_base_parameters(ur10):
    fit = ur10.fit(rotor_inertia=False)
    assert fit.model.inertial_count == 36 and len(fit.model.names) == 36 + 18
    expected = np.array([3.34, 2.92, 2.07, 0.57, 0.48, 1.80])
    assert (fit.training_quality.rms < FACTOR * expected).all() and (
        fit.training_quality.rms_unfiltered < FACTOR * expected
    ).all()
    assert (fit.training_quality.rms > expected / FACTOR)[:5].all() and fit.condition < 59 * FACTOR
    assert fit.training_quality.moving[5] < 0.9 and fit.training_quality.rms[5] < 0.7  # at rest it holds any effort


def test_ur10_fit_of_two_thousand_samples_is_valid_for_the_others(ur10):
    fit = ur10.fit(held_out=1441 / 3441)
    assert fit.model.inertial_count == 40 and len(fit.model.names) == 40 + 18
    expected = np.array([3.66, 4.30, 2.16, 1.05, 0.61, 1.87])
    assert (fit.validation_quality.rms < FACTOR * expected).all() and (
        fit.validation_quality.rms_unfiltered < FACTOR * expected
    ).all()
    assert fit.validation_quality.samples == pytest.approx(1441, abs=20)


def test_fitted_ur10_passes_the_default_tolerances(ur10, tmp_path):
    pytest.importorskip("clarabel", reason="clarabel, which computes physically consistent inertias, is not installed")
    consistent = fit_consistent_robot(ur10.fit())
    (tmp_path / "drives.yaml").write_text(write_drives(consistent.drives))
    dynamics = Dynamics(load_robot(write_mdh_yaml(consistent.robot), strict=True))
    drives = load_drives(tmp_path / "drives.yaml", dynamics.joint_names)
    recording = open_recording(REAL_DATA / "ur10" / "ur10_unisa_mcap", drives)
    checked = check(recording, dynamics, load_tolerances(), cutoff=8.0)
    failed = {verdict.joint.joint for verdict in checked.verdicts if verdict.failures}
    assert failed <= {"wrist_3_joint"}  # at rest for an eighth of the recording, where it holds any effort
    rms = np.array([verdict.joint.rms for verdict in checked.verdicts])
    assert (rms < FACTOR * np.array([3.34, 2.92, 2.07, 0.57, 0.48, 1.80])).all()


class LoadedRecording:
    """A real recording, to whose efforts those that a payload needs are added by computation."""

    def __init__(self, recording, dynamics, link, payload):
        self.recording, self.dynamics = recording, dynamics
        self.loaded = Dynamics(dynamics.robot.with_payload(link, payload))

    def __getattr__(self, name):
        return getattr(self.recording, name)

    def motions(self, statistics, *, cutoff=None):
        for motion in self.recording.motions(statistics, cutoff=cutoff):
            state = (motion.q, motion.qd, motion.qdd)
            added = self.loaded.inverse(*state) - self.dynamics.inverse(*state)
            yield replace(motion, unfiltered_efforts=motion.unfiltered_efforts + added)


def test_a_simulated_payload_in_the_recording_of_the_ur10_is_found(ur10):
    """Noise and errors of the model are real. The model is fitted to the first 16 s, the payload to the other 11 s."""
    pytest.importorskip("clarabel", reason="clarabel, which computes physically consistent inertias, is not installed")
    consistent = fit_consistent_robot(ur10.fit(held_out=0.4))
    dynamics = Dynamics(consistent.robot)
    model = build_identification_model(dynamics, consistent.drives)
    payload = Inertia.about_centre_of_mass(3.0, 0.006 * np.eye(3), [0.02, -0.05, 0.08])
    recording = replace(ur10.recording, drives=consistent.drives)
    loaded = LoadedRecording(recording, dynamics, "tool0", payload)
    results = [
        fit_payload(
            lambda each, run=run: Samples([run], each, cutoff=8.0, start_fraction=0.6),
            PayloadModel(model, "tool0", model),
        )
        for run in (loaded, recording)
    ]
    found, nothing = results
    assert found.is_determined and not nothing.is_determined
    assert found.inertia.mass == pytest.approx(3.0, rel=0.05)
    assert abs(found.inertia.mass - 3.0) < 2 * found.deviations[9]
    assert (np.abs(found.centre - [0.02, -0.05, 0.08]) < 3 * found.deviations[6:9]).all()
    assert nothing.inertia.mass < 0.15


@pytest.mark.slow
def test_tx40_fits_with_its_coupled_wrist(tx40):
    fit = tx40.fit()
    assert fit.model.inertial_count == 40 and len(fit.model.names) == 61
    assert (fit.training_quality.rms < FACTOR * np.array([1.68, 2.11, 1.11, 0.60, 0.93, 0.65])).all()
    viscous = np.array([fit.values[fit.model.names.index(f"Fv.joint_{k}")] for k in range(1, 7)])
    # without samples at rest nearer to the published values than 8.42 5.53 2.02 1.20 2.02 .645, which are with them
    assert viscous == pytest.approx([8.05, 5.53, 1.97, 1.11, 1.86, 0.65], rel=0.05)


@pytest.mark.slow
def test_tx40_fit_of_the_first_half_is_valid_for_the_second(tx40):
    fit = tx40.fit(held_out=0.5)
    assert (fit.validation_quality.rms < FACTOR * np.array([2.24, 3.60, 1.27, 0.74, 1.29, 0.90])).all()
    assert fit.validation_quality.samples == pytest.approx(22500, abs=60)
