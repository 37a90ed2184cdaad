"""Filters, derivatives and delays against closed forms."""

import numpy as np
import pytest
from peers.recorded import JOINTS, messages, panda_motion

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings import alignment
from robot_dynamics.recordings.alignment import resample_samples
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_motions import filter_motions
from robot_dynamics.recordings.joint_samples import sample_of_joint_state
from robot_dynamics.recordings.sample_statistics import SampleStatistics
from robot_dynamics.recordings.signals import choose_cutoff, differentiate, estimate_delay, interpolate_on_grid, lowpass

RATE = 200.0
TIMES = np.arange(2000) / RATE
INSIDE = slice(300, -300)


def sine(frequency, shift=0.0):
    return np.sin(2 * np.pi * frequency * (TIMES - shift))[:, None]


def test_the_filter_has_no_delay_and_halves_the_amplitude_at_its_cutoff():
    """Butterworth of order 4, twice: |H|² = 1 / (1 + (tan(π f/r) / tan(π c/r))⁸)."""
    for frequency in (2.0, 8.0, 20.0):
        ratio = np.tan(np.pi * frequency / RATE) / np.tan(np.pi * 8 / RATE)
        expected = sine(frequency) / (1 + ratio**8)
        assert np.abs(lowpass(sine(frequency), RATE, 8.0) - expected)[INSIDE].max() < 1e-4


def test_derivatives_are_central_differences():
    w = 2 * np.pi * 1.5
    found = differentiate(sine(1.5), RATE)[INSIDE]
    expected = np.cos(w * TIMES)[:, None][INSIDE] * np.sin(w / RATE) * RATE
    assert np.abs(found - expected).max() < 1e-9


@pytest.mark.parametrize("shift", [-0.08, 0.0, 0.0123, 0.03])
def test_delays_are_found_between_samples(shift):
    rng = np.random.default_rng(1)
    signal = sum(sine(f) for f in (0.4, 1.1, 2.3))[:, 0]
    shifted = sum(sine(f, shift) for f in (0.4, 1.1, 2.3))[:, 0] + 0.02 * rng.normal(size=len(TIMES))
    assert estimate_delay(shifted, signal, RATE) == pytest.approx(shift, abs=2e-3)
    assert np.isnan(estimate_delay(shifted, np.ones(len(TIMES)), RATE))


def test_uneven_samples_are_resampled():
    rng = np.random.default_rng(2)
    uneven = TIMES + rng.uniform(-0.3, 0.3, len(TIMES)) / RATE
    values = np.sin(2 * np.pi * 2.0 * uneven)[:, None]
    grid = TIMES[10:-10]
    assert np.abs(interpolate_on_grid(uneven, values, grid) - sine(2.0)[10:-10]).max() < 1e-5


def test_cutoffs_that_the_rate_does_not_allow_are_refused():
    assert choose_cutoff(125.0) == 8.0 and choose_cutoff(30.0) == 6.0 and choose_cutoff(125.0, 20.0) == 20.0
    with pytest.raises(RecordingError, match=r"between 0 and 62\.5 is needed"):
        choose_cutoff(125.0, 70.0)


def pieces(motion, chunk, monkeypatch, velocity=True):
    monkeypatch.setattr(alignment, "MESSAGES_PER_CHUNK", chunk)
    told, statistics = messages(motion if velocity else motion._replace(qd=motion.qd * np.nan)), SampleStatistics()
    samples = (sample_of_joint_state("/joint_states", 0, each) for each in told)
    return list(
        filter_motions(resample_samples(samples, JOINTS, statistics), direct_drives(JOINTS), statistics)
    ), statistics


def test_pieces_are_the_whole_to_rounding_of_the_filter(monkeypatch):
    motion = panda_motion(duration=30.0)
    whole = pieces(motion, 20_000, monkeypatch)[0][0]
    several, _ = pieces(motion, 400, monkeypatch)
    assert len(several) > 5
    for field in ("q", "qd", "qdd", "efforts"):
        joined = np.concatenate([getattr(piece, field) for piece in several])
        size = np.abs(getattr(whole, field)).max()
        assert np.abs(joined[: len(whole)] - getattr(whole, field)).max() < 1e-4 * size
    assert sum(map(len, several)) == len(motion.times) - 26  # a period of 8 Hz at either end


def test_velocities_that_are_missing_are_derivatives_of_positions(monkeypatch):
    motion = panda_motion(duration=10.0)
    (piece, *_), statistics = pieces(motion, 20_000, monkeypatch, velocity=False)
    inside = slice(100, len(piece) - 100)
    first = round(piece.time * 100)
    assert first == 13  # the filter knows nothing of what was before
    assert np.abs(piece.qd - motion.qd[first : first + len(piece)])[inside].max() < 2e-3
    assert np.abs(piece.qdd - motion.qdd[first : first + len(piece)])[inside].max() < 2e-2
    assert any("velocities that were not measured" in sentence for sentence in statistics.sentences)
