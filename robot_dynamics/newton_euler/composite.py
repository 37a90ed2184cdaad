"""The matrix A by composite bodies: link j with all that hangs on it, as if its joints were frozen (Khalil, 7.2).

A_kj is what joint k, on the way from link j to the base, has to bear when joint j alone accelerates by 1: the
composite body of j then moves about or along z_j, and its wrench is handed down. Rotors are counted on the diagonal.
"""

import numpy as np

from robot_dynamics.model.inertia import symmetric_entries, symmetric_matrix
from robot_dynamics.newton_euler.kinematics import axis_row, joint_placement
from robot_dynamics.newton_euler.screw import apply, cross, screw


def inertia_matrix(robot, q):
    """A (..., m, m) at joint positions q (..., n), rotors counted; m = n, or 6 + n with a moving base, it first."""
    masses = [link.inertia.mass for link in robot.links]
    first = [link.inertia.first_moments for link in robot.links]
    second = [link.inertia.second_moments for link in robot.links]
    base, joints = (6 if robot.moving_base else 0), len(robot.joints)
    entries = {}
    placed = [None] + [joint_placement(joint, q[..., j : j + 1]) for j, joint in enumerate(robot.joints)]
    for j in range(joints, 0, -1):
        joint, (R, P) = robot.joints[j - 1], placed[j]
        i = joint.antecedent
        wrench = _wrench_of_unit_acceleration(joint, masses[j], first[j], second[j])
        entries[j, j] = wrench[..., axis_row(joint)] + joint.rotor_inertia
        for k, handed in _handed_down(robot, placed, j, wrench):
            if k > 0:
                entries[k, j] = handed[..., axis_row(robot.joints[k - 1])]
            elif robot.moving_base:
                entries.update({(row - 6, j): handed[..., row] for row in range(6)})
        if i > 0 or robot.moving_base:
            turned, square = apply(R, first[j]), rotate_second_moments(joint, R, q[..., j - 1], second[j])
            second[i] = second[i] + square + _shift(masses[j], turned, P)
            first[i] = first[i] + turned + _times(masses[j], P)
            masses[i] = masses[i] + masses[j]
    if robot.moving_base:
        entries.update(_base_block(masses[0], first[0], second[0]))
    return _matrix(entries, base, joints, q.shape[:-1])


def _wrench_of_unit_acceleration(joint, mass, first, second):
    """J ja of a composite body (..., 6): the wrench that makes it move along, or turn about, z by 1."""
    x, y = first[..., 0], first[..., 1]
    zero = np.zeros_like(x)
    if joint.prismatic:
        return np.stack(np.broadcast_arrays(zero, zero, mass + zero, y, -x, zero), axis=-1)
    return np.stack([-y + zero, x + zero, zero, second[..., 0, 2], second[..., 1, 2], second[..., 2, 2]], axis=-1)


def _handed_down(robot, placed, j, wrench):
    """(k, wrench in frame k at its origin) for each link k between link j and the base, the base last."""
    while j > 0:
        R, P = placed[j]
        force = apply(R, wrench[..., :3])
        wrench = screw(force, apply(R, wrench[..., 3:]) + cross(P, force))
        j = robot.joints[j - 1].antecedent
        yield j, wrench


def rotate_second_moments(joint, R, position, J):
    """R J Rᵀ (..., 3, 3) for a symmetric J in frame j, in the axes of the antecedent.

    A turn about z leaves the trace of the upper left block alone, which saves half of the products.
    """
    if not joint.prismatic:
        c, s = np.cos(position), np.sin(position)
        xx, xy, xz, yy, yz, zz = symmetric_entries(J)
        t = c * (xx - yy) - s * (xy + xy)
        shift = c * t  # xx' = c² xx - 2 c s xy + s² yy = yy + c t
        J = symmetric_matrix(yy + shift, xy + s * t, c * xz - s * yz, xx - shift, s * xz + c * yz, zz)
        R = joint.rotation
    turned = R @ J
    return symmetric_from_upper(turned @ np.swapaxes(R, -1, -2))


def _shift(mass, first, P):
    """What moving the origin from O_j to O_i by P adds to second moments: -P̂ M̂S - M̂S P̂ - M P̂ P̂ (parallel axes)."""
    x, y, z = (P[..., k] for k in range(3))
    # with w = M P + 2 MS, the sum is (w·P) 1 - (w Pᵀ + P wᵀ) / 2 for its symmetric part; MS enters both ways
    a, b, c = (first[..., k] + first[..., k] + mass * P[..., k] for k in range(3))
    xx, yy, zz = a * x, b * y, c * z
    u, v = (first[..., k] + mass * P[..., k] for k in range(2))
    xy = -(u * y + first[..., 1] * x)
    xz = -(u * z + first[..., 2] * x)
    yz = -(v * z + first[..., 2] * y)
    return symmetric_matrix(yy + zz, xy, xz, xx + zz, yz, xx + yy)


def _times(mass, P):
    return np.expand_dims(mass, -1) * P if np.ndim(mass) else mass * P


def symmetric_from_upper(matrix):
    """The symmetric matrices (..., 3, 3) of which these have the upper triangle."""
    return symmetric_matrix(*symmetric_entries(matrix))


def _base_block(mass, first, second):
    """Entries {(row, column): (...)} of the base's own six rows, (-6..-1), of the whole robot as one body."""
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


def _matrix(entries, base, joints, batch):
    """The symmetric matrix (..., m, m) of entries {(row, column): (...)}; joints count from 1, base rows from -6."""
    size = base + joints
    kind = object if any(np.asarray(entry).dtype == object for entry in entries.values()) else float
    matrix = np.zeros((*batch, size, size), dtype=kind)
    for (row, column), entry in entries.items():
        place_of = [number + base - 1 if number > 0 else number + 6 for number in (row, column)]
        matrix[..., place_of[0], place_of[1]] = entry
        matrix[..., place_of[1], place_of[0]] = entry
    return matrix
