"""Motions that are played: of CSV files, and of each joint through its range."""

import numpy as np
import pytest
from viewing.drawn_loops import largest_gap

from robot_dynamics import Dynamics, RecordingError, load_robot
from robot_dynamics.viewing.configuration import Configuration
from robot_dynamics.viewing.played_motion import PlayedMotion, recorded_motion, sweep_joints


def write_csv(path, names, times, positions):
    rows = np.column_stack([times, positions])
    header = ",".join(["time", *(f"{name}.position" for name in names)])
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.17g")
    return path


def test_recorded_motion_is_that_of_the_file_with_its_loops_closed(tmp_path):
    dynamics = Dynamics(load_robot("four_bar"))
    times = np.arange(0, 4, 0.01)
    crank = dynamics.initial_joint_positions[0] + 0.5 * np.sin(2 * np.pi * 0.5 * times)
    motion = recorded_motion(dynamics, write_csv(tmp_path / "crank.csv", dynamics.joint_names, times, crank))
    assert motion.times[0] == 0 and np.allclose(np.diff(motion.times), 0.02)
    column = dynamics.all_joint_names.index(dynamics.joint_names[0])
    drawn = motion.positions[:100, column]
    # the filter needs a margin: the motion begins later than the file
    gaps = [np.abs(drawn - crank[start : start + 200 : 2]).max() for start in range(60)]
    assert min(gaps) < 2e-3
    for q in motion.positions[::20]:
        configuration = Configuration(dynamics.robot, dynamics)
        configuration.q = q
        assert largest_gap(dynamics.robot, dict(enumerate(configuration.link_poses()))) < 1e-9
    assert np.isfinite(motion.efforts).all() and np.isnan(motion.measured_efforts).all()
    assert np.abs(motion.efforts).max() > 0


def test_file_without_the_joints_is_refused(tmp_path):
    dynamics = Dynamics(load_robot("four_bar"))
    file = write_csv(tmp_path / "other.csv", ["elbow"], np.arange(0, 1, 0.01), np.zeros(100))
    with pytest.raises(RecordingError, match=dynamics.joint_names[0]):
        recorded_motion(dynamics, file)


@pytest.mark.parametrize("name", ["rx90", "gough_stewart", "four_bar", "panda"])
def test_sweep_moves_each_joint_within_its_limits_with_loops_closed(name):
    configuration = Configuration(load_robot(name))
    start = configuration.q
    motion = sweep_joints(configuration, 1.0, rate=8.0)
    assert np.array_equal(configuration.q, start) and np.array_equal(motion.positions[-1], start)
    moved = np.ptp(motion.positions, axis=0)[configuration.independent]
    assert (moved > 0).all()
    for index in configuration.independent:
        limits = configuration.joint_range(index, 1.0)
        assert motion.positions[:, index].min() >= limits.lower - 1e-12
        assert motion.positions[:, index].max() <= limits.upper + 1e-12
    for q in motion.positions[::10]:
        configuration.q = q
        assert largest_gap(configuration.robot, dict(enumerate(configuration.link_poses()))) < 1e-9


def test_sample_nearest_to_a_time_is_shown():
    nothing = np.full((3, 1), np.nan)
    motion = PlayedMotion(np.array([0.0, 1.0, 2.0]), np.array([[0.0], [10.0], [20.0]]), nothing, nothing)
    assert [motion.at(time)[0] for time in (-1, 0.4, 0.6, 1.4, 9)] == [0, 0, 10, 10, 20]


def line(times, start=0.0):
    """A motion of one joint whose position is its time."""
    nothing = np.full((len(times), 1), np.nan)
    return PlayedMotion(times, times[:, None], nothing, nothing, start)


def test_reference_is_at_the_same_time_of_one_clock_or_begins_with_the_motion():
    times = np.arange(0, 2.01, 0.01)
    motion = line(times, 100.0)
    one_clock = motion.beside(line(times, 100.5))
    assert one_clock.reference[:, 0] == pytest.approx(np.clip(times - 0.5, 0, None), abs=0.0051)
    assert one_clock.reference_at(1.0) == pytest.approx([0.5], abs=0.0051)
    assert motion.beside(line(times, 7000.0)).reference[:, 0] == pytest.approx(times, abs=0.0051)
    delayed = motion.beside(line(times, 100.5), delay=-0.3).reference[:, 0]
    assert delayed == pytest.approx(np.clip(times + 0.3, None, 2.0), abs=0.0051)
    assert motion.reference_at(1.0) is None


def test_recorded_motions_keep_the_times_of_their_clock(tmp_path):
    dynamics = Dynamics(load_robot("four_bar"))
    times = np.arange(0, 4, 0.01)
    crank = dynamics.initial_joint_positions[0] + 0.3 * np.sin(times)
    starts = []
    for delay in (0.0, 0.7):
        file = write_csv(tmp_path / "crank.csv", dynamics.joint_names, times + 50 + delay, crank)
        starts.append(recorded_motion(dynamics, file).start)
    assert starts[0] >= 50 and starts[1] - starts[0] == pytest.approx(0.7, abs=1e-6)
