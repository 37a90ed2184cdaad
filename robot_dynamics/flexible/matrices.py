"""Mass and stiffness matrices of the structure, from its elements (Briot, eq. 6, 7 and 15)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import qr, solve_triangular

from robot_dynamics.flexible.jacobians import (
    Jacobian,
    choose_eliminated_elements,
    closure_jacobians,
    compute_node_kinematics,
    dependent_jacobians,
    sum_jacobians,
)

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray
    from robot_dynamics.flexible.jacobians import (
        NodeKinematics,
    )
    from robot_dynamics.flexible.structure import Structure
    from robot_dynamics.model.robot import Robot

RANK_TOLERANCE = 1e-9  # a closure equation below this fraction of the others is redundant


class Matrices(NamedTuple):
    """Matrices of a robot with closed loops.

    mass, stiffness: (..., n, n) of the independent coordinates; independent: their numbers, in their order; expansion:
    (..., g, n), from these to all generalized coordinates.
    """

    mass: ScalarArray
    stiffness: ScalarArray
    independent: tuple[int, ...]
    expansion: ScalarArray


class MatrixContribution(NamedTuple):
    """A mass or a stiffness: (6, 6), (12, 12) or (1, 1), and the Jacobian of the rates that it belongs to."""

    jacobian: Jacobian
    matrix: Array


def mass_contributions(structure: Structure, kinematics: NodeKinematics) -> list[MatrixContribution]:
    """Return the terms of M: rigid bodies, elements by [t; q_e] (eq. 2), and rotors."""
    terms = [MatrixContribution(kinematics.end_jacobians[node], inertia) for node, inertia in structure.bodies]
    for node, start in zip(structure.nodes, kinematics.start_jacobians, strict=True):
        if start is None or node.element is None:
            continue
        columns = [6 + component for component in structure.components]
        rows = np.zeros((len(columns), 12), dtype=int)
        rows[range(len(columns)), columns] = 1
        padded = [Jacobian(start.numbers, _pad(start.rows))] if start.numbers else []
        jacobian = sum_jacobians([*padded, Jacobian(node.coordinates, rows)])
        terms.append(MatrixContribution(jacobian, node.element.mass))
    inertias = [(spring.coordinate, spring.inertia) for spring in structure.springs if spring.inertia]
    return terms + [_coordinate_contribution(number, inertia) for number, inertia in inertias]


def stiffness_contributions(structure: Structure) -> list[MatrixContribution]:
    """Return the terms of K: elements by q_e, and springs."""
    terms = []
    components = list(structure.components)
    for node in structure.nodes:
        if node.element is not None:
            matrix = node.element.stiffness[np.ix_(components, components)]
            terms.append(MatrixContribution(Jacobian(node.coordinates, np.eye(len(components), dtype=int)), matrix))
    stiffnesses = [(spring.coordinate, spring.stiffness) for spring in structure.springs if spring.stiffness]
    return terms + [_coordinate_contribution(number, stiffness) for number, stiffness in stiffnesses]


def _coordinate_contribution(number: int, value: float) -> MatrixContribution:
    """Return the contribution of a mass or stiffness of a single coordinate."""
    return MatrixContribution(Jacobian((number,), np.ones((1, 1), dtype=int)), np.array([[value]]))


def _pad(rows: ScalarArray) -> ScalarArray:
    return np.concatenate([rows, np.zeros_like(rows)], axis=-1)


def virtual_system(structure: Structure, q: ScalarArray) -> tuple[ScalarArray, ScalarArray]:
    """Return M_g and K_g (..., g, g) of the generalized coordinates with open loops (eq. 7)."""
    kinematics = compute_node_kinematics(structure, q)
    coordinates = range(len(structure.coordinates))
    return (
        _assemble(mass_contributions(structure, kinematics), coordinates, q),
        _assemble(stiffness_contributions(structure), coordinates, q),
    )


def constrained_matrices(structure: Structure, robot: Robot, q: ScalarArray) -> Matrices | None:
    """Return the Matrices with closed loops, by elimination of one element for each closure (eq. 11-15).

    q: (..., all joints) positions that close the loops; scalars are generic. None where no elements can be eliminated
    one by one.
    """
    elements = choose_eliminated_elements(structure)
    if elements is None:
        return None
    kinematics = compute_node_kinematics(structure, q)
    eliminated = dependent_jacobians(structure, kinematics, robot, q, elements)
    dependent = {number for numbers in eliminated for number in numbers}
    independent = tuple(number for number in range(len(structure.coordinates)) if number not in dependent)
    mass_terms = _eliminate(mass_contributions(structure, kinematics), eliminated)
    stiffness_terms = _eliminate(stiffness_contributions(structure), eliminated)
    J = _expansion(independent, eliminated, len(structure.coordinates), q)
    return Matrices(_assemble(mass_terms, independent, q), _assemble(stiffness_terms, independent, q), independent, J)


def _eliminate(
    terms: Sequence[MatrixContribution], eliminated: Mapping[tuple[int, ...], Jacobian]
) -> list[MatrixContribution]:
    return [MatrixContribution(eliminate_dependent(term.jacobian, eliminated), term.matrix) for term in terms]


def _expansion(
    independent: tuple[int, ...], eliminated: Mapping[tuple[int, ...], Jacobian], size: int, q: ScalarArray
) -> ScalarArray:
    """Return (..., size, n), from independent coordinates to all."""
    columns = {number: column for column, number in enumerate(independent)}
    J = _zeros(np.shape(q)[:-1], (size, len(independent)), q)
    J[..., list(independent), range(len(independent))] = 1
    for numbers, jacobian in eliminated.items():
        rows = np.array(numbers)[:, None]
        own = np.array([columns[number] for number in jacobian.numbers], dtype=int)
        J[..., rows, own] = np.swapaxes(jacobian.rows, -1, -2)
    return J


def constrained_matrices_by_qr(structure: Structure, robot: Robot, q: Array) -> Matrices:
    """Return the Matrices of one sample q (all joints,), with dependent coordinates chosen numerically.

    The dependent coordinates are the first pivots of a QR factorization of the closure equations. Redundant equations
    are allowed.
    """
    J_g = constraint_jacobian(structure, robot, q)
    M_g, K_g = virtual_system(structure, q)
    size = J_g.shape[1]
    scale = np.abs(J_g).max(axis=0)
    _, R, order = qr(J_g / np.where(scale > 0, scale, 1.0), pivoting=True, mode="economic")
    pivots = np.abs(np.diagonal(R))
    rank = int(np.sum(pivots > RANK_TOLERANCE * pivots[0])) if len(pivots) else 0
    dependent = order[:rank]
    free = order[rank:]
    _, R = qr(J_g[:, order], mode="economic")
    independent = np.sort(free)
    J = np.zeros((size, size - rank))
    J[free, np.searchsorted(independent, free)] = 1
    if rank:
        dependence = -solve_triangular(R[:rank, :rank], R[:rank, rank:])
        J[np.ix_(dependent, np.searchsorted(independent, free))] = dependence
    M = J.T @ M_g @ J
    K = J.T @ K_g @ J
    return Matrices((M + M.T) / 2, (K + K.T) / 2, tuple(independent.tolist()), J)


def constraint_jacobian(structure: Structure, robot: Robot, q: Array) -> Array:
    """Return J_g (6 closures, g), or 3 rows for each closure in the plane, of J_g q̇_g = 0 (eq. 10)."""
    kinematics = compute_node_kinematics(structure, q)
    blocks = []
    for leaf, target in closure_jacobians(structure, kinematics, robot, q):
        rows = np.zeros((len(structure.components), len(structure.coordinates)))
        for jacobian, sign in ((leaf, 1), (target, -1)):
            rows[:, list(jacobian.numbers)] += sign * jacobian.rows[:, list(structure.components)].T
        blocks.append(rows)
    return np.concatenate(blocks) if blocks else np.zeros((0, len(structure.coordinates)))


def eliminate_dependent(jacobian: Jacobian, eliminated: Mapping[tuple[int, ...], Jacobian]) -> Jacobian:
    """Return a Jacobian with respect to independent coordinates; eliminated: Jacobians of the dependent (eq. 12)."""
    dependent = {number for numbers in eliminated for number in numbers}
    terms = [jacobian.without(dependent)]
    for numbers, rows in eliminated.items():
        if numbers[0] in jacobian.numbers:
            own = [jacobian.numbers.index(number) for number in numbers]
            terms.append(Jacobian(rows.numbers, rows.rows @ jacobian.rows[..., own, :]))
    return sum_jacobians(terms) if len(terms) > 1 else jacobian


def _assemble(terms: Sequence[MatrixContribution], independent: Sequence[int], q: ScalarArray) -> ScalarArray:
    """Return Σ Jᵀ M J (..., n, n) with respect to the coordinates `independent`."""
    columns = {number: column for column, number in enumerate(independent)}
    total = _zeros(np.shape(q)[:-1], (len(columns), len(columns)), q)
    for jacobian, matrix in terms:
        own = np.array([columns[number] for number in jacobian.numbers], dtype=int)
        upper = np.triu(jacobian.rows @ matrix @ np.swapaxes(jacobian.rows, -1, -2))  # the matrix is symmetric
        total[..., own[:, None], own] += upper + np.swapaxes(np.triu(upper, 1), -1, -2)
    return total


def _zeros(batch: tuple[int, ...], shape: tuple[int, ...], q: ScalarArray) -> ScalarArray:
    """Return zeros (*batch, *shape) of the kind of scalars that q has."""
    if np.asarray(q).dtype == object:
        return np.zeros((*batch, *shape), dtype=int).astype(object)
    return np.zeros((*batch, *shape))
