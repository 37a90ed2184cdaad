"""Which fault explains residuals, on which joint, and since when: a generalised likelihood ratio over what may happen.

Each fault says how measured efforts differ from predicted ones from its onset on, by a few unknown sizes, or by none.
For each moment as onset the sizes are fitted to all that follows; the fault and the onset that take most off the
squares of the residuals, in units of each joint's noise, are those that are named (Basseville and Nikiforov,
"Detection of Abrupt Changes", 1993, chapter 7).

Delays are found, but hardly dated: only where efforts change quickly do they show.
"""

from dataclasses import dataclass, replace

import numpy as np

from robot_dynamics.model.inertia import Inertia
from robot_dynamics.replay.signals import lowpass

MOST_SAMPLES = 60_000  # that are looked at
SAMPLES_PER_PERIOD = 6  # of the cut-off
SHIFTS = np.arange(-4, 13) / 100  # [s] of efforts behind motion that are tried
LEAST_AFTER = 1.0  # [s] that a fault must have been there
QUIET = 0.3  # the part of seconds that are taken as free of faults, to tell the noise
EXPLAINED = 0.03  # of the squares of the residuals that a fault must take away
EXPLAINED_BY_DELAY = 0.06  # drives and filters of sound robots are some milliseconds late
LEAST_NOISE = 1e-3  # of the spread of a joint's efforts
LEAST_GAIN = 150.0  # and so many squares of the noise


@dataclass(frozen=True)
class Fault:
    """kind: payload, friction, swapped, sign or delay; joints: names; onset [s]; gain: squares of the noise that it
    takes off the residuals, of `total`; sentence: what it is."""

    kind: str
    joints: tuple
    onset: float
    gain: float
    total: float
    sentence: str


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
        self._parts, self._count = [], 0

    def add(self, motion, predicted, origin=0):
        """Take a Motion and the efforts (N, n) predicted for it; what is beyond MOST_SAMPLES is not looked at."""
        if self._count >= MOST_SAMPLES:
            return
        stride = max(1, int(motion.rate / (SAMPLES_PER_PERIOD * motion.cutoff)))
        payload = [self._predictor.efforts(loaded, motion) - predicted for loaded in self._loaded]
        signs = lowpass(np.sign(motion.qd), motion.rate, motion.cutoff) if len(motion) > 20 else np.sign(motion.qd)
        times = np.broadcast_to(motion.times[:, None], predicted.shape)
        arrays = (times, motion.efforts - predicted, predicted, signs, motion.qd, *payload)
        self._parts.append(np.stack([array[::stride] for array in arrays]))
        self._count += self._parts[-1].shape[1]

    def fault(self):
        """The Fault that explains the residuals, None where there is none to be named."""
        times, r, p, signs, qd, *payload = np.concatenate(self._parts, axis=1)
        times = times[:, 0]
        weight = 1 / np.maximum(_noise(times, r), LEAST_NOISE * p.std(axis=0) + 1e-9)
        n = r.shape[1]
        found = [self._fitted("payload", (), times, r * weight, np.stack(payload, -1) * weight[:, None])]
        for joint in range(n):
            columns = np.zeros((*r.shape, 2))
            columns[:, joint, 0], columns[:, joint, 1] = signs[:, joint] * weight[joint], qd[:, joint] * weight[joint]
            found.append(self._fitted("friction", (joint,), times, r * weight, columns))
            found.append(self._given("sign", (joint,), times, r, _only(p, {joint: -2 * p[:, joint]}), weight))
            for other in range(joint):
                difference = p[:, other] - p[:, joint]
                effect = _only(p, {joint: difference, other: -difference})
                found.append(self._given("swapped", (other, joint), times, r, effect, weight))
        found += [self._delayed(shift, times, r, p, weight) for shift in SHIFTS if shift]
        named = [fault for fault in found if fault.gain > max(LEAST_GAIN, fault.total * (
            EXPLAINED_BY_DELAY if fault.kind == "delay" else EXPLAINED))]  # fmt: skip
        return max(named, key=lambda fault: fault.gain, default=None)

    def _fitted(self, kind, joints, times, r, columns):
        """The Fault whose sizes are fitted to all that follows its onset."""
        squares = _suffix(np.einsum("tja,tjb->tab", columns, columns))
        products = _suffix(np.einsum("tja,tj->ta", columns, r))
        squares = squares + 1e-6 * np.trace(squares[0]) * np.eye(squares.shape[-1])
        sizes = np.linalg.solve(squares, products[..., None])[..., 0]
        gains = np.einsum("ta,ta->t", sizes, products)
        start = self._start(times, gains)
        told = (f"a payload of {sizes[start, 0]:+.2g} kg on {self.link}" if kind == "payload" else
                f"friction of {self.names[joints[0]]} changed by {sizes[start, 0]:+.2g} (Coulomb) "
                f"and {sizes[start, 1]:+.2g} (viscous)")  # fmt: skip
        return self._fault(kind, joints, times[start], gains[start], r, told)

    def _given(self, kind, joints, times, r, effect, weight):
        """The Fault that has no unknown size."""
        gains = _suffix(((r**2 - (r - effect) ** 2) * weight**2).sum(axis=1))
        start = self._start(times, gains)
        names = " and ".join(self.names[joint] for joint in joints)
        told = f"efforts of {names} are swapped" if kind == "swapped" else f"the sign of the effort of {names} is wrong"
        return self._fault(kind, joints, times[start], gains[start], r * weight, told)

    def _delayed(self, shift, times, r, p, weight):
        """Efforts that are `shift` [s] late."""
        effect = np.stack([np.interp(times - shift, times, column) for column in p.T], axis=1) - p
        fault = self._given("delay", (), times, r, effect, weight)
        return replace(fault, sentence=f"efforts are {1000 * shift:+.0f} ms late, since {fault.onset:.4g} s")

    def _start(self, times, gains):
        last = np.searchsorted(times, times[-1] - LEAST_AFTER)
        return int(np.argmax(gains[: max(1, last)]))

    def _fault(self, kind, joints, onset, gain, r, told):
        names = tuple(self.names[joint] for joint in joints)
        return Fault(kind, names, float(onset), float(gain), float((r * r).sum()), f"{told}, since {onset:.4g} s")


def _only(p, effects):
    effect = np.zeros_like(p)
    for joint, values in effects.items():
        effect[:, joint] = values
    return effect


def _suffix(values):
    """Sums of all rows from each row on."""
    return np.cumsum(values[::-1], axis=0)[::-1]


def _noise(times, r):
    """(n,) standard deviation of residuals in the quietest seconds of each joint."""
    seconds = np.floor(times).astype(int)
    starts = np.flatnonzero(np.diff(seconds, prepend=seconds[0] - 1))
    counts = np.diff([*starts, len(r)])
    rms = np.sqrt(np.add.reduceat(r * r, starts, axis=0) / counts[:, None])
    ordered = np.sort(rms, axis=0)[: max(1, int(np.ceil(QUIET * len(rms))))]
    return np.sqrt((ordered**2).mean(axis=0))
