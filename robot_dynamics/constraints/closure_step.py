"""One step of Newton's method towards closed loops, by the loop equations of a topology."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.constraints.least_squares import factor_bordered, least_squares

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.constraints.topology import ConstraintTopology


class NewtonStep(NamedTuple):
    """Newton's method for the loops at positions t (..., m).

    Attributes
    ----------
    residual : ndarray, shape (..., rows)
    step : ndarray, shape (..., dependent)
        Step of the dependent joints.
    pivots, squared_norms : ndarray, shape (..., dependent)
        Those of the BorderedFactors of J_d.
    determinant_matrix : ndarray, shape (..., dependent, dependent)
        Rows of J_d whose determinant is positive at the reference positions. It changes its sign at singular positions
        only.
    """

    residual: ScalarArray
    step: ScalarArray
    pivots: ScalarArray
    squared_norms: ScalarArray
    determinant_matrix: ScalarArray


def newton_step(topology: ConstraintTopology, t: ScalarArray) -> NewtonStep:
    """The NewtonStep of the loops of a topology at positions t (..., m)."""
    rows = topology.determinant_rows
    assert rows is not None, "a robot without loops has no loop equations"
    equations = topology.loop_equations_at(t)
    J = equations.jacobian @ topology.S[:, topology.dependent_columns]
    factors = factor_bordered(J, topology.jacobian_partition)
    step = least_squares(factors, -equations.residual[..., None])[..., 0]
    signs = np.array([topology.determinant_sign] + [1] * (len(rows) - 1))
    determinant_matrix = J[..., rows, :] * signs[: len(rows), None]
    return NewtonStep(equations.residual, step, factors.pivots, factors.squared_norms, determinant_matrix)
