"""Inertial parameters grouped into the fewest on which the joint efforts depend; the efforts stay the same.

The part of a revolute link j that is symmetric about z_j without spin inertia (mass M, first moment MZ along the axis,
second moments YY about x and y) exerts the same wrench on the antecedent at every position of joint j, so it can be
fixed to the antecedent. Of a prismatic link this holds for the part without mass (all second moments). Link j is left
with M = MZ = YY = 0, or without second moments: the closed-form rules of Khalil and Kleinfinger for MDH trees (Khalil,
section 2), from the tips to the base. On a fixed base, the rotor inertia of a first revolute joint counts as inertia of
its link. Where all joints are revolute, only further rotor inertias of special arms remain to be grouped; prismatic
joints near the base leave more, for which `select_independent_columns` finds the dependences numerically.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.robot import Link

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot

ROUNDING_THRESHOLD = 1e-9
"""Singular values below this fraction of the largest one may be rounding."""

THRESHOLD_FRACTIONS = (0.5, 0.6, 0.4, 0.7, 0.3, 0.8, 0.2, 0.9, 0.1)
"""Positions of the threshold for columns in the gap of the singular values, on a logarithmic scale."""


def group_inertial_parameters(robot: Robot, reoriented_joints: Collection[int] = ()) -> Robot:
    """The robot with the same efforts for every motion and fewer inertial parameters that are not zero.

    Parameters
    ----------
    robot : Robot
        Its inertial parameters may be symbols.
    reoriented_joints : collection of int
        Numbers of the joints whose axes move in the antecedent (attitude charts): only masses pass them.

    Returns
    -------
    Robot
        With the efforts, A, H, joint accelerations, base acceleration and base wrench of `robot`. Its links are not
        physically consistent bodies, and the wrenches in its joints differ.

    Notes
    -----
    Source: Khalil, section 2.
    """
    inertias = [link.inertia for link in robot.links]
    rotation_directions = _single_rotation_directions(robot)
    for number in range(len(robot.joints), 0, -1):
        joint = robot.joints[number - 1]
        moved = _massless_part(inertias[number]) if joint.prismatic else _symmetric_part(inertias[number])
        if number - 1 in reoriented_joints:
            moved = Inertia(moved.mass, 0 * moved.first_moments, 0 * moved.second_moments)
        inertias[number] = _subtract(inertias[number], moved)
        direction = rotation_directions[number]
        if joint.prismatic and direction is not None:
            inertias[number], first = _group_sliding_moments(inertias[number], direction)
            moved += first
        inertias[joint.antecedent] += moved.transformed_by(joint.placement)
    joints = list(robot.joints)
    for number, joint in enumerate(robot.joints, start=1):
        if joint.antecedent == 0 and not (joint.prismatic or robot.moving_base):
            inertias[number] += _rotor_as_body(joint)
            joints[number - 1] = replace(joint, rotor_inertia=0.0)
    links = [Link(link.name, inertia) for link, inertia in zip(robot.links, inertias, strict=True)]
    return replace(robot, links=tuple(links), joints=tuple(joints))


class IndependentColumns(NamedTuple):
    """Independent columns of a matrix, and how the others depend on them.

    Attributes
    ----------
    kept, dependent : list of int
        Column numbers; the kept ones are independent, and matrix[:, dependent] = matrix[:, kept] @ K.
    K : (len(kept), len(dependent))
    gap : (float, float)
        The smallest singular value within the rank and the largest one beyond it, relative to the largest of all.
    """

    kept: list[int]
    dependent: list[int]
    K: Array
    gap: tuple[float, float]


def select_independent_columns(matrix: Array) -> IndependentColumns:
    """As many independent columns of a matrix as it has rank; of dependent columns the first is kept.

    Parameters
    ----------
    matrix : (rows, p)
        For base parameters, the regressor of many random motions.

    Returns
    -------
    IndependentColumns
        For a regressor, the parameters θ_kept + K θ_dependent are base parameters.

    Notes
    -----
    The rank is where singular values fall the most on their way to rounding. Source: Gautier, "Numerical calculation of
    the base inertial parameters of robots" (1991), by QR factors.
    """
    triangle: Array = np.asarray(np.linalg.qr(matrix, mode="r"), dtype=float)
    s: Array = np.asarray(np.linalg.svd(triangle, compute_uv=False), dtype=float)
    rank, gap = _rank(s, matrix.shape)
    kept: list[int] = []
    lower = gap[1] * s.max(initial=0)
    upper = gap[0] * s.max(initial=0)
    # the normal part of an independent column is at least the smallest singular value, of a dependent one rounding
    for fraction in THRESHOLD_FRACTIONS:
        kept = _columns_with_normal_part(triangle, upper**fraction * lower ** (1 - fraction))
        if len(kept) == rank:
            break
    dependent = [column for column in range(matrix.shape[1]) if column not in set(kept)]
    K = np.linalg.lstsq(triangle[:, kept], triangle[:, dependent], rcond=None)[0]
    return IndependentColumns(kept, dependent, np.asarray(K, dtype=float), gap)


def _rank(s: Array, shape: tuple[int, ...]) -> tuple[int, tuple[float, float]]:
    """The rank, and the singular values on both sides of the gap relative to the largest one, of values s (p,)."""
    if not s.max(initial=0) > 0:
        return 0, (1.0, 0.0)
    rounding = max(shape) * np.finfo(float).eps
    relative = np.maximum(np.append(s / s[0], 0.0), rounding)
    ratios = np.where(relative[1:] < ROUNDING_THRESHOLD, relative[:-1] / relative[1:], 0.0)
    rank = int(np.argmax(ratios)) + 1
    return rank, (float(relative[rank - 1]), float(relative[rank]))


def _columns_with_normal_part(matrix: Array, threshold: float) -> list[int]:
    """Numbers of the columns whose part normal to the selected columns before them is longer than the threshold."""
    kept: list[int] = []
    basis = np.zeros((matrix.shape[0], 0))
    for column in range(matrix.shape[1]):
        normal = matrix[:, column]
        for _ in range(2):  # the second pass restores the digits that the first one loses
            normal = normal - basis @ (basis.T @ normal)
        length = np.linalg.norm(normal)
        if length > threshold:
            kept.append(column)
            basis = np.column_stack([basis, normal / length])
    return kept


def _symmetric_part(inertia: Inertia) -> Inertia:
    """The part of a body that is symmetric about z, without second moment about z."""
    YY = inertia.second_moments[1, 1]
    zero = 0 * YY
    first = np.array([zero, zero, inertia.first_moments[2]])
    return Inertia(inertia.mass, first, np.array([[YY, zero, zero], [zero, YY, zero], [zero, zero, zero]]))


def _rotor_as_body(joint: Joint) -> Inertia:
    """The rotor inertia of a joint as a body that turns about the joint axis."""
    zero = 0 * joint.rotor_inertia
    second = np.array([[zero, zero, zero], [zero, zero, zero], [zero, zero, joint.rotor_inertia]])
    return Inertia(zero, np.array([zero] * 3), second)


def _massless_part(inertia: Inertia) -> Inertia:
    return Inertia(0.0, np.zeros(3), inertia.second_moments)


def _single_rotation_directions(robot: Robot) -> list[ScalarArray | None]:
    """For each link the only direction a (3,) about which it can turn, in its frame.

    A unit vector; zero where the link cannot turn; None where it turns about several directions, where the base may
    move, or where angles are symbols.
    """
    directions: list[ScalarArray | None] = [None if robot.moving_base else np.zeros(3)]
    for joint in robot.joints:
        a = directions[joint.antecedent]
        try:
            R = np.asarray(joint.placement[:3, :3], dtype=float)
        except TypeError:
            a = None
        if a is not None:
            a = a @ R
            if not joint.prismatic:
                a = None if a[:2].any() else np.array([0.0, 0.0, 1.0])
        directions.append(a)
    return directions


def _group_sliding_moments(inertia: Inertia, a: ScalarArray) -> tuple[Inertia, Inertia]:
    """The remaining inertia of a prismatic link that turns about the direction a alone, and its antecedent's part.

    First moments along a exert no force, and a moment that no joint transmits to its effort: as much of them may be
    added as makes another entry zero. Where the link slides along a, first moments across a have the same effect at
    every position.
    """
    first = inertia.first_moments.copy()
    zeros = 0 * inertia.first_moments
    if not a.any():
        return Inertia(inertia.mass, zeros, inertia.second_moments), Inertia()
    if not a[:2].any():
        first[2] = 0 * first[2]
        return Inertia(inertia.mass, zeros, inertia.second_moments), Inertia(0.0, first)
    largest = np.argmax(np.abs(a))
    first = first - first[largest] / a[largest] * a
    first[largest] = zeros[largest]
    return Inertia(inertia.mass, first, inertia.second_moments), Inertia()


def _subtract(inertia: Inertia, part: Inertia) -> Inertia:
    """A body without a part of it; equal entries leave zero exactly."""
    return Inertia(
        inertia.mass - part.mass,
        inertia.first_moments - part.first_moments,
        inertia.second_moments - part.second_moments,
    )
