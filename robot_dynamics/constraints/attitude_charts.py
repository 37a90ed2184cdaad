"""Rotation of a platform without the singularity of its three angles, where pitch is ±90°.

A platform turns by yaw, pitch and roll, R = Rz(ψ) Ry(θ) Rx(φ). The rates of these angles do not exist for every angular
velocity where cos θ is zero. What moves with the platform is therefore computed in a chart at the current attitude

    R = Rz(ψ) Ry(θ) · Rz(a) Ry(b) · Rx(φ + c),   a = b = c = 0 here and now,

of which the three axes are orthogonal at every attitude. With s = sin θ and k = cos θ:

    ȧ = k ψ̇,             ḃ = θ̇,               ċ = φ̇ - s ψ̇
    ä = k ψ̈ - 2 s ψ̇ θ̇,    b̈ = θ̈ + s k ψ̇²,      c̈ = φ̈ - s ψ̈

The rate of pitch is that of the chart. In a tree the chart is the same six joints, with an orientation of the yaw joint
that depends on the positions, and with yaw and pitch zero: so all recursions take it as any other robot.
"""

import copy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from robot_dynamics.model.joint import Joint
from robot_dynamics.newton_euler.friction import signs
from robot_dynamics.newton_euler.kinematics import joint_placement

STEEP_PITCH_COSINE = 0.5
"""Cosine of pitch below which positions are changed by rotations, and not by the rates of the angles."""
SINGULAR_PITCH_COSINE = 1e-12
"""Cosine of pitch below which rates of yaw and roll do not exist for every angular velocity."""
VERTICAL_PITCH_COSINE = 1e-14
"""Cosine of pitch below which yaw is rounding."""
RELATIVE_ROUNDING = 1e-9
"""Part of an angular velocity or acceleration that may be rounding."""


class AttitudeJoints(NamedTuple):
    """The three turning joints of a platform.

    Attributes
    ----------
    joints : tuple of int
        Numbers of the joints of yaw, pitch and roll.
    places : tuple of int
        Their places among the joints that follow no other one.
    """

    joints: tuple[int, int, int]
    columns: tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class ReorientedJoint(Joint):
    """A joint whose orientation in its antecedent depends on the sample.

    turned: (..., 3, 3), in the place of the rotation of its placement.
    """

    orientation: np.ndarray | None = None

    @property
    def rotation(self):
        return self.orientation


def find_attitude_joints(robot, free):
    """The Attitudes of a robot's platforms that have a chart.

    There is none where something besides the platform moves with the angles: a body, a rotor or a friction at them,
    another branch, or a joint that follows one of them.

    Parameters
    ----------
    robot : Robot
    free : list of int
        Numbers of the joints that follow no other one.

    Returns
    -------
    tuple of Attitude
    """
    found = []
    for platform in robot.platforms:
        joints = tuple(platform.joints[3:])
        if _turn_the_platform_alone(robot, joints):
            found.append(AttitudeJoints(joints, tuple(free.index(number) for number in joints)))
    return tuple(found)


def _turn_the_platform_alone(robot, joints):
    """Whether nothing but the link of the last of three joints moves with them."""
    links = [number + 1 for number in joints[:2]]
    carried = [number for number, joint in enumerate(robot.joints) if joint.antecedent in links]
    ends = [end.link for loop in robot.loops for end in loop.ends]
    own = [robot.joints[number] for number in joints]
    followed = {leader for number, (leader, _, _) in enumerate(robot.mimic_relations) if leader != number}
    return not (
        any(np.any(robot.links[link].inertia.spatial) or robot.links[link].flexibility for link in links)
        or any(np.any([j.rotor_inertia, j.viscous_friction, j.coulomb_friction]) or j.spring or j.mimic for j in own)
        or carried != list(joints[1:])
        or {*links} & {*ends}
        or {*joints} & followed
        or any(np.any(joint.placement[:3, 3]) for joint in own[1:])
    )


def virtual_links(robot):
    """Numbers of the links between the turning joints of platforms: they move otherwise in a chart."""
    return frozenset(number + 1 for platform in robot.platforms for number in platform.joints[3:5])


