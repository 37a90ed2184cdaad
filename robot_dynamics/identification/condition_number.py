"""The condition number of the columns of efforts along a motion, and its gradient by positions, rates, accelerations.

With X the columns at all samples, each divided by its length, λ and v the eigenvalues and eigenvectors of XᵀX, u = Xv:

    log cond = ½ (log λ_max - log λ_min),   dλ = 2 uᵀ dX v,   dX_j = (dx_j - X_j X_jᵀ dx_j) / |x_j|

so that dλ is a weighted sum of derivatives of the entries x of columns, which one reverse sweep through the program of
the regressor gives by all of q, q̇ and q̈.
"""

import numpy as np

from robot_dynamics.codegen.trace.derivatives import DifferentiableProgram
from robot_dynamics.codegen.trace.models import regressor_model
from robot_dynamics.errors import InvalidInputError

ROUNDING = 1e-14  # part of the largest eigenvalue, below which the least one is taken as this


class LogConditionNumber:
    """The logarithm of the condition number of EffortColumns of a robot with a fixed base and without loops.

    widths: (n,) [rad/s or m/s] of velocities over which Coulomb friction changes its sign, so that it has a derivative;
    None: as it is, with a step.

    Raises QuestionError where efforts exclude gravity: some columns are then zero for every motion.
    """

    def __init__(self, columns, widths=None):
        robot = columns.dynamics.robot
        if columns.drives.excludes_gravity:
            raise InvalidInputError(f"{robot.name!r}: trajectories are designed for efforts that gravity is a part of, and "
                                "those of its drives exclude it")  # fmt: skip
        self.model, self.n = columns, len(columns.dynamics.joint_names)
        size = len(columns.base_parameters.names)
        entries = [row * size + number for row in range(self.n) for number in columns.parameter_indices]
        widths = None if widths is None else {"qd": widths}
        self._program = DifferentiableProgram(regressor_model(robot), entries, widths)

    def __call__(self, q, qd, qdd):
        """At samples (N, n) of a motion."""
        X, _ = self._unit_columns(self._program.evaluate(q, qd, qdd), qd, qdd)
        return _log_condition(np.linalg.eigvalsh(_products(X)))

    def with_gradient(self, q, qd, qdd):
        """(value, derivatives by q, qd and qdd, (N, n) each)."""
        evaluation = self._program.evaluate(q, qd, qdd)
        X, lengths = self._unit_columns(evaluation, qd, qdd)
        eigenvalues, vectors = np.linalg.eigh(_products(X))
        weights = np.zeros_like(X)
        for place, sign in ((-1, 0.5), (0, -0.5)):
            value, v = max(eigenvalues[place], ROUNDING * eigenvalues[-1]), vectors[:, place]
            weights += sign / value * 2 * (np.outer(X @ v, v) - value * v**2 * X)
        weights = (weights / lengths).reshape(len(q), self.n, -1)
        return _log_condition(eigenvalues), self._by_motion(evaluation, weights)

    def _unit_columns(self, evaluation, qd, qdd):
        """(columns (N n, P) of length 1, their lengths before (P,), 1 of columns without any entry)."""
        Y = evaluation.outputs.reshape(len(qd), self.n, -1)
        offsets = np.broadcast_to(np.eye(self.n), (len(Y), self.n, self.n))
        X = np.concatenate([Y, offsets, self.model.drives.coupling_regressor(qd, qdd)], axis=-1)
        X = X.reshape(-1, X.shape[-1])
        lengths = np.linalg.norm(X, axis=0)
        lengths = np.where(lengths > 0, lengths, 1.0)
        return X / lengths, lengths

    def _by_motion(self, evaluation, weights):
        """Derivatives by q, qd and qdd (N, n) of Σ weights * columns, for weights (N, n, P)."""
        size = len(self.model.parameter_indices)
        found = self._program.gradient(evaluation, weights[..., :size].reshape(len(weights), -1))
        q, qd, qdd = (found[name] for name in ("q", "qd", "qdd"))
        coupled = weights[..., size + self.n :]
        for number, w in enumerate(self.model.drives.coupling_ratios.values()):
            for shift, rates in ((0, qdd), (1, qd)):
                share = coupled[..., 3 * number + shift]
                rates += (share @ w)[:, None] * w - w * w * share
        return q, qd, qdd


def _log_condition(eigenvalues):
    """From eigenvalues, ascending, of XᵀX."""
    return float(0.5 * np.log(eigenvalues[-1] / max(eigenvalues[0], ROUNDING * eigenvalues[-1])))


def _products(X):
    """XᵀX, without the threads of a BLAS, which take longer to meet than this takes."""
    return np.einsum("ij,ik->jk", X, X)
