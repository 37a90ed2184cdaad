"""Pose and motion of platforms, in coordinates and as rotations: x, y, z, yaw, pitch, roll, and twists.

A platform with an attitude chart (constraints/attitude_charts.py) has the rates of x, y, z and of the chart, which
exist for every twist. With the angular velocity ω in the axes after yaw and pitch, which are those of the chart:

    ȧ = ω_z,            ḃ = ω_y,            ċ = ω_x
    ä = ω̇_z + ċ ḃ,      b̈ = ω̇_y - ċ ȧ,      c̈ = ω̇_x + ȧ ḃ

A platform without chart has the rates of yaw, pitch and roll.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.constraints.attitude_angles import (
    angles_from_rotation,
    axis_rotation,
    nearest_angles,
    rotation_from_angles,
)
from robot_dynamics.errors import InvalidInputError, describe_unknown_name
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.newton_euler.linear import solve_each
from robot_dynamics.newton_euler.screw import apply, apply_transposed

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray

POSE_TOLERANCE = 1e-9
"""Largest difference of two equal poses [characteristic lengths, rad]."""


def check_coordinate(name: str, free: Collection[str]) -> None:
    """Raise InvalidInputError unless `name` is one of the coordinates `free` of a platform."""
    if name not in COORDINATES:
        raise InvalidInputError(describe_unknown_name("coordinate of a platform", name, COORDINATES))
    if name not in free:
        raise InvalidInputError(f"the legs do not leave {name} of the platform free, only {', '.join(free)}")


def coordinates_from_pose(pose: ScalarArray, near: ScalarArray | None = None) -> ScalarArray:
    """Return coordinates x, y, z, yaw, pitch, roll (..., 6) [m, rad] of poses (..., 4, 4).

    near: (..., 6) coordinates; the angles nearest to these are returned. Default: pitch within ±90°. For symbols too.
    """
    R = np.asarray(pose)[..., :3, :3]
    angles = angles_from_rotation(R) if near is None else nearest_angles(R, near[..., 3:])
    return np.concatenate(np.broadcast_arrays(pose[..., :3, 3], angles), axis=-1)


def pose_from_coordinates(x: ScalarArray) -> ScalarArray:
    """Return poses (..., 4, 4) of coordinates x, y, z, yaw, pitch, roll (..., 6) [m, rad]. For symbols too."""
    pose = np.zeros((*x.shape[:-1], 4, 4), dtype=np.result_type(float, x))
    pose[..., :3, :3] = rotation_from_angles(x[..., 3:])
    pose[..., :3, 3] = x[..., :3]
    pose[..., 3, 3] = 1
    return pose


def twist_matrix(x: Array) -> Array:
    """Return matrices (..., 6, 6) from rates of coordinates x (..., 6) to the twist of the platform in its frame."""
    matrix = np.zeros((*x.shape[:-1], 6, 6))
    sine = np.sin(x[..., 4:])  # of pitch and roll
    cosine = np.cos(x[..., 4:])
    matrix[..., :3, :3] = np.swapaxes(rotation_from_angles(x[..., 3:]), -1, -2)
    matrix[..., 3, 3] = -sine[..., 0]
    matrix[..., 3, 5] = 1
    matrix[..., 4, 3] = cosine[..., 0] * sine[..., 1]
    matrix[..., 4, 4] = cosine[..., 1]
    matrix[..., 5, 3] = cosine[..., 0] * cosine[..., 1]
    matrix[..., 5, 4] = -sine[..., 1]
    return matrix


def twist_drift(x: Array, rates: Array) -> Array:
    """Return classical accelerations (..., 6) of the platform, in its frame, at constant rates (..., 6)."""
    yaw, pitch, roll = (rates[..., column] for column in (3, 4, 5))
    sin_pitch, sin_roll = np.moveaxis(np.sin(x[..., 4:]), -1, 0)
    cos_pitch, cos_roll = np.moveaxis(np.cos(x[..., 4:]), -1, 0)
    drift = np.zeros(np.broadcast_shapes(x.shape, rates.shape))
    drift[..., 3] = -yaw * pitch * cos_pitch
    drift[..., 4] = -pitch * roll * sin_roll + yaw * (roll * cos_pitch * cos_roll - pitch * sin_pitch * sin_roll)
    drift[..., 5] = -pitch * roll * cos_roll - yaw * (roll * cos_pitch * sin_roll + pitch * sin_pitch * cos_roll)
    return drift


class AngleRates:
    """Conversion between twists and rates of x, y, z, yaw, pitch, roll, for a platform without chart.

    Arguments are coordinates x, rates and their derivatives, twists and accelerations, (..., 6) each; twists and
    accelerations are in the frame of the platform.
    """

    @staticmethod
    def rates(x: Array, twist: Array) -> Array:
        """Return the rates of a twist."""
        return solve_each(twist_matrix(x), twist)

    @staticmethod
    def rate_derivatives(x: Array, rates: Array, acceleration: Array) -> Array:
        """Return the derivatives of the rates of an acceleration."""
        return solve_each(twist_matrix(x), acceleration - twist_drift(x, rates))

    @staticmethod
    def twist(x: Array, rates: Array) -> Array:
        """Return the twist of rates."""
        return apply(twist_matrix(x), rates)

    @staticmethod
    def acceleration(x: Array, rates: Array, rate_derivatives: Array) -> Array:
        """Return the acceleration of rates and their derivatives."""
        return apply(twist_matrix(x), rate_derivatives) + twist_drift(x, rates)


class ChartRates:
    """Conversion between twists and rates of x, y, z and of an attitude chart. Methods as of AngleRates."""

    @staticmethod
    def rates(x: Array, twist: Array) -> Array:
        """Return the rates of a twist."""
        linear = _in_base(x, twist[..., :3])
        angular = _in_chart(x, twist[..., 3:])
        return _concatenate(linear, angular[..., ::-1])

    @staticmethod
    def rate_derivatives(x: Array, rates: Array, acceleration: Array) -> Array:
        """Return the derivatives of the rates of an acceleration."""
        linear = _in_base(x, acceleration[..., :3])
        angular = _in_chart(x, acceleration[..., 3:])
        return _concatenate(linear, angular[..., ::-1] + _chart_drift(rates))

    @staticmethod
    def twist(x: Array, rates: Array) -> Array:
        """Return the twist of rates."""
        linear = apply_transposed(rotation_from_angles(x[..., 3:]), rates[..., :3])
        return _concatenate(linear, _in_platform(x, rates[..., :2:-1]))

    @staticmethod
    def acceleration(x: Array, rates: Array, rate_derivatives: Array) -> Array:
        """Return the acceleration of rates and their derivatives."""
        linear = apply_transposed(rotation_from_angles(x[..., 3:]), rate_derivatives[..., :3])
        angular = (rate_derivatives[..., 3:] - _chart_drift(rates))[..., ::-1]
        return _concatenate(linear, _in_platform(x, angular))


def _in_base(x: Array, vector: Array) -> Array:
    return apply(rotation_from_angles(x[..., 3:]), vector)


def _in_chart(x: Array, vector: Array) -> Array:
    return apply(axis_rotation(0, x[..., 5]), vector)


def _in_platform(x: Array, vector: Array) -> Array:
    return apply_transposed(axis_rotation(0, x[..., 5]), vector)


def _chart_drift(rates: Array) -> Array:
    """Return second derivatives (..., 3) of the chart coordinates at zero angular acceleration."""
    a, b, c = (rates[..., column] for column in (3, 4, 5))
    return np.stack([c * b, -c * a, a * b], axis=-1)


def _concatenate(linear: Array, angular: Array) -> Array:
    batch = np.broadcast_shapes(linear.shape, angular.shape)
    return np.concatenate([np.broadcast_to(linear, batch), np.broadcast_to(angular, batch)], axis=-1)


@dataclass(frozen=True)
class PlatformRates:
    """Conversion between twists and rates of several platforms: arrays (..., platforms, 6).

    conversions: AngleRates or ChartRates of each platform, whose methods these are.
    """

    conversions: tuple[type[AngleRates] | type[ChartRates], ...]

    def rates(self, x: Array, twist: Array) -> Array:
        """Return the rates of twists."""
        return _stack_platforms([conversion.rates for conversion in self.conversions], x, twist)

    def rate_derivatives(self, x: Array, rates: Array, acceleration: Array) -> Array:
        """Return the derivatives of the rates of accelerations."""
        functions = [conversion.rate_derivatives for conversion in self.conversions]
        return _stack_platforms(functions, x, rates, acceleration)

    def twist(self, x: Array, rates: Array) -> Array:
        """Return the twists of rates."""
        return _stack_platforms([conversion.twist for conversion in self.conversions], x, rates)

    def acceleration(self, x: Array, rates: Array, rate_derivatives: Array) -> Array:
        """Return the accelerations of rates and their derivatives."""
        functions = [conversion.acceleration for conversion in self.conversions]
        return _stack_platforms(functions, x, rates, rate_derivatives)


def _stack_platforms(functions: list[Callable[..., Array]], *values: Array) -> Array:
    """Return (..., platforms, 6): the result of each platform's function for its rows of values (..., platforms, 6)."""
    rows = zip(*(np.moveaxis(value, -2, 0) for value in values), strict=True)
    results = [function(*arguments) for function, arguments in zip(functions, rows, strict=True)]
    return np.stack(np.broadcast_arrays(*results), axis=-2)
