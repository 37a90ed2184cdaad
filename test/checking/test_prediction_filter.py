"""Predictions through the filter of measured efforts: piece by piece as in one piece."""

from itertools import pairwise

import numpy as np
import pytest

from robot_dynamics.checking.prediction_filter import PredictionFilter
from robot_dynamics.recordings.joint_motions import Motion
from robot_dynamics.recordings.signals import lowpass

RATE, CUTOFF = 100.0, 8.0
TIMES = np.arange(3000) / RATE


def motion_of(begin, end):
    """The samples from begin to end of a joint that oscillates, with 10 N m of Coulomb friction; and its effort."""
    qd = np.cos(TIMES[begin:end])[:, None]
    zero = np.zeros_like(qd)
    moving = np.ones(qd.shape, dtype=bool)
    motion = Motion(TIMES[begin], RATE, CUTOFF, zero, qd, zero, zero, zero, np.ones(1, dtype=bool), moving)
    return motion, 10 * np.sign(qd)


def filtered(cuts):
    prediction_filter, parts = PredictionFilter(), []
    for begin, end in pairwise(cuts):
        parts += prediction_filter.feed(*motion_of(begin, end))
    return [*parts, *prediction_filter.flush()]


def joined(parts, field):
    return np.concatenate([getattr(part, field) for part in parts])


@pytest.mark.parametrize("size", [7, 40, 500])
def test_pieces_are_filtered_as_the_whole(size):
    parts = filtered([*range(0, 3000, size), 3000])
    expected = lowpass(10 * np.sign(np.cos(TIMES))[:, None], RATE, CUTOFF)
    assert np.abs(joined(parts, "filtered") - expected).max() < 0.01  # of steps of 20
    assert np.abs(joined(parts, "directions") - expected / 10).max() < 0.001
    assert np.array_equal(joined(parts, "predicted"), 10 * np.sign(np.cos(TIMES))[:, None])
    times = np.concatenate([part.motion.times for part in parts])
    assert np.abs(times - TIMES).max() < 1e-9


def test_samples_before_a_gap_are_not_mixed_with_those_after_it():
    prediction_filter = PredictionFilter()
    parts = list(prediction_filter.feed(*motion_of(0, 1000)))
    parts += prediction_filter.feed(*motion_of(1500, 1505))  # too short to be filtered by itself
    parts += prediction_filter.feed(*motion_of(2000, 3000))
    parts += prediction_filter.flush()
    alone = np.concatenate([joined(filtered(cuts), "filtered") for cuts in ([0, 1000], [1500, 1505], [2000, 3000])])
    assert joined(parts, "filtered") == pytest.approx(alone, abs=1e-12)
    assert len(alone) == 2005
