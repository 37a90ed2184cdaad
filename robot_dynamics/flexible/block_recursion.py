"""The dynamics of a chain or tree whose links bend: the three sweeps of newton_euler, in blocks.

What moves a node of the structure against its parent has either its acceleration or its force given: a joint, one
coordinate; an element, its six elastic coordinates, whose force is -K e. As in newton_euler/recursion.py, what is
folded are the inertia and the bias of all that hangs on a frame; a pivot H is here a matrix, and on a parent hang, by
the same six coordinates, the end of an element and the sections in which its mass is gathered.

Source: Khalil, sections 3.2, 3.3.2 and 6, for coordinates in blocks; Boyer and Khalil (1998) for elastic ones.
"""

from typing import NamedTuple

import numpy as np

from robot_dynamics.errors import SingularModelError
from robot_dynamics.flexible.bending import AttachedFrames, place_sections
from robot_dynamics.newton_euler.kinematics import axis_row, axis_screw, joint_placement
from robot_dynamics.newton_euler.screw import (
    apply,
    apply_transposed,
    cross,
    inertia_to_antecedent,
    screw,
    twist_to_successor,
    wrench_to_antecedent,
)

MASSLESS = 1e-12  # a share of inertia below this is rounding


class Sweep(NamedTuple):
    """What the forward sweep leaves, for each node but the ground: hung: a Hung, the node itself last; gammas:
    (..., p, 6) accelerations of these that velocities cause; inertias, betas: (..., p, 6, 6) and (..., p, 6), of the
    last what is fastened to the node."""

    attached: list
    gammas: list
    inertias: list
    betas: list


def place_frames(node, x, rates):
    """The Hung of a Node, at coordinates x (..., g) of the structure and their rates."""
    own = list(node.coordinates)
    if node.element is not None:
        return place_sections(node.element, node.placement, x[..., own], rates[..., own])
    if node.joint is None:
        none = np.zeros((1, 6))
        return AttachedFrames(
            node.placement[None, :3, :3], node.placement[None, :3, 3], np.zeros((1, 6, 0)), none, none
        )
    R, P = joint_placement(node.joint, x[..., own])
    column = np.zeros((1, 6, 1))
    column[0, axis_row(node.joint)] = 1
    rate = axis_screw(node.joint, rates[..., own])[..., None, :]
    return AttachedFrames(R[..., None, :, :], P[..., None, :], column, rate, np.zeros((1, 6)))


def sweep_forward(structure, x, rates, wrenches):
    """Placements, velocities and what these demand. wrenches: {node: (..., 6) what its environment does to it}."""
    fastened = {}
    for node, inertia in structure.bodies:
        fastened[node] = fastened.get(node, 0) + inertia
    sweep, velocities = Sweep([None], [None], [None], [None]), [np.zeros((*x.shape[:-1], 6))]
    for number, node in enumerate(structure.nodes[1:], start=1):
        attached = place_frames(node, x, rates)
        before = velocities[node.parent][..., None, :]
        V = twist_to_successor(attached.rotations, attached.positions, before) + attached.rates
        own = fastened.get(number, np.zeros((6, 6)))[None]
        inertias = own if node.element is None else np.concatenate([node.element.sections.inertias, own])
        betas = -_velocity_wrench(inertias, V)
        if number in wrenches:
            betas[..., -1, :] += wrenches[number]
        for kept, value in zip(sweep, (attached, _gamma(attached, before), inertias, betas), strict=True):
            kept.append(value)
        velocities.append(V[..., -1, :])
    return sweep


def _gamma(attached, V):
    """(..., p, 6) accelerations that the twist V (..., 1, 6) of the parent and the rates of the coordinates cause."""
    omega = V[..., 3:]
    turned = apply_transposed(attached.rotations, omega)  # ω of the parent, in axes of what hangs there
    centripetal = apply_transposed(attached.rotations, cross(omega, cross(omega, attached.positions)))
    linear = centripetal + 2 * cross(turned, attached.rates[..., :3])
    return screw(linear, cross(turned, attached.rates[..., 3:])) + attached.drifts


def _velocity_wrench(inertias, V):
    """[ω × (ω × MS); ω × (J ω)], as in newton_euler, of spatial inertias (..., 6, 6)."""
    omega = V[..., 3:]
    caused = apply(inertias[..., 3:], omega)  # [ω × MS; J ω]
    return screw(cross(omega, caused[..., :3]), cross(omega, caused[..., 3:]))


class BackwardPass(NamedTuple):
    """What the backward sweep leaves for each node: of the equation Q = Cᵀ V̇ + H ẍ - load of its own coordinates x,
    V̇ being the acceleration of its parent, C (..., 6, k), H (..., k, k) and the load (..., k)."""

    couplings: list
    pivots: list
    loads: list


