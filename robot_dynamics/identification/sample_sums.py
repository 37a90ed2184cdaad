"""Sums over the samples of recordings: what processes exchange, and what fits and their quality are computed from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import RecordingError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.identification.triangular_factors import TriangularFactors

NO_SAMPLES = "no sample is left to fit or to validate"


@dataclass(frozen=True, eq=False)
class FitQuality:
    """Residuals of identified values on some samples of n joints.

    Attributes
    ----------
    rms : (n,) array
        Root mean square of the residuals in the band of the parallel filter [N m or N].
    rms_unfiltered : (n,) array
        Root mean square of the unfiltered residuals [N m or N].
    spread : (n,) array
        Standard deviation of the efforts in the band [N m or N].
    samples : int
        Number of samples before decimation.
    """

    rms: Array
    rms_unfiltered: Array
    spread: Array
    samples: int


@dataclass(frozen=True, eq=False)
class FactorSums:
    """Triangular factors of a number of rows; effective_samples: number of independent samples among the rows."""

    factors: TriangularFactors | None
    effective_samples: float = 0.0
    rows: int = 0

    def __add__(self, other: FactorSums) -> FactorSums:
        if other.factors is None:
            return self
        if self.factors is None:
            return other
        return FactorSums(
            self.factors + other.factors, self.effective_samples + other.effective_samples, self.rows + other.rows
        )


@dataclass(frozen=True, eq=False)
class QualitySums:
    """Sums from which FitQuality follows.

    in_band: (3, n) sums of squared residuals, squared efforts, and efforts, over filtered rows; rows: their number;
    squares: (n,) sums of squared unfiltered residuals; samples: their number.
    """

    in_band: Array
    rows: int
    squares: Array
    samples: int

    def __add__(self, other: QualitySums) -> QualitySums:
        return QualitySums(
            self.in_band + other.in_band,
            self.rows + other.rows,
            self.squares + other.squares,
            self.samples + other.samples,
        )

    @property
    def quality(self) -> FitQuality:
        """The FitQuality. Raises RecordingError if there is no sample."""
        if not self.rows:
            raise RecordingError(NO_SAMPLES)
        residuals, efforts, mean = self.in_band / self.rows
        spread = np.sqrt(np.maximum(efforts - mean**2, 0))
        return FitQuality(np.sqrt(residuals), np.sqrt(self.squares / self.samples), spread, self.samples)
