"""Mass and stiffness matrices of the structure, from its elements (Briot, eq. 6, 7 and 15)."""

from typing import NamedTuple

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

RANK_TOLERANCE = 1e-9  # a closing equation that has less than this part beside the others says nothing new


class Matrices(NamedTuple):
    """mass, stiffness: (..., n, n) of the independent coordinates, whose numbers `independent` has, in their order;
    expansion: (..., g, n), from these to all generalized coordinates."""

    mass: np.ndarray
    stiffness: np.ndarray
    independent: tuple
    expansion: np.ndarray


class MatrixContribution(NamedTuple):
    """What has a mass or a stiffness: (6, 6) or (12, 12), of what the columns of its Jacobian's rows are rates of."""

    jacobian: Jacobian
    matrix: np.ndarray


def mass_contributions(structure, motion):
    """The Parts of M: elements by [t; q_e] (eq. 2), and rigid bodies."""
    found = [MatrixContribution(motion.end_jacobians[node], inertia) for node, inertia in structure.bodies]
    for node, begin in zip(structure.nodes, motion.start_jacobians, strict=True):
        if begin is None:
            continue
        columns = [6 + component for component in structure.components]
        rows = np.zeros((len(columns), 12), dtype=int)
        rows[range(len(columns)), columns] = 1
        padded = [Jacobian(begin.numbers, _padded(begin.rows))] if begin.numbers else []
        found.append(MatrixContribution(sum_jacobians([*padded, Jacobian(node.coordinates, rows)]), node.element.mass))
    found += [MatrixContribution(Jacobian((number,), np.ones((1, 1), dtype=int)), np.array([[inertia]]))
              for number, inertia, _ in structure.springs if inertia]  # fmt: skip
    return found


def stiffness_contributions(structure):
    """The Parts of K: elements by q_e, and springs."""
    found, components = [], list(structure.components)
    for node in structure.nodes:
        if node.element is not None:
            matrix = node.element.stiffness[np.ix_(components, components)]
            found.append(MatrixContribution(Jacobian(node.coordinates, np.eye(len(components), dtype=int)), matrix))
    found += [MatrixContribution(Jacobian((number,), np.ones((1, 1), dtype=int)), np.array([[stiffness]]))
              for number, _, stiffness in structure.springs if stiffness]  # fmt: skip
    return found


def _padded(rows):
    return np.concatenate([rows, np.zeros_like(rows)], axis=-1)


def virtual_system(structure, q):
    """(M_g, K_g) (..., g, g): of the generalized coordinates, no loop closed (eq. 7)."""
    motion = compute_node_kinematics(structure, q)
    places = range(len(structure.coordinates))
    return _assembled(mass_contributions(structure, motion), places, q), _assembled(
        stiffness_contributions(structure), places, q
    )


def constrained_matrices(structure, robot, q):
    """The Matrices with all loops closed, by elements that are eliminated one by one (eq. 11-15); None where that
    cannot be. q: (..., all joints) positions that close the loops; scalars are generic."""
    elements = choose_eliminated_elements(structure)
    if elements is None:
        return None
    motion = compute_node_kinematics(structure, q)
    told = dependent_jacobians(structure, motion, robot, q, elements)
    dependent = {number for numbers in told for number in numbers}
    independent = tuple(number for number in range(len(structure.coordinates)) if number not in dependent)
    M, K = ([MatrixContribution(eliminate_dependent(part.jacobian, told), part.matrix) for part in parts]
            for parts in (mass_contributions(structure, motion), stiffness_contributions(structure)))  # fmt: skip
    J = _expansion(independent, told, len(structure.coordinates), q)
    return Matrices(_assembled(M, independent, q), _assembled(K, independent, q), independent, J)


def _expansion(independent, told, size, q):
    places = {number: place for place, number in enumerate(independent)}
    J = _zeros(np.shape(q)[:-1], (size, len(independent)), q)
    J[..., list(independent), range(len(independent))] = 1
    for numbers, jacobian in told.items():
        here = [places[number] for number in jacobian.numbers]
        J[(..., *np.ix_(numbers, here))] = np.swapaxes(jacobian.rows, -1, -2)
    return J


def constrained_matrices_by_qr(structure, robot, q):
    """The Matrices of one sample q (all joints,), its dependent coordinates chosen by their numbers: those that a QR
    factorization of the closing equations with pivoting takes first. Redundant equations do no harm."""
    J_g = constraint_jacobian(structure, robot, q)
    M_g, K_g = virtual_system(structure, q)
    size = J_g.shape[1]
    scale = np.abs(J_g).max(axis=0)
    _, R, order = qr(J_g / np.where(scale > 0, scale, 1.0), pivoting=True, mode="economic")
    pivots = np.abs(np.diagonal(R))
    rank = int(np.sum(pivots > RANK_TOLERANCE * pivots[0])) if len(pivots) else 0
    dependent, free = order[:rank], order[rank:]
    _, R = qr(J_g[:, order], mode="economic")
    independent = np.sort(free)
    J = np.zeros((size, size - rank))
    J[free, np.searchsorted(independent, free)] = 1
    if rank:
        told = -solve_triangular(R[:rank, :rank], R[:rank, rank:])
        J[np.ix_(dependent, np.searchsorted(independent, free))] = told
    M, K = ((A + A.T) / 2 for A in (J.T @ M_g @ J, J.T @ K_g @ J))
    return Matrices(M, K, tuple(independent.tolist()), J)


def constraint_jacobian(structure, robot, q):
    """J_g (6 closures, g), or with 3 for each closure in the plane, of the closing equations J_g q̇_g = 0 (eq. 10)."""
    motion, found = compute_node_kinematics(structure, q), []
    for leaf, target in closure_jacobians(structure, motion, robot, q):
        rows = np.zeros((len(structure.components), len(structure.coordinates)))
        for jacobian, sign in ((leaf, 1), (target, -1)):
            rows[:, list(jacobian.numbers)] += sign * jacobian.rows[:, list(structure.components)].T
        found.append(rows)
    return np.concatenate(found) if found else np.zeros((0, len(structure.coordinates)))


def eliminate_dependent(jacobian, told):
    """A Jacobian by independent coordinates alone, where `told` has what dependent ones come to (eq. 12)."""
    dependent = {number for numbers in told for number in numbers}
    parts = [jacobian.without(dependent)]
    for numbers, rows in told.items():
        if numbers[0] in jacobian.numbers:
            own = [jacobian.numbers.index(number) for number in numbers]
            parts.append(Jacobian(rows.numbers, rows.rows @ jacobian.rows[..., own, :]))
    return sum_jacobians(parts) if len(parts) > 1 else jacobian


def _assembled(parts, independent, q):
    """Σ Jᵀ M J (..., n, n)."""
    places = {number: place for place, number in enumerate(independent)}
    total = _zeros(np.shape(q)[:-1], (len(places), len(places)), q)
    for jacobian, matrix in parts:
        here = [places[number] for number in jacobian.numbers]
        half = np.triu(jacobian.rows @ matrix @ np.swapaxes(jacobian.rows, -1, -2))  # the rest mirrors it
        total[(..., *np.ix_(here, here))] += half + np.swapaxes(np.triu(half, 1), -1, -2)
    return total


def _zeros(batch, shape, q):
    """Zeros of the kind of scalars that q has."""
    symbols = np.asarray(q).dtype == object
    return np.zeros((*batch, *shape), dtype=int).astype(object) if symbols else np.zeros((*batch, *shape))
