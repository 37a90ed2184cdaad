"""Generalized momentum, and what changes it besides external efforts, as a straight-line program.

With the kinetic energy T = ½ q̇ᵀ A q̇ and the potential energy U of the weights, Lagrange's equations are

    p = ∂T/∂q̇,   ṗ = ∂(T - U)/∂q + Γ_l + τ_ext

where Γ_l are the efforts less springs and friction. ∂T/∂q is Cᵀq̇ for a C with Ȧ = C + Cᵀ. T - U is traced once, and one
reverse accumulation gives all derivatives: no matrix is formed, and no acceleration is needed.

Loops: T is a function of the independent joints through all of them, q̇_all = G q̇ and J q̇_all = 0. With multipliers μ
that carry the momenta of the dependent joints, as in `effort_derivatives`,

    p = Gᵀ ∂T/∂q̇_all,   ∂T/∂q = Gᵀ ∂(T - μᵀ J q̇_all)/∂q_all at constant q̇_all

A moving base has the twist V = [v; ω] in frame 0 as quasi-velocities. Its momentum [P; L] = ∂T/∂V at the origin of
frame 0, in its axes, changes by the turning of these axes too: Ṗ = f - ω × P, L̇ = m - ω × L - v × P.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.codegen.trace.accumulation import reverse_accumulation
from robot_dynamics.codegen.trace.effort_derivatives import FrozenScalars, position_directions
from robot_dynamics.codegen.trace.model_trace import ModelTrace
from robot_dynamics.codegen.trace.program import order_by_use
from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.newton_euler import centroid
from robot_dynamics.newton_euler.screw import cross

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.model.robot import Robot


def momentum_model(robot: Robot, *, group_parameters: bool = True) -> Program:
    """Generalized momentum and its rate without external efforts.

    q, qd, efforts (twist, gravity) -> momentum (m,), momentum_rate (m,).

    Parameters
    ----------
    robot : Robot
    group_parameters : bool
        Whether inertial parameters are grouped into base parameters.

    Returns
    -------
    Program
        Rows are the base and the independent joints. The rate has efforts, springs, friction (load-dependent friction
        too) and weights. It has no wrench that holds a moving base: that is an external one.
    """
    model = ModelTrace("momentum", robot, ("q", "qd", "efforts"), group_parameters=group_parameters)
    net_efforts = model.inputs["efforts"] - model.passive_efforts
    loads = model.loads(net_efforts, model.topology.independent)
    momentum, gradient = _looped_gradient(model) if model.topology.dependent else _open_gradient(model)
    rate = gradient + np.concatenate([np.zeros(len(gradient) - model.size, dtype=int), loads])
    return order_by_use(model.program({"momentum": momentum, "momentum_rate": rate}))


def _open_gradient(model: ModelTrace) -> tuple[ScalarArray, ScalarArray]:
    """Momentum (m,), and its rate (m,) by motion and weights, of a robot without loops."""
    n = model.size
    variables = np.concatenate([model.inputs["q"], model.inputs["qd"]])
    derivatives = _derivatives(model, _lagrangian(model, model.qd), variables, np.eye(2 * n, dtype=int))
    return _with_base(model, derivatives[:n], derivatives[n : 2 * n], derivatives[2 * n :])


def _looped_gradient(model: ModelTrace) -> tuple[ScalarArray, ScalarArray]:
    """As `_open_gradient`, of a robot with loops."""
    state = model.constrained_state
    frozen = FrozenScalars(model.trace)
    qd = frozen.freeze("velocities", model.qd)
    n = len(qd)
    lagrangian = _lagrangian(model, qd)
    all_momenta = frozen.restore(_derivatives(model, lagrangian, qd, np.eye(n, dtype=int)))
    momenta, base_momentum = all_momenta[:n], all_momenta[n:]
    multipliers = frozen.freeze("multipliers", state.multipliers(momenta))
    residual = loop_equations(model.robot, model.q, qd).jacobian @ qd
    lagrangian = lagrangian - np.sum(multipliers * residual)
    directions = frozen.freeze_sparse("G", position_directions(model))
    gradient = frozen.restore(_derivatives(model, lagrangian, model.inputs["q"], directions)[: model.size])
    return _with_base(model, gradient, state.projected(momenta), base_momentum)


def _lagrangian(model: ModelTrace, qd: ScalarArray) -> ScalarArray:
    """T - U (1,) at velocities (all joints,); with a moving base U is zero where frame 0 is."""
    energy: ScalarArray = centroid.kinetic_energy(model.robot, model.q, qd, model.twist)
    weights = model.gravity_screw[:3] * centroid.first_moments(model.robot, model.q)
    lagrangian: ScalarArray = energy + np.sum(weights)
    return lagrangian


def _derivatives(
    model: ModelTrace, output: ScalarArray, variables: ScalarArray, directions: ScalarArray
) -> ScalarArray:
    """Derivatives of an output (1,) along directions, then by the twist of a moving base: (k,) or (k + 6,)."""
    if model.robot.moving_base:
        count, columns = directions.shape
        variables = np.concatenate([variables, model.inputs["twist"]])
        extended: ScalarArray = np.zeros((count + 6, columns + 6), dtype=object)
        extended[:count, :columns] = directions
        extended[count:, columns:] = np.eye(6, dtype=int)
        directions = extended
    derivatives: ScalarArray = reverse_accumulation(model.trace, output, variables, directions)[0]
    return derivatives


def _with_base(
    model: ModelTrace, gradient: ScalarArray, momentum: ScalarArray, base_momentum: ScalarArray
) -> tuple[ScalarArray, ScalarArray]:
    """Momentum (m,) and its rate (m,) with the rows of a moving base, whose momentum (6,) is empty for a fixed one."""
    if not model.robot.moving_base:
        return momentum, gradient
    gravity = model.gravity_screw[:3]
    P, L = base_momentum[:3], base_momentum[3:]
    v, omega = model.twist[:3], model.twist[3:]
    force = centroid.moving_mass(model.robot) * gravity
    torque = cross(centroid.first_moments(model.robot, model.q), gravity)
    rate = [force - cross(omega, P), torque - cross(omega, L) - cross(v, P)]
    return np.concatenate([base_momentum, momentum]), np.concatenate([*rate, gradient])