def attach_charts(robot, q, attitudes, zero):
    """A robot and positions (..., joints) with the chart of each of `attitudes` at positions q (..., joints).

    zero: (joints,) positions of the joints where their angles are zero.
    """
    if not attitudes:
        return robot, q
    joints, q = list(robot.joints), np.array(q)
    for (yaw, pitch, _), _ in attitudes:
        at = zero[[yaw, pitch]]
        turned = _orientation(joints, yaw, pitch, q[..., yaw, None], q[..., pitch, None])
        back = _orientation(joints, yaw, pitch, at[:1], at[1:], first=np.eye(3, dtype=int))
        values = {**vars(joints[yaw]), "orientation": turned @ np.swapaxes(back, -1, -2)}
        q[..., yaw], q[..., pitch] = 0 * q[..., yaw] + at[0], 0 * q[..., pitch] + at[1]
        joints[yaw] = ReorientedJoint(**values)
    found = copy.copy(robot)  # the checks of a Robot are done
    object.__setattr__(found, "joints", tuple(joints))
    return found, q


def _orientation(joints, yaw, pitch, yaw_at, pitch_at, first=None):
    """(..., 3, 3) of the frame of the pitch joint in the antecedent of the yaw joint, or with another orientation
    `first` of the yaw joint's axes."""
    placed = joints[yaw] if first is None else ReorientedJoint(**vars(joints[yaw]), orientation=first)
    return joint_placement(placed, yaw_at)[0] @ joint_placement(joints[pitch], pitch_at)[0]


def pitch_sine_cosine(q, attitude, zero):
    """Sine and cosine (...) of pitch."""
    pitch = attitude.joints[1]
    angle = q[..., pitch : pitch + 1] - zero[pitch]
    return np.sin(angle)[..., 0], np.cos(angle)[..., 0]


def divide_by_cosine(value, cosine, whole):
    """value / cosine (...), 0 where both are rounding and nan where the cosine alone is. whole: (..., 3)."""
    undefined = np.abs(cosine) < SINGULAR_PITCH_COSINE
    none = np.abs(value) <= RELATIVE_ROUNDING * np.abs(whole).max(axis=-1)
    with np.errstate(invalid="ignore"):
        return np.where(undefined, np.where(none, 0.0, np.nan), value / np.where(undefined, 1.0, cosine))


def divide_by_cosine_or_zero(value, cosine, _):
    """value / cosine (...), 0 where the cosine is rounding; of symbols too."""
    existing = angle_rates_exist(cosine)
    return value * existing * cosine / (cosine * cosine + (1 - existing))


def angle_rates_exist(cosine):
    """1 where rates of yaw and roll exist for every angular velocity, 0 elsewhere (...); of symbols too."""
    return (1 + signs(cosine * cosine - SINGULAR_PITCH_COSINE**2)) / 2


def joint_velocities(q, rates, attitudes, zero, divide_by_cosine=divide_by_cosine):
    """Velocities (..., joints) of the joints, from rates (..., joints) in the charts of `attitudes` at q (..., joints).

    Where pitch is ±90° they do not exist for every angular velocity: there those of yaw and roll are nan, or yaw stands
    still where roll and pitch alone make the motion; or they are what `quotient` says.
    """
    if not attitudes:
        return rates
    rates = _own(q, rates)
    for attitude in attitudes:
        (yaw, _, roll), (sine, cosine) = attitude.joints, pitch_sine_cosine(q, attitude, zero)
        rates[..., yaw] = divide_by_cosine(rates[..., yaw], cosine, rates[..., attitude.joints])
        rates[..., roll] = rates[..., roll] + sine * rates[..., yaw]
    return rates


