"""Which fault explains the residuals, on which joint, and since when: a generalised likelihood ratio test.

Each kind of fault states how measured efforts differ from predicted ones from its onset on, with a few unknown sizes or
none. For each sample as onset the sizes are fitted to all later samples. The fault and the onset that reduce the
squares of white residuals most are reported (Basseville and Nikiforov, "Detection of Abrupt Changes", 1993, chapter 7).
Then the filter that whitens the noise, and the response of the joints to predictions, are fitted to the residuals
without this fault, and the test is repeated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from robot_dynamics.checking.block_averages import BlockAverages
from robot_dynamics.checking.fault_signals import FaultSignals
from robot_dynamics.checking.whitening import WhiteningFilter
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.robot import attach_payload
from robot_dynamics.newton_euler.linear import solve_each

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.checking.check import Predictor
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.recordings.joint_motions import Motion

MAX_SAMPLES = 40_000  # kept in memory; longer recordings are averaged over blocks
SAMPLES_PER_PERIOD = 6  # of the cut-off
MIN_SAMPLES = 100
CANDIDATE_DELAYS = np.arange(-4, 13) / 100  # [s] of efforts behind motion that are tried
MAX_USUAL_DELAY = 0.03  # [s] by which drives and filters without fault may be late, or early
MIN_FAULT_DURATION = 2.0  # [s] a shorter change cannot be distinguished from an error of the model
ITERATIONS = 3
SIZE_FIT_PENALTY = 0.8  # factor on the gain of faults with fitted sizes, which also fit errors of the model
MIN_EXPLAINED_RATIO = 0.03  # least part of the squares of white residuals after the onset that a fault explains
MIN_GAIN = 60.0  # least reduction of these squares, in variances of the noise
ONSET_GAIN_MARGIN = 15.0  # onsets whose gain is lower by less are possible onsets

FaultKind: TypeAlias = Literal["payload", "friction", "swapped", "sign", "delay"]
SIZED_KINDS: tuple[FaultKind, ...] = ("payload", "friction")  # whose sizes are fitted


@dataclass(frozen=True)
class Fault:
    """A fault of a recording.

    Attributes
    ----------
    kind : of the fault.
    joints : names of the joints; empty for a payload and a delay, which concern all.
    onset : most likely beginning [s].
    between : earliest and latest possible beginning [s].
    gain : reduction of the squares of white residuals after the onset, in variances of the noise.
    total : these squares.
    sentence : description of the fault.
    """

    kind: FaultKind
    joints: tuple[str, ...]
    onset: float
    between: tuple[float, float]
    gain: float
    total: float
    sentence: str


@dataclass(frozen=True, eq=False)
class FaultHypothesis:
    """A fault that may explain the residuals, with its best onset.

    Attributes
    ----------
    kind : of the fault.
    joints : their numbers.
    gains : (M,) reduction of the squares of white residuals for an onset at each of the first M samples.
    row : sample with the largest gain.
    effect : (N, n) effect on the efforts for this onset [N m or N].
    description : of the fault.
    """

    kind: FaultKind
    joints: tuple[int, ...]
    gains: Array
    row: int
    effect: Array
    description: str

    @property
    def gain(self) -> float:
        """The gain of the best onset."""
        return float(self.gains[self.row])

    @property
    def score(self) -> float:
        """The gain with a penalty on fitted sizes, for the comparison of faults."""
        return self.gain * (SIZE_FIT_PENALTY if self.kind in SIZED_KINDS else 1.0)


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
        unit_payloads = [Inertia(1.0), *(Inertia(0.0, axis) for axis in np.eye(3))]
        self._loaded = [Dynamics(attach_payload(robot, self.link, payload)) for payload in unit_payloads]
        self._averages: BlockAverages | None = None  # of rows (9, N, n) for FaultSignals
        self._cutoff = 0.0
        self._has_efforts = np.ones(len(self.names), dtype=bool)

    def add(self, motion: Motion, predicted: Array, origin: int = 0) -> None:
        """Add a motion and its predicted efforts (N, n); origin is not used (the interface of `PieceCallback`)."""
        if self._averages is None:
            stride = max(1, int(motion.rate / (SAMPLES_PER_PERIOD * motion.cutoff)))
            self._averages = BlockAverages(stride, MAX_SAMPLES)
            self._cutoff = motion.cutoff
        self._has_efforts &= motion.has_efforts
        payload_efforts = [self._predictor.efforts(loaded, motion) - predicted for loaded in self._loaded]
        times = np.broadcast_to(motion.times[:, None], predicted.shape)
        velocity_signs = np.sign(motion.qd)
        rows = [times, motion.unfiltered_efforts, predicted, velocity_signs, motion.qd, *payload_efforts]
        self._averages.add(np.stack(rows))

    def find_fault(self) -> Fault | None:
        """Find the fault that explains the residuals.

        Returns
        -------
        Fault or None
            None where no fault explains enough, or the samples are too few.

        Notes
        -----
        Each iteration fits the noise and the response of the joints to the residuals without the best fault so far.
        """
        if self._averages is None:
            return None
        rows = self._averages.rows
        if rows.shape[1] < MIN_SAMPLES:
            return None
        rows[1:, :, ~self._has_efforts] = 0
        raw = FaultSignals.from_rows(rows, self._cutoff)
        if raw.valid.sum() < MIN_SAMPLES:
            return None
        test = FaultTest(raw, raw.initial_whitening(), self.names, self.link)
        best = test.best_hypothesis()
        for _ in range(ITERATIONS - 1):
            unexplained = raw.residuals - best.effect
            signals = raw.with_fitted_response(unexplained)
            noise = unexplained + signals.residuals - raw.residuals
            whitening = WhiteningFilter.fit(noise, raw.valid, raw.min_noise)
            test = FaultTest(signals, whitening, self.names, self.link)
            best = test.best_hypothesis()
        return test.significant_fault(best)


def _last_link_name(robot: Robot) -> str:
    last = len(robot.links) - 1
    return next(frame.name for frame in reversed(robot.frames) if frame.link == last)


class FaultTest:
    """The likelihood ratio test of all faults on given signals and noise.

    Parameters
    ----------
    signals : residuals and their predictors.
    whitening : filter of the noise.
    names : of the n joints.
    link : name of the link that may carry a payload.
    """

    def __init__(self, signals: FaultSignals, whitening: WhiteningFilter, names: Sequence[str], link: str) -> None:
        self.signals = signals
        self.whitening = whitening
        self.names = names
        self.link = link
        self.white = whitening(signals.residuals)  # (N, n)

    def best_hypothesis(self) -> FaultHypothesis:
        """The fault with the highest score."""
        return max(self._hypotheses(), key=lambda hypothesis: hypothesis.score)

    def _hypotheses(self) -> Iterator[FaultHypothesis]:
        """Yield the hypothesis of each fault, with its best onset."""
        signals = self.signals
        p = signals.predicted
        all_joints = list(range(len(self.names)))
        yield self._hypothesis("payload", all_joints, signals.payload_efforts)
        for joint in all_joints:
            friction = np.stack([signals.velocity_signs[:, [joint]], signals.velocities[:, [joint]]], axis=-1)
            yield self._hypothesis("friction", [joint], friction)
            yield self._hypothesis("sign", [joint], -2 * p[:, [joint], None])
            for other in range(joint):
                difference = p[:, joint] - p[:, other]
                columns = np.stack([difference, -difference], axis=1)[..., None]
                yield self._hypothesis("swapped", [other, joint], columns)
        yield self._delay_hypothesis()

    def _hypothesis(self, kind: FaultKind, joints: list[int], columns: Array) -> FaultHypothesis:
        """The hypothesis with effect columns (N, k, a) @ sizes (a,) on k joints.

        The sizes are fitted to the samples after the onset, or 1 where the fault has none.
        """
        squares, products = self.whitening.correlation_sums(columns, self.white, joints)
        if kind in SIZED_KINDS:
            squares = squares + (1e-6 * np.trace(squares[0]) + 1e-12) * np.eye(squares.shape[-1])
            sizes = solve_each(squares, products)
            gains = np.einsum("ta,ta->t", sizes, products)
        else:
            sizes = np.ones((len(self.white), 1))
            gains = 2 * products[:, 0] - squares[:, 0, 0]
        gains = _gains_of_onsets(self.signals, gains)
        row = int(np.argmax(gains))
        effect = np.zeros_like(self.white)
        effect[row:, joints] = columns[row:] @ sizes[row]
        return FaultHypothesis(kind, tuple(joints), gains, row, effect, self._describe(kind, joints, sizes[row]))

    def _describe(self, kind: FaultKind, joints: list[int], sizes: Array) -> str:
        names = " and ".join(self.names[joint] for joint in joints)
        if kind == "payload":
            return f"a payload of {sizes[0]:+.2g} kg on {self.link}"
        if kind == "friction":
            return f"friction of {names} changed by {sizes[0]:+.2g} (Coulomb) and {sizes[1]:+.2g} (viscous)"
        return f"efforts of {names} are swapped" if kind == "swapped" else f"the sign of the effort of {names} is wrong"

    def _delay_hypothesis(self) -> FaultHypothesis:
        """Efforts that are later from the onset on than before it; the usual delay before it is estimated too."""
        effects = {shift: self.signals.delay_effect(shift) for shift in (*CANDIDATE_DELAYS, 0.0)}
        usual_shifts = [shift for shift in effects if abs(shift) <= MAX_USUAL_DELAY]
        before = 0.0
        for _ in range(2):
            best = self._best_delay_change(effects, before)
            if not self.signals.valid[: best.row].any():
                break
            remainders = {
                shift: ((self.white - self.whitening(effects[shift]))[: best.row] ** 2).sum() for shift in usual_shifts
            }
            before = min(usual_shifts, key=lambda shift: remainders[shift])
        return best

    def _best_delay_change(self, effects: dict[float, Array], before: float) -> FaultHypothesis:
        """The best change from a delay `before` [s] to another; effects: {delay: (N, n) effect of it}."""
        joints = list(range(len(self.names)))
        residuals = self.white - self.whitening(effects[before])
        gain_before = (self.white**2).sum() - (residuals**2).sum()
        rows = np.arange(len(self.white))[:, None]
        best: FaultHypothesis | None = None
        for shift, effect in effects.items():
            change = effect - effects[before]
            squares, products = self.whitening.correlation_sums(change[..., None], residuals, joints)
            gains = _gains_of_onsets(self.signals, gain_before + 2 * products[:, 0] - squares[:, 0, 0])
            row = int(np.argmax(gains))
            if best is None or gains[row] > best.gain:
                total_effect = effects[before] + np.where(rows >= row, change, 0)
                description = f"efforts are {1000 * (shift - before):+.0f} ms late"
                best = FaultHypothesis("delay", (), gains, row, total_effect, description)
        assert best is not None, "there are candidate delays"
        return best

    def significant_fault(self, best: FaultHypothesis) -> Fault | None:
        """The Fault of a hypothesis; None where it explains too little."""
        total = float((self.white[best.row :] ** 2).sum())
        if best.gain <= max(MIN_GAIN, MIN_EXPLAINED_RATIO * total):
            return None
        step = self.signals.step
        times = self.signals.times[: len(best.gains)]
        likelihoods = np.cumsum(np.exp((best.gains - best.gain) / 2))
        onset = float(times[np.searchsorted(likelihoods, 0.5 * likelihoods[-1])])  # the median
        possible = times[best.gains >= best.gain - ONSET_GAIN_MARGIN]
        earliest = float(max(possible[0] - step, times[0]))
        latest = float(possible[-1] + step)
        names = () if best.kind in ("payload", "delay") else tuple(self.names[joint] for joint in best.joints)
        sentence = f"{best.description}, since {onset:.4g} s (between {earliest:.4g} and {latest:.4g} s)"
        return Fault(best.kind, names, onset, (earliest, latest), best.gain, total, sentence)


def _gains_of_onsets(signals: FaultSignals, gains: Array) -> Array:
    """The gains of the samples that may be an onset: not those in the last MIN_FAULT_DURATION."""
    last = signals.times[signals.valid][-1] - MIN_FAULT_DURATION
    return gains[: max(1, int(np.searchsorted(signals.times, last)))]
