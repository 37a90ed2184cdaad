"""Which fault explains the residuals of a recording, on which joint, and since when.

Each kind of fault states how measured efforts differ from predicted ones from its onset on. `ChangeTest` fits its size
and its onset beside the constant errors of the model. For the best faults the noise is fitted anew without their
effects, so that their likelihoods can be compared. The most likely one is named if it beats every sound explanation:
its evidence is consistent between blocks of the recording, its effect stands out of the errors of the model, and its
size is one that sound robots do not show.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.checking.change_test import ChangeTest
from robot_dynamics.checking.contacts import find_contact_in_motion
from robot_dynamics.checking.fault_hypotheses import describe, fault_hypotheses
from robot_dynamics.checking.lasting_gain import lasting_gain
from robot_dynamics.checking.whitening import WhiteningFilter

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.checking.change_test import Change
    from robot_dynamics.checking.contacts import Contact
    from robot_dynamics.checking.fault_hypotheses import FaultHypothesis, FaultKind
    from robot_dynamics.checking.fault_signals import FaultSignals
    from robot_dynamics.model.joint import Joint

MIN_DURATION = 2.0  # [s] a shorter change cannot be distinguished from an error of the model
ITERATIONS = 3
CANDIDATES = 6  # faults with the largest gains whose likelihoods are compared
CONSTANT_ERRORS = ("payload", "offset")  # faults whose effect over the whole recording is an error of the model
MAX_P_VALUE = 6e-4  # of a kind of fault; divided by the number of faults of this kind that may be
MIN_LOG_LIKELIHOOD = 20.0  # least increase of the logarithm of the likelihood
MIN_LASTING_LOG_LIKELIHOOD = 20.0  # as above, without the best second: an event is no change that lasts
MIN_LOG_LIKELIHOOD_PER_SIZE = 10.0  # as above, for each fitted size: more sizes fit errors of the model better
MIN_EFFECT_RATIO = 0.5  # least RMS of the effect of a fault, relative to that of residuals without fault, in one joint
MIN_PAYLOAD_RATIO = 1.0  # as above, of a payload, whose four sizes fit errors of the model better
MAX_ONSET_INTERVAL = 0.3  # longest interval of possible onsets, as a part of the recording
ONSET_WINDOW = 0.5  # [s] around the onset that is named: that with the largest likelihood
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
    gain : increase of the logarithm of the likelihood of the residuals; None for contacts, and for faults that
        positions or stamps show.
    p_value : probability of evidence as strong without fault, for one kind of fault; None as for gain.
    sentence : description of the fault.
    """

    kind: FaultKind
    joints: tuple[str, ...]
    onset: float
    between: tuple[float, float]
    gain: float | None
    p_value: float | None
    sentence: str


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fault that may explain the residuals.

    Attributes
    ----------
    hypothesis : kind and joints.
    change : its size and onset.
    gain : increase of the logarithm of the likelihood.
    whitening : filter of the noise beside it.
    p_value : probability of evidence as strong without fault.
    effect_ratio : largest RMS of its effect on a joint after the onset, relative to the RMS of residuals without it.
    """

    hypothesis: FaultHypothesis
    change: Change
    gain: float
    whitening: WhiteningFilter
    p_value: float
    effect_ratio: float


class FaultSearch:
    """The comparison of all faults on the signals of a recording.

    Parameters
    ----------
    signals : residuals and their predictors.
    names : of the n joints.
    joints : the n joints.
    link : name of the link that may carry a payload.
    masses : of this link, and of all links that move [kg].
    """

    def __init__(
        self,
        signals: FaultSignals,
        names: Sequence[str],
        joints: tuple[Joint, ...],
        link: str,
        masses: tuple[float, float],
    ) -> None:
        self.signals = signals
        self.names = names
        self.link = link
        self._joints = joints
        times = signals.times[signals.valid.any(axis=1)]
        limits = [times[0], times[0] + MIN_DURATION / 2, times[-1] - MIN_DURATION]
        moves, first, last = np.searchsorted(signals.times, limits)
        self._onsets = slice(first, max(first, last))
        self._onsets_of_swaps = slice(moves, max(first, last))  # no error of the model is like a swap
        nothing = np.zeros_like(signals.residuals)
        whitening, _ = self._fit_noise(nothing)
        self._sound_log_likelihood = whitening.log_likelihood
        test = ChangeTest(signals, whitening, signals.residuals)
        self.contact = find_contact_in_motion(test)
        self._hypotheses = list(fault_hypotheses(signals, joints, *masses))
        self._numbers = Counter(hypothesis.kind for hypothesis in self._hypotheses)
        fits = [(hypothesis, self._fit(test, hypothesis)) for hypothesis in self._hypotheses]
        best = sorted(fits, key=lambda each: -each[1].gain)[:CANDIDATES]
        self.candidates = sorted((self._candidate(*each) for each in best), key=lambda each: -self._score(each))

    def _fit(self, test: ChangeTest, hypothesis: FaultHypothesis) -> Change:
        return test.fit(
            hypothesis.columns,
            list(hypothesis.affected),
            hypothesis.fit_sizes,
            self._possible_rows(hypothesis),
            is_constant_error=hypothesis.kind in CONSTANT_ERRORS,
        )

    def _possible_rows(self, hypothesis: FaultHypothesis) -> slice:
        return self._onsets_of_swaps if hypothesis.kind == "swapped" else self._onsets

    def _fit_noise(self, effect: Array) -> tuple[WhiteningFilter, Array]:
        """Fit filter and constant errors of the model (N, n) to the residuals without an effect (N, n)."""
        signals = self.signals
        residuals = signals.residuals - effect
        errors = np.zeros_like(residuals)
        for _ in range(2):
            whitening = WhiteningFilter.fit(residuals - errors, signals.valid, signals.min_noise)
            errors = ChangeTest(signals, whitening, residuals).model_errors
        return WhiteningFilter.fit(residuals - errors, signals.valid, signals.min_noise), errors

    def _candidate(self, hypothesis: FaultHypothesis, change: Change) -> Candidate:
        """The candidate of a hypothesis and its first fit; the noise is fitted to the residuals without its effect."""
        signals = self.signals
        for _ in range(ITERATIONS):
            whitening, errors = self._fit_noise(change.effect)
            test = ChangeTest(signals, whitening, signals.residuals)
            change = self._fit(test, hypothesis)
        p_value = test.p_value(
            change,
            hypothesis.columns,
            list(hypothesis.affected),
            is_constant_error=hypothesis.kind in CONSTANT_ERRORS,
        )
        whitening, errors = self._fit_noise(change.effect)
        gain = whitening.log_likelihood - self._sound_log_likelihood
        after = np.arange(len(signals.times)) >= change.row
        effect = _rms(change.effect, signals.valid & after[:, None])
        unexplained = _rms(signals.residuals - errors - change.effect, signals.valid)
        effect_ratio = float((effect / np.maximum(unexplained, 1e-300)).max())
        return Candidate(hypothesis, change, gain, whitening, p_value, effect_ratio)

    def fault(self) -> Fault | None:
        """The most likely fault; None where a sound robot explains the residuals."""
        significant = next((each for each in self.candidates if self._is_significant(each)), None)
        if significant is None:
            return None if self.contact is None else name_contact(self.contact, self.names)
        # something is wrong with these joints: of the faults of the same joints, the most likely one is named
        joints = significant.hypothesis.joints
        best = next(each for each in self.candidates if each.hypothesis.joints == joints and self._is_large(each))
        residuals = self.signals.residuals - best.change.effect
        whitening, _ = self._fit_noise(best.change.effect)
        remaining = find_contact_in_motion(ChangeTest(self.signals, whitening, residuals))
        return self._named(best) if remaining is None else name_contact(remaining, self.names)

    def _is_significant(self, candidate: Candidate) -> bool:
        """Whether no sound robot shows such evidence."""
        return (
            self._is_large(candidate)
            and candidate.p_value * self._numbers[candidate.hypothesis.kind] <= MAX_P_VALUE
            and self._onset_interval(candidate.change) <= MAX_ONSET_INTERVAL * self._duration
            and not self._has_sound_explanation(candidate)
            and lasting_gain(self.signals, candidate.whitening, candidate.change.effect) >= MIN_LASTING_LOG_LIKELIHOOD
        )

    def _score(self, candidate: Candidate) -> float:
        """Logarithm of the likelihood, less the part that sizes explain by chance (Schwarz, 1978)."""
        samples = int(self.signals.valid.any(axis=1).sum())
        return candidate.gain - 0.5 * len(candidate.change.sizes) * float(np.log(samples))

    def _has_sound_explanation(self, candidate: Candidate) -> bool:
        """Whether something that is no fault is more likely.

        This is a change of the same joints that is no fault, as heat changes friction, or a load from the first sample
        on that the model does not have.
        """
        score = self._score(candidate)
        return self._gain_of_constant_load > score or any(
            each.hypothesis.joints == candidate.hypothesis.joints
            and self._score(each) > score
            and not each.hypothesis.is_fault(each.change.sizes)
            for each in self.candidates
        )

    @cached_property
    def _gain_of_constant_load(self) -> float:
        """Increase of the logarithm of the likelihood by a payload from the first sample on."""
        payload = next(each for each in self._hypotheses if each.kind == "payload")
        effect = np.zeros_like(self.signals.residuals)
        for _ in range(ITERATIONS):
            whitening, _ = self._fit_noise(effect)
            test = ChangeTest(self.signals, whitening, self.signals.residuals)
            joints = list(payload.affected)
            effect = test.fit(payload.columns, joints, payload.fit_sizes, slice(0, 1), is_constant_error=False).effect
        whitening, _ = self._fit_noise(effect)
        return whitening.log_likelihood - self._sound_log_likelihood

    def _is_large(self, candidate: Candidate) -> bool:
        """Whether size, likelihood and effect are beyond those of sound robots."""
        min_ratio = MIN_PAYLOAD_RATIO if candidate.hypothesis.kind == "payload" else MIN_EFFECT_RATIO
        return (
            candidate.gain >= max(MIN_LOG_LIKELIHOOD, MIN_LOG_LIKELIHOOD_PER_SIZE * len(candidate.change.sizes))
            and candidate.effect_ratio >= min_ratio
            and candidate.hypothesis.is_fault(candidate.change.sizes)
        )

    @property
    def _duration(self) -> float:
        return float(self.signals.times[-1] - self.signals.times[0])

    def _onset_interval(self, change: Change) -> float:
        """Duration [s] of the interval of possible onsets."""
        earliest, latest = self._possible_onsets(change)
        return latest - earliest

    def _possible_onsets(self, change: Change) -> tuple[float, float]:
        """Earliest and latest possible onset [s]."""
        times = self.signals.times
        possible = times[(change.gains > 0) & (change.gains >= change.gain - 2 * ONSET_MARGIN)]
        return float(max(possible[0] - self.signals.step, times[0])), float(possible[-1] + self.signals.step)

    def _named(self, candidate: Candidate) -> Fault:
        """The Fault of a candidate, with the interval of its onset."""
        times = self.signals.times
        change = candidate.change
        log_likelihoods = np.where(change.gains > 0, (change.gains - change.gain) / 2, -np.inf)
        onset = float(times[_most_likely_row(np.exp(log_likelihoods), round(0.5 * ONSET_WINDOW / self.signals.step))])
        earliest, latest = self._possible_onsets(change)
        names = tuple(self.names[joint] for joint in candidate.hypothesis.joints)
        description = describe(candidate.hypothesis.kind, names, change.sizes, self.link)
        since = f"since {onset:.4g} s (between {earliest:.4g} and {latest:.4g} s)"
        if earliest < times[self._possible_rows(candidate.hypothesis).start]:
            earliest, since = float(times[0]), f"from the start (at the latest since {latest:.4g} s)"
        gain, p_value = candidate.gain, candidate.p_value
        sentence = f"{description}, {since}"
        return Fault(candidate.hypothesis.kind, names, onset, (earliest, latest), gain, p_value, sentence)


def name_contact(contact: Contact, joint_names: Sequence[str]) -> Fault:
    """The Fault of a contact; joint_names: of the robot."""
    names = tuple(joint_names[joint] for joint in contact.joints)
    where = " at rest" if contact.at_rest else ""
    sentence = (
        f"external contact{where} from {contact.start:.4g} to {contact.end:.4g} s, which loads {', '.join(names)}"
    )
    return Fault("contact", names, contact.start, contact.between, None, None, sentence)


def _most_likely_row(likelihoods: Array, reach: int) -> int:
    """The median row of those, in a window of `reach` rows on each side, that are the most likely of all windows.

    The median of all rows may fall between two likely ones.
    """
    reach = min(max(1, reach), (len(likelihoods) - 1) // 2)
    centre = int(np.argmax(np.convolve(likelihoods, np.ones(2 * reach + 1), "same")))
    first = max(0, centre - reach)
    sums = np.cumsum(likelihoods[first : centre + reach + 1])
    return first + int(np.searchsorted(sums, 0.5 * sums[-1]))


def _rms(values: Array, counts: BoolArray) -> Array:
    """RMS (n,) of the values (N, n) that count."""
    squares = np.where(counts, values, 0) ** 2
    rms: Array = np.sqrt(squares.sum(axis=0) / np.maximum(1, counts.sum(axis=0)))
    return rms
