"""Charts of the attitude of a platform, without the singularity of its three angles where pitch is ±90°.

A platform rotates by yaw, pitch and roll, R = Rz(ψ) Ry(θ) Rx(φ). Where cos θ is zero, the rates of these angles do not
exist for every angular velocity. Rates of a platform are therefore computed in a chart at the current attitude

    R = Rz(ψ) Ry(θ) · Rz(a) Ry(b) · Rx(φ + c),   with a = b = c = 0 at the current attitude.

Its three axes are orthogonal at every attitude. With s = sin θ and k = cos θ:

    ȧ = k ψ̇,             ḃ = θ̇,               ċ = φ̇ - s ψ̇
    ä = k ψ̈ - 2 s ψ̇ θ̇,    b̈ = θ̈ + s k ψ̇²,      c̈ = φ̈ - s ψ̈

The rate of pitch is that of the chart. In a tree the chart has the same six joints, with an orientation of the yaw
joint that depends on the positions, and with yaw and pitch zero: the recursions take it as any other robot.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from robot_dynamics.array_types import ScalarArray
from robot_dynamics.constraints.attitude_angles import (
    axis_rotation,
    nearest_angles,
    rotation_exponential,
    rotation_from_angles,
    rotation_logarithm,
)
from robot_dynamics.model.joint import Joint
from robot_dynamics.newton_euler.friction import signs
from robot_dynamics.newton_euler.joint_placement import joint_placement

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray
    from robot_dynamics.model.robot import Robot

STEEP_PITCH_COSINE = 0.5
"""Cosine of pitch below which positions are displaced by rotations, and not by the rates of the angles."""
SINGULAR_PITCH_COSINE = 1e-12
"""Cosine of pitch below which rates of yaw and roll do not exist for every angular velocity."""
RELATIVE_ROUNDING = 1e-9
"""Part of an angular velocity or acceleration that may be rounding."""

Division: TypeAlias = Callable[[ScalarArray, ScalarArray, ScalarArray], ScalarArray]
"""Divides a value (...) by the cosine (...) of pitch, given the vector (..., 3) with which it is compared."""


class AttitudeJoints(NamedTuple):
    """The three rotational joints of a platform.

    Attributes
    ----------
    joints : tuple of int
        Numbers of the joints of yaw, pitch and roll.
    columns : tuple of int
        Their columns among the joints that mimic no other joint.
    """

    joints: tuple[int, int, int]
    columns: tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class ReorientedJoint(Joint):
    """A joint whose orientation in its antecedent depends on the sample.

    orientation: (..., 3, 3), instead of the rotation of its placement.
    """

    orientation: ScalarArray | None = None

    @property
    def rotation(self) -> ScalarArray:
        return super().rotation if self.orientation is None else self.orientation


def find_attitude_joints(robot: Robot, non_mimic_joints: Sequence[int]) -> tuple[AttitudeJoints, ...]:
    """Find the AttitudeJoints of the platforms that have a chart.

    A platform has no chart where the angles move something else: a body, a rotor or friction at them, another branch,
    or a joint that mimics one of them.

    Parameters
    ----------
    robot : Robot
    non_mimic_joints : sequence of int
        Numbers of the joints that mimic no other joint.
    """
    attitudes = []
    for platform in robot.platforms:
        yaw, pitch, roll = platform.joints[3:]
        if _move_platform_only(robot, (yaw, pitch, roll)):
            column_of = non_mimic_joints.index
            columns = column_of(yaw), column_of(pitch), column_of(roll)
            attitudes.append(AttitudeJoints((yaw, pitch, roll), columns))
    return tuple(attitudes)


def _move_platform_only(robot: Robot, joints: tuple[int, int, int]) -> bool:
    """Whether three successive joints move nothing but the link of the last one."""
    links = [number + 1 for number in joints[:2]]
    successors = [number for number, joint in enumerate(robot.joints) if joint.antecedent in links]
    loop_ends = {end.link for loop in robot.loops for end in loop.ends}
    leaders = {leader for number, (leader, _, _) in enumerate(robot.mimic_relations) if leader != number}
    attitude_joints = [robot.joints[number] for number in joints]
    return not (
        any(np.any(robot.links[link].inertia.spatial) or robot.links[link].flexibility for link in links)
        or any(_has_drive(joint) for joint in attitude_joints)
        or successors != list(joints[1:])
        or {*links} & loop_ends
        or {*joints} & leaders
        or any(np.any(joint.placement[:3, 3]) for joint in attitude_joints[1:])
    )


def _has_drive(joint: Joint) -> bool:
    """Whether a joint has a rotor, friction, a spring, or mimics another one."""
    has_drive = bool(joint.rotor_inertia) or joint.has_friction
    return has_drive or joint.spring is not None or joint.mimic is not None


def virtual_links(robot: Robot) -> frozenset[int]:
    """Numbers of the links between the rotational joints of platforms, whose motion differs in a chart."""
    return frozenset(number + 1 for platform in robot.platforms for number in platform.joints[3:5])


def attitudes_within(
    attitudes: Sequence[AttitudeJoints], columns: Collection[int] | IntArray
) -> tuple[AttitudeJoints, ...]:
    """Those attitudes whose yaw and roll are among these columns."""
    return tuple(attitude for attitude in attitudes if {attitude.columns[0], attitude.columns[2]} <= {*columns})


def attach_charts(
    robot: Robot, q: ScalarArray, attitudes: Sequence[AttitudeJoints], zero: Array
) -> tuple[Robot, ScalarArray]:
    """Replace the attitude joints of a robot by those of the charts at its positions.

    Parameters
    ----------
    robot : Robot
    q : ndarray, shape (..., joints)
    attitudes : sequence of AttitudeJoints
    zero : ndarray, shape (joints,)
        Positions of the joints where the angles are zero.

    Returns
    -------
    robot : Robot
    q : ndarray, shape (..., joints)
    """
    if not attitudes:
        return robot, q
    joints = list(robot.joints)
    q = np.array(q)
    for (yaw, pitch, _), _ in attitudes:
        zero_angles = zero[[yaw, pitch]]
        orientation = _orientation(joints[yaw], joints[pitch], q[..., yaw, None], q[..., pitch, None])
        unrotated = ReorientedJoint(**vars(joints[yaw]), orientation=np.eye(3, dtype=int))
        at_zero = _orientation(unrotated, joints[pitch], zero_angles[:1], zero_angles[1:])
        fields = {**vars(joints[yaw]), "orientation": orientation @ np.swapaxes(at_zero, -1, -2)}
        q[..., yaw] = 0 * q[..., yaw] + zero_angles[0]
        q[..., pitch] = 0 * q[..., pitch] + zero_angles[1]
        joints[yaw] = ReorientedJoint(**fields)
    charted = copy.copy(robot)  # without the checks of a new Robot
    object.__setattr__(charted, "joints", tuple(joints))
    return charted, q


def _orientation(yaw: Joint, pitch: Joint, yaw_position: ScalarArray, pitch_position: ScalarArray) -> ScalarArray:
    """(..., 3, 3) of the frame of the pitch joint in the antecedent of the yaw joint."""
    R: ScalarArray = joint_placement(yaw, yaw_position)[0] @ joint_placement(pitch, pitch_position)[0]
    return R


def pitch_sine_cosine(q: ScalarArray, attitude: AttitudeJoints, zero: Array) -> tuple[ScalarArray, ScalarArray]:
    """Sine and cosine (...) of pitch at positions q (..., joints)."""
    pitch = attitude.joints[1]
    angle = q[..., pitch : pitch + 1] - zero[pitch]
    return np.sin(angle)[..., 0], np.cos(angle)[..., 0]


def divide_by_cosine(value: Array, cosine: Array, vector: Array) -> Array:
    """value / cosine (...), 0 where both are rounding, nan where the cosine is. vector: (..., 3), has the value."""
    is_singular = np.abs(cosine) < SINGULAR_PITCH_COSINE
    is_zero = np.abs(value) <= RELATIVE_ROUNDING * np.abs(vector).max(axis=-1)
    with np.errstate(invalid="ignore"):
        return np.where(is_singular, np.where(is_zero, 0.0, np.nan), value / np.where(is_singular, 1.0, cosine))


def divide_by_cosine_or_zero(value: ScalarArray, cosine: ScalarArray, _: ScalarArray) -> ScalarArray:
    """value / cosine (...), 0 where the cosine is rounding; for symbols too."""
    exists = angle_rates_exist(cosine)
    quotient: ScalarArray = value * exists * cosine / (cosine * cosine + (1 - exists))
    return quotient


def angle_rates_exist(cosine: ScalarArray) -> ScalarArray:
    """(...) 1 where rates of yaw and roll exist for every angular velocity, 0 elsewhere; for symbols too."""
    exists: ScalarArray = (1 + signs(cosine * cosine - SINGULAR_PITCH_COSINE**2)) / 2
    return exists


def joint_velocities(
    q: ScalarArray,
    rates: ScalarArray,
    attitudes: Sequence[AttitudeJoints],
    zero: Array,
    divide_by_cosine: Division = divide_by_cosine,
) -> ScalarArray:
    """Velocities of the joints from rates in the charts.

    Where pitch is ±90° the velocities of yaw and roll do not exist for every angular velocity. By default they are nan
    there, or yaw is at rest where roll and pitch alone make the motion.

    Parameters
    ----------
    q, rates : ndarray, shape (..., joints)
    attitudes : sequence of AttitudeJoints
    zero : ndarray, shape (joints,)
        Positions of the joints where the angles are zero.
    divide_by_cosine : Division

    Returns
    -------
    ndarray, shape (..., joints)
    """
    if not attitudes:
        return rates
    rates = _copy_last(q, rates)
    for attitude in attitudes:
        yaw, _, roll = attitude.joints
        sine, cosine = pitch_sine_cosine(q, attitude, zero)
        rates[..., yaw] = divide_by_cosine(rates[..., yaw], cosine, rates[..., attitude.joints])
        rates[..., roll] = rates[..., roll] + sine * rates[..., yaw]
    return rates


def joint_accelerations(
    q: ScalarArray,
    velocities: ScalarArray,
    rates: ScalarArray,
    attitudes: Sequence[AttitudeJoints],
    zero: Array,
    divide_by_cosine: Division = divide_by_cosine,
) -> ScalarArray:
    """Accelerations (..., joints) of the joints from those in the charts, `rates` (..., joints).

    velocities: (..., joints), as `joint_velocities` returns them. Accelerations are nan where velocities are, or as
    `divide_by_cosine` defines them. Other arguments as for `joint_velocities`.
    """
    if not attitudes:
        return rates
    rates = _copy_last(q, velocities, rates)
    for attitude in attitudes:
        yaw, pitch, roll = attitude.joints
        sine, cosine = pitch_sine_cosine(q, attitude, zero)
        yaw_term = 2 * sine * velocities[..., yaw] * velocities[..., pitch]
        pitch_term = sine * cosine * velocities[..., yaw] * velocities[..., yaw]
        yaw_acceleration = divide_by_cosine(rates[..., yaw] + yaw_term, cosine, rates[..., attitude.joints])
        rates[..., pitch] = rates[..., pitch] - pitch_term
        rates[..., yaw] = yaw_acceleration
        rates[..., roll] = rates[..., roll] + sine * yaw_acceleration
    return rates


def chart_rates(q: Array, velocities: Array, attitudes: Sequence[AttitudeJoints], zero: Array) -> Array:
    """Rates (..., joints) in the charts from velocities (..., joints) of the joints."""
    velocities = _copy_last(q, velocities) if attitudes else velocities
    for attitude in attitudes:
        yaw, _, roll = attitude.joints
        sine, cosine = pitch_sine_cosine(q, attitude, zero)
        velocities[..., roll] -= sine * velocities[..., yaw]
        velocities[..., yaw] *= cosine
    return velocities


def chart_forces(
    q: ScalarArray,
    forces: ScalarArray,
    attitudes: Sequence[AttitudeJoints],
    zero: Array,
    divide_by_cosine: Division = divide_by_cosine,
) -> ScalarArray:
    """Forces (..., joints) along the coordinates of the charts from those at the joints, by virtual work."""
    forces = _copy_last(q, forces) if attitudes else forces
    for attitude in attitudes:
        yaw, _, roll = attitude.joints
        sine, cosine = pitch_sine_cosine(q, attitude, zero)
        moments = forces[..., attitude.joints]
        forces[..., yaw] = divide_by_cosine(forces[..., yaw] + sine * forces[..., roll], cosine, moments)
    return forces


def _copy_last(*arrays: ScalarArray) -> ScalarArray:
    """A copy of the last of arrays (..., joints), broadcast to the batch of all."""
    return np.array(np.broadcast_arrays(*arrays)[-1], dtype=np.result_type(float, *arrays))


def displace(t: Array, step: Array, attitudes: Sequence[AttitudeJoints]) -> Array:
    """Positions (..., m) after a displacement.

    Parameters
    ----------
    t : ndarray, shape (..., m)
        Positions of the joints that mimic no other joint.
    step : ndarray, shape (..., m)
        Displacement; its entries of attitude joints are in their charts at t.
    attitudes : sequence of AttitudeJoints
    """
    end: Array = t + step
    for attitude in attitudes:
        columns = list(attitude.columns)
        angles = t[..., columns]
        chart_step = step[..., columns]
        sine = np.sin(angles[..., 1])
        cosine = np.cos(angles[..., 1])
        is_steep = np.asarray(np.abs(cosine) < STEEP_PITCH_COSINE)
        if not np.all(is_steep):
            divisor = np.where(is_steep, 1.0, cosine)
            yaw, roll = angle_steps(chart_step[..., 0], chart_step[..., 2], sine, divisor)
            end[..., columns[0]] = angles[..., 0] + yaw
            end[..., columns[2]] = angles[..., 2] + roll
        if np.any(is_steep):
            _assign_columns(end, is_steep, columns, _rotate_angles(angles[is_steep], chart_step[is_steep]))
    return end


def displacement(begin: Array, end: Array, attitudes: Sequence[AttitudeJoints]) -> Array:
    """Displacement (..., m) from positions `begin` to `end` (..., m), in the charts of `attitudes` at the end."""
    step = end - begin
    for attitude in attitudes:
        columns = list(attitude.columns)
        before = begin[..., columns]
        after = end[..., columns]
        angles_step = step[..., columns]
        sine = np.sin(after[..., 1])
        cosine = np.cos(after[..., 1])
        yaw, roll = chart_steps(angles_step[..., 0], angles_step[..., 2], sine, cosine)
        step[..., columns[0]] = yaw
        step[..., columns[2]] = roll
        is_steep = (np.abs(cosine) < STEEP_PITCH_COSINE) | (np.abs(np.cos(before[..., 1])) < STEEP_PITCH_COSINE)
        if np.any(is_steep):
            _assign_columns(step, is_steep, columns, _chart_displacement(before[is_steep], after[is_steep]))
    return step


def angle_steps(yaw: Any, roll: Any, sine: Any, cosine: Any) -> tuple[Any, Any]:
    """Steps of yaw and roll (...) from those in the chart, with the sine and cosine (...) of pitch; for symbols too."""
    yaw_step = yaw / cosine
    return yaw_step, roll + sine * yaw_step


def chart_steps(yaw: Any, roll: Any, sine: Any, cosine: Any) -> tuple[Any, Any]:
    """Steps in the chart from those of yaw and roll (...), with the sine and cosine (...) of pitch; for symbols too."""
    return cosine * yaw, roll - sine * yaw


def _assign_columns(array: Array, samples: BoolArray, columns: list[int], values: Array) -> None:
    """Assign values (N, k) to columns of the selected samples (...) of an array (..., m)."""
    rows = np.flatnonzero(samples.ravel())
    flat = array.reshape(-1, array.shape[-1])
    flat[rows[:, None], columns] = values
    array[...] = flat.reshape(array.shape)


def _rotate_angles(angles: Array, step: Array) -> Array:
    """Angles (N, 3) after a rotation by `step` (N, 3) in their chart, nearest to `angles` (N, 3)."""
    R = axis_rotation(2, angles[:, 0]) @ axis_rotation(1, angles[:, 1]) @ rotation_exponential(step[:, ::-1])
    yaw, pitch, roll = nearest_angles(R, np.stack([angles[:, 0], angles[:, 1], 0 * angles[:, 2]], axis=-1)).T
    return np.stack([yaw, pitch, angles[:, 2] + roll], axis=-1)


def _chart_displacement(before: Array, after: Array) -> Array:
    """Rotation (N, 3) from angles `before` (N, 3) to `after`, in the chart at the latter."""
    R = np.swapaxes(rotation_from_angles(before), -1, -2) @ rotation_from_angles(after)
    step: Array = (axis_rotation(0, after[:, 2]) @ rotation_logarithm(R)[..., None])[:, ::-1, 0]
    return step