def joint_accelerations(q, velocities, rates, attitudes, zero, divide_by_cosine=divide_by_cosine):
    """Accelerations (..., joints) of the joints, from those in the charts; velocities: as `joint_velocities` has them.
    They are nan where velocities are, or what `quotient` says."""
    if not attitudes:
        return rates
    rates = _own(q, velocities, rates)
    for attitude in attitudes:
        (yaw, pitch, roll), (sine, cosine) = attitude.joints, pitch_sine_cosine(q, attitude, zero)
        turning = 2 * sine * velocities[..., yaw] * velocities[..., pitch]
        bending = sine * cosine * velocities[..., yaw] * velocities[..., yaw]
        yaw_rate = divide_by_cosine(rates[..., yaw] + turning, cosine, rates[..., attitude.joints])
        rates[..., pitch] = rates[..., pitch] - bending
        rates[..., yaw], rates[..., roll] = yaw_rate, rates[..., roll] + sine * yaw_rate
    return rates


def chart_rates(q, velocities, attitudes, zero):
    """Rates (..., joints) in the charts, from velocities (..., joints) of the joints."""
    velocities = _own(q, velocities) if attitudes else velocities
    for attitude in attitudes:
        (yaw, _, roll), (sine, cosine) = attitude.joints, pitch_sine_cosine(q, attitude, zero)
        velocities[..., roll] -= sine * velocities[..., yaw]
        velocities[..., yaw] *= cosine
    return velocities


def chart_forces(q, forces, attitudes, zero, divide_by_cosine=divide_by_cosine):
    """Forces (..., joints) along the coordinates of the charts, from those at the joints, by virtual work."""
    forces = _own(q, forces) if attitudes else forces
    for attitude in attitudes:
        (yaw, _, roll), (sine, cosine) = attitude.joints, pitch_sine_cosine(q, attitude, zero)
        whole = forces[..., attitude.joints]
        forces[..., yaw] = divide_by_cosine(forces[..., yaw] + sine * forces[..., roll], cosine, whole)
    return forces


def _own(*arrays):
    """The last of arrays (..., joints), a copy with the batch of all."""
    return np.array(np.broadcast_arrays(*arrays)[-1], dtype=np.result_type(float, *arrays))


def displace(t, way, attitudes):
    """Positions (..., m) of the joints that follow no other one, from positions t (..., m) by a way (..., m) of which
    the parts of `attitudes` are in their charts at t."""
    found = t + way
    for _, places in attitudes:
        columns = list(places)
        angles, part = t[..., columns], way[..., columns]
        sine, cosine = np.sin(angles[..., 1]), np.cos(angles[..., 1])
        steep = np.abs(cosine) < STEEP_PITCH_COSINE
        if not np.all(steep):
            yaw = part[..., 0] / np.where(steep, 1.0, cosine)
            found[..., places[0]] = angles[..., 0] + yaw
            found[..., places[2]] = angles[..., 2] + part[..., 2] + sine * yaw
        if np.any(steep):
            turned = _turned(angles[steep], part[steep])
            rows = np.flatnonzero(steep.ravel())
            flat = found.reshape(-1, found.shape[-1])
            flat[rows[:, None], columns] = turned
            found = flat.reshape(found.shape)
    return found


def displacement(begin, end, attitudes):
    """The way (..., m) from positions `begin` (..., m) of the joints that follow no other one to positions `end`, in
    the charts of `attitudes` at the end."""
    way = end - begin
    for _, places in attitudes:
        columns = list(places)
        before, after, part = begin[..., columns], end[..., columns], way[..., columns]
        sine, cosine = np.sin(after[..., 1]), np.cos(after[..., 1])
        way[..., places[0]] = cosine * part[..., 0]
        way[..., places[2]] = part[..., 2] - sine * part[..., 0]
        steep = (np.abs(cosine) < STEEP_PITCH_COSINE) | (np.abs(np.cos(before[..., 1])) < STEEP_PITCH_COSINE)
        if np.any(steep):
            rows = np.flatnonzero(steep.ravel())
            flat = way.reshape(-1, way.shape[-1])
            flat[rows[:, None], columns] = _rotation_between(before[steep], after[steep])
            way = flat.reshape(way.shape)
    return way


