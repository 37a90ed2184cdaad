"""Pose and motion of platforms, in coordinates and as rotations: x, y, z, yaw, pitch, roll, and twists.

A platform with a chart (`newton_euler.attitude`) has as rates those of x, y, z and of the chart, which exist for every
twist. With the angular velocity ω in the axes after yaw and pitch, which are those of the chart:

    ȧ = ω_z,            ḃ = ω_y,            ċ = ω_x
    ä = ω̇_z + ċ ḃ,      b̈ = ω̇_y - ċ ȧ,      c̈ = ω̇_x + ȧ ḃ

One without has rates of the angles.
"""

import numpy as np

from robot_dynamics.constraints.attitude_angles import (
    angles_from_rotation,
    axis_rotation,
    nearest_angles,
    rotation_from_angles,
)
from robot_dynamics.newton_euler.linear import solve_each
from robot_dynamics.newton_euler.screw import apply, apply_transposed


def coordinates_from_pose(pose, near=None):
    """(..., 6) x, y, z, yaw, pitch, roll of poses (..., 4, 4).

    near: (..., 6) coordinates; of all angles that mean the rotation come those nearest to these. Without, pitch is
    within ±90°.
    """
    R = np.asarray(pose)[..., :3, :3]
    angles = angles_from_rotation(R) if near is None else nearest_angles(R, near[..., 3:])
    return np.concatenate(np.broadcast_arrays(pose[..., :3, 3], angles), axis=-1)


def pose_from_coordinates(x):
    """(..., 4, 4) poses of coordinates (..., 6)."""
    pose = np.zeros((*x.shape[:-1], 4, 4))
    pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = rotation_from_angles(x[..., 3:]), x[..., :3], 1
    return pose


def twist_matrix(x):
    """(..., 6, 6): from the rates of coordinates x (..., 6) to the twist of the platform in its own frame."""
    matrix = np.zeros((*x.shape[:-1], 6, 6))
    matrix[..., :3, :3] = np.swapaxes(rotation_from_angles(x[..., 3:]), -1, -2)
    sine, cosine = np.sin(x[..., 4:]), np.cos(x[..., 4:])  # of pitch and roll
    matrix[..., 3, 3], matrix[..., 3, 5] = -sine[..., 0], 1
    matrix[..., 4, 3], matrix[..., 4, 4] = cosine[..., 0] * sine[..., 1], cosine[..., 1]
    matrix[..., 5, 3], matrix[..., 5, 4] = cosine[..., 0] * cosine[..., 1], -sine[..., 1]
    return matrix


def twist_drift(x, rates):
    """(..., 6): the classical acceleration of the platform at rates (..., 6) that do not change."""
    yaw, pitch, roll = (rates[..., k] for k in (3, 4, 5))
    (sp, sr), (cp, cr) = (np.moveaxis(of(x[..., 4:]), -1, 0) for of in (np.sin, np.cos))
    found = np.zeros(np.broadcast_shapes(x.shape, rates.shape))
    found[..., 3] = -yaw * pitch * cp
    found[..., 4] = -pitch * roll * sr + yaw * (roll * cp * cr - pitch * sp * sr)
    found[..., 5] = -pitch * roll * cr - yaw * (roll * cp * sr + pitch * sp * cr)
    return found


class AngleRates:
    """Twists and rates of a platform without a chart: those of its coordinates.

    Arguments are coordinates x, rates and their derivatives, twists and accelerations, (..., 6) each; twists and
    accelerations are in the platform's own frame.
    """

    @staticmethod
    def rates(x, twist):
        return solve_each(twist_matrix(x), twist)

    @staticmethod
    def rate_derivatives(x, rates, acceleration):
        """The derivatives of rates."""
        return solve_each(twist_matrix(x), acceleration - twist_drift(x, rates))

    @staticmethod
    def twist(x, rates):
        return apply(twist_matrix(x), rates)

    @staticmethod
    def acceleration(x, rates, rate_derivatives):
        return apply(twist_matrix(x), rate_derivatives) + twist_drift(x, rates)


class ChartRates:
    """Twists and rates of a platform with a chart. Arguments as of AngleRates."""

    @staticmethod
    def rates(x, twist):
        linear, angular = _in_base(x, twist[..., :3]), _in_chart(x, twist[..., 3:])
        return _joined(linear, angular[..., ::-1])

    @staticmethod
    def rate_derivatives(x, rates, acceleration):
        """The derivatives of rates."""
        linear, angular = _in_base(x, acceleration[..., :3]), _in_chart(x, acceleration[..., 3:])
        return _joined(linear, angular[..., ::-1] + _turning(rates))

    @staticmethod
    def twist(x, rates):
        return _joined(
            apply_transposed(rotation_from_angles(x[..., 3:]), rates[..., :3]), _in_platform(x, rates[..., :2:-1])
        )

    @staticmethod
    def acceleration(x, rates, rate_derivatives):
        angular = (rate_derivatives[..., 3:] - _turning(rates))[..., ::-1]
        return _joined(
            apply_transposed(rotation_from_angles(x[..., 3:]), rate_derivatives[..., :3]), _in_platform(x, angular)
        )


def _in_base(x, vector):
    return apply(rotation_from_angles(x[..., 3:]), vector)


def _in_chart(x, vector):
    return apply(axis_rotation(0, x[..., 5]), vector)


def _in_platform(x, vector):
    return apply_transposed(axis_rotation(0, x[..., 5]), vector)


def _turning(rates):
    """(..., 3): what second derivatives of the chart have beside the angular acceleration."""
    a, b, c = (rates[..., k] for k in (3, 4, 5))
    return np.stack([c * b, -c * a, a * b], axis=-1)


def _joined(linear, angular):
    batch = np.broadcast_shapes(linear.shape, angular.shape)
    return np.concatenate([np.broadcast_to(linear, batch), np.broadcast_to(angular, batch)], axis=-1)
