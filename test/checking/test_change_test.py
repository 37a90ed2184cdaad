"""Changes of residuals against dense least squares, and their significance against its definition."""

from dataclasses import replace

import numpy as np
import pytest
from peers.random_signals import random_signals
from scipy.linalg import block_diag, toeplitz
from scipy.signal import lfilter

from robot_dynamics.checking import change_test
from robot_dynamics.checking.change_test import ChangeTest
from robot_dynamics.checking.fault_signals import FaultSignals
from robot_dynamics.checking.whitening import WhiteningFilter

N = 160
STEP = 0.02
ONSETS = slice(20, 140)


def free_sizes(squares, products):
    return np.linalg.solve(squares, products[..., None])[..., 0]


@pytest.fixture
def signals():
    valid = np.ones((N, 2), dtype=bool)
    valid[50:54, 1] = False
    return random_signals(valid)


@pytest.mark.parametrize("is_constant_error", [False, True])
def test_gains_are_those_of_dense_least_squares(signals, monkeypatch, is_constant_error):
    """A change beside the constant errors of the model, for each onset: least squares with all columns at once."""
    for constant in ("RIDGE", "ROUNDING", "MIN_DISTINCT_PART"):
        monkeypatch.setattr(change_test, constant, 1e-13)
    whitening = WhiteningFilter(np.array([[1, -0.5, 0.2], [1, 0.3, -0.1]]), np.array([0.7, 1.3]), signals.valid)
    columns = np.random.default_rng(1).normal(size=(N, 2, 2))
    test = ChangeTest(signals, whitening, signals.residuals)
    change = test.fit(columns, [0, 1], free_sizes, ONSETS, is_constant_error=is_constant_error)

    def white(values):
        """(2 N, a) of values (N, 2, a), by dense matrices."""
        rows = []
        for joint in range(2):
            matrix = toeplitz(np.r_[whitening.filters[joint], np.zeros(N - 3)], np.r_[1, np.zeros(N - 1)])
            rows.append(whitening.weights[:, [joint]] * (matrix @ values[:, joint]))
        return np.concatenate(rows)

    def squares(matrix, target):
        return float(np.sum((target - matrix @ np.linalg.lstsq(matrix, target, rcond=1e-12)[0]) ** 2))

    target = white(signals.residuals[..., None])[:, 0]
    each = [white(np.stack([signals.model_error_columns[joint][0]] * 2, axis=1)) for joint in range(2)]
    errors = block_diag(each[0][:N], each[1][N:])
    if is_constant_error:
        errors = np.concatenate([errors, white(columns)], axis=1)
    without = squares(errors, target)
    for onset in (25, 49, 52, 90, 139):
        begun = np.where(np.arange(N)[:, None, None] >= onset, columns, 0)
        expected = without - squares(np.concatenate([errors, white(begun)], axis=1), target)
        assert change.gains[onset] == pytest.approx(expected, rel=1e-4), onset
    assert not change.gains[:20].any() and not change.gains[140:].any()
    assert change.effect[: change.row].any() == np.False_


def test_a_bump_is_not_as_significant_as_a_lasting_change_of_equal_gain(signals):
    """One block that has all evidence may be an error of the model; many blocks may not."""
    rng = np.random.default_rng(2)
    long = replace(
        signals,
        **{
            name: np.tile(getattr(signals, name), (10, *[1] * (getattr(signals, name).ndim - 1)))
            for name in ("predicted", "velocity_signs", "velocities", "payload_efforts", "offset_efforts", "resting")
        },
        times=STEP * np.arange(10 * N),
        valid=np.ones((10 * N, 2), dtype=bool),
        recorded=np.ones(10 * N),
        residuals=rng.normal(size=(10 * N, 2)),
    )
    whitening = WhiteningFilter(np.array([[1.0, 0.0], [1.0, 0.0]]), np.ones(2), long.valid)
    columns = np.zeros((10 * N, 1, 1))
    columns[:, 0, 0] = rng.normal(size=10 * N)
    p_values = []
    for duration in (800, 40):
        residuals = long.residuals.copy()
        residuals[800 : 800 + duration, 0] += 0.4 * np.sqrt(800 / duration) * columns[800 : 800 + duration, 0, 0]
        test = ChangeTest(long, whitening, residuals)
        change = test.fit(columns, [0], free_sizes, slice(780, 820), is_constant_error=False)
        p_values.append(test.p_value(change, columns, [0], is_constant_error=False))
    assert p_values[0] < 1e-8 and p_values[1] > 1e-3


def test_significance_of_a_gain_holds_where_errors_of_the_model_are_slow():
    """Errors with a correlation time of 0.3 s: a wrong gain must not seem significant more often than it states.

    The effect of a gain is one of the constant errors of the model, so that nothing of it is left over a whole
    recording without them; its scatter must come from the effect itself.
    """
    rows = 2000
    times = STEP * np.arange(rows)
    p_values = []
    for trial in range(60):
        rng = np.random.default_rng(trial)
        phase = rng.uniform(0, 6, size=4)
        predicted = 20 * np.sin(0.9 * times + phase[0]) + 8 * np.sin(2.3 * times + phase[1])
        velocity = np.cos(0.9 * times + phase[2]) + np.cos(1.7 * times + phase[3])
        errors = lfilter([1.0], [1, -np.exp(-STEP / 0.3)], rng.normal(size=rows))
        nothing = np.zeros((rows, 1))
        signals = FaultSignals(
            times=times, step=STEP, band=4.0, residuals=errors[:, None], predicted=predicted[:, None],
            velocity_signs=np.sign(velocity)[:, None], velocities=velocity[:, None],
            payload_efforts=np.zeros((rows, 1, 4)), offset_efforts=np.zeros((rows, 1, 1)),
            valid=nothing == 0, resting=nothing != 0, recorded=np.ones(rows),
        )  # fmt: skip
        test = ChangeTest(
            signals, WhiteningFilter.fit(signals.residuals, signals.valid, np.array([1e-9])), errors[:, None]
        )
        columns = predicted[:, None, None]
        change = test.fit(columns, [0], free_sizes, slice(1000, 1001), is_constant_error=False)
        p_values.append(test.p_value(change, columns, [0], is_constant_error=False))
    p_values = np.array(p_values)
    assert (p_values < 0.01).mean() <= 0.05 and (p_values < 0.2).mean() <= 0.3, np.sort(p_values)[:10]
    assert (p_values < 0.5).mean() > 0.1  # nor is it insignificant whatever the errors
