"""Evidence of a single event does not last; that of a change does."""

import numpy as np
import pytest
from peers.random_signals import random_signals

from robot_dynamics.checking.lasting_gain import lasting_gain
from robot_dynamics.checking.whitening import WhiteningFilter

N = 1000
SECOND = 50  # samples


@pytest.fixture
def signals():
    return random_signals(np.ones((N, 2), dtype=bool))


def gain_of(signals, effect):
    """White noise of unit variance: half of the squares that the effect takes from the residuals."""
    signals.residuals[:] += effect
    whitening = WhiteningFilter(np.ones((2, 1)), np.ones(2), signals.valid)
    return lasting_gain(signals, whitening, effect)


def test_event_of_a_second_has_no_lasting_gain(signals):
    effect = np.zeros((N, 2))
    effect[600 : 600 + SECOND, 0] = 20 * np.random.default_rng(1).normal(size=SECOND)
    assert gain_of(signals, effect) == pytest.approx(0, abs=1e-6)


def test_change_that_lasts_loses_its_best_second_only(signals):
    """Noise that no error of the model resembles: half of its squares, but for those of the best second."""
    effect = np.zeros((N, 2))
    effect[600:, 0] = 5 * np.random.default_rng(1).normal(size=400)
    squares = effect[:, 0] ** 2
    best = max(squares[first : first + SECOND].sum() for first in range(N - SECOND))
    assert gain_of(signals, effect) == pytest.approx(0.5 * (squares.sum() - best), rel=0.1)
