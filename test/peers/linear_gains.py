"""Drive gains by linear least squares as in the literature, with numpy only: y_k γ_k - X_k θ = L_k for motor k.

Gautier and Briot, "Global identification of joint drive gains and dynamic parameters of robots" (2014), and the scripts
of shamilmamedov/dynamic_calibration (estimate_drive_gains.m), which have the same two methods."""

import numpy as np


def ordinary_least_squares_gains(signals, columns, known):
    """Gains (k,) by ordinary least squares, for which `known` is noisy and the signals are exact.

    signals, known: (N, k) measured signals and known efforts; columns: (N, k, P) of unknown parameters."""
    matrix = _equations(signals, columns)
    return np.linalg.lstsq(matrix, known.ravel(), rcond=None)[0][: signals.shape[1]]


def total_least_squares_gains(signals, columns, known):
    """Gains (k,) by total least squares with errors of the same size in all columns; arguments as above."""
    matrix = np.column_stack([_equations(signals, columns), -known.ravel()])
    solution = np.linalg.svd(matrix, full_matrices=False)[2][-1]
    return solution[: signals.shape[1]] / solution[-1]


def _equations(signals, columns):
    """Columns (N k, k + P) of the gains and of the parameters."""
    by_gain = signals[..., None] * np.eye(signals.shape[1])
    return np.concatenate([by_gain, -columns], axis=-1).reshape(signals.size, -1)
