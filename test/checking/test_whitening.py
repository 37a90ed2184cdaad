"""Whitening against dense least squares, and block averages of a stream against those of the whole."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from robot_dynamics.checking.block_averages import BlockAverages
from robot_dynamics.checking.whitening import WhiteningFilter

RNG = np.random.default_rng(0)


def test_whitening_makes_residuals_of_an_autoregression_white():
    shocks = RNG.normal(size=(20_000, 2)) * [1.0, 3.0]
    coloured = np.stack([lfilter([1], [1, -0.9], shocks[:, 0]), lfilter([1], [1, -1.2, 0.5], shocks[:, 1])], axis=1)
    white = WhiteningFilter.fit(coloured, np.ones(len(coloured), dtype=bool), np.zeros(2))(coloured)
    for column in white.T:
        assert column.std() == pytest.approx(1.0, abs=0.03)
        assert abs(np.corrcoef(column[1:], column[:-1])[0, 1]) < 0.03


def test_correlation_sums_are_those_of_dense_matrices():
    N, n, filters = 40, 3, np.array([[1, -0.7, 0.1], [1, 0.3, 0.0], [1, -1.1, 0.4]])
    weights, columns, residuals = RNG.uniform(0.5, 2, (N, n)), RNG.normal(size=(N, 2, 2)), RNG.normal(size=(N, n))
    weights[7] = 0  # a row that does not count
    squares, products = WhiteningFilter(filters, weights).correlation_sums(columns, residuals, [0, 2])
    for row in (0, 3, 6, 7, 8, 38, 39):
        begun = np.where(np.arange(N)[:, None, None] >= row, columns, 0)
        white = []
        for column, joint in enumerate((0, 2)):
            matrix = toeplitz(np.r_[filters[joint], np.zeros(N - 3)], np.r_[1, np.zeros(N - 1)])
            white.append(weights[:, [joint]] * (matrix @ begun[:, column]))
        assert squares[row] == pytest.approx(sum(each.T @ each for each in white), abs=1e-10)
        expected = sum(each.T @ residuals[:, joint] for each, joint in zip(white, (0, 2), strict=True))
        assert products[row] == pytest.approx(expected, abs=1e-10)


def test_block_averages_of_pieces_are_those_of_the_whole():
    samples = RNG.normal(size=(2, 1003, 3))
    averages = BlockAverages(2, 50)
    for piece in np.array_split(samples, [1, 4, 105, 106, 650], axis=1):
        averages.add(piece)
        assert averages.rows.shape[1] < 50
    assert averages.stride == 32  # the first power of 2 that leaves fewer than 50
    assert averages.rows == pytest.approx(samples[:, : 31 * 32].reshape(2, 31, 32, 3).mean(axis=2))
