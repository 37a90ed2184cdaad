"""Weighted total least squares for drive gains and parameters: y_k γ_k = X_k θ + L_k of motor k.

γ_k is the gain of motor k, δ_k its inverse, θ are the parameters, and L_k are the efforts that the known payload masses
require. The signals y_k are noisy; X_k and L_k follow from positions and count as exact. So the equations have noisy
columns, those of the gains, and known ones. Ordinary least squares, for which L_k would be the noisy side, give gains
that are too small.

As each equation has one noisy signal, the smallest weighted errors of the signals are the residuals of
y_k = (X_k θ + L_k) δ_k: nonlinear least squares, in x = (θ (P,), δ (k,)), give the total least squares solution with
noise of a size of its own for each motor. The linear problem of total least squares gives the initial values.

Source: Gautier and Briot, "Global identification of joint drive gains and dynamic parameters of robots" (2014).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.total_least_squares import solve_total_least_squares
from robot_dynamics.identification.triangular_factors import solve_least_squares

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray

MIN_IDENTIFIABILITY = 1e-6  # smallest part of the effect of gains on efforts that no parameter reproduces
TOTAL_LEAST_SQUARES_ITERATIONS = 4
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

    def restricted(self, count: int) -> GainProblem:
        """Return the problem with the first parameters only."""
        return GainProblem(np.concatenate([self.X[..., :count], self.L[..., None], self.y[..., None]], axis=-1))

    def initial_values(self, noise_variances: Array, samples: IntArray) -> Array:
        """Compute x by total least squares with noise in the measured signals only.

        noise_variances: (k,) of the signals; samples: (k,) rows of each motor. The equations of a motor are divided by
        its noise, in efforts. That depends on the gain, so the gains are computed repeatedly. Raises RecordingError if
        the known masses do not determine the gains.
        """
        X = self.X.reshape(-1, self.parameter_count)
        L = self.L.ravel()
        if not np.linalg.norm(L - X @ solve_least_squares(X, L).values) > MIN_IDENTIFIABILITY * np.linalg.norm(L):
            raise _unidentifiable_gains()
        deviations = np.sqrt(noise_variances)
        x = self._solve_total_least_squares(np.ones(len(self.y)), deviations * np.sqrt(samples))
        for _ in range(TOTAL_LEAST_SQUARES_ITERATIONS):
            roots = np.abs(x[self.parameter_count :]) / deviations
            x = self._solve_total_least_squares(roots, roots * deviations * np.sqrt(samples))
        return x

    def noise_squares(self) -> Array:
        """Compute the sums of squares (k,) of what no parameters explain of a signal, those of its motor alone."""
        columns = np.concatenate([self.X, self.L[..., None]], axis=-1)
        residuals = [y - A @ solve_least_squares(A, y).values for A, y in zip(columns, self.y, strict=True)]
        squares: Array = np.square(residuals).sum(axis=1)
        return squares

    def _solve_total_least_squares(self, roots: Array, noise: Array) -> Array:
        """Compute x for equations times the roots (k,) of weights; noise: (k,) errors of the signals in them."""
        k = len(self.y)
        signals = np.einsum("kr,kg->krg", self.y * roots[:, None], np.eye(k)).reshape(-1, k)
        columns = np.concatenate([self.X, self.L[..., None]], axis=-1) * roots[:, None, None]
        gains, coefficients = solve_total_least_squares(signals, columns.reshape(-1, columns.shape[-1]), noise)
        smallest = MIN_IDENTIFIABILITY * np.abs(gains).max()
        gains = np.where(np.abs(gains) > smallest, gains, smallest)
        *values, scale = -coefficients
        return np.concatenate([np.array(values) / scale, scale / gains])

    def residual_sum_of_squares(self, x: Array) -> Array:
        """Compute the sums of squares (k,) of the residuals."""
        squares: Array = np.square(self.residuals(x)).sum(axis=1)
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

    def solve_parameters(self, inverse_gains: Array, weights: Array) -> Array:
        """Compute x with the parameters that belong to inverse gains (k,), for weights (k,)."""
        roots = np.sqrt(weights)[:, None]
        columns = roots[..., None] * self.X * inverse_gains[:, None, None]
        signals = roots * (self.y - self.L * inverse_gains[:, None])
        values = solve_least_squares(columns.reshape(-1, self.parameter_count), signals.ravel()).values
        return np.concatenate([values, inverse_gains])

    def jacobian(self, x: Array) -> Array:
        """Derivatives (k, rows, P + k) of the modelled signals (X_k θ + L_k) δ_k with respect to x."""
        inverse_gains, efforts = self._split(x)
        by_gain = np.einsum("kr,kg->krg", efforts, np.eye(len(efforts)))
        return np.concatenate([self.X * inverse_gains[..., None], by_gain], axis=-1)

    def residuals(self, x: Array) -> Array:
        """Measured minus modelled signals (k, rows)."""
        inverse_gains, efforts = self._split(x)
        residuals: Array = self.y - efforts * inverse_gains
        return residuals

    def require_identifiable_gains(self, x: Array, weights: Array) -> None:
        """Raise RecordingError if parameters reproduce the effect of gains on the signals, with weights (k,)."""
        P = self.parameter_count
        J = (np.sqrt(weights)[:, None, None] * self.jacobian(x)).reshape(-1, len(x))
        by_gain = J[:, P:]
        fits = np.stack([solve_least_squares(J[:, :P], column).values for column in by_gain.T], axis=1)
        scaled = (by_gain - J[:, :P] @ fits) / np.linalg.norm(by_gain, axis=0)
        if not np.linalg.svd(scaled, compute_uv=False)[-1] > MIN_IDENTIFIABILITY:
            raise _unidentifiable_gains()

    def _split(self, x: Array) -> tuple[Array, Array]:
        """Return the inverse gains (k, 1) and the efforts (k, rows) of x."""
        P = self.parameter_count
        return x[P:, None], self.X @ x[:P] + self.L


def _unidentifiable_gains() -> RecordingError:
    return RecordingError(f"the gains cannot be identified from the payload masses: {REQUIREMENT}")
