"""Filters, derivatives and interpolation against closed forms."""

import numpy as np
import pytest
from peers.recorded import JOINTS, messages, panda_motion
from scipy.signal import correlate, correlation_lags

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings import alignment
from robot_dynamics.recordings.alignment import SignalSegment, resample_samples
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_motions import filter_motions
from robot_dynamics.recordings.joint_samples import sample_of_joint_state
from robot_dynamics.recordings.sample_statistics import SampleStatistics
from robot_dynamics.recordings.signals import choose_cutoff, differentiate, interpolate_on_grid, lowpass

RATE = 200.0
TIMES = np.arange(2000) / RATE
INSIDE = slice(300, -300)


def sine(frequency, shift=0.0):
    return np.sin(2 * np.pi * frequency * (TIMES - shift))[:, None]


def estimate_delay(later, earlier, rate, longest=0.2):
    """Delay [s] of `later` (N,) behind `earlier` (N,): the peak of their correlation, between samples too.

    longest: largest delay [s] to both sides. nan where one of them is constant.
    """
    a = later - later.mean()
    b = earlier - earlier.mean()
    if not a.any() or not b.any():
        return np.nan
    lags = correlation_lags(len(a), len(b))
    near = np.abs(lags) <= max(1, round(longest * rate))
    lags = lags[near]
    correlation = correlate(a, b, mode="full")[near] / (len(a) - np.abs(lags))
    peak = int(np.argmax(correlation))
    shift = 0.0
    if 0 < peak < len(correlation) - 1:
        left, top, right = correlation[peak - 1 : peak + 2]
        shift = 0.5 * (left - right) / (left - 2 * top + right)
    return float((lags[peak] + shift) / rate)


def test_lowpass_has_no_delay_and_halves_the_amplitude_at_its_cutoff():
    """Butterworth of order 4, twice: |H|² = 1 / (1 + (tan(π f/r) / tan(π c/r))⁸)."""
    for frequency in (2.0, 8.0, 20.0):
        ratio = np.tan(np.pi * frequency / RATE) / np.tan(np.pi * 8 / RATE)
        expected = sine(frequency) / (1 + ratio**8)
        filtered = lowpass(sine(frequency), RATE, 8.0)
        assert np.abs(filtered - expected)[INSIDE].max() < 1e-4
    signal = sum(sine(frequency) for frequency in (0.4, 1.1, 2.3))
    filtered = lowpass(signal, RATE, 8.0)
    assert estimate_delay(filtered[INSIDE, 0], signal[INSIDE, 0], RATE) == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize("frequency", [0.5, 1.5, 8.0, 20.0, 40.0])
def test_derivatives_of_sines_are_exact_up_to_a_fifth_of_the_rate(frequency):
    """40 Hz at 200 samples per second; central differences would be 24 % too small there."""
    w = 2 * np.pi * frequency
    velocity = differentiate(sine(frequency), RATE)
    assert np.abs(velocity - w * np.cos(w * TIMES)[:, None])[INSIDE].max() < 1e-5 * w
    acceleration = differentiate(velocity, RATE)
    assert np.abs(acceleration + w * w * sine(frequency))[INSIDE].max() < 2e-5 * w * w


def test_filter_follows_a_signal_up_to_the_ends():
    """Parabolas are extended exactly; noise of the last sample hardly matters beyond one period of the cut-off."""
    parabola = (3 + 2 * TIMES - 0.5 * TIMES**2)[:, None]
    assert np.abs(lowpass(parabola, RATE, 8.0) - parabola).max() < 1e-3
    disturbed = sine(0.7)
    expected = lowpass(disturbed, RATE, 8.0)
    disturbed[[0, -1]] += 0.1
    error = differentiate(lowpass(disturbed, RATE, 8.0) - expected, RATE)
    assert np.abs(error[25:-25]).max() < 0.05  # 0.12 by reflection about the last sample


def test_derivative_of_a_line_is_its_slope_up_to_the_ends():
    line = np.stack([3.0 * TIMES, 1.0 - TIMES], axis=1)
    assert np.abs(differentiate(line, RATE) - [3.0, -1.0]).max() < 1e-9
    assert np.abs(differentiate(line[:3], RATE) - [3.0, -1.0]).max() < 1e-9


