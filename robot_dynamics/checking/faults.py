"""Which fault explains residuals, on which joint, and since when: a generalised likelihood ratio over what may happen.

Each fault says how measured efforts differ from predicted ones from its onset on, by a few unknown sizes, or by none.
For each moment as onset the sizes are fitted to all that follows; the fault and the onset that take most off the
squares of white residuals are those that are named (Basseville and Nikiforov, "Detection of Abrupt Changes", 1993,
chapter 7). Then the colour of the noise, and how joints answer to what is predicted, are taken from the residuals that
this fault leaves, and all is weighed anew.
"""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.checking.block_averages import BlockAverages
from robot_dynamics.checking.fault_signals import FaultSignals
from robot_dynamics.checking.whitening import WhiteningFilter
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.newton_euler.linear import solve_each

MAX_SAMPLES = 40_000  # that are held; means over the more the longer a recording is
SAMPLES_PER_PERIOD = 6  # of the cut-off
MIN_SAMPLES = 100
CANDIDATE_DELAYS = np.arange(-4, 13) / 100  # [s] of efforts behind motion that are tried
MAX_USUAL_DELAY = 0.03  # [s] that drives and filters of sound robots may be late, or early
MIN_FAULT_DURATION = 2.0  # [s] that a fault must have been there: in less, errors of a model look like one
ITERATIONS = 3
SIZE_FIT_PENALTY = 0.8  # of the gain of a fault with sizes to fit is enough for one without
MIN_EXPLAINED_RATIO = 0.03  # of the squares of white residuals that follow the onset that a fault must take away
MIN_GAIN = 60.0  # and so many squares of the noise
ONSET_GAIN_MARGIN = 15.0  # squares of the noise by which another onset may be worse, and still be the one


@dataclass(frozen=True)
class Fault:
    """kind: payload, friction, swapped, sign or delay; joints: names; onset, and between: the earliest and the latest
    that it may be [s]; gain: squares of the noise that it takes off the residuals that follow, of `total`; sentence:
    what it is."""

    kind: str
    joints: tuple
    onset: float
    between: tuple
    gain: float
    total: float
    sentence: str


@dataclass(frozen=True, eq=False)
class FaultHypothesis:
    """kind; joints: numbers; gains: squares of the noise that it takes off if it begins at each of the rows that may be
    its onset; row: where that is most; effect: (N, n) that it has on efforts then; told: what it is."""

    kind: str
    joints: tuple
    gains: np.ndarray
    row: int
    effect: np.ndarray
    description: str

    @property
    def gain(self):
        return self.gains[self.row]

    @property
    def score(self):
        """The gain, in favour of faults that have no sizes: the others fit errors of the model besides."""
        return self.gain * (SIZE_FIT_PENALTY if self.kind in ("payload", "friction") else 1.0)


