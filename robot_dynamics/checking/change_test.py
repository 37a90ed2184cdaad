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
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from scipy.stats import f as f_distribution

from robot_dynamics.array_types import Array
from robot_dynamics.checking.whitening import shift_back, sums_to_end

if TYPE_CHECKING:
    from robot_dynamics.checking.fault_signals import FaultSignals
    from robot_dynamics.checking.whitening import WhiteningFilter

INDEPENDENCE_DURATION = 1.0  # [s] over which errors of a model are taken as independent
MIN_OUTLIER_VARIANCE = 4.0  # of the evidence in the worst block, relative to that in the mean of blocks, at least
MIN_BLOCK_INFORMATION = 0.3  # of a block that may be the worst one, relative to the mean of blocks
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
        everywhere = self.whitening(columns, joints)
        begun = everywhere.copy()
        begun[: change.row + self.whitening.order] = 0  # without the step at the onset, which one block has alone
        white = self._without_model_errors(begun, joints)
        residuals = self.white_residuals[:, joints]
        if is_constant_error:
            constant = self._without_model_errors(everywhere, joints)
            squares = np.einsum("tja,tjb->ab", constant, constant)
            inverse = np.linalg.inv(squares + (ROUNDING * np.trace(squares) + 1e-12) * np.eye(len(squares)))
            white = white - constant @ (inverse @ np.einsum("tja,tjb->ab", constant, white))
            residuals = residuals - constant @ (inverse @ np.einsum("tja,tj->a", constant, residuals))
        product = np.einsum("tja,tj->a", white, residuals)
        scatter = self._scatter(everywhere, white, residuals - white @ sizes)
        if scatter is None or not sizes.any():
            return 1.0
        a = len(sizes)
        statistic = min(
            product @ np.linalg.solve(covariance + 1e-12 * np.trace(covariance) * np.eye(a), product)
            for covariance in scatter.covariances
        )
        return float(f_distribution.sf(statistic / a, a, scatter.freedom))

    def _scatter(self, everywhere: Array, white: Array, unexplained: Array) -> Scatter | None:
        """Scatter of the product of a change with the residuals, which errors of the model cause; None for few blocks.

        All blocks of the recording tell how large the products of a block are, as parts of its information: the change
        itself may have begun a few seconds before the end.

        Parameters
        ----------
        everywhere : (N, k, a) white effect, as if the change was there from the first sample on.
        white : (N, k, a) white effect since the onset, without what constant errors of the model reproduce.
        unexplained : (N, k) white residuals without the change.
        """
        times = self.signals.times
        starts = np.unique(np.searchsorted(times, np.arange(times[0], times[-1], INDEPENDENCE_DURATION)))
        products = np.add.reduceat(everywhere * unexplained[..., None], starts, axis=0)  # (B, k, a)
        all_information = np.add.reduceat(np.square(everywhere).sum(axis=-1), starts, axis=0)  # (B, k)
        information = np.add.reduceat(np.square(white).sum(axis=-1), starts, axis=0)
        a = products.shape[-1]
        freedom = _effective_number(all_information.sum(axis=1)) - a - 1
        if freedom < 1:
            return None
        of_blocks = products.sum(axis=1)  # (B, a)
        outliers = _largest_ratio(np.square(of_blocks).sum(axis=1), all_information.sum(axis=1))
        factor = information.sum() / all_information.sum() * (1 + (a + 1) / freedom)
        factor *= 1 + max(MIN_OUTLIER_VARIANCE, outliers) / _effective_number(information)
        of_joints = products.reshape(-1, a)
        return Scatter((factor * of_blocks.T @ of_blocks, factor * of_joints.T @ of_joints), freedom)


class Scatter(NamedTuple):
    """Scatter of products, estimated from the scatter between blocks.

    covariances : (a, a) with errors of joints that are the same, and with errors of joints that are independent.
    freedom : degrees of freedom.
    """

    covariances: tuple[Array, Array]
    freedom: float


def _largest_ratio(squares: Array, information: Array) -> float:
    """Largest ratio of squares (B,) to information (B,) in a block, relative to the ratio in all blocks."""
    counts = information > MIN_BLOCK_INFORMATION * information.mean()
    if not squares.any() or not counts.any():
        return 0.0
    return float((squares[counts] / information[counts]).max() * information.sum() / squares.sum())


def _effective_number(information: Array) -> float:
    """Number of blocks with equal information that are as few as blocks with this information (B, ...)."""
    return float(information.sum() ** 2 / max((information**2).sum(), 1e-300))
