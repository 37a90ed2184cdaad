"""Predicted efforts through the filter of the measured ones, so that both sides of a comparison have the same band.

Where Coulomb friction changes its sign, predictions have steps. The filter of measured efforts smooths such steps.
Without the same filter on predictions the residual contains the difference.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.recordings.signals import lowpass

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.recordings.joint_motions import Motion

MARGIN_PERIODS = 3.0  # of the cut-off, after which 1e-3 of a step is left of the transient of the filter
MIN_FILTER_SAMPLES = 16  # `lowpass` needs as many


@dataclass(frozen=True, eq=False)
class PredictedMotion:
    """A motion with its predicted efforts.

    Attributes
    ----------
    motion : of N samples.
    predicted : (N, n) efforts of the model [N m or N].
    filtered : (N, n) the same through the filter of `motion.efforts`.
    directions : (N, n) signs of the velocities, through the same filter.
    """

    motion: Motion
    predicted: Array
    filtered: Array
    directions: Array

    def slice_samples(self, begin: int, end: int) -> PredictedMotion:
        """The samples from `begin` to `end`, without the last."""
        rows = slice(begin, end)
        return PredictedMotion(
            self.motion.slice_samples(begin, end), self.predicted[rows], self.filtered[rows], self.directions[rows]
        )


class PredictionFilter:
    """Filters the predicted efforts of motions that come piece by piece.

    The filter of a sample uses the samples up to one margin after it: the last margin of a piece waits for the next
    piece, or for `flush`.
    """

    def __init__(self) -> None:
        self._motion: Motion | None = None
        self._predicted: Array | None = None
        self._skipped = 0  # samples of `_motion` that are returned already

    def feed(self, motion: Motion, predicted: Array) -> Iterator[PredictedMotion]:
        """Add a motion and its predicted efforts (N, n); yield what is complete."""
        if self._motion is not None and abs(motion.time - self._motion.end) * motion.rate > 0.5:
            yield from self.flush()
        if self._motion is None or self._predicted is None:
            self._motion, self._predicted = motion, predicted
        else:
            self._motion = self._motion.concatenate(motion)
            self._predicted = np.concatenate([self._predicted, predicted])
        margin = int(np.ceil(MARGIN_PERIODS * motion.rate / motion.cutoff))
        size = len(self._motion)
        if size - margin > self._skipped:
            yield self._filter_samples(self._motion, self._predicted, size - margin)
            first_kept = max(0, size - 2 * margin)
            self._skipped = size - margin - first_kept
            self._motion = self._motion.slice_samples(first_kept, size)
            self._predicted = self._predicted[first_kept:]

    def flush(self) -> Iterator[PredictedMotion]:
        """Yield the rest; no motion continues it."""
        motion, predicted, skipped = self._motion, self._predicted, self._skipped
        if motion is not None and predicted is not None and len(motion) > skipped:
            yield self._filter_samples(motion, predicted, len(motion))
        self._motion = self._predicted = None
        self._skipped = 0

    def _filter_samples(self, motion: Motion, predicted: Array, end: int) -> PredictedMotion:
        """The samples from the first that is not returned yet to `end`."""
        signals = np.hstack([predicted, np.sign(motion.qd)])
        missing = max(0, MIN_FILTER_SAMPLES - len(signals))
        padded = np.pad(signals, ((missing, missing), (0, 0)), mode="edge")
        lowpassed = lowpass(padded, motion.rate, motion.cutoff)[missing : missing + len(signals)]
        filtered, directions = np.hsplit(lowpassed, 2)
        return PredictedMotion(motion, predicted, filtered, directions).slice_samples(self._skipped, end)
