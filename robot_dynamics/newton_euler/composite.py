"""Inertia matrix A by composite bodies: link j and its subtree, as if their joints were locked (Khalil, 7.2).

A_kj is the force at joint k, on the path from link j to the base, where joint j alone accelerates by 1. The composite
body of j then moves along z_j or rotates about it, and its wrench is transmitted to the base. Rotors are counted on the
diagonal.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robot_dynamics.array_types import ScalarArray
from robot_dynamics.model.inertia import symmetric_entries, symmetric_matrix
from robot_dynamics.newton_euler.joint_placement import joint_placement
from robot_dynamics.newton_euler.kinematics import axis_row
from robot_dynamics.newton_euler.screw import apply, cross, screw

if TYPE_CHECKING:
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot

Entries: TypeAlias = dict[tuple[int, int], ScalarArray]
"""Entries (...) of a matrix by row and column: joints count from 1, rows of the base from -6 to -1."""


def inertia_matrix(robot: Robot, q: ScalarArray, with_base: bool | None = None) -> ScalarArray:
    """Inertia matrix A (..., m, m) at joint positions q (..., n), rotors counted.

    m = n, or 6 + n with rows of the base, which come first. with_base: whether it has these rows; None: if the base
    moves.
    """
    with_base = robot.moving_base if with_base is None else with_base
    masses: list[float | ScalarArray] = [link.inertia.mass for link in robot.links]
    first = [link.inertia.first_moments for link in robot.links]
    second = [link.inertia.second_moments for link in robot.links]
    base = 6 if with_base else 0
    joints = len(robot.joints)
    entries: Entries = {}
    placements = [joint_placement(joint, q[..., j : j + 1]) for j, joint in enumerate(robot.joints)]
    for j in range(joints, 0, -1):
        joint = robot.joints[j - 1]
        R, P = placements[j - 1]
        i = joint.antecedent
        unit_wrench = _wrench_of_unit_acceleration(joint, masses[j], first[j], second[j])
        entries[j, j] = unit_wrench[..., axis_row(joint)] + joint.rotor_inertia
        for k, wrench in _transmit_to_base(robot, placements, j, unit_wrench):
            if k > 0:
                entries[k, j] = wrench[..., axis_row(robot.joints[k - 1])]
            elif with_base:
                entries.update({(row - 6, j): wrench[..., row] for row in range(6)})
        if i > 0 or with_base:
            rotated_first = apply(R, first[j])
            rotated_second = rotate_second_moments(joint, R, q[..., j - 1], second[j])
            second[i] = second[i] + rotated_second + _parallel_axis_term(masses[j], rotated_first, P)
            first[i] = first[i] + rotated_first + _scale(masses[j], P)
            masses[i] = masses[i] + masses[j]
    if with_base:
        entries.update(_base_block(masses[0], first[0], second[0]))
    return _symmetric_from_entries(entries, base, joints, q.shape[:-1])


def _wrench_of_unit_acceleration(
    joint: Joint, mass: float | ScalarArray, first: ScalarArray, second: ScalarArray
) -> ScalarArray:
    """J ja (..., 6) of a composite body: the wrench that accelerates it along z, or about z, by 1."""
    x = first[..., 0]
    y = first[..., 1]
    zero = np.zeros_like(x)
    if joint.prismatic:
        return np.stack(np.broadcast_arrays(zero, zero, mass + zero, y, -x, zero), axis=-1)
    return np.stack([-y + zero, x + zero, zero, second[..., 0, 2], second[..., 1, 2], second[..., 2, 2]], axis=-1)


def _transmit_to_base(
    robot: Robot, placements: list[tuple[ScalarArray, ScalarArray]], j: int, wrench: ScalarArray
) -> Iterator[tuple[int, ScalarArray]]:
    """(k, wrench (..., 6) in frame k at its origin) for each link k between link j and the base, the base last."""
    while j > 0:
        R, P = placements[j - 1]
        force = apply(R, wrench[..., :3])
        wrench = screw(force, apply(R, wrench[..., 3:]) + cross(P, force))
        j = robot.joints[j - 1].antecedent
        yield j, wrench


def rotate_second_moments(joint: Joint, R: ScalarArray, position: ScalarArray, J: ScalarArray) -> ScalarArray:
    """R J Rᵀ (..., 3, 3) for a symmetric J in frame j, in the axes of the antecedent.

    A rotation about z keeps the trace of the upper left block, which saves half of the products.
    """
    if not joint.prismatic:
        c = np.cos(position)
        s = np.sin(position)
        xx, xy, xz, yy, yz, zz = symmetric_entries(J)
        t = c * (xx - yy) - s * (xy + xy)
        shift = c * t  # xx' = c² xx - 2 c s xy + s² yy = yy + c t
        J = symmetric_matrix(yy + shift, xy + s * t, c * xz - s * yz, xx - shift, s * xz + c * yz, zz)
        R = joint.rotation
    rotated = R @ J
    return symmetric_from_upper(rotated @ np.swapaxes(R, -1, -2))


def _parallel_axis_term(mass: float | ScalarArray, first: ScalarArray, P: ScalarArray) -> ScalarArray:
    """-P̂ M̂S - M̂S P̂ - M P̂ P̂ (..., 3, 3): change of second moments where the origin moves from O_j to O_i by P."""
    x, y, z = (P[..., k] for k in range(3))
    # with w = M P + 2 MS, the sum is (w·P) 1 - (w Pᵀ + P wᵀ) / 2 for its symmetric part; MS enters both ways
    a, b, c = (first[..., k] + first[..., k] + mass * P[..., k] for k in range(3))
    xx = a * x
    yy = b * y
    zz = c * z
    u, v = (first[..., k] + mass * P[..., k] for k in range(2))
    xy = -(u * y + first[..., 1] * x)
    xz = -(u * z + first[..., 2] * x)
    yz = -(v * z + first[..., 2] * y)
    return symmetric_matrix(yy + zz, xy, xz, xx + zz, yz, xx + yy)


def _scale(mass: float | ScalarArray, P: ScalarArray) -> ScalarArray:
    """mass P (..., 3)."""
    scaled: ScalarArray = np.expand_dims(mass, -1) * P if np.ndim(mass) else mass * P
    return scaled


def symmetric_from_upper(matrix: ScalarArray) -> ScalarArray:
    """Symmetric matrices (..., 3, 3) with the upper triangle of `matrix` (..., 3, 3)."""
    return symmetric_matrix(*symmetric_entries(matrix))


def _base_block(mass: float | ScalarArray, first: ScalarArray, second: ScalarArray) -> Entries:
    """Entries of the rows of the base, for the whole robot as one body."""
    x, y, z = (first[..., k] for k in range(3))
    zero = np.zeros_like(x)
    coupling = [[zero, z, -y], [-z, zero, x], [y, -x, zero]]  # -M̂S
    entries = {(k - 6, k - 6): mass + zero for k in range(3)}
    for row in range(3):
        for column in range(3):
            entries[row - 6, column - 3] = coupling[row][column]
            if column >= row:
                entries[row - 3, column - 3] = second[..., row, column]
    return entries


def _symmetric_from_entries(entries: Entries, base: int, joints: int, batch: tuple[int, ...]) -> ScalarArray:
    """The symmetric matrix (*batch, m, m) of its upper entries."""
    size = base + joints
    is_symbolic = any(np.asarray(entry).dtype == object for entry in entries.values())
    matrix: ScalarArray = np.zeros((*batch, size, size), dtype=object if is_symbolic else float)
    for (row, column), entry in entries.items():
        i, j = (number + base - 1 if number > 0 else number + 6 for number in (row, column))
        matrix[..., i, j] = entry
        matrix[..., j, i] = entry
    return matrix
