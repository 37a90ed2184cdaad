"""Verdict on how well recordings determine a robot: how exactly the fit predicts the efforts of other motions.

A condition number does not tell whether a motion suffices: parameters that hardly matter may be unknown. What matters
is the standard deviation of the predicted efforts, from the covariance of all parameters, relative to these efforts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from robot_dynamics.identification.motion_samples import sample_random_motions

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.identification.fitting import Fit

Verdict: TypeAlias = Literal["well", "poorly", "not determined"]

EFFORT_ACCURACY = 0.03  # relative standard deviation of the scale of measured efforts, as gains of drives have
MOTIONS = 200
MAX_WELL_DETERMINED = 0.25  # standard deviation of predicted efforts, relative to the efforts
MAX_DETERMINED = 1.0  # beyond which the description without a recording would be as good
MAX_NAMES = 6


@dataclass(frozen=True, eq=False)
class Determination:
    """How well recordings determine a robot with n joints.

    Attributes
    ----------
    verdict : {"well", "poorly", "not determined"}
        The worst of the verdicts of the joints.
    joint_verdicts : tuple of str, length n
        Verdict of each joint.
    prediction_errors : (n,) array
        Standard deviation of the efforts that the fit predicts for random motions within the joint limits, at up to
        3 rad/s or m/s, relative to the RMS of these efforts.
    main_parameters : tuple of str
        Names of the parameters that contribute most to these errors, at most six; empty if well determined.
    """

    verdict: Verdict
    joint_verdicts: tuple[Verdict, ...]
    prediction_errors: Array
    main_parameters: tuple[str, ...]


def judge_determination(fit: Fit) -> Determination:
    """Judge how well the recordings of a fit determine the robot."""
    model = fit.model
    motions = sample_random_motions(model.dynamics, MOTIONS)
    X = model.regressor_at(motions.q, motions.qd, motions.qdd, motions.base)
    efforts = np.sqrt(np.square(X @ fit.values).mean(axis=0))
    efforts = np.maximum(efforts, 1e-9 * max(float(efforts.max()), 1e-9))
    variances = np.einsum("Njp,pq,Njq->j", X, fit.covariance, X) / len(X)
    errors = np.sqrt(np.maximum(variances, 0)) / efforts
    verdicts = tuple(_verdict(error) for error in errors)
    is_poor = errors > MAX_WELL_DETERMINED
    shares = np.einsum("Njp,p->jp", X**2, np.diagonal(fit.covariance)) / len(X) / efforts[:, None] ** 2
    order = np.argsort(-shares[is_poor].sum(axis=0), kind="stable")[: MAX_NAMES if is_poor.any() else 0]
    return Determination(_verdict(float(errors.max())), verdicts, errors, tuple(model.names[index] for index in order))


def _verdict(error: float) -> Verdict:
    if error <= MAX_WELL_DETERMINED:
        return "well"
    return "poorly" if error <= MAX_DETERMINED else "not determined"
