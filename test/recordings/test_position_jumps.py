"""Jumps of positions are cut out of signals; fast motions are none."""

import numpy as np
import pytest

from robot_dynamics.recordings.alignment import SignalSegment
from robot_dynamics.recordings.drives import Drives, direct_drives
from robot_dynamics.recordings.joint_motions import filter_motions
from robot_dynamics.recordings.position_jumps import find_encoder_jumps, split_at_jumps
from robot_dynamics.recordings.sample_statistics import SampleStatistics

NAMES = ("first", "second", "third")


def segment(position, rate):
    velocity = np.full(position.shape, np.nan)
    return SignalSegment(5.0, rate, position, velocity, np.ones(position.shape), False, recorded=np.ones(len(position)))


def motion(rate, duration=10.0):
    times = np.arange(0, duration, 1 / rate)[:, None]
    return 0.4 * np.sin(2 * np.pi * np.array([0.2, 0.5, 0.9]) * times + [0, 1, 2])


@pytest.mark.parametrize("rate", [50.0, 100.0, 1000.0])
@pytest.mark.parametrize("size", [0.05, -0.03])
def test_segment_is_cut_where_an_encoder_jumps(rate, size):
    position = motion(rate)
    row = len(position) // 3
    position[row:, 1] += size
    first, second = split_at_jumps(segment(position, rate), 3)
    assert len(first) == row and len(second) == len(position) - row
    assert first.jump is None and not second.is_continuation
    assert second.time == pytest.approx(5 + row / rate) == second.jump.time
    assert second.jump.sizes == pytest.approx([0, size, 0], abs=0.2 * abs(size))
    assert np.array_equal(second.position, position[row:]) and len(second.recorded) == len(second)


@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_rows_that_are_missing_are_a_jump_of_all_joints_along_their_velocities(rate):
    position = motion(rate)
    row = int(2.6 * rate)
    lost = int(0.2 * rate)
    _, second = split_at_jumps(segment(np.delete(position, slice(row, row + lost), axis=0), rate), 3)
    jump = second.jump
    assert jump.time == pytest.approx(5 + row / rate, abs=1.5 / rate)
    assert jump.missing_duration == pytest.approx(0.2, abs=0.05)


@pytest.mark.parametrize("rate", [100.0, 200.0])
def test_rows_of_encoder_jumps_are_those_of_no_motion(rate):
    position = motion(rate)
    row = int(2.6 * rate)
    missing = np.delete(position, slice(row, row + int(0.2 * rate)), axis=0)
    assert not find_encoder_jumps(missing, rate).any()
    missing[2 * row :, 2] += 0.05  # the fastest joint, along its velocity
    assert np.flatnonzero(find_encoder_jumps(missing, rate)).tolist() == [2 * row]
    at_rest = np.zeros((200, 3))
    at_rest[100:, 0] = 0.05
    assert np.flatnonzero(find_encoder_jumps(at_rest, rate)).tolist() == [100]


@pytest.mark.parametrize("rate", [30.0, 125.0, 1000.0])
def test_fast_motions_and_noise_are_no_jumps(rate):
    """120 rad/s² at 2 Hz, a velocity that changes within 20 ms, steps of an encoder, and white noise."""
    times = np.arange(0, 10, 1 / rate)
    fast = 120 / (4 * np.pi) ** 2 * np.sin(4 * np.pi * times)
    sudden = np.cumsum(np.clip(np.sin(times) * 50, -1, 1)) / rate
    coarse = np.round(0.3 * np.sin(times) / 0.002) * 0.002
    noisy = 0.3 * np.sin(times) + 5e-4 * np.random.default_rng(0).normal(size=len(times))
    whole = segment(np.stack([fast, sudden, coarse, noisy], axis=1), rate)
    (only,) = split_at_jumps(whole, 4)
    assert only is whole


def test_motions_have_no_acceleration_of_a_jump_and_the_first_one_after_it_says_so():
    """Two motors with a ratio of 10: a jump of the motor by 0.5 is one of the joint by 0.05."""
    rate = 100.0
    joints = motion(rate)[:, :2]
    motors = 10 * joints
    motors[400:, 0] += 0.5
    ratios = np.diag([10.0, 10.0])
    direct = direct_drives(NAMES[:2])
    drives = Drives(direct.joint_names, direct.names, ratios, np.zeros(2), np.ones(2), np.zeros(2))
    statistics = SampleStatistics()
    motions = list(filter_motions([segment(motors, rate)], drives, statistics))
    largest = max(np.abs(each.qdd).max() for each in motions)
    assert largest < 1.1 * 0.4 * (2 * np.pi * 0.5) ** 2
    assert statistics.counts["position_jumps"] == 1
    (jump,) = [each.jump for each in motions if each.jump is not None]
    assert jump.time == pytest.approx(9.0) and jump.sizes == pytest.approx([0.05, 0], abs=2e-3)
    whole = motions[-1]
    assert whole.slice_samples(0, 10).jump is whole.jump and whole.slice_samples(5, 10).jump is None
    assert len(whole.slice_samples(5, 10).recorded) == 5


@pytest.mark.parametrize("resolution", [1e-3, 1e-2])
def test_steps_of_an_encoder_after_a_long_rest_are_no_jumps(resolution):
    """A motor at 5 kHz that rests for three quarters of the recording, quantised; a jump of it is seen all the same."""
    rate = 5000.0
    times = np.arange(0, 4, 1 / rate)
    angle = 30 * (1 - np.cos(2 * np.pi * np.maximum(times - 3, 0)))
    position = np.round(np.stack([angle, 0.3 * angle], axis=1) / resolution) * resolution
    (only,) = split_at_jumps(segment(position, rate), 2)
    assert only.jump is None
    position[15000 + 2500 :, 0] += 1.0
    _, second = split_at_jumps(segment(position, rate), 2)
    assert second.jump.sizes == pytest.approx([1.0, 0.0], abs=0.2)