class Evidence:
    """What `add` is given of a recording, thinned: residuals, predictions, and what a payload and friction would do.

    link: name of the link that may carry a payload; None: the last one.
    """

    def __init__(self, predictor, link=None):
        self._predictor = predictor
        dynamics = predictor.dynamics
        last = len(dynamics.robot.links) - 1
        link = link or next(frame.name for frame in reversed(dynamics.robot.frames) if frame.link == last)
        units = [Inertia(1.0), *(Inertia(0.0, axis) for axis in np.eye(3))]
        self.link, self.names = link, dynamics.joint_names
        self._loaded = [type(dynamics)(dynamics.robot.with_payload(link, unit)) for unit in units]
        self._kept, self._cutoff = None, None
        self._measured = np.ones(len(self.names), dtype=bool)

    def add(self, motion, predicted, origin=0):
        """Take a Motion and the efforts (N, n) predicted for it."""
        if self._kept is None:
            stride = max(1, int(motion.rate / (SAMPLES_PER_PERIOD * motion.cutoff)))
            self._kept, self._cutoff = BlockAverages(stride, MAX_SAMPLES), motion.cutoff
        self._measured &= motion.has_efforts
        payload = [self._predictor.efforts(loaded, motion) - predicted for loaded in self._loaded]
        times = np.broadcast_to(motion.times[:, None], predicted.shape)
        self._kept.add(np.stack([times, motion.unfiltered_efforts, predicted, np.sign(motion.qd), motion.qd, *payload]))

    def find_fault(self):
        """The Fault that explains the residuals, None where there is none to be named."""
        rows = np.zeros((9, 0, 1)) if self._kept is None else self._kept.rows
        if rows.shape[1] < MIN_SAMPLES:
            return None
        rows[1:, :, ~self._measured] = 0
        signals = raw = FaultSignals.from_rows(rows, self._cutoff)
        if raw.valid.sum() < MIN_SAMPLES:
            return None
        noise, best = raw.initial_whitening(), None
        for _ in range(ITERATIONS):
            if best is not None:
                left = raw.residuals - best.effect
                signals = raw.with_fitted_response(left)
                noise = WhiteningFilter.fit(left + signals.residuals - raw.residuals, raw.valid, raw.min_noise)
            white = noise(signals.residuals)
            best = max(self._explanations(signals, noise, white), key=lambda each: each.score)
        return self._named(best, signals, white)

    def _explanations(self, signals, noise, white):
        """Yield an Explanation of the residuals by each fault."""
        everywhere, p = np.arange(len(self.names)), signals.predicted
        yield self._explanation("payload", everywhere, signals.payload_efforts, signals, noise, white)
        for joint in range(len(self.names)):
            friction = np.stack([signals.velocity_signs[:, [joint]], signals.velocities[:, [joint]]], axis=-1)
            yield self._explanation("friction", (joint,), friction, signals, noise, white)
            yield self._explanation("sign", (joint,), -2 * p[:, [joint], None], signals, noise, white)
            for other in range(joint):
                difference = p[:, joint] - p[:, other]
                effect = np.stack([difference, -difference], axis=1)[..., None]
                yield self._explanation("swapped", (other, joint), effect, signals, noise, white)
        yield self._delay(signals, noise, white)

    def _explanation(self, kind, joints, columns, signals, noise, white):
        """That by columns (N, k, a) of some joints, times sizes (a,) that are fitted to what follows, or 1."""
        joints = list(joints)
        squares, products = noise.correlation_sums(columns, white, joints)
        if kind in ("payload", "friction"):
            squares = squares + (1e-6 * np.trace(squares[0]) + 1e-12) * np.eye(squares.shape[-1])
            sizes = solve_each(squares, products)
            gains = np.einsum("ta,ta->t", sizes, products)
        else:
            sizes, gains = np.ones((len(white), 1)), 2 * products[:, 0] - squares[:, 0, 0]
        gains = _of_onsets(signals, gains)
        row = int(np.argmax(gains))
        effect = np.zeros_like(white)
        effect[row:, joints] = columns[row:] @ sizes[row]
        return FaultHypothesis(kind, tuple(joints), gains, row, effect, self._told(kind, joints, sizes[row]))

    def _told(self, kind, joints, sizes):
        names = " and ".join(self.names[joint] for joint in joints)
        if kind == "payload":
            return f"a payload of {sizes[0]:+.2g} kg on {self.link}"
        if kind == "friction":
            return f"friction of {names} changed by {sizes[0]:+.2g} (Coulomb) and {sizes[1]:+.2g} (viscous)"
        return f"efforts of {names} are swapped" if kind == "swapped" else f"the sign of the effort of {names} is wrong"

    def _delay(self, signals, noise, white):
        """Efforts that are late from some moment on, more than they were before: that is found out as well."""
        joints, before = list(range(len(self.names))), 0.0
        effects = {shift: signals.delay_effect(shift) for shift in (*CANDIDATE_DELAYS, 0.0)}
        for _ in range(2):
            rest = white - noise(effects[before])
            told = (white**2).sum() - (rest**2).sum()
            best = None
            for shift, effect in effects.items():
                change = effect - effects[before]
                squares, products = noise.correlation_sums(change[..., None], rest, joints)
                gains = _of_onsets(signals, told + 2 * products[:, 0] - squares[:, 0, 0])
                row = int(np.argmax(gains))
                if best is None or gains[row] > best.gain:
                    sentence = f"efforts are {1000 * (shift - before):+.0f} ms late"
                    whole = effects[before] + np.where(np.arange(len(white))[:, None] >= row, change, 0)
                    best = FaultHypothesis("delay", (), gains, row, whole, sentence)
            if not signals.valid[: best.row].any():
                break
            usual = [shift for shift in effects if abs(shift) <= MAX_USUAL_DELAY]
            before = min(usual, key=lambda shift: ((white - noise(effects[shift]))[: best.row] ** 2).sum())
        return best

    def _named(self, best, signals, white):
        """The Fault of an Explanation, None where that explains too little."""
        total = float((white[best.row :] ** 2).sum())
        if best.gain <= max(MIN_GAIN, MIN_EXPLAINED_RATIO * total):
            return None
        times = signals.times[: len(best.gains)]
        chances = np.cumsum(np.exp((best.gains - best.gain) / 2))
        onset = float(times[np.searchsorted(chances, 0.5 * chances[-1])])  # half of what is likely is before it
        near = times[best.gains >= best.gain - ONSET_GAIN_MARGIN]
        between = float(max(near[0] - signals.step, times[0])), float(near[-1] + signals.step)
        names = tuple(self.names[joint] for joint in best.joints) if best.kind not in ("payload", "delay") else ()
        told = f"{best.description}, since {onset:.4g} s (between {between[0]:.4g} and {between[1]:.4g} s)"
        return Fault(best.kind, names, onset, between, float(best.gain), total, told)


def _of_onsets(signals, gains):
    """Those of gains (N,) whose rows may be the onset of a fault."""
    last = signals.times[signals.valid][-1] - MIN_FAULT_DURATION
    return gains[: max(1, np.searchsorted(signals.times, last))]
