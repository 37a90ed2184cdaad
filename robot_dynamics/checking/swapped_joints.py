"""Two joints whose columns are swapped in the whole recording: their efforts, or positions and velocities too.

Nothing changes in such a recording, so that no change is found. The motion and the efforts are compared with the model
once more for each pair of joints, with its columns swapped back. A swap is named where it explains the
efforts of the robot much better than constant errors of the model do: offset, friction and scale of each joint.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from robot_dynamics.checking.fault_search import Fault

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from robot_dynamics.checking.check import Predictor
    from robot_dynamics.recordings.joint_motions import Motion

Pair: TypeAlias = tuple[int, int]

RATE = 20.0  # [Hz] of the samples that are kept
MIN_RATE = 1e-3  # [Hz] to which the rate is reduced
MAX_ROWS = 10_000  # samples that are kept
MIN_ROWS = 50  # samples in which a joint moves
MIN_IMPROVEMENT = 1.3  # factor by which a swap reduces residuals, in the geometric mean of two joints


class SwapSearch:
    """Keeps samples of a recording and finds two joints whose columns are swapped.

    Parameters
    ----------
    predictor : of the robot without fault.
    """

    def __init__(self, predictor: Predictor) -> None:
        self._predictor = predictor
        self._motions: list[Motion] = []
        self._rows = 0  # of all motions
        self._rate = RATE

    def add(self, motion: Motion) -> None:
        """Keep some samples of a motion."""
        self._motions.append(motion.slice_samples(0, len(motion), max(1, round(motion.rate / self._rate))))
        self._rows += len(self._motions[-1])
        if self._rows > MAX_ROWS:
            self._halve()
            self._rate = max(MIN_RATE, self._rate / 2)

    def _halve(self) -> None:
        """Keep each second sample, and of the motions with a single sample each second one."""
        single = [each for each in self._motions if len(each) == 1]
        dropped = {id(each) for each in single[1::2]}
        self._motions = [each.slice_samples(0, len(each), 2) for each in self._motions if id(each) not in dropped]
        self._rows = sum(map(len, self._motions))

    def append(self, later: SwapSearch) -> None:
        """Add the samples of a later part of the same recording."""
        for motion in later._motions:
            self.add(motion)

    def find_swapped_columns(self, names: Sequence[str]) -> Fault | None:
        """Find the pair of joints whose positions, velocities and efforts are swapped; None where there is none.

        Parameters
        ----------
        names : of the n joints.
        """
        return self._find_swap(names, "the columns", lambda pair: _Columns(pair, pair))

    def find_swapped_efforts(self, names: Sequence[str]) -> Fault | None:
        """Find the pair of joints whose efforts are swapped; names: of the n joints; None where there is none."""
        return self._find_swap(names, "efforts", lambda pair: _Columns((), pair))

    def _find_swap(self, names: Sequence[str], what: str, columns_of: Callable[[Pair], _Columns]) -> Fault | None:
        if not self._motions:
            return None
        moves = np.concatenate([motion.moving & motion.has_efforts for motion in self._motions])
        joints = np.flatnonzero(moves.sum(axis=0) >= MIN_ROWS).tolist()
        if len(joints) < 2:
            return None
        sound = self._log_residuals(_Columns((), ()), joints, with_scale=True)
        improvements = {
            pair: sound - self._log_residuals(columns_of(pair), joints, with_scale=False)
            for pair in combinations(joints, 2)
        }
        best = max(improvements, key=lambda pair: improvements[pair])
        if improvements[best] < 2 * np.log(MIN_IMPROVEMENT):
            return None
        swapped = names[best[0]], names[best[1]]
        start = self._motions[0].time
        sentence = f"{what} of {swapped[0]} and {swapped[1]} are swapped, from the start"
        return Fault("swapped", swapped, start, (start, start), None, None, sentence)

    def _log_residuals(self, columns: _Columns, joints: Sequence[int], *, with_scale: bool) -> float:
        """Sum of the logarithms of the RMS residuals of some joints, beside constant errors of the model.

        columns : those that are swapped; with_scale: whether the scale is one of these errors.
        """
        motions = [_swap_motion(motion, columns.motion) for motion in self._motions]
        predicted = np.concatenate([self._predictor(motion) for motion in motions])
        efforts = np.concatenate([motion.efforts for motion in self._motions])
        efforts = efforts[:, _order(efforts.shape[1], columns.efforts)]
        velocities = np.concatenate([motion.qd for motion in motions])
        moves = np.concatenate([motion.moving for motion in motions])
        total = 0.0
        for joint in joints:
            rows = moves[:, joint]
            velocity = velocities[rows, joint]
            errors = [np.ones(len(velocity)), velocity, np.sign(velocity)]
            errors += [predicted[rows, joint]] if with_scale else []
            stacked = np.stack(errors, axis=1)
            residual = efforts[rows, joint] - predicted[rows, joint]
            residual = residual - stacked @ np.linalg.lstsq(stacked, residual, rcond=None)[0]
            total += 0.5 * float(np.log(np.mean(residual**2) + 1e-30))
        return total


class _Columns(NamedTuple):
    """Columns that are swapped.

    motion, efforts : two joints whose positions and velocities, and efforts, are swapped; empty: none.
    """

    motion: tuple[int, ...]
    efforts: tuple[int, ...]


def _order(joints: int, pair: tuple[int, ...]) -> list[int]:
    """The column of each of n joints; pair: two joints that are swapped, or empty."""
    order = list(range(joints))
    for joint, column in zip(pair, reversed(pair), strict=True):
        order[joint] = column
    return order


def _swap_motion(motion: Motion, pair: tuple[int, ...]) -> Motion:
    """The motion with positions and velocities of two joints swapped."""
    order = _order(motion.q.shape[1], pair)
    q, qd, qdd = (values[:, order] for values in (motion.q, motion.qd, motion.qdd))
    return replace(motion, q=q, qd=qd, qdd=qdd, moving=motion.moving[:, order])
