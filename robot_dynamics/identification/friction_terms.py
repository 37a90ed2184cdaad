"""Terms of friction that are fitted beside viscous and Coulomb friction, as columns of the regressor.

The terms are those of `newton_euler.friction`: asymmetric viscous friction Fva, Stribeck friction Fst, and friction
that depends on load, mu. The Coulomb asymmetry Fsa is missing: while a joint moves it is a constant effort, which the
offset of the drive is too. Fst may be negative: dry friction then grows with velocity, from Fs + Fst to Fs.

Stribeck friction is not linear in its velocity vs. Near a velocity v0 it is, to first order,

    Fst / (1 + (q̇ / vs)²) = Fst / (1 + r²) + S · 2 r² / (1 + r²)²,    r = q̇ / v0,    S = Fst ln(vs / v0),

which is linear in Fst and in the shift S. The shift is zero if v0 is the best velocity. Fitted with the others, it
shows what the uncertainty of vs does to all parameters.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.joint_friction import find_friction_conflict, has_value
from robot_dynamics.newton_euler.friction import LOAD_PARAMETER, further_friction_parameters, signs, unit_friction

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.model.robot import Robot

MAX_LOAD_FRICTION = 0.99  # from 1 on, friction would hold any load
ASYMMETRY_PARAMETER = "Fva"
STRIBECK_PARAMETER = "Fst"
SHIFT_PARAMETER = "vs"
"""Name of the shift S, by which the Stribeck velocity differs from that of its columns."""

PARAMETER_OF_MODEL = {
    "asymmetric": ASYMMETRY_PARAMETER,
    "stribeck": STRIBECK_PARAMETER,
    "load": LOAD_PARAMETER,
}
"""Parameter that each model of friction has beside Fv and Fs."""


class FrictionTerm(NamedTuple):
    """A parameter of friction of a joint.

    parameter: Fva, Fst, vs (the shift) or mu; joint: number in Dynamics.joint_names; velocity: v0 [rad/s or m/s] of Fst
    and of the shift.
    """

    parameter: str
    joint: int
    velocity: float = 0.0

    def effect(self, qd: Array, loads: Array) -> Array:
        """Efforts (N,) of the joint at velocities (N, n) and loads (N, n), if the value of the parameter is 1."""
        rates = qd[:, self.joint]
        efforts: Array
        if self.parameter == SHIFT_PARAMETER:
            squares = (rates / self.velocity) ** 2
            efforts = 2 * squares / (1 + squares) ** 2 * signs(rates)
        else:
            efforts = unit_friction(self.parameter, rates, loads[:, self.joint], self.velocity or 1.0)
        return efforts


def friction_term_columns(terms: Sequence[FrictionTerm], qd: Array, loads: Array) -> Array:
    """Columns (N, n, T) of T terms at velocities and loads (N, n)."""
    columns = np.zeros((*qd.shape, len(terms)))
    for number, term in enumerate(terms):
        columns[:, term.joint, number] = term.effect(qd, loads)
    return columns


def with_shifts(terms: Sequence[FrictionTerm]) -> Iterator[FrictionTerm]:
    """Terms, with the shift of its velocity after each term of Stribeck friction."""
    for term in terms:
        yield term
        if term.parameter == STRIBECK_PARAMETER:
            yield term._replace(parameter=SHIFT_PARAMETER)


def possible_models(dynamics: Dynamics, excludes_gravity: bool) -> Iterator[tuple[str, int]]:
    """Models of friction that joints can have, with the number of the joint in Dynamics.joint_names.

    excludes_gravity: whether measured efforts exclude gravity, so that the loads of the joints are not known.
    """
    robot = dynamics.robot
    for number, name in enumerate(dynamics.joint_names):
        for model, parameter in PARAMETER_OF_MODEL.items():
            if parameter != LOAD_PARAMETER or (_can_depend_on_load(robot, name) and not excludes_gravity):
                yield model, number


def _can_depend_on_load(robot: Robot, name: str) -> bool:
    """Whether the friction of a joint can depend on its load; Robot refuses it where a joint has none of its own."""
    joints = list(robot.joints)
    index = robot.joint_numbers[name]
    joints[index] = replace(joints[index], load_friction=0.1)
    if find_friction_conflict(replace(joints[index], viscous_asymmetry=0.0, coulomb_asymmetry=0.0)) is not None:
        return False
    try:
        replace(robot, joints=tuple(joints))
    except DescriptionError:
        return False
    return True


def has_further_friction(robot: Robot) -> bool:
    """Whether a joint has friction beside viscous and Coulomb friction."""
    return bool(further_friction_parameters(robot)) or any(has_value(joint.stribeck_velocity) for joint in robot.joints)


def without_further_friction(robot: Robot) -> Robot:
    """Return the robot with viscous and Coulomb friction only."""
    joints = [
        replace(
            joint,
            viscous_asymmetry=0.0,
            coulomb_asymmetry=0.0,
            stribeck_friction=0.0,
            stribeck_velocity=0.0,
            load_friction=0.0,
        )
        for joint in robot.joints
    ]
    return replace(robot, joints=tuple(joints))
