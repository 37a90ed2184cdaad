"""Nonlinear least squares for drive gains and parameters: residuals y_k - (X_k θ + L_k) δ_k of motor k.

δ_k is the inverse gain of motor k, θ are the parameters, and L_k are the efforts that the known payload masses require.
The unknowns are x = (θ (P,), δ (k,)).

Source: Gautier and Briot, "Global identification of drive gains parameters of robots using a known payload" (2014),
whose total least squares give the initial values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.triangular_factors import solve_least_squares

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

MIN_IDENTIFIABILITY = 1e-6  # smallest part of the effect of gains on efforts that no parameter reproduces
REQUIREMENT = "record runs with a payload of known mass beside runs without it, in motions that load every joint"


class GainProblem:
    """Least squares of y_k - (X_k θ + L_k) δ_k; triangles: (k, P + 2, P + 2), factor R of [X L y] of each motor."""

    def __init__(self, triangles: Array) -> None:
        self.X = triangles[..., :-2]
        self.L = triangles[..., -2]
        self.y = triangles[..., -1]

    @property
    def parameter_count(self) -> int:
        """P, the number of parameters θ."""
        return int(self.X.shape[-1])

    def initial_values(self) -> Array:
        """Compute x by total least squares: gains for which the measured signals, scaled to 1, are nearest to [X L].

        Raises RecordingError if the known masses do not determine the gains.
        """
        k = len(self.y)
        P = self.parameter_count
        X = self.X.reshape(-1, P)
        L = self.L.ravel()
        if not np.linalg.norm(L - X @ solve_least_squares(X, L).values) > MIN_IDENTIFIABILITY * np.linalg.norm(L):
            raise _unidentifiable_gains()
        lengths = np.linalg.norm(self.y, axis=1)
        signals = np.einsum("kr,kg->krg", self.y / lengths[:, None], np.eye(k)).reshape(-1, k)
        columns = np.column_stack([X, L])
        fits = np.stack([solve_least_squares(columns, signal).values for signal in signals.T], axis=1)
        gains = np.linalg.svd(signals - columns @ fits)[2][-1]
        *values, scale = fits @ gains
        gains = np.where(np.abs(gains) > MIN_IDENTIFIABILITY, gains, MIN_IDENTIFIABILITY) / lengths
        return np.concatenate([np.array(values) / scale, scale / gains])

    def residual_sum_of_squares(self, x: Array) -> Array:
        """Compute the sums of squares (k,) of the residuals."""
        inverse_gains, efforts = self._split(x)
        squares: Array = np.square(efforts * inverse_gains - self.y).sum(axis=1)
        return squares

    def minimize(self, x: Array, weights: Array) -> Array:
        """Minimise the squares of the residuals with weights (k,), from initial values x.

        The unknowns of the solver are z = (θ δ_1, δ_1, δ_k / δ_1), where motor 1 is the one with the largest payload
        efforts. The overall scale is the least certain unknown; here it is linear, as the factor of the column L.
        """
        P = self.parameter_count
        first = int(np.argmax(np.linalg.norm(self.L, axis=1)))
        others = np.arange(len(self.y)) != first
        root_weights = np.sqrt(weights)[:, None]
        columns = root_weights[..., None] * np.concatenate([self.X, self.L[..., None]], axis=-1)
        y = root_weights * self.y
        by_gain = np.eye(len(self.y))[:, None, others]

        def relative_gains(z: Array) -> Array:
            gains = np.ones(len(self.y))
            gains[others] = z[P + 1 :]
            return gains[:, None]

        def residuals(z: Array) -> Array:
            return np.ravel(relative_gains(z) * (columns @ z[: P + 1]) - y)

        def jacobian(z: Array) -> Array:
            efforts = (columns @ z[: P + 1])[..., None]
            blocks = [columns * relative_gains(z)[..., None], efforts * by_gain]
            return np.concatenate(blocks, -1).reshape(-1, len(z))

        scale = x[P + first]
        z = np.concatenate([x[:P] * scale, [scale], x[P:][others] / scale])
        z = least_squares(residuals, z, jacobian, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12).x
        return np.concatenate([z[:P] / z[P], relative_gains(z)[:, 0] * z[P]])

    def covariances(self, x: Array, weights: Array) -> tuple[Array, Array]:
        """Compute the covariances of θ (P, P) and δ (k, k), for residuals of variance 1.

        Raises RecordingError if the known masses do not determine the gains.
        """
        P = self.parameter_count
        J = (np.sqrt(weights)[:, None, None] * self._jacobian(x)).reshape(-1, len(x))
        parameter_covariance = solve_least_squares(J[:, :P], np.zeros(len(J))).covariance
        by_gain = -parameter_covariance @ (J[:, :P].T @ J[:, P:])  # dθ/dδ
        reduced = J[:, P:] + J[:, :P] @ by_gain
        lengths = np.linalg.norm(J[:, P:], axis=0)
        if not np.linalg.svd(reduced / lengths, compute_uv=False)[-1] > MIN_IDENTIFIABILITY:
            raise _unidentifiable_gains()
        gain_covariance = np.linalg.inv(reduced.T @ reduced)
        return parameter_covariance + by_gain @ gain_covariance @ by_gain.T, gain_covariance

    def _split(self, x: Array) -> tuple[Array, Array]:
        """Return the inverse gains (k, 1) and the efforts (k, rows) of x."""
        P = self.parameter_count
        return x[P:, None], self.X @ x[:P] + self.L

    def _jacobian(self, x: Array) -> Array:
        inverse_gains, efforts = self._split(x)
        by_gain = np.einsum("kr,kg->krg", efforts, np.eye(len(efforts)))
        return np.concatenate([self.X * inverse_gains[..., None], by_gain], axis=-1)


def _unidentifiable_gains() -> RecordingError:
    return RecordingError(f"the gains cannot be identified from the payload masses: {REQUIREMENT}")
