"""Recordings of a UR10 and a Panda, published by unisa-acg/inverse-dynamics-solver (BSD-3), beside the checkout.

The expected values are those of an independent analysis of the same recordings with Pinocchio: Butterworth filters
without delay, accelerations as gradients of filtered velocities."""

import numpy as np
import pytest
from peers.recorded import REAL_DATA

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.checking.check import check
from robot_dynamics.checking.tolerances import load_tolerances
from robot_dynamics.recordings.bags import Bag
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.recording import open_recording

pytest.importorskip("rosbags", reason="rosbags, which reads bags, is not installed")
pytestmark = pytest.mark.skipif(not REAL_DATA.is_dir(), reason=f"no real data in {REAL_DATA}")
UR10 = REAL_DATA / "ur10"
FACTOR = 1.2


def rms(result):
    return np.array([verdict.joint.rms for verdict in result.verdicts])


@pytest.mark.parametrize("storage", ["mcap", "db3"])
def test_check_of_a_ur10_fails_in_all_joints_with_the_residuals_of_the_reference(storage):
    dynamics = Dynamics(load_robot(str(UR10 / "ur10.urdf")))
    recording = open_recording(UR10 / f"ur10_unisa_{storage}", direct_drives(dynamics.joint_names))
    result = check(recording, dynamics, load_tolerances(), cutoff=8.0)
    expected = np.array([21.6, 22.4, 16.9, 6.1, 4.1, 5.8])
    assert (rms(result) < FACTOR * expected).all() and (rms(result) > expected / FACTOR).all()
    correlation = [verdict.joint.correlation for verdict in result.verdicts]
    assert correlation == pytest.approx([0.21, 0.95, 0.85, 0.27, 0.01, 0.03], abs=0.04)  # rest counted there
    assert not any(verdict.passed for verdict in result.verdicts)
    assert result.comparison.samples == 3441 - 32  # the edges
    assert [note.split()[0] for note in result.notes] == ["32"]


def test_check_of_a_panda_without_hand_has_the_residuals_of_the_reference():
    """The description has no friction: viscous and Coulomb friction are fitted to the residual of each joint."""
    dynamics = Dynamics(load_robot("panda"))
    recording = open_recording(REAL_DATA / "panda" / "panda_unisa_mcap", direct_drives(dynamics.joint_names))
    pieces = []
    result = check(recording, dynamics, load_tolerances(), on_piece=lambda motion, p, _: pieces.append((motion, p)))
    residual = np.concatenate([motion.efforts - predicted for motion, predicted in pieces])
    rates = np.concatenate([motion.qd for motion, _ in pieces])
    unexplained = []
    for r, rate in zip(residual.T, rates.T, strict=True):
        X = np.stack([rate, np.sign(rate), np.ones(len(rate))], axis=1)
        unexplained.append(np.sqrt(np.mean((r - X @ np.linalg.lstsq(X, r, rcond=None)[0]) ** 2)))
    assert (np.array(unexplained) < FACTOR * np.array([0.51, 0.37, 0.43, 0.65, 0.18, 0.21, 0.07])).all()
    # one of 50 messages repeats the values before it: the values have 29.4 Hz, of which the cut-off is a fifth
    assert result.comparison.samples > 700 and result.cutoff == pytest.approx(5.88, abs=0.01)


def test_bag_reads_the_rest_of_a_real_truncated_database(tmp_path):
    content = (UR10 / "ur10_unisa_db3" / "ur10_unisa_db3.db3").read_bytes()
    whole = np.array([sample.position for sample in Bag(UR10 / "ur10_unisa_db3").samples(["/joint_states"])])
    for tenth in range(1, 10):
        cut = tmp_path / f"cut_{tenth}.db3"
        cut.write_bytes(content[: len(content) * tenth // 10])
        bag = Bag(cut)
        positions = np.array([sample.position for sample in bag.samples(bag.joint_topics())])
        assert np.array_equal(positions, whole[: len(positions)])
        assert len(positions) > (tenth / 10 - 0.05) * len(whole)
