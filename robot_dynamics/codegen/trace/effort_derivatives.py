"""Derivatives of the generalized efforts of a motion by positions and velocities, at constant accelerations.

Positions that close loops move along the tangent G of the constraints. Their rates follow from the loop equations:

    J G = 0,   J dq̇_all = -dJ q̇_all,   J dq̈_all = -dJ q̈_all - d(J̇q̇),   dΓ = Gᵀ (dΓ_all - dJᵀ λ)

with the multipliers λ that carry the forces of the dependent joints, so that no factorization of J is differentiated.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.codegen.trace.accumulation import substitute
from robot_dynamics.codegen.trace.scalar import LEAVES, Scalar
from robot_dynamics.constraints.attitude_charts import joint_velocities
from robot_dynamics.constraints.loop_equations import loop_equations

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.codegen.trace.accumulation import Accumulation
    from robot_dynamics.codegen.trace.model_trace import ModelTrace
    from robot_dynamics.codegen.trace.scalar import Trace


def motion_derivatives(
    model: ModelTrace,
    qdd: ScalarArray,
    base_acceleration: ScalarArray,
    accumulate: Accumulation,
    at_constant_efforts: bool = False,
) -> ScalarArray:
    """(m, 2 m) derivatives of generalized efforts by positions and velocities, at constant accelerations.

    qdd, base_acceleration: as ModelTrace.forces takes them; at_constant_efforts: whether load-dependent friction is
    that of the efforts among the inputs, and not that of the motion.
    """
    frozen = FrozenScalars(model.trace)
    variables, directions = _base_directions(model)
    if model.topology.dependent:
        motion = _looped_motion(model, qdd, base_acceleration, accumulate, frozen)
    else:
        motion = _open_motion(model, qdd, frozen)
    if model.base_is_free:
        base_acceleration = frozen.freeze("base acceleration", base_acceleration)
    forces, wrench = model.tree_forces(motion.qd, motion.accelerations, base_acceleration)
    passive_efforts = model.passive_efforts_at(motion.qd)
    G = motion.G
    if at_constant_efforts:
        net_efforts = model.inputs["efforts"] - G.T @ passive_efforts
        rows = G.T @ (forces - motion.loop_forces) - model.loads(net_efforts, model.topology.independent, motion.qd)
    else:
        efforts = forces + passive_efforts + model.load_friction_at(motion.qd, forces)
        rows = G.T @ (efforts - motion.loop_forces)
    outputs = np.concatenate([wrench, rows]) if model.robot.moving_base else rows
    variables = np.concatenate([variables, motion.variables])
    directions = np.concatenate([directions, motion.directions])
    return frozen.restore(accumulate(model.trace, outputs, variables, directions))


class FrozenScalars:
    """Scalars that are constant in a derivative, or variables of it, although they depend on inputs.

    They are replaced by inputs of the trace, so that no operation on them is simplified with what they depend on, and
    are put back into the derivative.
    """

    def __init__(self, trace: Trace) -> None:
        self._trace = trace
        self._replacements: dict[int, Scalar] = {}

    def freeze(self, name: str, array: ScalarArray) -> ScalarArray:
        """The array with an input of the trace in place of each entry."""
        inputs = self._trace.input(name, array.size)
        scalars = [entry if isinstance(entry, Scalar) else self._trace.constant(entry) for entry in array.ravel()]
        self._replacements.update((leaf.node, scalar) for leaf, scalar in zip(inputs, scalars, strict=True))
        return inputs.reshape(array.shape)

    def freeze_sparse(self, name: str, array: ScalarArray) -> ScalarArray:
        """As `freeze`; entries that are numbers or inputs stay as they are."""
        inputs = self.freeze(name, array)
        is_leaf = [not isinstance(entry, Scalar) or self._trace.nodes[entry.node][0] in LEAVES for entry in array.flat]
        return np.where(np.reshape(is_leaf, array.shape), array, inputs)

    def restore(self, array: ScalarArray) -> ScalarArray:
        """The array with the entries back in place of the inputs."""
        return substitute(self._trace, [array], self._replacements)[0]


class _Motion(NamedTuple):
    """Motion of all joints, and its derivatives by positions and velocities.

    qd, accelerations, loop_forces: (all joints,), the last ones forces that the loops exert; G: (all joints, n);
    variables: (k,), on which they depend; directions: (k, 2 m).
    """

    qd: ScalarArray
    accelerations: ScalarArray
    G: ScalarArray
    loop_forces: ScalarArray
    variables: ScalarArray
    directions: ScalarArray


def _open_motion(model: ModelTrace, qdd: ScalarArray, frozen: FrozenScalars) -> _Motion:
    """The _Motion of a robot without loops."""
    accelerations = model.joint_accelerations(frozen.freeze_sparse("accelerations", qdd))
    variables = np.concatenate([model.inputs["q"], model.inputs["qd"]])
    directions = np.zeros((len(variables), _columns(model)), dtype=int)
    directions[: model.size, _position_columns(model)] = np.eye(model.size, dtype=int)
    directions[model.size :, _velocity_columns(model)] = np.eye(model.size, dtype=int)
    no_forces = np.zeros(len(model.qd), dtype=int)
    return _Motion(model.qd, accelerations, model.constrained_state.G, no_forces, variables, directions)


def _looped_motion(
    model: ModelTrace, qdd: ScalarArray, base_acceleration: ScalarArray, accumulate: Accumulation, frozen: FrozenScalars
) -> _Motion:
    """The _Motion of a robot with loops."""
    state = model.constrained_state
    forces, _ = model.forces(qdd, base_acceleration)
    multipliers = frozen.freeze("multipliers", state.multipliers(forces + model.all_passive_efforts))
    q = model.inputs["q"]
    qd = frozen.freeze("velocities", model.qd)
    accelerations = frozen.freeze("accelerations", model.joint_accelerations(qdd))
    equations = loop_equations(model.robot, model.q, qd)
    q_directions: ScalarArray = np.zeros((len(q), _columns(model)), dtype=object)
    q_directions[:, _position_columns(model)] = position_directions(model)
    residual = equations.jacobian @ qd
    qd_directions = state.close_rates(-accumulate(model.trace, residual, q, q_directions))
    qd_directions[:, _velocity_columns(model)] = state.G
    residual = equations.jacobian @ accelerations + equations.drift
    variables = np.concatenate([q, qd])
    directions = np.concatenate([q_directions, qd_directions])
    acceleration_directions = state.close_rates(-accumulate(model.trace, residual, variables, directions))
    return _Motion(
        qd,
        accelerations,
        frozen.freeze_sparse("G", state.G),
        multipliers @ equations.jacobian,
        np.concatenate([variables, accelerations]),
        np.concatenate([directions, acceleration_directions]),
    )


def position_directions(model: ModelTrace) -> ScalarArray:
    """(all joints, n) derivatives of the positions of all joints by those of the independent ones."""
    state = model.constrained_state
    offset = state.topology.offset
    rates = [joint_velocities(state.q, column, state.attitudes, offset, _divide_by_cosine) for column in state.G.T]
    return np.stack(rates, axis=1)


def _divide_by_cosine(value: ScalarArray, cosine: ScalarArray, _: ScalarArray) -> ScalarArray:
    quotient: ScalarArray = value / cosine  # not finite where pitch is ±90°
    return quotient


def _base_directions(model: ModelTrace) -> tuple[ScalarArray, ScalarArray]:
    """Gravity and twist (k,) of a moving base, and their derivatives (k, 2 m); none of a fixed base."""
    columns = _columns(model)
    if not model.robot.moving_base:
        return np.zeros(0, dtype=object), np.zeros((0, columns), dtype=int)
    directions: ScalarArray = np.zeros((9, columns), dtype=object)
    directions[:3, :6] = gravity_directions(model)[:3]
    directions[3:, columns // 2 : columns // 2 + 6] = np.eye(6, dtype=int)
    return np.concatenate([model.inputs["gravity"], model.inputs["twist"]]), directions


def _columns(model: ModelTrace) -> int:
    """2 m: columns of positions and of velocities, of the base and of the independent joints."""
    return 2 * (model.size + (6 if model.robot.moving_base else 0))


def _position_columns(model: ModelTrace) -> slice:
    return slice(_columns(model) // 2 - model.size, _columns(model) // 2)


def _velocity_columns(model: ModelTrace) -> slice:
    return slice(_columns(model) - model.size, _columns(model))


def gravity_directions(model: ModelTrace) -> ScalarArray:
    """(6, 6) derivatives of gravity in frame 0 by a displacement of the base: a rotation φ gives g × φ."""
    directions: ScalarArray = np.zeros((6, 6), dtype=object)
    x, y, z = model.inputs["gravity"]
    directions[:3, 3:] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    return directions
