"""Derivatives of the inverse and direct dynamic models as straight-line programs.

The traced inverse model is differentiated at constant accelerations, and the equation of motion does the rest:

    Γ(q, q̇, q̈) = A(q) q̈ + H(q, q̇) + friction + springs
    dq̈ = A⁻¹ (dτ - ∂Γ/∂q dq - ∂Γ/∂q̇ dq̇) at the accelerations q̈ that the efforts τ cause

so that the solution of the direct model is not differentiated. Where some accelerations are known and others are not
(elastic joints, a free base), the same is done with the rows of the unknown ones.

Rows and columns are those of A: with a moving base six of the base come first. The columns of positions are then those
of a displacement ξ of the base, [translation; rotation] in frame 0, its pose T becoming T exp(ξ).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.codegen.trace.accumulation import forward_accumulation, reverse_accumulation
from robot_dynamics.codegen.trace.effort_derivatives import gravity_directions, motion_derivatives
from robot_dynamics.codegen.trace.model_trace import ModelTrace
from robot_dynamics.codegen.trace.program import order_by_use
from robot_dynamics.newton_euler import composite, linear

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.codegen.trace.accumulation import Accumulation
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.model.robot import Robot

ACCUMULATIONS: tuple[Accumulation, ...] = (forward_accumulation, reverse_accumulation)
"""Ways to differentiate; a program is made in the way that gives the fewest operations."""


def inverse_derivatives_model(
    robot: Robot,
    *,
    wrenches: Sequence[str] = (),
    prescribed_base: bool = False,
    with_pivots: bool = False,
    group_parameters: bool = True,
) -> Program:
    """Derivatives of the inverse dynamic model: q, qd, qdd -> by_positions, by_velocities, by_accelerations (m, m).

    Parameters
    ----------
    robot, wrenches, prescribed_base, with_pivots, group_parameters
        See `models.inverse_model`.

    Returns
    -------
    Program
        Rows are the wrench that holds the base and the efforts of the independent joints, columns the base and these
        joints. Rows and columns of accelerations that are solved for are zero: of unactuated joints, of a free base.
    """

    def build(accumulate: Accumulation) -> Program:
        model = ModelTrace(
            "inverse_derivatives", robot, ("q", "qd", "qdd"), wrenches, prescribed_base, group_parameters
        )
        base_acceleration, qdd = _solved_accelerations(model)
        derivatives = motion_derivatives(model, qdd, base_acceleration, accumulate)
        A = _inertia_matrix(model)
        efforts = _load_growth(model, qdd, base_acceleration)[:, None] * A
        m = len(A)
        unknown = _unknown_rows(model, model.unactuated)
        known = [row for row in range(m) if row not in unknown]
        columns = np.concatenate([derivatives, efforts * _mask(m, known)], axis=1)
        if unknown:
            right_side = columns[unknown]
            columns = columns - efforts[:, unknown] @ _solve(A, unknown, right_side)
            columns = columns * _mask(m, known)[:, None]
        names = ("by_positions", "by_velocities", "by_accelerations")
        return model.program(dict(zip(names, np.split(columns, 3, axis=1), strict=True)), with_pivots=with_pivots)

    return _smallest(build)


def direct_derivatives_model(
    robot: Robot,
    *,
    wrenches: Sequence[str] = (),
    prescribed_base: bool = False,
    with_pivots: bool = False,
    group_parameters: bool = True,
) -> Program:
    """Derivatives of the direct dynamic model: q, qd, efforts -> by_positions, by_velocities (m, m), by_efforts (m, n).

    Parameters
    ----------
    robot, wrenches, prescribed_base, with_pivots, group_parameters
        See `models.inverse_model`.

    Returns
    -------
    Program
        Rows are the acceleration of the base and the accelerations of the independent joints. If the acceleration of
        the base is prescribed, its rows are zero, and `by_base_acceleration` (m, 6) are the derivatives by it.
    """

    def build(accumulate: Accumulation) -> Program:
        model = ModelTrace(
            "direct_derivatives", robot, ("q", "qd", "efforts"), wrenches, prescribed_base, group_parameters
        )
        n = model.size
        net_efforts = model.inputs["efforts"] - model.passive_efforts
        loads = model.loads(net_efforts, model.topology.independent)
        zeros = np.zeros(n, dtype=int)
        base_acceleration, qdd = model.accelerations(tuple(range(n)), zeros, loads)
        derivatives = motion_derivatives(model, qdd, base_acceleration, accumulate, at_constant_efforts=True)
        A = _inertia_matrix(model)
        m = len(A)
        unknown = _unknown_rows(model, tuple(range(n)))
        prescribed = [row for row in range(m) if row not in unknown]
        by_efforts = np.eye(m, dtype=int)[:, m - n :] * _load_reduction(model, net_efforts)
        columns = np.concatenate([-derivatives, by_efforts, -A[:, prescribed]], axis=1)
        solution: ScalarArray = np.zeros(columns.shape, dtype=object)
        solution[unknown] = _solve(A, unknown, columns[unknown])
        positions, velocities, efforts, by_base = np.split(solution, [m, 2 * m, 2 * m + n], axis=1)
        if model.base_is_free:  # what is solved for has gravity subtracted
            positions[:6, :6] = positions[:6, :6] + gravity_directions(model)
        results = {"by_positions": positions, "by_velocities": velocities, "by_efforts": efforts}
        if prescribed:
            by_base[:6] = np.eye(6, dtype=int)
            results["by_base_acceleration"] = by_base
        return model.program(results, with_pivots=with_pivots)

    return _smallest(build)


def _smallest(build: Callable[[Accumulation], Program]) -> Program:
    """The program with the fewest operations, with its statements near those that read their results."""
    smallest = min(map(build, ACCUMULATIONS), key=lambda program: sum(program.operations))
    return order_by_use(smallest)


def _solved_accelerations(model: ModelTrace) -> tuple[ScalarArray, ScalarArray]:
    """Accelerations of the base (minus gravity) and of the independent joints, in the inverse model."""
    qdd = model.inputs["qdd"] * _mask(model.size, [k for k in range(model.size) if k not in model.unactuated])
    if model.unactuated or model.base_is_free:
        return model.accelerations(model.unactuated, qdd, -model.passive_efforts)
    return model.base_acceleration, qdd


def _mask(size: int, indices: Sequence[int]) -> ScalarArray:
    """(size,) 1 at the indices, else 0."""
    mask: ScalarArray = np.zeros(size, dtype=int)
    mask[list(indices)] = 1
    return mask


def _unknown_rows(model: ModelTrace, unknown: Sequence[int]) -> list[int]:
    """Rows of A of the accelerations that are solved for, in the order of `solve_constrained_accelerations`."""
    base = 6 if model.robot.moving_base else 0
    return [*(base + k for k in reversed(unknown)), *(range(6) if model.base_is_free else ())]


def _inertia_matrix(model: ModelTrace) -> ScalarArray:
    P = model.projection_matrix
    A: ScalarArray = P.T @ composite.inertia_matrix(model.force_robot, model.force_q) @ P
    return A


def _solve(A: ScalarArray, rows: Sequence[int], right_side: ScalarArray) -> ScalarArray:
    """Solution (k, c) of the rows of A, for right_side (k, c)."""
    solution: ScalarArray = linear.solve_columns(linear.factor(A[np.ix_(rows, rows)]), right_side)
    return solution


def _load_growth(model: ModelTrace, qdd: ScalarArray, base_acceleration: ScalarArray) -> ScalarArray:
    """(m,) derivatives of the efforts by the loads: 1 without load-dependent friction."""
    forces, _ = model.forces(qdd, base_acceleration)
    growth = model.load_growth(forces[model.topology.independent])
    return np.concatenate([np.ones(6 if model.robot.moving_base else 0, dtype=int), growth])


def _load_reduction(model: ModelTrace, net_efforts: ScalarArray) -> ScalarArray:
    """(n,) derivatives of the loads by the efforts: 1 without load-dependent friction."""
    reduction: ScalarArray = 1 / model.load_growth(net_efforts)
    return reduction