def solve(structure, sweep, accelerations, forces, unknown, base_acceleration):
    """(accelerations, forces) (..., g) of all coordinates.

    accelerations, forces: (..., g), of which the first is read where `found` (g,) is False and the second where it is
    True. ground: (6,) the acceleration of the ground, gravity taken off.
    """
    folded = _fold_backward(structure, sweep, accelerations, forces, unknown)
    accelerations, forces = np.array(accelerations), np.array(forces)
    moved = [base_acceleration]
    for number, node in enumerate(structure.nodes[1:], start=1):
        attached, own, V_dot = sweep.attached[number], list(node.coordinates), moved[node.parent]
        C, H, load = (kept[number] for kept in folded)
        caused = apply(np.swapaxes(C, -1, -2), V_dot) - load
        if own and unknown[own[0]]:
            accelerations[..., own] = _divided(H, (forces[..., own] - caused)[..., None])[..., 0]
        else:
            forces[..., own] = apply(H, accelerations[..., own]) + caused
        here = twist_to_successor(attached.rotations[..., -1, :, :], attached.positions[..., -1, :], V_dot)
        here = here + sweep.gammas[number][..., -1, :] + apply(attached.columns[..., -1, :, :], accelerations[..., own])
        moved.append(here)
    return accelerations, forces


def _fold_backward(structure, sweep, accelerations, forces, unknown):
    size = len(structure.nodes)
    folded = BackwardPass(*([None] * size for _ in range(3)))
    hanging = [(np.zeros((6, 6)), np.zeros(6))] * size  # inertia and bias of what hangs on each node
    for number in range(size - 1, 0, -1):
        node, attached = structure.nodes[number], sweep.attached[number]
        J = _with_last(sweep.inertias[number], hanging[number][0], axes=2)
        beta = _with_last(sweep.betas[number], hanging[number][1], axes=1)
        A, own = attached.columns, list(node.coordinates)
        U = J @ A
        alpha = apply(J, sweep.gammas[number]) - beta
        transposed = np.swapaxes(A, -1, -2)
        H, load = (transposed @ U).sum(axis=-3), -apply(transposed, alpha).sum(axis=-2)
        if node.joint is not None:
            H = H + node.joint.rotor_inertia
        places = attached.rotations[..., None, :, :], attached.positions[..., None, :]
        C = np.swapaxes(wrench_to_antecedent(*places, np.swapaxes(U, -1, -2)).sum(axis=-3), -1, -2)
        K = inertia_to_antecedent(*attached[:2], J).sum(axis=-3)
        bias = -wrench_to_antecedent(*attached[:2], alpha).sum(axis=-2)
        if own and unknown[own[0]]:
            _refuse_massless(structure, node, H)
            right = np.concatenate(_alike(np.swapaxes(C, -1, -2), (forces[..., own] + load)[..., None]), axis=-1)
            solved = _divided(H, right)
            K = K - C @ solved[..., :6]
            bias = bias - apply(C, solved[..., 6])
        else:
            bias = bias - apply(C, accelerations[..., own])
        for kept, value in zip(folded, (C, H, load), strict=True):
            kept[number] = value
        hanging[node.parent] = tuple(sum(pair) for pair in zip(hanging[node.parent], (K, bias), strict=True))
    return folded


def _with_last(values, more, axes):
    """(..., p, ...) with more (..., ...) added to the last of p."""
    values, more = np.broadcast_arrays(values, np.expand_dims(more, -axes - 1))
    total = np.array(values)
    last = (..., -1, *[slice(None)] * axes)
    total[last] += more[last]
    return total


def _alike(*matrices):
    """Matrices with all batch axes."""
    batch = np.broadcast_shapes(*(matrix.shape[:-2] for matrix in matrices))
    return [np.broadcast_to(matrix, (*batch, *matrix.shape[-2:])) for matrix in matrices]


def _divided(H, right):
    """H⁻¹ (..., k, m)."""
    return right / H if H.shape[-1] == 1 else np.linalg.solve(*_alike(H, right))


def _refuse_massless(structure, node, H):
    scale = np.sqrt(np.abs(np.diagonal(H, axis1=-2, axis2=-1)))
    scale = np.where(scale > 0, scale, 1.0)
    pivots = np.linalg.eigvalsh(H / (scale[..., :, None] * scale[..., None, :]))
    if not (pivots > MASSLESS).all():
        name = structure.coordinates[node.coordinates[0]]
        name = name if node.joint is not None else name.rsplit(".", 1)[0]
        raise SingularModelError(
            f"some motion of {name!r} meets no inertia. Give the links that it moves a mass, or the material a density"
        )
