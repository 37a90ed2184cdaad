"""Blocks of samples whose residuals are taken as independent of each other: pieces of motion of a second.

Residuals of real robots are noise and errors of the model: friction that changes with temperature and load, elasticity,
ripple of gears. Errors of the model are similar at similar times and in similar motions. Samples of one second belong
to one block therefore, and so do the samples of a motion that is repeated, in one recording or in several: a repeated
motion tells nothing new of the errors of the model. The scatter between blocks gives the uncertainty of parameters
(`block_scatter`).

Blocks travel between processes as triangular factors, so their number is limited: neighbouring blocks of a recording
are merged, those with the fewest rows first. The result does not depend on the number of processes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray
    from robot_dynamics.identification.triangular_factors import TriangularFactors

MOTION_BLOCK_DURATION = 1.0  # [s]
MAX_BLOCKS = 64
MAX_SHIFT = 0.5  # of a block, between a motion and its repetition
POSITION_TOLERANCE = 0.1  # of the travel of a joint in a block, within which a motion counts as repeated
VELOCITY_TOLERANCE = 4.0  # times the tolerance of positions, per block duration
MIN_TOLERANCE = 1e-3  # [rad or m]


class MotionSummary(NamedTuple):
    """Motion in blocks: mean positions, mean velocities, mean accelerations and travel, each (..., n)."""

    positions: Array
    velocities: Array
    accelerations: Array
    travel: Array

    @classmethod
    def of_samples(cls, q: Array, qd: Array) -> MotionSummary:
        """Summarise the samples (N, n) of one block."""
        accelerations = (qd[-1] - qd[0]) / MOTION_BLOCK_DURATION
        return cls(q.mean(0), qd.mean(0), accelerations, np.abs(qd).mean(0) * MOTION_BLOCK_DURATION)

    def repetitions(self, block: MotionSummary) -> BoolArray:
        """Which of S motions (S, n) are the same as that of one block (n,), but for a shift in time."""
        velocity = 0.5 * (self.velocities + block.velocities)
        distance = block.positions - self.positions
        speed = np.maximum((velocity**2).sum(-1), 1e-12)
        shift = np.clip(
            (distance * velocity).sum(-1) / speed, -MAX_SHIFT * MOTION_BLOCK_DURATION, MAX_SHIFT * MOTION_BLOCK_DURATION
        )
        tolerance = POSITION_TOLERANCE * np.maximum(self.travel, block.travel) + MIN_TOLERANCE
        change = shift[:, None] * 0.5 * (self.accelerations + block.accelerations)
        near = np.abs(distance - shift[:, None] * velocity) < tolerance
        similar = (
            np.abs(block.velocities - self.velocities - change) < VELOCITY_TOLERANCE * tolerance / MOTION_BLOCK_DURATION
        )
        same: BoolArray = (near & similar).all(-1)
        return same


@dataclass(frozen=True, eq=False)
class MotionBlocks:
    """Blocks of samples as triangular factors.

    Attributes
    ----------
    factors : tuple of TriangularFactors
        Triangular factors of each block.
    recordings : tuple of str
        Name of the recording of each block, the first one for a motion that is repeated.
    motions : MotionSummary
        Motions of S seconds, each with arrays (S, n).
    owners : (S,) array
        Number of the block that each motion belongs to.
    """

    factors: tuple[TriangularFactors, ...]
    recordings: tuple[str, ...]
    motions: MotionSummary
    owners: IntArray

    @classmethod
    def of_samples(cls, recording: str, q: Array, qd: Array, factors: TriangularFactors) -> MotionBlocks:
        """One block of samples with positions and velocities (N, n)."""
        motion = MotionSummary.of_samples(q, qd)
        return cls((factors,), (recording,), MotionSummary(*(values[None] for values in motion)), np.zeros(1, int))

    def __len__(self) -> int:
        return len(self.factors)

    def __add__(self, other: MotionBlocks) -> MotionBlocks:
        factors = list(self.factors)
        recordings = list(self.recordings)
        new_owners = np.empty(len(other), dtype=int)
        is_new = np.zeros(len(other.owners), dtype=bool)
        for number, owner in enumerate(other._repeated_blocks(self)):
            if owner is None:
                new_owners[number] = len(factors)
                factors.append(other.factors[number])
                recordings.append(other.recordings[number])
                is_new |= other.owners == number
            else:
                factors[owner] = factors[owner] + other.factors[number]
        motions = MotionSummary(
            *(np.concatenate([a, b[is_new]]) for a, b in zip(self.motions, other.motions, strict=True))
        )
        owners = np.concatenate([self.owners, new_owners[other.owners[is_new]]])
        return _merge_neighbours(MotionBlocks(tuple(factors), tuple(recordings), motions, owners))

    def _repeated_blocks(self, earlier: MotionBlocks) -> Iterator[int | None]:
        """For each block, the earlier block that has most of its motions, if these are more than half of them."""
        for number in range(len(self)):
            votes = np.zeros(len(earlier), dtype=int)
            mine = np.flatnonzero(self.owners == number)
            for row in mine:
                same = earlier.motions.repetitions(MotionSummary(*(values[row] for values in self.motions)))
                if same.any():
                    votes[earlier.owners[int(np.argmax(same))]] += 1
            best = int(np.argmax(votes))
            yield best if votes[best] > len(mine) / 2 else None


def _merge_neighbours(blocks: MotionBlocks) -> MotionBlocks:
    """Merge neighbouring blocks, of one recording as long as there are any, until no more than MAX_BLOCKS are left."""
    factors = list(blocks.factors)
    recordings = list(blocks.recordings)
    owners = blocks.owners
    while len(factors) > MAX_BLOCKS:
        rows = np.array([int(part.samples.sum()) for part in factors])
        pairs = (rows[:-1] + rows[1:]).astype(float)
        same = np.array(recordings[:-1]) == np.array(recordings[1:])
        first = int(np.argmin(np.where(same, pairs, np.inf) if same.any() else pairs))
        factors[first : first + 2] = [factors[first] + factors[first + 1]]
        del recordings[first + 1]
        owners = owners - (owners > first)
    return MotionBlocks(tuple(factors), tuple(recordings), blocks.motions, owners)
