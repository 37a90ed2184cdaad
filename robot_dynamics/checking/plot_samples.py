"""Samples of a recording of any length for figures: every k-th, at equal distances."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.checking.prediction_filter import PredictedMotion

MAX_PLOT_SAMPLES = 4000  # kept, and up to twice as many


class PlotSamples(NamedTuple):
    """times (K,) [s]; measured and predicted efforts, filtered, and velocities (K, n); moving (K, n): not at rest."""

    times: Array
    measured: Array
    predicted: Array
    velocities: Array
    moving: BoolArray


class PlotSampler:
    """Keeps every k-th sample; k doubles whenever too many are kept."""

    def __init__(self) -> None:
        self._parts: list[Array] = []  # (5, N, n): the fields of PlotSamples
        self._stride = 1
        self._phase = 0

    def add(self, part: PredictedMotion) -> None:
        """Add a motion and its predicted efforts."""
        motion = part.motion
        picked = slice((-self._phase) % self._stride, None, self._stride)
        self._phase += len(motion)
        times = np.broadcast_to(motion.times[:, None], motion.q.shape)
        signals = (times, motion.efforts, part.filtered, motion.qd, motion.moving)
        self._parts.append(np.stack([each[picked] for each in signals]))
        self._limit_samples()

    def append(self, later: PlotSampler) -> None:
        """Append the samples of a later part of the recording."""
        while self._stride < later._stride:
            self._halve()
        while later._stride < self._stride:
            later._halve()
        self._parts += later._parts
        self._limit_samples()

    def _limit_samples(self) -> None:
        while sum(part.shape[1] for part in self._parts) > 2 * MAX_PLOT_SAMPLES:
            self._halve()

    def _halve(self) -> None:
        self._stride = 2 * self._stride
        if self._parts:
            samples = np.concatenate(self._parts, axis=1)[:, ::2].copy()
            self._parts = [samples]
            self._phase = self._stride * samples.shape[1]

    @property
    def samples(self) -> PlotSamples:
        """The samples that are kept."""
        times, measured, predicted, velocities, moving = np.concatenate(self._parts, axis=1)
        return PlotSamples(times[:, 0], measured, predicted, velocities, moving > 0)
