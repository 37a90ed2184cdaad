"""Gains of drives, found together with the parameters of the robot: from currents to efforts.

Robots with twice the masses and twice the gains measure the same. So some recordings are made with a payload whose mass
is known, after Gautier and Briot, "Global identification of drive gains parameters of robots using a known payload"
(2014). They spread the noise over all columns, by total least squares. It is on what was measured: here residuals are
those of y_k = (X_k θ + L_k) / γ_k for motor k, with L_k what the known mass demands, in which no column is noisy.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.fitting import REWEIGHTING_ITERATIONS, require_enough_samples, residual_variances
from robot_dynamics.identification.identification_model import IdentificationModel
from robot_dynamics.identification.triangular_factors import solve_least_squares
from robot_dynamics.newton_euler.regressor import LINK_PARAMETERS
from robot_dynamics.recordings.drives import Drives

UNKNOWN_COUNT = len(LINK_PARAMETERS) - 1  # parameters of a payload of which only the mass, the last one, is known
MIN_IDENTIFIABILITY = 1e-6  # part of what gains do to the efforts that the parameters cannot do, at least
MAX_RELATIVE_DEVIATION = 0.2  # of a gain, as part of it
REQUIREMENT = (
    "runs with a payload of known mass beside runs without it, in motions that every joint feels it in, are needed"
)


@dataclass(frozen=True)
class Payload:
    """What a robot carries on a link, in its frame: of known mass [kg]; its centre and its inertia are not known."""

    link: str
    mass: float


@dataclass(frozen=True, eq=False)
class PayloadIdentificationModel:
    """What signals of k motors are made of, times their gains: the columns of a robot, UNKNOWN columns of each of its
    payloads, and one of what their known masses demand. carried: {name of a recording: its payload}; here: that of
    this recording, None where there is none."""

    model: IdentificationModel
    payloads: tuple
    payload_by_recording: dict
    current_payload: Payload | None = None

    @property
    def dynamics(self):
        return self.model.dynamics

    def for_recording(self, recording):
        """The columns of one recording."""
        return replace(self, current_payload=self.payload_by_recording.get(recording.name))

    def efforts(self, motion):
        """(N, k) unfiltered efforts of the motors."""
        return motion.unfiltered_efforts @ np.linalg.inv(self.model.drives.ratios)

    def motion_regressor(self, motion):
        """(N, k, P + UNKNOWN payloads + 1) of a Motion."""
        Y = self.model.full_regressor(motion.q, motion.qd, motion.qdd, motion.base)
        parts = [self.model.reduce_regressor(Y, motion.qd, motion.qdd)]
        known = np.zeros((*Y.shape[:2], 1))
        for payload in self.payloads:
            demanded = payload_regressor(self.model.dynamics, payload, Y) * (payload == self.current_payload)
            parts.append(demanded[..., :UNKNOWN_COUNT])
            known += payload.mass * demanded[..., UNKNOWN_COUNT:]
        inverse = np.linalg.inv(self.model.drives.ratios)
        return np.einsum("jk,Njp->Nkp", inverse, np.concatenate([*parts, known], axis=-1))


def payload_regressor(dynamics, payload, Y):
    """(N, n, 10): what parameters BODY of a Payload demand, those of a regressor Y (N, n, p) for the link it is on."""
    robot = dynamics.robot
    first = dynamics.parameter_names.index(f"XX.{robot.links[robot.frame(payload.link).link].name}")
    return Y[..., first : first + len(LINK_PARAMETERS)]


@dataclass(frozen=True, eq=False)
class UnloadedIdentificationModel:
    """EffortColumns of recordings, with what payloads demand taken off the efforts. payloads: {name of a recording:
    (Payload, its parameters BODY (10,))}; here: that of this recording, None where there is none."""

    model: IdentificationModel
    payloads: dict
    current_payload: tuple | None = None

    def for_recording(self, recording):
        """The columns of one recording."""
        return replace(self, current_payload=self.payloads.get(recording.name))

    def efforts(self, motion):
        """(N, n) unfiltered efforts that the robot itself demands."""
        if self.current_payload is None:
            return motion.unfiltered_efforts
        payload, parameters = self.current_payload
        Y = self.model.full_regressor(motion.q, motion.qd, motion.qdd, motion.base)
        return motion.unfiltered_efforts - payload_regressor(self.model.dynamics, payload, Y) @ parameters

    def motion_regressor(self, motion):
        """(N, n, P) of a Motion."""
        return self.model.motion_regressor(motion)

    @property
    def dynamics(self):
        return self.model.dynamics

    @property
    def names(self):
        return self.model.names


@dataclass(frozen=True, eq=False)
class DriveGains:
    """drives: with the effort gains (k,) that were found; deviations (k,): standard deviations of their errors;
    covariance (P, P) of the parameters that were found with them; columns: to fit these to recordings with `drives`."""

    drives: Drives
    standard_deviations: np.ndarray
    covariance: np.ndarray
    model: UnloadedIdentificationModel

    def include_gain_uncertainty(self, fit):
        """The Fit to recordings with these gains, its deviations with what the gains may be wrong by."""
        standard_deviations = np.sqrt(np.diagonal(self.covariance))
        return replace(fit, model=self.model.model, covariance=self.covariance, standard_deviations=standard_deviations)


def identify_gains(samples):
    """The Gains of Samples with LoadedColumns, by least squares weighted by motor. Raises RecordingError."""
    loaded, drives = samples.model, samples.model.model.drives
    factors, effective_samples = require_enough_samples(samples.accumulate_factors())
    problem = _Problem(factors.triangles)
    silent = [name for name, y in zip(drives.names, problem.y, strict=True) if not y.any()]
    if silent:
        raise RecordingError(f"gains cannot be told: nothing was measured of {', '.join(silent)}")
    x, P = problem.start(), problem.X.shape[-1]
    for _ in range(REWEIGHTING_ITERATIONS):
        variance = residual_variances(problem.residual_sum_of_squares(x), problem.y, factors.samples, P)
        weights = variance.mean() / variance
        x = problem.solve_least_squares(x, weights)
    per_sample = np.mean(
        residual_variances(problem.residual_sum_of_squares(x), problem.y, factors.samples, P) * weights
    )
    of_parameters, of_inverse = (C * per_sample / effective_samples for C in problem.covariances(x, weights))
    values, gains = x[:P], 1 / x[P:]
    standard_deviations = np.sqrt(np.diagonal(of_inverse)) * gains**2
    uncertain = [f"{name} to {abs(deviation / gain):.0%}" for name, gain, deviation
                 in zip(drives.names, gains, standard_deviations, strict=True)
                 if not deviation < MAX_RELATIVE_DEVIATION * abs(gain)]  # fmt: skip
    if uncertain:
        raise RecordingError(f"gains cannot be told, but {', '.join(uncertain)}: {REQUIREMENT}")
    found = replace(drives, effort_gains=drives.effort_gains * gains)
    p = len(loaded.model.names)
    rest = values[p:].reshape(-1, UNKNOWN_COUNT)
    parameters = {payload: np.append(own, payload.mass) for payload, own in zip(loaded.payloads, rest, strict=True)}
    payloads = {name: (payload, parameters[payload]) for name, payload in loaded.payload_by_recording.items()}
    columns = UnloadedIdentificationModel(replace(loaded.model, drives=found), payloads)
    return DriveGains(found, standard_deviations * np.abs(drives.effort_gains), of_parameters[:p, :p], columns)


class _Problem:
    """Least squares of y_k - (X_k θ + L_k) δ_k, δ_k the inverse gain of motor k, in x = (θ (P,), δ (k,)); triangles:
    (k, P + 2, P + 2), R of [X L y] of each motor."""

    def __init__(self, triangles):
        self.X, self.L, self.y = triangles[..., :-2], triangles[..., -2], triangles[..., -1]

    def start(self):
        """x of total least squares: gains by which what was measured, scaled to 1, is least outside of [X L]."""
        k, P = len(self.y), self.X.shape[-1]
        X, L = self.X.reshape(-1, P), self.L.ravel()
        if not np.linalg.norm(L - X @ solve_least_squares(X, L).values) > MIN_IDENTIFIABILITY * np.linalg.norm(L):
            raise RecordingError(f"gains cannot be told from masses: {REQUIREMENT}")
        lengths = np.linalg.norm(self.y, axis=1)
        signals = np.einsum("kr,kg->krg", self.y / lengths[:, None], np.eye(k)).reshape(-1, k)
        columns = np.column_stack([X, L])
        fits = np.stack([solve_least_squares(columns, signal).values for signal in signals.T], axis=1)
        gains = np.linalg.svd(signals - columns @ fits)[2][-1]
        *values, scale = fits @ gains
        gains = np.where(np.abs(gains) > MIN_IDENTIFIABILITY, gains, MIN_IDENTIFIABILITY) / lengths
        return np.concatenate([np.array(values) / scale, scale / gains])

    def _efforts(self, x):
        """(inverse gains (k, 1), efforts (k, rows)) of x."""
        P = self.X.shape[-1]
        return x[P:, None], self.X @ x[:P] + self.L

    def residual_sum_of_squares(self, x):
        """(k,) sums of squares of the residuals."""
        inverse, efforts = self._efforts(x)
        return np.square(efforts * inverse - self.y).sum(axis=1)

    def solve_least_squares(self, x, weights):
        """x that is best where the squares of the motors count by weights (k,), from another one.

        Sought are the relative inverse gains, that of one motor being 1, and all else times its inverse gain: so that
        the scale of everything, which is what is least known, is the factor of a column, L, as the parameters are.
        """
        P, first = self.X.shape[-1], int(np.argmax(np.linalg.norm(self.L, axis=1)))
        others = np.arange(len(self.y)) != first
        columns = np.sqrt(weights)[:, None, None] * np.concatenate([self.X, self.L[..., None]], axis=-1)
        wanted = np.sqrt(weights)[:, None] * self.y
        by_gain = np.eye(len(self.y))[:, None, others]

        def relative(z):
            gains = np.ones(len(self.y))
            gains[others] = z[P + 1 :]
            return gains[:, None]

        def residuals(z):
            return (relative(z) * (columns @ z[: P + 1]) - wanted).ravel()

        def jacobian(z):
            efforts = (columns @ z[: P + 1])[..., None]
            return np.concatenate([columns * relative(z)[..., None], efforts * by_gain], -1).reshape(-1, len(z))

        scale = x[P + first]
        z = np.concatenate([x[:P] * scale, [scale], x[P:][others] / scale])
        z = least_squares(residuals, z, jacobian, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12).x
        return np.concatenate([z[:P] / z[P], relative(z)[:, 0] * z[P]])

    def _jacobian(self, x):
        inverse, efforts = self._efforts(x)
        by_gain = np.einsum("kr,kg->krg", efforts, np.eye(len(efforts)))
        return np.concatenate([self.X * inverse[..., None], by_gain], axis=-1)

    def covariances(self, x, weights):
        """Of θ (P, P) and δ (k, k), for residuals of variance 1. Raises RecordingError where δ follows from nothing."""
        P = self.X.shape[-1]
        J = (np.sqrt(weights)[:, None, None] * self._jacobian(x)).reshape(-1, len(x))
        alone = solve_least_squares(J[:, :P], np.zeros(len(J))).covariance
        by_gain = -alone @ (J[:, :P].T @ J[:, P:])  # of θ, by δ
        left = J[:, P:] + J[:, :P] @ by_gain
        lengths = np.linalg.norm(J[:, P:], axis=0)
        if not np.linalg.svd(left / lengths, compute_uv=False)[-1] > MIN_IDENTIFIABILITY:
            raise RecordingError(f"gains cannot be told from masses: {REQUIREMENT}")
        of_gains = np.linalg.inv(left.T @ left)
        return alone + by_gain @ of_gains @ by_gain.T, of_gains
