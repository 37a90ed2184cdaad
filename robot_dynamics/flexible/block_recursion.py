"""Dynamics of a chain or tree with flexible links: the three sweeps of newton_euler, in blocks.

Each node of the structure moves in its parent by a joint, one coordinate, or by an element, its six elastic
coordinates, whose force is -K e. Either its acceleration or its force is known. As in newton_euler/articulated_body.py,
the backward pass carries articulated inertias and bias wrenches; a pivot H is here a matrix, and the same six
coordinates move the end of an element and the sections in which its mass is concentrated.

Source: Khalil, sections 3.2, 3.3.2 and 6, for coordinates in blocks; Boyer and Khalil (1998) for elastic coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.errors import SingularModelError
from robot_dynamics.flexible.bending import AttachedFrames, place_sections
from robot_dynamics.newton_euler.joint_placement import joint_placement
from robot_dynamics.newton_euler.kinematics import axis_row, axis_screw
from robot_dynamics.newton_euler.screw import (
    apply,
    apply_transposed,
    cross,
    inertia_to_antecedent,
    screw,
    twist_to_successor,
    wrench_to_antecedent,
)

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.flexible.structure import Node, Structure

MASSLESS = 1e-12  # a scaled inertia below this is a rounding error


class NodeSweep(NamedTuple):
    """Result of the forward sweep for one node.

    attached: its AttachedFrames, the node itself last; gammas: (..., p, 6) velocity-dependent accelerations of these;
    inertias, betas: (..., p, 6, 6) and (..., p, 6), the last one of the bodies on the node.
    """

    attached: AttachedFrames
    gammas: Array
    inertias: Array
    betas: Array


class NodePivot(NamedTuple):
    """Result of the backward sweep for one node: Q = Cᵀ V̇ + H ẍ - load.

    Q: forces of its own k coordinates x; V̇: acceleration of its parent; coupling: C (..., 6, k); pivot: H (..., k, k);
    load: (..., k).
    """

    coupling: Array
    pivot: Array
    load: Array


def place_frames(node: Node, x: Array, rates: Array) -> AttachedFrames:
    """Return the AttachedFrames of a node at coordinates x (..., g) of the structure and their rates."""
    own = list(node.coordinates)
    if node.element is not None:
        return place_sections(node.element, node.placement, x[..., own], rates[..., own])
    if node.joint is None:
        zero = np.zeros((1, 6))
        return AttachedFrames(
            node.placement[None, :3, :3], node.placement[None, :3, 3], np.zeros((1, 6, 0)), zero, zero
        )
    R, P = joint_placement(node.joint, x[..., own])
    column = np.zeros((1, 6, 1))
    column[0, axis_row(node.joint)] = 1
    rate = axis_screw(node.joint, rates[..., own])[..., None, :]
    return AttachedFrames(R[..., None, :, :], P[..., None, :], column, rate, np.zeros((1, 6)))


def sweep_forward(structure: Structure, x: Array, rates: Array, wrenches: Mapping[int, Array]) -> dict[int, NodeSweep]:
    """Return placements, velocities and inertial effects of each node but the root, by number.

    x, rates: (..., g); wrenches: {node: (..., 6) of the environment on it, in its axes at its origin}.
    """
    body_inertias: dict[int, Array] = {}
    for body_node, inertia in structure.bodies:
        body_inertias[body_node] = body_inertias.get(body_node, 0) + inertia
    sweep: dict[int, NodeSweep] = {}
    velocities = [np.zeros((*x.shape[:-1], 6))]
    for number, node in enumerate(structure.nodes[1:], start=1):
        attached = place_frames(node, x, rates)
        parent_velocity = velocities[node.parent_number][..., None, :]
        V = twist_to_successor(attached.rotations, attached.positions, parent_velocity) + attached.rates
        own_inertia = body_inertias.get(number, np.zeros((6, 6)))[None]
        inertias = (
            own_inertia if node.element is None else np.concatenate([node.element.sections.inertias, own_inertia])
        )
        betas = -_velocity_wrench(inertias, V)
        if number in wrenches:
            betas[..., -1, :] += wrenches[number]
        sweep[number] = NodeSweep(attached, _gamma(attached, parent_velocity), inertias, betas)
        velocities.append(V[..., -1, :])
    return sweep


def _gamma(attached: AttachedFrames, V: Array) -> Array:
    """Return accelerations (..., p, 6) that the twist V (..., 1, 6) of the parent and the rates cause."""
    omega = V[..., 3:]
    rotated = apply_transposed(attached.rotations, omega)  # ω of the parent, in the axes of the attached frames
    centripetal = apply_transposed(attached.rotations, cross(omega, cross(omega, attached.positions)))
    linear = centripetal + 2 * cross(rotated, attached.rates[..., :3])
    return screw(linear, cross(rotated, attached.rates[..., 3:])) + attached.drifts


def _velocity_wrench(inertias: Array, V: Array) -> Array:
    """Return [ω × (ω × MS); ω × (J ω)], as in newton_euler, of spatial inertias (..., 6, 6)."""
    omega = V[..., 3:]
    momentum = apply(inertias[..., 3:], omega)  # [ω × MS; J ω]
    return screw(cross(omega, momentum[..., :3]), cross(omega, momentum[..., 3:]))


def solve(
    structure: Structure,
    sweep: Mapping[int, NodeSweep],
    accelerations: Array,
    forces: Array,
    unknown: BoolArray,
    base_acceleration: Array,
) -> tuple[Array, Array]:
    """Return accelerations and forces (..., g) of all coordinates.

    accelerations, forces: (..., g), of which the first is read where `unknown` (g,) is False and the second where it is
    True. base_acceleration: (6,) of the ground, gravity subtracted.
    """
    pivots = _sweep_backward(structure, sweep, accelerations, forces, unknown)
    accelerations = np.array(accelerations)
    forces = np.array(forces)
    node_accelerations = [base_acceleration]
    for number, node in enumerate(structure.nodes[1:], start=1):
        forward = sweep[number]
        backward = pivots[number]
        attached = forward.attached
        own = list(node.coordinates)
        V_dot = node_accelerations[node.parent_number]
        bias = apply(np.swapaxes(backward.coupling, -1, -2), V_dot) - backward.load
        if own and unknown[own[0]]:
            accelerations[..., own] = _divide(backward.pivot, (forces[..., own] - bias)[..., None])[..., 0]
        else:
            forces[..., own] = apply(backward.pivot, accelerations[..., own]) + bias
        carried = twist_to_successor(attached.rotations[..., -1, :, :], attached.positions[..., -1, :], V_dot)
        relative = apply(attached.columns[..., -1, :, :], accelerations[..., own])
        node_accelerations.append(carried + forward.gammas[..., -1, :] + relative)
    return accelerations, forces


def _sweep_backward(
    structure: Structure,
    sweep: Mapping[int, NodeSweep],
    accelerations: Array,
    forces: Array,
    unknown: BoolArray,
) -> dict[int, NodePivot]:
    """Return the NodePivot of each node but the root, by number; arguments as of `solve`."""
    size = len(structure.nodes)
    pivots: dict[int, NodePivot] = {}
    articulated_inertias: list[Array] = [np.zeros((6, 6))] * size
    bias_wrenches: list[Array] = [np.zeros(6)] * size
    for number in range(size - 1, 0, -1):
        node = structure.nodes[number]
        forward = sweep[number]
        attached = forward.attached
        own = list(node.coordinates)
        J = _add_to_last(forward.inertias, articulated_inertias[number], axes=2)
        beta = _add_to_last(forward.betas, bias_wrenches[number], axes=1)
        A = attached.columns
        A_transposed = np.swapaxes(A, -1, -2)
        U = J @ A
        alpha = apply(J, forward.gammas) - beta
        H = (A_transposed @ U).sum(axis=-3)
        load = -apply(A_transposed, alpha).sum(axis=-2)
        if node.joint is not None:
            H = H + node.joint.rotor_inertia
        R = attached.rotations
        P = attached.positions
        columns = wrench_to_antecedent(R[..., None, :, :], P[..., None, :], np.swapaxes(U, -1, -2)).sum(axis=-3)
        C = np.swapaxes(columns, -1, -2)
        K = inertia_to_antecedent(R, P, J).sum(axis=-3)
        bias = -wrench_to_antecedent(R, P, alpha).sum(axis=-2)
        if own and unknown[own[0]]:
            _refuse_massless(structure, node, H)
            right_side = np.concatenate(
                _broadcast_batches(np.swapaxes(C, -1, -2), (forces[..., own] + load)[..., None]), axis=-1
            )
            solution = _divide(H, right_side)
            K = K - C @ solution[..., :6]
            bias = bias - apply(C, solution[..., 6])
        else:
            bias = bias - apply(C, accelerations[..., own])
        pivots[number] = NodePivot(C, H, load)
        parent = node.parent_number
        articulated_inertias[parent] = articulated_inertias[parent] + K
        bias_wrenches[parent] = bias_wrenches[parent] + bias
    return pivots


def _add_to_last(values: Array, addition: Array, axes: int) -> Array:
    """Return (..., p, ...) with an addition (..., ...) to the last of p."""
    values, addition = np.broadcast_arrays(values, np.expand_dims(addition, -axes - 1))
    total = np.array(values)
    last = np.moveaxis(total, -1 - axes, 0)[-1]  # a view
    last += np.moveaxis(addition, -1 - axes, 0)[-1]
    return total


def _broadcast_batches(*matrices: Array) -> list[Array]:
    """Return matrices with the batch axes of all."""
    batch = np.broadcast_shapes(*(matrix.shape[:-2] for matrix in matrices))
    return [np.broadcast_to(matrix, (*batch, *matrix.shape[-2:])) for matrix in matrices]


def _divide(H: Array, right_side: Array) -> Array:
    """Return H⁻¹ right_side (..., k, m)."""
    if H.shape[-1] == 1:
        return right_side / H
    H, right_side = _broadcast_batches(H, right_side)
    return np.asarray(np.linalg.solve(H, right_side), dtype=np.float64)


def _refuse_massless(structure: Structure, node: Node, H: Array) -> None:
    """Raise SingularModelError where the inertia H (..., k, k) of a node's coordinates is singular."""
    diagonal = np.sqrt(np.abs(np.diagonal(H, axis1=-2, axis2=-1)))
    scale = np.where(diagonal > 0, diagonal, 1.0)
    pivots = np.linalg.eigvalsh(H / (scale[..., :, None] * scale[..., None, :]))
    if not (pivots > MASSLESS).all():
        name = structure.coordinates[node.coordinates[0]]
        if node.joint is None:
            name = name.rsplit(".", 1)[0]
        raise SingularModelError(
            f"some motion of {name!r} has no inertia. Give the links that it moves a mass, or the material a density"
        )
