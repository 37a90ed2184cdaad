"""Condition number of the identification columns along a motion, and its gradient.

Let X be the columns at all samples, each divided by its length, λ and v the eigenvalues and eigenvectors of XᵀX, and
u = Xv:

    log cond = ½ (log λ_max - log λ_min),   dλ = 2 uᵀ dX v,   dX_j = (dx_j - X_j X_jᵀ dx_j) / |x_j|

So dλ is a weighted sum of derivatives of the entries of the columns x. One reverse sweep through the program of the
regressor gives its derivatives by q, q̇ and q̈.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from robot_dynamics.codegen.trace.derivatives import DifferentiableProgram
from robot_dynamics.codegen.trace.models import regressor_model
from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.codegen.trace.derivatives import Evaluation
    from robot_dynamics.identification.identification_model import IdentificationModel

ROUNDING = 1e-14  # smallest eigenvalue that is used, relative to the largest


class LogConditionNumber:
    """Logarithm of the condition number of an IdentificationModel, for robots with a fixed base and without loops.

    widths: (n,) [rad/s or m/s] of the velocity range over which Coulomb friction changes its sign, which makes the
    value differentiable; None: the sign is a step.

    Raises InvalidInputError if the efforts exclude gravity: some columns are then zero for every motion.
    """

    def __init__(self, model: IdentificationModel, widths: Array | None = None) -> None:
        robot = model.dynamics.robot
        if model.drives.excludes_gravity:
            raise InvalidInputError(
                f"{robot.name!r}: the measured efforts exclude gravity (effort_excludes_gravity). An excitation "
                "trajectory needs efforts that include gravity"
            )
        self.model = model
        self.n = len(model.dynamics.joint_names)
        size = len(model.base_parameters.names)
        entries = [row * size + index for row in range(self.n) for index in model.parameter_indices]
        smoothing_widths = None if widths is None else {"qd": widths}
        self._program = DifferentiableProgram(regressor_model(robot), entries, smoothing_widths)

    def __call__(self, q: Array, qd: Array, qdd: Array) -> float:
        """Compute the value at samples (N, n) of a motion."""
        X, _ = self._unit_columns(self._program.evaluate(q, qd, qdd), qd, qdd)
        return _log_condition(np.linalg.eigvalsh(_gram_matrix(X)))

    def with_gradient(self, q: Array, qd: Array, qdd: Array) -> tuple[float, tuple[Array, Array, Array]]:
        """Compute the value and its derivatives by q, qd and qdd, (N, n) each."""
        evaluation = self._program.evaluate(q, qd, qdd)
        X, lengths = self._unit_columns(evaluation, qd, qdd)
        eigenvalues, vectors = np.linalg.eigh(_gram_matrix(X))
        weights = np.zeros_like(X)
        for index, sign in ((-1, 0.5), (0, -0.5)):
            eigenvalue = max(eigenvalues[index], ROUNDING * eigenvalues[-1])
            v = vectors[:, index]
            weights += sign / eigenvalue * 2 * (np.outer(X @ v, v) - eigenvalue * v**2 * X)
        weights = (weights / lengths).reshape(len(q), self.n, -1)
        return _log_condition(eigenvalues), self._motion_gradient(evaluation, weights)

    def _unit_columns(self, evaluation: Evaluation, qd: Array, qdd: Array) -> tuple[Array, Array]:
        """Return the columns (N n, P), scaled to length 1, and their original lengths (P,); 1 for zero columns."""
        Y = evaluation.outputs.reshape(len(qd), self.n, -1)
        offsets = np.broadcast_to(np.eye(self.n), (len(Y), self.n, self.n))
        X = np.concatenate([Y, offsets, self.model.drives.coupling_regressor(qd, qdd)], axis=-1)
        X = X.reshape(-1, X.shape[-1])
        lengths = np.linalg.norm(X, axis=0)
        lengths = np.where(lengths > 0, lengths, 1.0)
        return X / lengths, lengths

    def _motion_gradient(self, evaluation: Evaluation, weights: Array) -> tuple[Array, Array, Array]:
        """Compute the derivatives by q, qd and qdd (N, n) of Σ weights * columns, for weights (N, n, P)."""
        size = len(self.model.parameter_indices)
        gradient = self._program.gradient(evaluation, weights[..., :size].reshape(len(weights), -1))
        by_q, by_qd, by_qdd = (gradient[name] for name in ("q", "qd", "qdd"))
        coupling_weights = weights[..., size + self.n :]
        for index, w in enumerate(self.model.drives.coupling_ratios.values()):
            for shift, derivative in ((0, by_qdd), (1, by_qd)):
                share = coupling_weights[..., 3 * index + shift]
                derivative += (share @ w)[:, None] * w - w * w * share
        return by_q, by_qd, by_qdd


def _log_condition(eigenvalues: NDArray[np.floating]) -> float:
    """Compute the value from the ascending eigenvalues of XᵀX."""
    return float(0.5 * np.log(eigenvalues[-1] / max(eigenvalues[0], ROUNDING * eigenvalues[-1])))


def _gram_matrix(X: Array) -> Array:
    """Compute XᵀX without BLAS threads, whose synchronisation takes longer than the product."""
    product: Array = np.einsum("ij,ik->jk", X, X)
    return product