@pytest.mark.parametrize("with_velocity", [True, False])
@pytest.mark.parametrize(("rate", "cutoff"), [(30.0, 6.0), (125.0, 8.0), (1000.0, 8.0)])
def test_motion_in_the_band_has_exact_velocities_and_accelerations(rate, cutoff, with_velocity):
    """Up to 0.4 cut-offs the filter leaves the amplitude; amplitude and phase are those of the sine."""
    for frequency in (0.1 * cutoff, 0.25 * cutoff, 0.4 * cutoff):
        w = 2 * np.pi * frequency
        times = np.arange(int(40 / cutoff * rate)) / rate
        q = np.sin(w * times)[:, None]
        qd = w * np.cos(w * times)[:, None] if with_velocity else np.full_like(q, np.nan)
        segment = SignalSegment(0.0, rate, q, qd, np.zeros_like(q), is_continuation=False)
        motions = list(filter_motions([segment], direct_drives(["joint"]), SampleStatistics(), cutoff))
        motion = motions[0]
        for other in motions[1:]:
            motion = motion.concatenate(other)
        inside = slice(len(motion) // 4, -len(motion) // 4)
        basis = np.stack([np.cos(w * motion.times), np.sin(w * motion.times)], axis=1)[inside]
        for values, expected in ((motion.q, [0, 1]), (motion.qd, [w, 0]), (motion.qdd, [0, -w * w])):
            factors = np.linalg.lstsq(basis, values[inside, 0], rcond=None)[0]
            assert np.abs(factors - expected).max() < 1e-3 * np.abs(expected).max()


@pytest.mark.parametrize("shift", [-0.08, 0.0, 0.0123, 0.03])
def test_estimate_delay_is_exact_between_samples(shift):
    rng = np.random.default_rng(1)
    signal = sum(sine(f) for f in (0.4, 1.1, 2.3))[:, 0]
    shifted = sum(sine(f, shift) for f in (0.4, 1.1, 2.3))[:, 0] + 0.02 * rng.normal(size=len(TIMES))
    assert estimate_delay(shifted, signal, RATE) == pytest.approx(shift, abs=2e-3)
    assert np.isnan(estimate_delay(shifted, np.ones(len(TIMES)), RATE))


def test_interpolation_of_uneven_samples_follows_the_signal():
    rng = np.random.default_rng(2)
    uneven = TIMES + rng.uniform(-0.3, 0.3, len(TIMES)) / RATE
    values = np.sin(2 * np.pi * 2.0 * uneven)[:, None]
    grid = TIMES[10:-10]
    assert np.abs(interpolate_on_grid(uneven, values, grid) - sine(2.0)[10:-10]).max() < 1e-5


def test_choose_cutoff_refuses_cutoffs_above_half_the_rate():
    assert choose_cutoff(125.0) == 8.0 and choose_cutoff(30.0) == 6.0 and choose_cutoff(125.0, 20.0) == 20.0
    with pytest.raises(RecordingError, match=r"between 0 and 62\.5 is needed"):
        choose_cutoff(125.0, 70.0)


def filter_in_chunks(motion, chunk, monkeypatch, velocity=True):
    """(Motions, SampleStatistics) of a recorded motion that is resampled in chunks of so many messages."""
    monkeypatch.setattr(alignment, "MESSAGES_PER_CHUNK", chunk)
    states = messages(motion if velocity else motion._replace(qd=motion.qd * np.nan))
    statistics = SampleStatistics()
    samples = (sample_of_joint_state("/joint_states", 0, state) for state in states)
    segments = resample_samples(samples, JOINTS, statistics)
    return list(filter_motions(segments, direct_drives(JOINTS), statistics)), statistics


def test_filtering_in_pieces_gives_the_whole_to_the_accuracy_of_the_filter(monkeypatch):
    motion = panda_motion(duration=30.0)
    whole = filter_in_chunks(motion, 20_000, monkeypatch)[0][0]
    several, _ = filter_in_chunks(motion, 400, monkeypatch)
    assert len(several) > 5
    for field in ("q", "qd", "qdd", "efforts"):
        concatenated = np.concatenate([getattr(piece, field) for piece in several])
        size = np.abs(getattr(whole, field)).max()
        assert np.abs(concatenated[: len(whole)] - getattr(whole, field)).max() < 1e-4 * size
    assert sum(map(len, several)) == len(motion.times) - 26  # a period of 8 Hz at either end


def test_filtering_derives_missing_velocities_from_positions(monkeypatch):
    motion = panda_motion(duration=10.0)
    (piece, *_), statistics = filter_in_chunks(motion, 20_000, monkeypatch, velocity=False)
    inside = slice(100, len(piece) - 100)
    first = round(piece.time * 100)
    assert first == 13  # the filter has no data before the beginning
    assert np.abs(piece.qd - motion.qd[first : first + len(piece)])[inside].max() < 2e-3
    assert np.abs(piece.qdd - motion.qdd[first : first + len(piece)])[inside].max() < 2e-2
    assert any("velocities that were not measured" in sentence for sentence in statistics.sentences)
