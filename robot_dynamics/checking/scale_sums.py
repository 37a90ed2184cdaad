"""The scale of efforts: the factor from the predicted to the measured effort of a joint, with its uncertainty.

Friction changes with temperature and load by tens of percent, a drive gain does not. The scale is therefore fitted
beside an offset and a change of Coulomb and viscous friction:

    measured = scale · predicted + offset + ΔFs · sign(q̇) + ΔFv · q̇ + error

Its standard deviation follows from the scatter of sums over blocks of one second or more, as neighbouring errors are
correlated (a sandwich estimator with blocks as clusters; Liang and Zeger, "Longitudinal data analysis using generalized
linear models", 1986). Errors of the model that are the same in all blocks do not scatter. Two of them are added: a
correlation of errors with the prediction (`ERROR_CORRELATION`), and a part of the friction that is not described by
Coulomb and viscous friction (`FRICTION_ERROR`). Where nearly all of the effort is friction the scale is thus uncertain.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray

REGRESSORS = 4  # predicted effort, 1, direction, velocity
MEASURED = 4  # column of the measured effort
ONE = 1  # column of ones
DIRECTION = 2  # column of the signs of velocities
MAX_BLOCKS = 1024  # beyond, neighbouring blocks are merged
MIN_BLOCKS = 8  # of a second or more, for a standard deviation
ERROR_CORRELATION = 0.1  # of errors of the model with the prediction
FRICTION_ERROR = 0.03  # part of the effort that the friction columns explain: 10 % of it with a correlation of 0.3
MIN_RELATIVE_VARIANCE = 1e-9  # of a regressor that the others do not explain; below it there is no scale


class Scale(NamedTuple):
    """The scale of a joint and its standard deviation; nan where they cannot be computed."""

    value: float
    deviation: float


class ScaleSums:
    """Sums of products over blocks of samples, from which the scales of n joints follow.

    Attributes
    ----------
    total : (n, 5, 5) sums over all samples of x xᵀ, with x = (predicted, 1, direction, velocity, measured).
    """

    def __init__(self, joints: int) -> None:
        self.total = np.zeros((joints, REGRESSORS + 1, REGRESSORS + 1))
        self._blocks: dict[int, Array] = {}  # (n, 5, 5) by their number
        self._width = 1  # of a block, in windows

    def add(self, number: int, columns: Array, counted: BoolArray) -> None:
        """Add the samples of a window.

        Parameters
        ----------
        number : of the window.
        columns : (5, N, n) predicted efforts, ones, directions, velocities, measured efforts.
        counted : (N, n) samples that count.
        """
        masked = np.where(counted, columns, 0.0)
        products = np.einsum("ink,jnk->kij", masked, masked)
        self.total += products
        block = number // self._width
        self._blocks[block] = self._blocks.get(block, 0) + products
        while len(self._blocks) > MAX_BLOCKS:
            self._merge_blocks()

    def append(self, later: ScaleSums, shift: Array) -> None:
        """Add the sums of later samples, whose efforts were smaller by shift (n,) [N m or N] when they were added."""
        T = np.tile(np.eye(REGRESSORS + 1), (len(shift), 1, 1))
        T[:, 0, ONE] = T[:, MEASURED, ONE] = shift
        self.total += T @ later.total @ T.transpose(0, 2, 1)
        while self._width < later._width:
            self._merge_blocks()
        while later._width < self._width:
            later._merge_blocks()
        for number, products in later._blocks.items():
            self._blocks[number] = self._blocks.get(number, 0) + T @ products @ T.transpose(0, 2, 1)
        while len(self._blocks) > MAX_BLOCKS:
            self._merge_blocks()

    def _merge_blocks(self) -> None:
        merged: dict[int, Array] = {}
        for number, products in self._blocks.items():
            merged[number // 2] = merged.get(number // 2, 0) + products
        self._blocks = merged
        self._width = 2 * self._width

    def scales(self) -> list[Scale]:
        """The scale of each joint."""
        blocks = np.array(list(self._blocks.values())).reshape(-1, *self.total.shape)
        return [_fit_scale(total, blocks[:, joint]) for joint, total in enumerate(self.total)]


def _fit_scale(total: Array, blocks: Array) -> Scale:
    """The scale from the sums (5, 5) of a joint and those of blocks (B, 5, 5)."""
    count = total[ONE, ONE]
    norms = np.sqrt(np.diagonal(total))
    if count == 0 or norms[0] == 0 or not np.isfinite(total).all():
        return Scale(np.nan, np.nan)
    norms = np.where(norms > 0, norms, 1.0)
    squares = (total / np.outer(norms, norms))[:REGRESSORS, :REGRESSORS]
    inverse = np.linalg.pinv(squares, rcond=MIN_RELATIVE_VARIANCE, hermitian=True)
    # part of the squares of the prediction that the other regressors do not explain
    others = np.linalg.pinv(squares[1:, 1:], rcond=MIN_RELATIVE_VARIANCE, hermitian=True)
    unexplained = float(squares[0, 0] - squares[0, 1:] @ others @ squares[1:, 0])
    if unexplained < MIN_RELATIVE_VARIANCE:
        return Scale(np.nan, np.nan)
    products = total[:REGRESSORS, MEASURED] / norms[:REGRESSORS]
    coefficients = inverse @ products
    value = float(coefficients[0] / norms[0])
    used = blocks[blocks[:, ONE, ONE] > 0]
    if len(used) < MIN_BLOCKS:
        return Scale(value, np.nan)
    weights = coefficients / norms[:REGRESSORS]
    scores = used[:, :REGRESSORS, MEASURED] - used[:, :REGRESSORS, :REGRESSORS] @ weights
    influences = (scores / norms[:REGRESSORS]) @ inverse[0] / norms[0]
    scatter = (influences**2).sum() * len(used) / (len(used) - REGRESSORS)
    # sums of squares: of the errors; of the prediction, less its mean; of its part that is no friction
    errors = max(0.0, float(total[MEASURED, MEASURED] - total[:REGRESSORS, MEASURED] @ weights))
    varying = float(total[0, 0] - total[0, ONE] ** 2 / count)
    rigid = unexplained * norms[0] ** 2
    model_error = (ERROR_CORRELATION**2 * errors + FRICTION_ERROR**2 * max(0.0, varying - rigid)) / rigid
    return Scale(value, float(np.sqrt(scatter + model_error)))
