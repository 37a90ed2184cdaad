"""Sums over the samples of recordings: what processes exchange, and what fits and their quality are computed from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.triangular_factors import TriangularFactors

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.identification.motion_blocks import MotionBlocks

NO_SAMPLES = "no sample is left to fit or to validate: samples at rest do not count"


@dataclass(frozen=True, eq=False)
class FitQuality:
    """Residuals of identified values on some samples of n joints, those at rest excepted.

    Attributes
    ----------
    rms : (n,) array
        Root mean square of the residuals in the band of the parallel filter [N m or N]; 0 for a joint that rests.
    rms_unfiltered : (n,) array
        Root mean square of the unfiltered residuals [N m or N].
    spread : (n,) array
        Standard deviation of the efforts in the band [N m or N].
    samples : int
        Number of samples before decimation.
    moving : (n,) array
        Part of the samples at which each joint moves, 0 to 1.
    """

    rms: Array
    rms_unfiltered: Array
    spread: Array
    samples: int
    moving: Array


@dataclass(frozen=True, eq=False)
class FactorSums:
    """Triangular factors of blocks of rows; None: no rows.

    effective_samples: (n,) number of independent samples of each joint, for white noise before the filter.
    """

    blocks: MotionBlocks | None
    effective_samples: Array

    def __add__(self, other: FactorSums) -> FactorSums:
        if other.blocks is None:
            return self
        if self.blocks is None:
            return other
        return FactorSums(self.blocks + other.blocks, self.effective_samples + other.effective_samples)

    @cached_property
    def factors(self) -> TriangularFactors | None:
        """Triangular factors of all rows."""
        return None if self.blocks is None else TriangularFactors.sum(self.blocks.factors)


@dataclass(frozen=True, eq=False)
class QualitySums:
    """Sums from which FitQuality follows, for K sets of values.

    residuals: (K, n) sums of squared residuals over filtered rows; efforts: (2, n) sums of squared efforts and of
    efforts; rows: (n,) their numbers; unfiltered: (K, n) sums of squared unfiltered residuals over moving (n,) samples;
    samples: number of samples.
    """

    residuals: Array
    efforts: Array
    rows: IntArray
    unfiltered: Array
    moving: IntArray
    samples: int

    def __add__(self, other: QualitySums) -> QualitySums:
        return QualitySums(
            self.residuals + other.residuals,
            self.efforts + other.efforts,
            self.rows + other.rows,
            self.unfiltered + other.unfiltered,
            self.moving + other.moving,
            self.samples + other.samples,
        )

    @property
    def qualities(self) -> tuple[FitQuality, ...]:
        """The FitQuality of each set of values. Raises RecordingError if there is no sample."""
        if not self.rows.any():
            raise RecordingError(NO_SAMPLES)
        rows = np.maximum(self.rows, 1)
        moving = np.maximum(self.moving, 1)
        squares, mean = self.efforts / rows
        spread = np.sqrt(np.maximum(squares - mean**2, 0))
        share = self.moving / max(1, self.samples)
        return tuple(
            FitQuality(np.sqrt(residuals / rows), np.sqrt(unfiltered / moving), spread, self.samples, share)
            for residuals, unfiltered in zip(self.residuals, self.unfiltered, strict=True)
        )
