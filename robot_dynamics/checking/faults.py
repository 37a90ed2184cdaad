"""Which fault explains the residuals of a recording, on which joint, and since when.

Each kind of fault states how measured efforts differ from predicted ones from its onset on. `ChangeTest` fits its size
and its onset beside the constant errors of the model. For the best faults the noise is fitted anew without their
effects, so that their likelihoods can be compared. The most likely one is named if it beats every sound explanation:
its evidence is consistent between blocks of the recording, its effect stands out of the errors of the model, and its
size is one that sound robots do not show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.checking.block_averages import BlockAverages
from robot_dynamics.checking.change_test import Change, ChangeTest
from robot_dynamics.checking.contacts import Contact, find_contact_at_rest, find_contact_in_motion
from robot_dynamics.checking.fault_hypotheses import FaultHypothesis, FaultKind, describe, fault_hypotheses
from robot_dynamics.checking.fault_signals import FIXED_ROWS, FaultSignals
from robot_dynamics.checking.whitening import WhiteningFilter
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.robot import attach_payload

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.checking.check import Predictor
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.recordings.joint_motions import Motion

MAX_SAMPLES = 40_000  # kept in memory; longer recordings are averaged over blocks
MAX_VALUES = 20_000_000  # kept in memory, of all signals
SAMPLES_PER_PERIOD = 6  # of the cut-off
MIN_SAMPLES = 100
OFFSET_STEP = 0.01  # [rad or m] by which positions are shifted to find the effect of an encoder offset
MIN_DURATION = 2.0  # [s] a shorter change cannot be distinguished from an error of the model
ITERATIONS = 3
CANDIDATES = 6  # faults with the largest gains whose likelihoods are compared
CONSTANT_ERRORS = ("payload", "offset")  # faults whose effect over the whole recording is an error of the model
MAX_P_VALUE = 1e-4
MIN_LOG_LIKELIHOOD = 20.0  # least increase of the logarithm of the likelihood
MIN_EFFECT_RATIO = 0.5  # least RMS of the effect of a fault, relative to that of residuals without fault, in one joint
MIN_PAYLOAD_RATIO = 1.0  # as above, of a payload, whose four sizes fit errors of the model better
ONSET_MARGIN = 7.5  # onsets whose logarithm of the likelihood is lower by less are possible onsets


@dataclass(frozen=True)
class Fault:
    """A fault of a recording.

    Attributes
    ----------
    kind : of the fault.
    joints : names of the joints; empty for a payload, a delay and a contact, which concern all.
    onset : most likely beginning [s].
    between : earliest and latest possible beginning [s].
    gain : increase of the logarithm of the likelihood of the residuals.
    p_value : probability of evidence as strong without fault, for one kind of fault.
    sentence : description of the fault.
    """

    kind: FaultKind
    joints: tuple[str, ...]
    onset: float
    between: tuple[float, float]
    gain: float
    p_value: float
    sentence: str


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fault that may explain the residuals.

    Attributes
    ----------
    hypothesis : kind and joints.
    change : its size and onset.
    gain : increase of the logarithm of the likelihood.
    effect_ratio : largest RMS of its effect on a joint after the onset, relative to the RMS of residuals without it.
    """

    hypothesis: FaultHypothesis
    change: Change
    gain: float
    effect_ratio: float


