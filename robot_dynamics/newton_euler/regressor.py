"""Regressor: joint efforts are linear in the inertial parameters, Γ = Y θ.

The parameters of a link are XX, XY, XZ, YY, YZ, ZZ, MX, MY, MZ, M about the origin of its frame, then Ia, Fv, Fs of its
joint. Link 0 has the first ten where the base moves. Each column is the wrench that a link requires with this parameter
1 and the others 0, transmitted to the base. At the end there is a column for each further parameter of friction that a
joint has: Fva, Fsa, Fst or mu.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.model.inertia import INERTIA_ENTRIES, symmetric_entries
from robot_dynamics.newton_euler.augmented import inverse_dynamics, link_motions, rotational_moment
from robot_dynamics.newton_euler.friction import (
    LOAD_PARAMETER,
    friction_parameter,
    further_friction_parameters,
    has_load_friction,
    signs,
    unit_friction,
)
from robot_dynamics.newton_euler.kinematics import axis_row
from robot_dynamics.newton_euler.screw import apply, cross, screw

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray
    from robot_dynamics.model.inertia import Inertia
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.newton_euler.augmented import LinkMotion

LINK_PARAMETERS = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
JOINT_PARAMETERS = ("Ia", "Fv", "Fs")


def parameter_names(robot: Robot) -> tuple[str, ...]:
    """Names of the columns: `XX.link`, ... `M.link`, `Ia.joint`, `Fv.joint`, `Fs.joint`, link by link, then others.

    The others are `Fva.joint`, `Fsa.joint`, `Fst.joint` and `mu.joint`, where the joint has this friction.
    """
    names = [f"{key}.{robot.base_link}" for key in LINK_PARAMETERS] if robot.moving_base else []
    for joint, link in zip(robot.joints, robot.links[1:], strict=True):
        names += [f"{key}.{link.name}" for key in LINK_PARAMETERS]
        names += [f"{key}.{joint.name}" for key in JOINT_PARAMETERS]
    names += [f"{key}.{robot.joints[number].name}" for key, number in further_friction_parameters(robot)]
    return tuple(names)


def link_parameters(inertia: Inertia) -> list[Any]:
    """Values (10,) of LINK_PARAMETERS of an inertia."""
    return [*symmetric_entries(inertia.second_moments), *inertia.first_moments, inertia.mass]


def parameters(robot: Robot) -> Array:
    """θ (p,): values of `parameter_names` for this robot."""
    values: list[float] = []
    for number, link in enumerate(robot.links):
        if number > 0 or robot.moving_base:
            values += link_parameters(link.inertia)
        if number > 0:
            joint = robot.joints[number - 1]
            values += [joint.rotor_inertia, joint.viscous_friction, joint.coulomb_friction]
    values += [friction_parameter(robot.joints[number], key) for key, number in further_friction_parameters(robot)]
    return np.array(values)


def regressor(
    robot: Robot,
    q: ScalarArray,
    qd: ScalarArray,
    qdd: ScalarArray,
    base_twist: ScalarArray,
    base_acceleration: ScalarArray,
    links: Collection[int] | None = None,
) -> ScalarArray:
    """Regressor Y of the joint efforts.

    Parameters
    ----------
    robot : Robot
    q, qd, qdd : ndarray, shape (..., n)
    base_twist, base_acceleration : ndarray, shape (..., 6)
        0V0 and 0V̇0, gravity subtracted, in frame 0.
    links : collection of int, optional
        Numbers of the links whose columns are computed, with those of their joints, without further friction. By
        default all columns.

    Returns
    -------
    ndarray, shape (..., m, p)
        m = n, or 6 + n with a moving base, whose wrench comes first.
    """
    motions = link_motions(robot, q, qd, qdd, base_twist, base_acceleration, for_all_parameters=True)
    base = 6 if robot.moving_base else 0
    joints = len(robot.joints)
    zero = 0 * (q[..., 0] if joints else base_acceleration[..., 0])
    columns: list[list[ScalarArray]] = []
    for number, motion in enumerate(motions):
        if links is not None and number not in links:
            continue
        if number > 0 or robot.moving_base:
            for wrench in _unit_wrenches(motion):
                columns.append(_rows(robot, motions, number, wrench, base, zero))
        if number > 0:
            rate = qd[..., number - 1]
            for entry in (qdd[..., number - 1], rate, signs(rate)):
                column = [zero] * (base + joints)
                column[base + number - 1] = entry
                columns.append(column)
    if links is None and further_friction_parameters(robot):
        loads = zero
        if has_load_friction(robot):
            loads, _ = inverse_dynamics(robot, q, qd, qdd, base_twist, base_acceleration, {})
        for entry, number in _further_friction(robot, qd, loads):
            column = [zero] * (base + joints)
            column[base + number] = entry
            columns.append(column)
    if not columns:
        return np.zeros((base + joints, 0))
    stacked = [np.stack(np.broadcast_arrays(*column), axis=-1) for column in columns]
    return np.stack(np.broadcast_arrays(*stacked), axis=-1)


def _further_friction(robot: Robot, qd: ScalarArray, loads: ScalarArray) -> Iterator[tuple[ScalarArray, int]]:
    """Effect (...) of each of `further_friction_parameters` with the value 1, and the number of its joint.

    loads (..., n): efforts without friction, read for load-dependent friction.
    """
    for key, number in further_friction_parameters(robot):
        load = loads[..., number] if key == LOAD_PARAMETER else 0.0
        stribeck_velocity = robot.joints[number].stribeck_velocity if key == "Fst" else 1.0
        yield unit_friction(key, qd[..., number], load, stribeck_velocity), number


def _unit_wrenches(motion: LinkMotion) -> Iterator[ScalarArray]:
    """Wrench (..., 6) that a link with this motion requires for each of LINK_PARAMETERS, in its frame."""
    zero = 0 * motion.alpha
    for row, column in INERTIA_ENTRIES.values():
        K = np.zeros((3, 3), dtype=int)
        K[row, column] = 1
        K[column, row] = 1
        yield screw(zero, rotational_moment(K, motion.angular))
    for axis in np.eye(3, dtype=int):
        yield screw(motion.angular.times(axis), cross(axis + zero, motion.alpha))
    yield screw(motion.alpha, zero)


def _rows(
    robot: Robot, motions: list[LinkMotion], number: int, wrench: ScalarArray, base: int, zero: ScalarArray
) -> list[ScalarArray]:
    """Components (...) of a wrench (..., 6) on a link in the rows of the base and of the joints on its path."""
    rows = [zero] * (base + len(robot.joints))
    while number > 0:
        joint = robot.joints[number - 1]
        motion = motions[number]
        rows[base + number - 1] = wrench[..., axis_row(joint)]
        force = apply(motion.R, wrench[..., :3])
        wrench = screw(force, apply(motion.R, wrench[..., 3:]) + cross(motion.P, force))
        number = joint.antecedent
    rows[:base] = [wrench[..., row] for row in range(base)]
    return rows