def _turned(angles, way):
    """Angles (N, 3) nearest to `angles` (N, 3), after a rotation by `way` (N, 3) in their chart."""
    M = axis_rotation(2, angles[:, 0]) @ axis_rotation(1, angles[:, 1]) @ rotation_exponential(way[:, ::-1])
    yaw, pitch, roll = nearest_angles(M, np.stack([angles[:, 0], angles[:, 1], 0 * angles[:, 2]], axis=-1)).T
    return np.stack([yaw, pitch, angles[:, 2] + roll], axis=-1)


def _rotation_between(before, after):
    """(N, 3) the rotation from angles `before` (N, 3) to `after`, in the chart of the latter."""
    R = np.swapaxes(rotation(before), -1, -2) @ rotation(after)
    return (axis_rotation(0, after[:, 2]) @ rotation_logarithm(R)[..., None])[:, ::-1, 0]


def axis_rotation(axis, angle):
    """(..., 3, 3) rotations by angles (...) about an axis of the frame, 0, 1 or 2."""
    R = np.zeros((*np.shape(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[..., axis, axis] = 1
    R[..., i, i] = R[..., j, j] = np.cos(angle)
    R[..., j, i] = np.sin(angle)
    R[..., i, j] = -R[..., j, i]
    return R


def rotation(angles):
    """(..., 3, 3) of yaw, pitch and roll (..., 3)."""
    return axis_rotation(2, angles[..., 0]) @ axis_rotation(1, angles[..., 1]) @ axis_rotation(0, angles[..., 2])


def rotation_exponential(vector):
    """(..., 3, 3) of rotation vectors (..., 3)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = (vector[..., k] for k in range(3))
    zero = np.zeros_like(x)
    K = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vector.shape[:-1], 3, 3)
    return np.eye(3) + np.sinc(angle / np.pi) * K + np.sinc(angle / (2 * np.pi)) ** 2 / 2 * (K @ K)


def rotation_logarithm(R):
    """(..., 3) rotation vectors of rotations (..., 3, 3) by less than half a turn."""
    skewed = (R - np.swapaxes(R, -1, -2)) / 2
    sines = np.stack([skewed[..., 2, 1], skewed[..., 0, 2], skewed[..., 1, 0]], axis=-1)
    sine = np.linalg.norm(sines, axis=-1)
    angle = np.arctan2(sine, (np.trace(R, axis1=-2, axis2=-1) - 1) / 2)
    return sines * np.where(sine > 0, angle / np.where(sine > 0, sine, 1.0), 1.0)[..., None]


def nearest_angles(R, near):
    """Yaw, pitch and roll (..., 3) of rotations (..., 3, 3): of all that mean this rotation those nearest to angles
    `near` (..., 3). Where pitch is ±90° to the last digits yaw is as there, and roll what is left."""
    one = angles_from_rotation(R, near[..., 0])
    both = np.stack([one, one * [1, -1, 1] + np.pi])
    apart = both - near
    apart -= 2 * np.pi * np.round(apart / (2 * np.pi))
    nearest = np.linalg.norm(apart[1], axis=-1) < np.linalg.norm(apart[0], axis=-1)
    return near + np.where(nearest[..., None], apart[1], apart[0])


def angles_from_rotation(R, yaw=0.0):
    """Yaw, pitch within ±90°, and roll (..., 3) of rotations (..., 3, 3). yaw: (...), what it is where pitch is ±90° to
    the last digits, and roll what is left."""
    level = np.hypot(R[..., 0, 0], R[..., 1, 0])
    yaw = np.where(level > VERTICAL_PITCH_COSINE, np.arctan2(R[..., 1, 0], R[..., 0, 0]), yaw)
    sine, cosine = np.sin(yaw), np.cos(yaw)
    pitch = np.arctan2(-R[..., 2, 0], cosine * R[..., 0, 0] + sine * R[..., 1, 0])
    roll = np.arctan2(sine * R[..., 0, 2] - cosine * R[..., 1, 2], cosine * R[..., 1, 1] - sine * R[..., 0, 1])
    return np.stack([yaw, pitch, roll], axis=-1)
