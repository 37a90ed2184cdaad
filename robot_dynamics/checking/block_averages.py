"""Means over ever more neighbours: a stream of any length in bounded memory."""

import numpy as np


class BlockAverages:
    """Rows that are means over `stride` samples; whenever there are `most` of them, pairs are averaged.

    most: even; rows: (k, M, n) of all that was `add`-ed, but for the last samples, fewer than `stride`.
    """

    def __init__(self, stride, max_rows):
        self.stride, self.max_rows = stride, max_rows
        self._parts, self._count, self._rest = [], 0, None

    @property
    def rows(self):
        return np.concatenate(self._parts, axis=1)

    def add(self, samples):
        """Take samples (k, N, n)."""
        samples = samples if self._rest is None else np.concatenate([self._rest, samples], axis=1)
        while True:
            whole = min(self.max_rows - self._count, samples.shape[1] // self.stride)
            k, _, n = samples.shape
            taken, samples = np.split(samples, [whole * self.stride], axis=1)
            self._parts.append(taken.reshape(k, whole, self.stride, n).mean(axis=2))
            self._count += whole
            if self._count < self.max_rows:
                break
            self._parts = [self.rows.reshape(k, -1, 2, n).mean(axis=2)]
            self.stride, self._count = 2 * self.stride, self.max_rows // 2
        self._rest = samples.copy()
