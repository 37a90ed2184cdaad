"""Inertial parameters gathered into the fewest that the joint efforts depend on, the robot's efforts staying the same.

Of the body of a revolute link j, the part that is symmetric about z_j without spin inertia (mass M, first moment MZ
along the axis, second moments YY about x and y) exerts the same wrench on the antecedent however joint j turns, so it
can as well be fixed to the antecedent. Of a prismatic link, a part without mass (all second moments) does. What is left
of link j has M = MZ = YY = 0, or no second moments: the closed-form rules of Khalil and Kleinfinger for MDH trees
(Khalil, section 2), from the tips to the base. On a base that stands, the rotor of a first joint that turns counts as
inertia of its link. Where all joints turn nothing is left to gather but further rotors in special arms; links that
slide near the base leave more, for which `independent_columns` finds what depends on what by numbers.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.robot import Link

ROUNDING_THRESHOLD = 1e-9  # part of the largest singular value, above which one is none of rounding
THRESHOLD_FRACTIONS = (
    0.5,
    0.6,
    0.4,
    0.7,
    0.3,
    0.8,
    0.2,
    0.9,
    0.1,
)  # of the way up the gap, where a column's own part may count


def group_inertial_parameters(robot, reoriented_joints=()):
    """The Robot with the same efforts for every motion, and fewer inertial parameters that are not zero.

    turned: numbers of joints whose axes do not stay where they are in the antecedent: only masses pass them.

    Its links are no bodies that could exist. Efforts, A, H, the accelerations of the direct model and those of a moving
    base and its wrench are those of the given robot; what joints carry besides their efforts is not.
    """
    inertias = [link.inertia for link in robot.links]
    turned_about = _only_directions(robot)
    for number in range(len(robot.joints), 0, -1):
        joint = robot.joints[number - 1]
        moved = _symmetric_part(inertias[number]) if not joint.prismatic else _massless_part(inertias[number])
        if number - 1 in reoriented_joints:
            moved = Inertia(moved.mass, 0 * moved.first_moments, 0 * moved.second_moments)
        inertias[number] = _without(inertias[number], moved)
        if joint.prismatic and turned_about[number] is not None:
            inertias[number], first = _slid(inertias[number], turned_about[number])
            moved += first
        inertias[joint.antecedent] += moved.transformed_by(joint.placement)
    joints = list(robot.joints)
    for number, joint in enumerate(robot.joints, start=1):
        if joint.antecedent == 0 and not (joint.prismatic or robot.moving_base):
            inertias[number] += _as_body(joint)
            joints[number - 1] = replace(joint, rotor_inertia=0.0)
    links = [Link(link.name, inertia) for link, inertia in zip(robot.links, inertias, strict=True)]
    return replace(robot, links=tuple(links), joints=tuple(joints))


class IndependentColumns(NamedTuple):
    """kept, dependent: numbers of columns of a matrix such that the kept ones are independent, and matrix[:, dependent]
    = matrix[:, kept] @ K; gap: the least singular value of the matrix that counts, and the largest that does not, as
    parts of the largest of all."""

    kept: list
    dependent: list
    K: np.ndarray
    gap: tuple


def select_independent_columns(matrix):
    """The IndependentColumns of a `matrix` (rows, p), as many as it has rank.

    Of columns that depend on each other the first is kept. The rank is where singular values fall the most on their way
    to rounding. For a regressor of many random motions, the parameters θ_kept + K θ_dependent are base parameters.
    Source: Gautier, "Numerical calculation of the base inertial parameters of robots" (1991), by QR factors.
    """
    triangle = np.linalg.qr(matrix, mode="r")
    s = np.linalg.svd(triangle, compute_uv=False)
    rank, gap = _rank(s, matrix.shape)
    kept, least, most = [], gap[1] * s.max(initial=0), gap[0] * s.max(initial=0)
    # a column's own part is at least the least singular value; what is left of a dependent one is rounding
    for share in THRESHOLD_FRACTIONS:
        kept = _own_columns(triangle, most**share * least ** (1 - share))
        if len(kept) == rank:
            break
    dependent = [column for column in range(matrix.shape[1]) if column not in set(kept)]
    K = np.linalg.lstsq(triangle[:, kept], triangle[:, dependent], rcond=None)[0]
    return IndependentColumns(kept, dependent, K, gap)


def _rank(s, shape):
    """(rank, (least value that counts, largest that does not)) of singular values s, as parts of the largest."""
    if not s.max(initial=0) > 0:
        return 0, (1.0, 0.0)
    rounding = max(shape) * np.finfo(float).eps
    parts = np.maximum(np.append(s / s[0], 0.0), rounding)
    falls = np.where(parts[1:] < ROUNDING_THRESHOLD, parts[:-1] / parts[1:], 0.0)
    rank = int(np.argmax(falls)) + 1
    return rank, (float(parts[rank - 1]), float(parts[rank]))


def _own_columns(matrix, least):
    """Numbers of the columns of a matrix of which so much is normal to the columns before them."""
    kept, basis = [], np.zeros((matrix.shape[0], 0))
    for column in range(matrix.shape[1]):
        rest = matrix[:, column]
        for _ in range(2):  # once more, for the digits that the first time loses
            rest = rest - basis @ (basis.T @ rest)
        length = np.linalg.norm(rest)
        if length > least:
            kept.append(column)
            basis = np.column_stack([basis, rest / length])
    return kept


def _symmetric_part(inertia):
    """The part of a body that looks the same however it is turned about z, with second moment zero about z."""
    YY = inertia.second_moments[1, 1]
    zero = 0 * YY
    first = np.array([zero, zero, inertia.first_moments[2]])
    return Inertia(inertia.mass, first, np.array([[YY, zero, zero], [zero, YY, zero], [zero, zero, zero]]))


def _as_body(joint):
    """The rotor of a joint as a body that turns about its axis."""
    zero = 0 * joint.rotor_inertia
    second = np.array([[zero, zero, zero], [zero, zero, zero], [zero, zero, joint.rotor_inertia]])
    return Inertia(zero, np.array([zero] * 3), second)


def _massless_part(inertia):
    return Inertia(0.0, np.zeros(3), inertia.second_moments)


def _only_directions(robot):
    """For each link the direction a (3,) in its frame about which alone it can turn: a unit vector; zero where it
    cannot turn at all; None where it turns about several, the base may move, or nobody knows as angles are symbols."""
    directions = [None if robot.moving_base else np.zeros(3)]
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


def _slid(inertia, a):
    """(what is left of a link that slides, what moves to its antecedent), where it turns about the direction a alone.

    First moments along a exert no force, and a moment that no joint feels: as much of them may be added as makes
    another entry zero. Where the link slides along a, those across a exert the same wherever it is.
    """
    first = inertia.first_moments.copy()
    nothing = 0 * inertia.first_moments
    if not a.any():
        return Inertia(inertia.mass, nothing, inertia.second_moments), Inertia()
    if not a[:2].any():
        first[2] = 0 * first[2]
        return Inertia(inertia.mass, nothing, inertia.second_moments), Inertia(0.0, first)
    largest = np.argmax(np.abs(a))
    first = first - first[largest] / a[largest] * a
    first[largest] = nothing[largest]
    return Inertia(inertia.mass, first, inertia.second_moments), Inertia()


def _without(inertia, part):
    """What is left of a body without a part of it. What is equal leaves zero exactly."""
    return Inertia(
        inertia.mass - part.mass,
        inertia.first_moments - part.first_moments,
        inertia.second_moments - part.second_moments,
    )
