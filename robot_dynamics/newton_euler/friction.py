"""Joint friction: viscous, Coulomb, asymmetric, Stribeck and load-dependent.

    f = Fv q̇ + Fva |q̇| + (Fs + Fst / (1 + (q̇ / vs)²) + μ |Γ_l|) sign(q̇) + Fsa |sign(q̇)|

Fv and Fs are those of Khalil (sections 7.2 and 7.3, eq. 106). Fva and Fsa are half the difference between positive and
negative direction. The Stribeck curve is that of D. P. Hess and A. Soom, Friction at a lubricated line contact
operating at oscillating sliding velocities, 1990. The load Γ_l is the effort of the joint without friction: of bodies,
rotors, gravity and external wrenches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.model.joint_friction import FRICTION_COEFFICIENTS, has_value

if TYPE_CHECKING:
    from robot_dynamics.array_types import ArrayLike, ScalarArray
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot

FRICTION_PARAMETERS = ("Fv", "Fs", "Fva", "Fsa", "Fst", "mu")
"""Parameters in which friction is linear, in the order of FRICTION_COEFFICIENTS."""

LOAD_PARAMETER = "mu"
"""The parameter of which the effect depends on the load."""

_FIELD_OF_PARAMETER = dict(zip(FRICTION_PARAMETERS, FRICTION_COEFFICIENTS, strict=True))

_symbolic_sign = np.frompyfunc(lambda scalar: scalar.signum() if hasattr(scalar, "signum") else np.sign(scalar), 1, 1)


def friction(robot: Robot, qd: ScalarArray) -> ScalarArray:
    """Efforts (..., n) [N m or N] that overcome friction at joint velocities qd (..., n); zero at rest.

    Load-dependent friction is not counted: it is that of `load_friction`.
    """
    efforts: ScalarArray = _effect(robot, "Fv", qd) + _effect(robot, "Fs", qd)
    further = {parameter for parameter, _ in further_friction_parameters(robot)}
    for parameter in FRICTION_PARAMETERS[2:]:
        if parameter in further and parameter != LOAD_PARAMETER:
            efforts = efforts + _effect(robot, parameter, qd)
    return efforts


def has_load_friction(robot: Robot) -> bool:
    """Whether the friction of a joint depends on its load."""
    return any(has_value(joint.load_friction) for joint in robot.joints)


def load_friction(joints: Sequence[Joint], qd: ScalarArray, loads: ScalarArray) -> ScalarArray:
    """Efforts (..., n) [N m or N] that overcome load-dependent friction, μ |Γ_l| sign(q̇); zero at rest.

    Parameters
    ----------
    joints : sequence of Joint
        The n joints.
    qd : ndarray, shape (..., n)
        Velocities [rad/s or m/s].
    loads : ndarray, shape (..., n)
        Γ_l, the efforts without friction [N m or N].
    """
    efforts: ScalarArray = _coefficients(joints, LOAD_PARAMETER) * unit_friction(LOAD_PARAMETER, qd, loads)
    return efforts


def loads_from_net_efforts(joints: Sequence[Joint], qd: ScalarArray, net_efforts: ScalarArray) -> ScalarArray:
    """Loads Γ_l (..., n) [N m or N] of joints whose efforts are known.

    Parameters
    ----------
    joints : sequence of Joint
        The n joints.
    qd : ndarray, shape (..., n)
        Velocities [rad/s or m/s].
    net_efforts : ndarray, shape (..., n)
        y, the efforts less all friction that does not depend on load, and springs [N m or N].

    Notes
    -----
    y = Γ_l + μ |Γ_l| sign(q̇) and μ < 1, so y and Γ_l have one sign, and Γ_l = y / (1 + μ sign(q̇) sign(y)).
    """
    if not any(has_value(joint.load_friction) for joint in joints):
        return net_efforts
    loads: ScalarArray = net_efforts / load_growth(joints, qd, net_efforts)
    return loads


def load_growth(joints: Sequence[Joint], qd: ScalarArray, loads: ScalarArray) -> ScalarArray:
    """1 + μ sign(q̇) sign(Γ_l) (..., n): derivatives of net efforts by the loads of n joints. Arguments as above."""
    growth: ScalarArray = 1 + _coefficients(joints, LOAD_PARAMETER) * signs(qd) * signs(loads)
    return growth


def friction_columns(qd: ScalarArray, loads: ScalarArray, stribeck_velocities: ArrayLike) -> ScalarArray:
    """Efforts of each parameter of friction with the value 1.

    Parameters
    ----------
    qd : ndarray, shape (..., n)
        Velocities [rad/s or m/s].
    loads : ndarray, shape (..., n)
        Γ_l, the efforts without friction [N m or N].
    stribeck_velocities : array_like, shape (n,) or ()
        vs [rad/s or m/s], above zero.

    Returns
    -------
    ndarray, shape (..., n, K)
        K columns for each joint, in the order of FRICTION_PARAMETERS. Columns times parameters, summed, are the
        friction.
    """
    columns = [unit_friction(parameter, qd, loads, stribeck_velocities) for parameter in FRICTION_PARAMETERS]
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def unit_friction(
    parameter: str, qd: ScalarArray, loads: ScalarArray | float = 0.0, stribeck_velocities: ArrayLike = 1.0
) -> ScalarArray:
    """Efforts (..., n) of one of FRICTION_PARAMETERS with the value 1; the other arguments as `friction_columns`."""
    if parameter == "Fv":
        return qd
    directions = signs(qd)
    if parameter == "Fva":
        efforts = qd * directions
    elif parameter == "Fsa":
        efforts = directions * directions
    elif parameter == "Fst":
        ratios = qd / np.asarray(stribeck_velocities)
        efforts = directions / (1 + ratios * ratios)
    elif parameter == LOAD_PARAMETER:
        efforts = loads * signs(loads) * directions
    else:
        efforts = directions
    return efforts


def further_friction_parameters(robot: Robot) -> list[tuple[str, int]]:
    """Parameters beside Fv and Fs that are not zero, with the number of their joint, joint by joint."""
    return [
        (parameter, number)
        for number, joint in enumerate(robot.joints)
        for parameter in FRICTION_PARAMETERS[2:]
        if has_value(getattr(joint, _FIELD_OF_PARAMETER[parameter]))
    ]


def friction_parameter(joint: Joint, parameter: str) -> float:
    """Value of one of FRICTION_PARAMETERS of a joint."""
    value: float = getattr(joint, _FIELD_OF_PARAMETER[parameter])
    return value


def signs(rates: ScalarArray | float) -> ScalarArray:
    """Sign of each rate: -1, 0 or 1; the operation `signum` for symbols."""
    result: ScalarArray = np.sign(rates) if np.asarray(rates).dtype != object else _symbolic_sign(rates)
    return result


def _effect(robot: Robot, parameter: str, qd: ScalarArray) -> ScalarArray:
    """Efforts (..., n) of a parameter of the joints of a robot that does not depend on load."""
    velocities: ScalarArray | float = 1.0
    if parameter == "Fst":
        velocities = np.array(
            [joint.stribeck_velocity if has_value(joint.stribeck_friction) else 1.0 for joint in robot.joints]
        )
    efforts: ScalarArray = _coefficients(robot.joints, parameter) * unit_friction(parameter, qd, 0.0, velocities)
    return efforts


def _coefficients(joints: Sequence[Joint], parameter: str) -> ScalarArray:
    """Values (n,) of a parameter of joints."""
    return np.array([friction_parameter(joint, parameter) for joint in joints])