class Evidence:
    """Collects the residuals of a recording, in bounded memory, and finds the fault that explains them.

    Parameters
    ----------
    predictor : of the robot without fault.
    link : name of the link that may carry a payload; None: the last link.
    """

    def __init__(self, predictor: Predictor, link: str | None = None) -> None:
        self._predictor = predictor
        robot = predictor.dynamics.robot
        self.link = link or _last_link_name(robot)
        self.names = predictor.dynamics.joint_names
        self._joints = tuple(robot.joints[robot.joint_numbers[name]] for name in self.names)
        unit_payloads = [Inertia(1.0), *(Inertia(0.0, axis) for axis in np.eye(3))]
        self._loaded = [Dynamics(attach_payload(robot, self.link, payload)) for payload in unit_payloads]
        self._link_mass = robot.links[robot.frame(self.link).link].inertia.mass
        self._averages: BlockAverages | None = None  # of rows for FaultSignals
        self._cutoff = 0.0
        self._has_efforts = np.ones(len(self.names), dtype=bool)

    def add(self, motion: Motion, predicted: Array, origin: int = 0) -> None:
        """Add a motion and its predicted efforts (N, n); origin is not used (the interface of `PieceCallback`)."""
        n = len(self.names)
        if self._averages is None:
            stride = max(1, int(motion.rate / (SAMPLES_PER_PERIOD * motion.cutoff)))
            max_rows = min(MAX_SAMPLES, MAX_VALUES // (n * (FIXED_ROWS + n)) // 2 * 2)
            self._averages = BlockAverages(stride, max_rows)
            self._cutoff = motion.cutoff
        self._has_efforts &= motion.has_efforts
        payload_efforts = [self._predictor.efforts(loaded, motion) - predicted for loaded in self._loaded]
        offset_efforts = [self._offset_effect(motion, predicted, joint) for joint in range(n)]
        times = np.broadcast_to(motion.times[:, None], predicted.shape)
        signs = np.sign(motion.qd)
        rows = [times, motion.moving, motion.unfiltered_efforts, predicted, signs, motion.qd]
        self._averages.add(np.stack([*rows, *payload_efforts, *offset_efforts]))

    def _offset_effect(self, motion: Motion, predicted: Array, joint: int) -> Array:
        """Change of residuals (N, n) for each rad or m by which positions of a joint are recorded too large.

        The prediction for recorded positions is `predicted`; the measured efforts are those of smaller positions.
        """
        q = motion.q.copy()
        q[:, joint] -= OFFSET_STEP
        return (self._predictor(replace(motion, q=q)) - predicted) / OFFSET_STEP

    def find_fault(self) -> Fault | None:
        """Find the fault that explains the residuals.

        Returns
        -------
        Fault or None
            None where no fault explains enough, or the samples are too few.
        """
        signals = self.signals()
        if signals is None:
            return None
        search = self.search()
        fault = None if search is None else search.fault()
        if fault is not None:
            return fault
        contact = find_contact_at_rest(signals, self._joints)
        return None if contact is None else name_contact(contact, self.names)

    def signals(self) -> FaultSignals | None:
        """The signals of the recording; None where the samples are too few."""
        if self._averages is None:
            return None
        rows = self._averages.rows
        if rows.shape[1] < MIN_SAMPLES:
            return None
        rows[1:, :, ~self._has_efforts] = 0
        return FaultSignals.from_rows(rows, self._cutoff)

    def search(self) -> FaultSearch | None:
        """The search for a fault in motion; None where the samples are too few."""
        signals = self.signals()
        if signals is None or signals.valid.any(axis=1).sum() < MIN_SAMPLES:
            return None
        return FaultSearch(signals, self.names, self._joints, self.link, self._link_mass)


def _last_link_name(robot: Robot) -> str:
    last = len(robot.links) - 1
    return next(frame.name for frame in reversed(robot.frames) if frame.link == last)


class FaultSearch:
    """The comparison of all faults on the signals of a recording.

    Parameters
    ----------
    signals : residuals and their predictors.
    names : of the n joints.
    joints : the n joints.
    link : name of the link that may carry a payload.
    link_mass : its mass [kg].
    """

    def __init__(
        self, signals: FaultSignals, names: Sequence[str], joints: tuple[Joint, ...], link: str, link_mass: float
    ) -> None:
        self.signals = signals
        self.names = names
        self.link = link
        self._joints = joints
        times = signals.times[signals.valid.any(axis=1)]
        first, last = np.searchsorted(signals.times, [times[0] + MIN_DURATION / 2, times[-1] - MIN_DURATION])
        self._onsets = slice(first, max(first, last))
        nothing = np.zeros_like(signals.residuals)
        whitening, _ = self._fit_noise(nothing)
        self._sound_log_likelihood = whitening.log_likelihood
        test = ChangeTest(signals, whitening, signals.residuals)
        self.contact = find_contact_in_motion(test)
        hypotheses = list(fault_hypotheses(signals, joints, link_mass))
        gains = [self._fit(test, hypothesis).gain for hypothesis in hypotheses]
        best = sorted(range(len(gains)), key=lambda index: -gains[index])[:CANDIDATES]
        self.candidates = sorted((self._candidate(hypotheses[index], test) for index in best), key=lambda each: -each.gain)

    def _fit(self, test: ChangeTest, hypothesis: FaultHypothesis) -> Change:
        return test.fit(
            hypothesis.columns,
            list(hypothesis.affected),
            hypothesis.fit_sizes,
            self._onsets,
            is_constant_error=hypothesis.kind in CONSTANT_ERRORS,
        )

    def _fit_noise(self, effect: Array) -> tuple[WhiteningFilter, Array]:
        """Fit filter and constant errors of the model (N, n) to the residuals without an effect (N, n)."""
        signals = self.signals
        residuals = signals.residuals - effect
        errors = np.zeros_like(residuals)
        for _ in range(2):
            whitening = WhiteningFilter.fit(residuals - errors, signals.valid, signals.min_noise)
            errors = ChangeTest(signals, whitening, residuals).model_errors
        return WhiteningFilter.fit(residuals - errors, signals.valid, signals.min_noise), errors

    def _candidate(self, hypothesis: FaultHypothesis, test: ChangeTest) -> Candidate:
        """The candidate of a hypothesis, with the noise fitted to the residuals without its effect."""
        signals = self.signals
        change = self._fit(test, hypothesis)
        for _ in range(ITERATIONS):
            whitening, errors = self._fit_noise(change.effect)
            change = self._fit(ChangeTest(signals, whitening, signals.residuals), hypothesis)
        whitening, errors = self._fit_noise(change.effect)
        gain = whitening.log_likelihood - self._sound_log_likelihood
        after = np.arange(len(signals.times)) >= change.row
        effect = _rms(change.effect, signals.valid & after[:, None])
        unexplained = _rms(signals.residuals - errors - change.effect, signals.valid)
        return Candidate(hypothesis, change, gain, float((effect / np.maximum(unexplained, 1e-300)).max()))

    def fault(self) -> Fault | None:
        """The most likely fault; None where a sound robot explains the residuals."""
        best = next((each for each in self.candidates if self._is_significant(each)), None)
        if best is None:
            return None if self.contact is None else name_contact(self.contact, self.names)
        residuals = self.signals.residuals - best.change.effect
        whitening, _ = self._fit_noise(best.change.effect)
        remaining = find_contact_in_motion(ChangeTest(self.signals, whitening, residuals))
        return self._named(best) if remaining is None else name_contact(remaining, self.names)

    def _is_significant(self, candidate: Candidate) -> bool:
        """Whether no sound robot shows such evidence."""
        return (
            candidate.gain >= MIN_LOG_LIKELIHOOD
            and candidate.change.p_value <= MAX_P_VALUE
            and candidate.effect_ratio >= (MIN_PAYLOAD_RATIO if candidate.hypothesis.kind == "payload" else MIN_EFFECT_RATIO)
            and candidate.hypothesis.is_fault(candidate.change.sizes)
        )

    def _named(self, candidate: Candidate) -> Fault:
        """The Fault of a candidate, with the interval of its onset."""
        times = self.signals.times
        step = self.signals.step
        change = candidate.change
        log_likelihoods = np.where(change.gains > 0, (change.gains - change.gain) / 2, -np.inf)
        likelihoods = np.cumsum(np.exp(log_likelihoods))
        onset = float(times[np.searchsorted(likelihoods, 0.5 * likelihoods[-1])])  # the median
        possible = times[log_likelihoods >= -ONSET_MARGIN]
        earliest = float(max(possible[0] - step, times[0]))
        latest = float(possible[-1] + step)
        names = tuple(self.names[joint] for joint in candidate.hypothesis.joints)
        description = describe(candidate.hypothesis.kind, names, change.sizes, self.link)
        sentence = f"{description}, since {onset:.4g} s (between {earliest:.4g} and {latest:.4g} s)"
        kind = candidate.hypothesis.kind
        return Fault(kind, names, onset, (earliest, latest), candidate.gain, change.p_value, sentence)


def name_contact(contact: Contact, joint_names: Sequence[str]) -> Fault:
    """The Fault of a contact; joint_names: of the robot."""
    names = tuple(joint_names[joint] for joint in contact.joints)
    where = " at rest" if contact.at_rest else ""
    sentence = f"external contact{where} from {contact.start:.4g} to {contact.end:.4g} s, which loads {', '.join(names)}"
    return Fault("contact", names, contact.start, contact.between, contact.evidence, 0.0, sentence)


def _rms(values: Array, counts: Array) -> Array:
    """RMS (n,) of the values (N, n) that count."""
    squares = np.where(counts, values, 0) ** 2
    rms: Array = np.sqrt(squares.sum(axis=0) / np.maximum(1, counts.sum(axis=0)))
    return rms
