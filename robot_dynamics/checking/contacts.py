"""External contacts: residuals of several joints that rise and vanish within seconds, while the robot moves or rests.

A contact adds J^T f to the efforts, with a force f that nobody knows. It is searched for as bumps of several durations,
with a free size in each joint. Errors of the model form bumps too: a bump is compared with the usual one of the same
joint in the same recording.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import correlate, lfilter
from scipy.signal.windows import hann
from scipy.stats import chi2

if TYPE_CHECKING:
    from collections.abc import Iterator

    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.checking.change_test import ChangeTest
    from robot_dynamics.checking.fault_signals import FaultSignals
    from robot_dynamics.model.joint import Joint

DURATIONS = (0.6, 1.2, 2.4)  # [s] of bumps
USUAL_QUANTILE = 0.9  # of the evidence of bumps of a joint, which is that of errors of the model
MIN_EVIDENCE = 150.0  # least evidence of a contact
MIN_JOINT_EVIDENCE = 12.0  # least evidence in one joint
MIN_JOINTS = 2  # joints that a contact loads at least
STICTION_RATIO = 1.5  # static friction of a joint at most, relative to its Coulomb friction
REST_NOISE_RATIO = 5.0  # residual at rest beyond static friction, relative to the scatter of residuals at rest
MIN_REST_DURATION = 0.3  # [s] of a contact at rest


@dataclass(frozen=True)
class Contact:
    """A contact.

    Attributes
    ----------
    start, end : [s]
    between : earliest and latest possible beginning [s].
    joints : numbers of the joints that it loads.
    evidence : squares of white residuals that it explains, relative to those that errors of the model explain.
    at_rest : whether the loaded joints rest.
    """

    start: float
    end: float
    between: tuple[float, float]
    joints: tuple[int, ...]
    evidence: float
    at_rest: bool


def find_contact_in_motion(test: ChangeTest) -> Contact | None:
    """The contact with the strongest evidence while joints move; None where there is none. test: of the residuals."""
    return max(_contacts_in_motion(test), key=lambda contact: contact.evidence, default=None)


def find_contact_at_rest(signals: FaultSignals, joints: tuple[Joint, ...]) -> Contact | None:
    """The contact with the strongest evidence at rest: the residual of a joint exceeds its static friction.

    Parameters
    ----------
    signals : of n joints.
    joints : the n joints of the robot. Those whose friction in the model is less than the scatter of their residuals at
        rest have no bound, and show no contact: a fit that does not see friction gives little or none.
    """
    return max(_contacts_at_rest(signals, joints), key=lambda contact: contact.evidence, default=None)


def _contacts_in_motion(test: ChangeTest) -> Iterator[Contact]:
    """Yield the strongest contact of each duration."""
    signals = test.signals
    step = signals.step
    for duration in DURATIONS:
        length = max(4, round(duration / step))
        if length >= len(signals.times) // 4:
            continue
        evidence = _bump_evidence(test, length)  # (M, n) of a bump that begins at each sample
        total = evidence.sum(axis=1)
        row = int(np.argmax(total))
        loaded = np.flatnonzero(evidence[row] > MIN_JOINT_EVIDENCE)
        if total[row] < MIN_EVIDENCE or len(loaded) < min(MIN_JOINTS, evidence.shape[1]):
            continue
        possible = np.flatnonzero(total > 0.8 * total[row])
        possible = possible[np.abs(possible - row) <= length]
        start = float(signals.times[row])
        between = float(signals.times[possible[0]]) - step, float(signals.times[possible[-1]]) + step
        yield Contact(start, start + duration, between, tuple(loaded.tolist()), float(total[row]), False)


def _bump_evidence(test: ChangeTest, length: int) -> Array:
    """Evidence (M, n) of a bump of some samples that begins at each sample, relative to the usual one of the joint."""
    white = test.white_residuals
    weights = test.whitening.weights
    shape = hann(length + 2)[1:-1]
    columns = []
    for joint in range(white.shape[1]):
        bump = np.asarray(lfilter(test.whitening.filters[joint], 1, np.r_[shape, np.zeros(test.whitening.order)]))
        products = correlate(
            white[:, joint] * (weights[:, joint] > 0), bump / test.whitening.deviations[joint], "valid"
        )
        squares = correlate(weights[:, joint] ** 2, bump**2, "valid")
        complete = squares > 0.9 * squares.max()
        evidence = np.where(complete, products**2 / np.maximum(squares, 1e-300), 0)
        usual = np.quantile(evidence[complete], USUAL_QUANTILE) if complete.any() else 0.0
        columns.append(evidence / max(1.0, usual / chi2.ppf(USUAL_QUANTILE, 1)))
    return np.stack(columns, axis=1)


def _contacts_at_rest(signals: FaultSignals, joints: tuple[Joint, ...]) -> Iterator[Contact]:
    """Yield the times at which residuals of resting joints exceed static friction."""
    friction = np.array([joint.coulomb_friction for joint in joints])
    noise = np.array(
        [_robust_deviation(column[rests]) for column, rests in zip(signals.residuals.T, signals.resting.T, strict=True)]
    )
    bound = STICTION_RATIO * friction + REST_NOISE_RATIO * noise
    excess = np.where(signals.resting & (friction > noise), np.abs(signals.residuals) - bound, -1)
    excess[~_begins_at_rest(excess > 0, signals.resting)] = -1
    beyond = (excess > 0).any(axis=1)
    edges = np.flatnonzero(np.diff(beyond.astype(int), prepend=0, append=0))
    step = signals.step
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        if (end - begin) * step < MIN_REST_DURATION:
            continue
        loaded = np.flatnonzero((excess[begin:end] > 0).any(axis=0))
        ratio = (np.abs(signals.residuals[begin:end, loaded]) / bound[loaded]).max()
        start, stop = float(signals.times[begin]), float(signals.times[end - 1]) + step
        yield Contact(start, stop, (start - step, start + step), tuple(loaded.tolist()), MIN_EVIDENCE * ratio**2, True)


def _begins_at_rest(beyond: BoolArray, resting: BoolArray) -> BoolArray:
    """Samples (N, n) beyond the bound, in runs that begin while the joint rests.

    A residual that is there when the joint comes to rest, or from the first sample on, is an error of the model.
    """
    kept = np.zeros_like(beyond)
    for joint, column in enumerate(beyond.T):
        edges = np.flatnonzero(np.diff(column.astype(int), prepend=0, append=0))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            kept[begin:end, joint] = begin > 0 and resting[begin - 1, joint]
    return kept


def _robust_deviation(values: Array) -> float:
    """Standard deviation of values (N,), of which a few may be outliers."""
    return float(1.4826 * np.median(np.abs(values - np.median(values)))) if len(values) else 0.0
