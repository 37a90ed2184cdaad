"""Whitening against dense least squares, and block averages of a stream against those of the whole."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from robot_dynamics.checking import whitening
from robot_dynamics.checking.block_averages import BlockAverages
from robot_dynamics.checking.whitening import WhiteningFilter

RNG = np.random.default_rng(0)


def test_whitening_makes_residuals_of_an_autoregression_white(monkeypatch):
    monkeypatch.setattr(whitening, "VARIANCE_FLOOR", 1e-6)
    shocks = RNG.normal(size=(20_000, 2)) * [1.0, 3.0]
    coloured = np.stack([lfilter([1], [1, -0.9], shocks[:, 0]), lfilter([1], [1, -1.2, 0.5], shocks[:, 1])], axis=1)
    white = WhiteningFilter.fit(coloured, np.ones(coloured.shape, dtype=bool), np.zeros(2))(coloured)
    for column in white.T:
        assert column.std() == pytest.approx(1.0, abs=0.03)
        assert abs(np.corrcoef(column[1:], column[:-1])[0, 1]) < 0.03


def test_first_samples_are_those_of_dense_matrices():
    """White values of columns that begin at a row: the filter does not use earlier columns."""
    N, filters = 40, np.array([[1, -0.7, 0.1], [1, 0.3, 0.0], [1, -1.1, 0.4]])
    columns = RNG.normal(size=(N, 2, 2))
    valid = np.ones((N, 3), dtype=bool)
    valid[7] = False
    fixed = WhiteningFilter(filters, np.array([0.5, 1.0, 2.0]), valid)
    for row in (0, 6, 7, 37):
        begun = np.where(np.arange(N)[:, None, None] >= row, columns, 0)
        for column, joint in enumerate((0, 2)):
            matrix = toeplitz(np.r_[filters[joint], np.zeros(N - 3)], np.r_[1, np.zeros(N - 1)])
            white = fixed.weights[:, [joint]] * (matrix @ begun[:, column])
            for lag in range(2):
                first = fixed.first_samples(columns, lag, [0, 2])[row, column]
                assert first == pytest.approx(white[row + lag], abs=1e-12)


def test_block_averages_of_pieces_are_those_of_the_whole():
    samples = RNG.normal(size=(2, 1003, 3))
    averages = BlockAverages(2, 50)
    for piece in np.array_split(samples, [1, 4, 105, 106, 650], axis=1):
        averages.add(piece)
        assert averages.rows.shape[1] < 50
    assert averages.stride == 32  # the first power of 2 that leaves fewer than 50
    assert averages.rows == pytest.approx(samples[:, : 31 * 32].reshape(2, 31, 32, 3).mean(axis=2))
