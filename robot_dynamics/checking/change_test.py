"""Test whether a change that begins at some sample explains residuals, beside the constant errors of the model.

A change adds columns times sizes to the residuals of some joints from its onset on. For each sample as onset the sizes
are fitted together with the constant errors of the model: offset, friction, scale, delay and response of each joint.
The gain is the reduction of the squares of white residuals (Basseville and Nikiforov, "Detection of Abrupt Changes",
1993, chapter 7).

The significance of a change is not computed from the gain, which takes the errors of the model for white noise. It is
computed from the scatter of the evidence between blocks of the recording: a change that is real shows in all blocks
after its onset, the error of a model in some of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.stats import f as f_distribution

from robot_dynamics.array_types import Array
from robot_dynamics.checking.whitening import shift_back, sums_to_end

if TYPE_CHECKING:
    from robot_dynamics.checking.fault_signals import FaultSignals
    from robot_dynamics.checking.whitening import WhiteningFilter

INDEPENDENCE_DURATION = 1.0  # [s] over which errors of a model are taken as independent
OUTLIER_VARIANCE = 15.0  # of the evidence in the worst block, relative to that in the mean of blocks
RIDGE = 1e-3  # regularisation of the response of joints, as a part of the squares of its columns
MIN_DISTINCT_PART = 3e-3  # of the squares of a change that constant errors of the model do not reproduce: less is noise
ROUNDING = 1e-6  # regularisation of all other columns

SizeFit: TypeAlias = Callable[[Array, Array], Array]
"""Fits sizes (N, a) to the normal equations (N, a, a), (N, a), within physical bounds."""


@dataclass(frozen=True, eq=False)
class Change:
    """A change of the residuals with its best onset.

    Attributes
    ----------
    gains : (N,) reduction of the squares of white residuals for an onset at each sample; 0 where none may be.
    row : sample with the largest gain.
    sizes : (a,) sizes for this onset.
    effect : (N, n) effect on the residuals for this onset [N m or N].
    """

    gains: Array
    row: int
    sizes: Array
    effect: Array

    @property
    def gain(self) -> float:
        """The gain of the best onset."""
        return float(self.gains[self.row])


class ChangeTest:
    """Tests changes of residuals.

    Parameters
    ----------
    signals : residuals and their predictors.
    whitening : filter of the noise.
    residuals : (N, n) residuals to test; those of the signals, or without an effect that is known.

    Attributes
    ----------
    model_errors : (N, n) constant errors of the model, fitted without a change.
    white_residuals : (N, n) white residuals without these errors.
    """

    def __init__(self, signals: FaultSignals, whitening: WhiteningFilter, residuals: Array) -> None:
        self.signals = signals
        self.whitening = whitening
        white = whitening(residuals)
        self._columns: list[Array] = []  # (N, K) of each joint, white
        self._inverses: list[Array] = []  # (K, K)
        self.model_errors = np.zeros_like(residuals)
        self.white_residuals = np.zeros_like(residuals)  # without model errors
        for joint in range(residuals.shape[1]):
            columns, free = signals.model_error_columns[joint]
            white_columns = whitening(columns[:, None], [joint])[:, 0]
            lengths = np.linalg.norm(white_columns, axis=0) + 1e-12
            white_columns = white_columns / lengths
            ridge = np.full(len(lengths), RIDGE)
            ridge[:free] = ROUNDING
            inverse = np.linalg.inv(white_columns.T @ white_columns + np.diag(ridge))
            coefficients = inverse @ (white_columns.T @ white[:, joint])
            self._columns.append(white_columns)
            self._inverses.append(inverse)
            self.white_residuals[:, joint] = white[:, joint] - white_columns @ coefficients
            self.model_errors[:, joint] = columns @ (coefficients / lengths)

    def fit(
        self, columns: Array, joints: list[int], fit_sizes: SizeFit, onsets: slice, *, is_constant_error: bool
    ) -> Change:
        """Fit a change.

        Parameters
        ----------
        columns : (N, k, a) effect on k joints for unit values of a sizes.
        joints : numbers of the k joints.
        fit_sizes : fits the sizes.
        onsets : samples that may be the onset.
        is_constant_error : whether the same effect over the whole recording is an error of the model.
        """
        squares, products = self._normal_equations(columns, joints, is_constant_error)
        sizes = fit_sizes(squares, products)
        gains = np.zeros(len(columns))
        all_gains = 2 * np.einsum("ta,ta->t", sizes, products) - np.einsum("ta,tab,tb->t", sizes, squares, sizes)
        gains[onsets] = np.maximum(all_gains[onsets], 0)
        row = int(np.argmax(gains))
        effect = np.zeros_like(self.white_residuals)
        effect[row:, joints] = columns[row:] @ sizes[row]
        return Change(gains, row, sizes[row], effect)

    def _normal_equations(self, columns: Array, joints: list[int], is_constant_error: bool) -> tuple[Array, Array]:
        """squares (N, a, a) and products (N, a) of a change that begins at each sample, without model errors."""
        order = self.whitening.order
        white = self.whitening(columns, joints)
        residuals = self.white_residuals[:, joints]
        first = [self.whitening.first_samples(columns, lag, joints) for lag in range(order)]

        def sums(values: Array, rows: slice = slice(None)) -> Array:
            """Sums (N, a, ...) of products of a change that begins at each sample with values (N, k, ...)."""
            total: Array = shift_back(sums_to_end(np.einsum("tja,tj...->ta...", white[:, rows], values)), order)
            for lag, begun in enumerate(first):
                total += np.einsum("tja,tj...->ta...", begun[:, rows], shift_back(values, lag))
            return total

        products: Array = sums(residuals)
        level = sums(white)  # with the same effect over the whole recording
        squares: Array = shift_back(sums_to_end(np.einsum("tja,tjb->tab", white, white)), order)
        for begun in first:
            squares += np.einsum("tja,tjb->tab", begun, begun)
        ridge = MIN_DISTINCT_PART * np.diagonal(squares, axis1=1, axis2=2).copy()
        constant_squares = np.einsum("tja,tjb->ab", white, white)
        for index, joint in enumerate(joints):
            cross = sums(self._columns[joint][:, None], slice(index, index + 1))
            weighted = cross @ self._inverses[joint]
            constant = np.einsum("ta,tk->ak", white[:, index], self._columns[joint])
            squares -= weighted @ cross.transpose(0, 2, 1)
            level -= weighted @ constant.T
            constant_squares -= constant @ self._inverses[joint] @ constant.T
        rounding = (ROUNDING * np.trace(squares[0]) + 1e-12) * np.eye(squares.shape[-1])
        if is_constant_error:
            inverse = np.linalg.inv(constant_squares + rounding)
            squares -= level @ inverse @ level.transpose(0, 2, 1)
            products -= level @ (inverse @ np.einsum("tja,tj->a", white, residuals))
        squares += rounding + ridge[:, :, None] * np.eye(squares.shape[-1])
        return squares, products

    def _without_model_errors(self, white: Array, joints: list[int]) -> Array:
        """White columns (N, k, a) of k joints without the part that constant errors of the model reproduce."""
        remaining: Array = white.copy()
        for index, joint in enumerate(joints):
            error_columns = self._columns[joint]
            remaining[:, index] -= error_columns @ (self._inverses[joint] @ (error_columns.T @ white[:, index]))
        return remaining

    def p_value(self, change: Change, columns: Array, joints: list[int], *, is_constant_error: bool) -> float:
        """Probability of evidence as strong for a change, if errors of the model of independent blocks were its cause.

        columns, joints, is_constant_error: as for `fit`, which returned the change.
        """
        sizes = change.sizes
        begun = self.whitening(columns, joints)
        everywhere = self._without_model_errors(begun, joints)
        begun[: change.row + self.whitening.order] = 0  # without the step at the onset, which one block has alone
        white = self._without_model_errors(begun, joints)
        residuals = self.white_residuals[:, joints]
        if is_constant_error:
            squares = np.einsum("tja,tjb->ab", everywhere, everywhere)
            inverse = np.linalg.inv(squares + (ROUNDING * np.trace(squares) + 1e-12) * np.eye(len(squares)))
            white = white - everywhere @ (inverse @ np.einsum("tja,tjb->ab", everywhere, white))
            residuals = residuals - everywhere @ (inverse @ np.einsum("tja,tj->a", everywhere, residuals))
        unexplained = residuals - white @ sizes
        times = self.signals.times
        starts = np.unique(np.searchsorted(times, np.arange(times[0], times[-1], INDEPENDENCE_DURATION)))
        scores = np.add.reduceat(np.einsum("tja,tj->ta", everywhere, unexplained), starts, axis=0)
        all_information = np.add.reduceat(np.einsum("tja,tja->t", everywhere, everywhere), starts)
        information = np.add.reduceat(np.einsum("tja,tja->t", white, white), starts)
        a = len(sizes)
        freedom = _effective_number(all_information) - a - 1
        if freedom < 1 or not sizes.any():
            return 1.0
        share = information.sum() / all_information.sum()
        outliers = 1 + OUTLIER_VARIANCE / _effective_number(information)
        scatter = share * outliers * (scores.T @ scores) * (1 + (a + 1) / freedom)
        product = np.einsum("tja,tj->a", white, residuals)
        statistic = product @ np.linalg.solve(scatter + 1e-12 * np.trace(scatter) * np.eye(a), product)
        return float(f_distribution.sf(statistic / a, a, freedom))


def _effective_number(information: Array) -> float:
    """Number of blocks with equal information that are as few as blocks with this information (B,)."""
    return float(information.sum() ** 2 / max((information**2).sum(), 1e-300))
