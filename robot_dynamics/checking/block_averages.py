"""Means over blocks of samples that grow with the stream: a stream of any length in bounded memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array


class BlockAverages:
    """Means over blocks of `stride` samples; when there are `max_rows` means, pairs are averaged and `stride` doubles.

    Parameters
    ----------
    stride : samples in a block at first.
    max_rows : number of means that are kept, even.
    """

    def __init__(self, stride: int, max_rows: int) -> None:
        self.stride = stride
        self.max_rows = max_rows
        self._parts: list[Array] = []  # (k, M, n) means
        self._count = 0
        self._remainder: Array | None = None  # (k, N, n) last samples, fewer than `stride`

    @property
    def rows(self) -> Array:
        """The means (k, M, n), without the last samples, fewer than `stride`."""
        return np.concatenate(self._parts, axis=1)

    def add(self, samples: Array) -> None:
        """Add samples (k, N, n)."""
        if self._remainder is not None:
            samples = np.concatenate([self._remainder, samples], axis=1)
        k, _, n = samples.shape
        while True:
            blocks = min(self.max_rows - self._count, samples.shape[1] // self.stride)
            complete, samples = np.split(samples, [blocks * self.stride], axis=1)
            self._parts.append(complete.reshape(k, blocks, self.stride, n).mean(axis=2))
            self._count += blocks
            if self._count < self.max_rows:
                break
            self._halve()
        self._remainder = samples.copy()

    def append(self, later: BlockAverages) -> None:
        """Append the means of later samples; samples that are no complete block are left out at both ends."""
        if not later._parts:
            return
        if not self._parts:
            self.stride, self._parts, self._count = later.stride, list(later._parts), later._count
            return
        while self.stride < later.stride:
            self._halve()
        while later.stride < self.stride:
            later._halve()
        self._parts += later._parts
        self._count += later._count
        self._remainder = None
        while self._count >= self.max_rows:
            self._halve()

    def _halve(self) -> None:
        """Average pairs of means; a last one without partner is left out."""
        rows = self.rows
        k, count, n = rows.shape
        self._parts = [rows[:, : count // 2 * 2].reshape(k, -1, 2, n).mean(axis=2)]
        self.stride = 2 * self.stride
        self._count = count // 2
