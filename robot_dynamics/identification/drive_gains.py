"""Identification of drive gains, from currents to efforts, together with the parameters of the robot.

A robot with twice the masses and twice the gains gives the same measurements. Some recordings are therefore made with a
payload of known mass, after Gautier and Briot, "Global identification of joint drive gains and dynamic parameters of
robots" (2014). `gain_problem` has the equations.

Errors of the friction model bias gains, first those of a joint with a vertical axis: its efforts show a payload only by
accelerations. The friction has more parameters here than in the fit that follows, therefore. Each recording has the
unknown parameters of its payload for itself: a payload that is mounted again has another centre.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.fitting import (
    REWEIGHTING_ITERATIONS,
    require_enough_samples,
    residual_variances,
)
from robot_dynamics.identification.gain_problem import REQUIREMENT, GainProblem
from robot_dynamics.identification.gain_uncertainty import gain_covariance, parameter_covariance
from robot_dynamics.newton_euler.regressor import LINK_PARAMETERS

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.identification.fitting import (
        Fit,
    )
    from robot_dynamics.identification.identification_model import IdentificationModel
    from robot_dynamics.identification.samples import Samples
    from robot_dynamics.recordings.drives import Drives
    from robot_dynamics.recordings.joint_motions import Motion
    from robot_dynamics.recordings.recording import Recording

UNKNOWN_COUNT = len(LINK_PARAMETERS) - 1  # unknown parameters of a payload: all but its mass, the last one
MAX_RELATIVE_DEVIATION = 0.2  # standard deviation of a gain, relative to the gain; beyond it gains are refused


@dataclass(frozen=True)
class Payload:
    """A payload of known mass [kg] on a link. Its centre of mass and its inertia are unknown."""

    link: str
    mass: float


@dataclass(frozen=True, eq=False)
class PayloadIdentificationModel:
    """Model of the efforts of k motors with gain 1, from which gains are identified.

    Its columns are those of the robot, UNKNOWN_COUNT columns for each recording with a payload, those of
    `further_friction`, and one column with the efforts that the known masses require.

    payloads: payloads by the name of the recording; recording_name: that of this recording.
    """

    model: IdentificationModel
    payloads: dict[str, Payload]
    recording_name: str | None = None

    @property
    def dynamics(self) -> Dynamics:
        """Dynamics of the robot."""
        return self.model.dynamics

    def for_recording(self, recording: Recording) -> PayloadIdentificationModel:
        """Return the model of one recording."""
        return replace(self, recording_name=recording.name)

    def efforts(self, motion: Motion) -> Array:
        """Compute the unfiltered efforts (N, k) of the motors."""
        return motion.unfiltered_efforts @ np.linalg.inv(self.model.drives.ratios)

    def motion_regressor(self, motion: Motion) -> Array:
        """Compute the columns (N, k, count) of a motion."""
        Y = self.model.full_regressor(motion.q, motion.qd, motion.qdd, motion.base)
        columns = [self.model.reduce_regressor(Y, motion.qd, motion.qdd)]
        known_efforts = np.zeros((*Y.shape[:2], 1))
        for name, payload in self.payloads.items():
            link_columns = payload_regressor(self.model.dynamics, payload, Y) * (name == self.recording_name)
            columns.append(link_columns[..., :UNKNOWN_COUNT])
            known_efforts += payload.mass * link_columns[..., UNKNOWN_COUNT:]
        columns.append(further_friction(motion.qd))
        inverse = np.linalg.inv(self.model.drives.ratios)
        regressor = np.concatenate([*columns, known_efforts], axis=-1)
        motor_regressor: Array = np.einsum("jk,Njp->Nkp", inverse, regressor)
        return motor_regressor


def further_friction(qd: Array) -> Array:
    """Columns (N, n, 2 n) of friction between Coulomb and viscous, and beyond viscous: √|q̇| sign(q̇) and q̇ |q̇|.

    They have no scale of speed that must be known.
    """
    joints = np.eye(qd.shape[1])
    curves = (np.sign(qd) * np.sqrt(np.abs(qd)), qd * np.abs(qd))
    return np.concatenate([curve[..., None] * joints for curve in curves], axis=-1)


def payload_regressor(dynamics: Dynamics, payload: Payload, Y: Array) -> Array:
    """Select the columns (N, n, 10) of the link that carries a payload from a full regressor Y (N, n, p)."""
    robot = dynamics.robot
    first = dynamics.parameter_names.index(f"XX.{robot.links[robot.frame(payload.link).link].name}")
    columns: Array = Y[..., first : first + len(LINK_PARAMETERS)]
    return columns


@dataclass(frozen=True, eq=False)
class IdentifiedPayload:
    """A payload with all its parameters, LINK_PARAMETERS (10,) in the frame of its link."""

    payload: Payload
    parameters: Array


@dataclass(frozen=True, eq=False)
class UnloadedIdentificationModel:
    """The identification model of a robot for recordings with payloads, whose efforts are subtracted.

    payloads: identified payloads by the name of the recording; current_payload: that of this recording, None if there
    is none.
    """

    model: IdentificationModel
    payloads: dict[str, IdentifiedPayload] = field(default_factory=dict)
    current_payload: IdentifiedPayload | None = None

    @property
    def dynamics(self) -> Dynamics:
        """Dynamics of the robot."""
        return self.model.dynamics

    @property
    def identification_model(self) -> IdentificationModel:
        """The model of the robot without payloads."""
        return self.model

    def for_recording(self, recording: Recording) -> UnloadedIdentificationModel:
        """Return the model of one recording."""
        return replace(self, current_payload=self.payloads.get(recording.name))

    def with_same_payloads(self, payloads: dict[str, Payload]) -> UnloadedIdentificationModel:
        """Return the model with payloads of further recordings: those identified on the same link with the same mass.

        payloads: by the name of the recording.
        """
        identified = {body.payload: body for body in reversed(self.payloads.values())}
        further = {name: identified[payload] for name, payload in payloads.items() if name not in self.payloads}
        return replace(self, payloads={**self.payloads, **further})

    def efforts(self, motion: Motion) -> Array:
        """Compute the unfiltered efforts (N, n) without those that the payload requires."""
        if self.current_payload is None:
            return motion.unfiltered_efforts
        Y = self.model.full_regressor(motion.q, motion.qd, motion.qdd, motion.base)
        regressor = payload_regressor(self.model.dynamics, self.current_payload.payload, Y)
        return motion.unfiltered_efforts - regressor @ self.current_payload.parameters

    def motion_regressor(self, motion: Motion) -> Array:
        """Compute the columns (N, n, P) of a motion."""
        return self.model.motion_regressor(motion)


@dataclass(frozen=True, eq=False)
class DriveGains:
    """Identified drive gains.

    drives: drives with the identified effort gains (k,); standard_deviations: (k,) of the errors of the gains;
    covariance: (P, P) of the parameters that were identified with them; model: model to fit recordings with `drives`;
    uncertain_above: relative standard deviation from which a gain counts as uncertain.
    """

    uncertain_above: ClassVar[float] = 0.05

    drives: Drives
    standard_deviations: Array
    covariance: Array
    model: UnloadedIdentificationModel

    @property
    def uncertain(self) -> BoolArray:
        """(k,) whether the recordings determine a gain only roughly."""
        uncertain: BoolArray = self.standard_deviations > self.uncertain_above * np.abs(self.drives.effort_gains)
        return uncertain

    def include_gain_uncertainty(self, fit: Fit) -> Fit:
        """Return a fit to recordings with these gains, with standard deviations that include their uncertainty.

        The gains were identified with more parameters of friction and of payloads. The larger deviation is kept.
        """
        standard_deviations = np.sqrt(np.maximum(np.diagonal(self.covariance), np.diagonal(fit.covariance)))
        ratios = standard_deviations / np.maximum(np.sqrt(np.diagonal(self.covariance)), 1e-300)
        covariance = self.covariance * ratios * ratios[:, None]
        return replace(fit, covariance=covariance, standard_deviations=standard_deviations)


def identify_gains(samples: Samples[PayloadIdentificationModel]) -> DriveGains:
    """Identify gains by total least squares, weighted by motor.

    Raises RecordingError if there are too few samples or the recordings do not determine the gains.
    """
    payload_model = samples.model
    drives = payload_model.model.drives
    sums = samples.accumulate_factors()
    factors, white_share = require_enough_samples(sums)
    assert sums.blocks is not None  # `require_enough_samples` refuses samples without blocks
    problem = GainProblem(factors.triangles)
    _require_signals(drives.names, problem)
    P = problem.parameter_count
    x, weights = _solve(problem, factors.samples)
    inverse_gain_covariance = gain_covariance(sums.blocks, x, weights, white_share)
    gains = 1 / x[P:]
    standard_deviations = np.sqrt(np.diagonal(inverse_gain_covariance)) * gains**2
    _require_certain_gains(drives.names, gains, standard_deviations)
    identified_drives = replace(drives, effort_gains=drives.effort_gains * gains)
    p = len(payload_model.model.names)
    count = p + UNKNOWN_COUNT * len(payload_model.payloads)  # of parameters without further friction
    simpler = problem.restricted(count)
    x_simpler = simpler.solve_parameters(x[P:], weights)
    covariance = parameter_covariance(
        sums.blocks,
        x_simpler,
        _inverse_variances(simpler, x_simpler, factors.samples),
        white_share,
        inverse_gain_covariance,
    )
    return DriveGains(
        drives=identified_drives,
        standard_deviations=standard_deviations * np.abs(drives.effort_gains),
        covariance=covariance[:p, :p],
        model=UnloadedIdentificationModel(
            replace(payload_model.model, drives=identified_drives), _identified_payloads(payload_model, x[p:count])
        ),
    )


def _solve(problem: GainProblem, samples: IntArray) -> tuple[Array, Array]:
    """Solve the problem with weights (k,) from the residuals of each motor; samples: (k,) rows of each motor."""
    noise_variances = residual_variances(problem.noise_squares(), problem.y, samples, problem.parameter_count)
    x = problem.initial_values(noise_variances, samples)
    for _ in range(REWEIGHTING_ITERATIONS):
        x = problem.minimize(x, _inverse_variances(problem, x, samples))
    weights = _inverse_variances(problem, x, samples)
    problem.require_identifiable_gains(x, weights)
    return x, weights


def _inverse_variances(problem: GainProblem, x: Array, samples: IntArray) -> Array:
    """Compute the inverse variances (k,) of the residuals; samples: (k,) rows of each motor."""
    squares = problem.residual_sum_of_squares(x)
    weights: Array = 1 / residual_variances(squares, problem.y, samples, problem.parameter_count)
    return weights


def _identified_payloads(model: PayloadIdentificationModel, values: Array) -> dict[str, IdentifiedPayload]:
    """Collect the payloads by the name of the recording, from the unknown parameters of all payloads."""
    rows = values.reshape(-1, UNKNOWN_COUNT)
    return {
        name: IdentifiedPayload(payload, np.append(row, payload.mass))
        for (name, payload), row in zip(model.payloads.items(), rows, strict=True)
    }


def _require_signals(motors: tuple[str, ...], problem: GainProblem) -> None:
    silent = [name for name, y in zip(motors, problem.y, strict=True) if not y.any()]
    if silent:
        raise RecordingError(f"the gains cannot be identified: the measured efforts of {', '.join(silent)} are zero")


def _require_certain_gains(motors: tuple[str, ...], gains: Array, standard_deviations: Array) -> None:
    uncertain = [
        f"{name} {abs(deviation / gain):.0%}"
        for name, gain, deviation in zip(motors, gains, standard_deviations, strict=True)
        if not deviation < MAX_RELATIVE_DEVIATION * abs(gain)
    ]
    if uncertain:
        raise RecordingError(
            "the gains cannot be identified, their standard deviations are too large "
            f"({', '.join(uncertain)}): {REQUIREMENT}"
        )
