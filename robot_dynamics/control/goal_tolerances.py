"""Tolerances of a trajectory goal: how far joints may be from their reference on the way and at the end."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import InvalidInputError, describe_unknown_name

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

UNSPECIFIED = 0.0
"""A requested tolerance that leaves the default as it is; as a default: no limit."""
ERASED = -1.0
"""A requested tolerance that removes the default."""
QUANTITIES = ("position", "velocity")


@dataclass(frozen=True)
class JointLimits:
    """Tolerances that a goal requests for one joint; position [rad or m] and velocity [rad/s or m/s]."""

    name: str
    position: float
    velocity: float


@dataclass(frozen=True)
class GoalTolerances:
    """Tolerances of n joints.

    Attributes
    ----------
    path, goal : ndarray, shape (2, n)
        Largest errors of positions and velocities before the end and at it; inf where there is no limit.
    goal_time : float
        Time [s] after the end in which the joints must come within `goal`; inf for no limit.
    """

    path: Array
    goal: Array
    goal_time: float

    @classmethod
    def from_defaults(
        cls, trajectory: Sequence[float], goal: Sequence[float], stopped_velocity: float, goal_time: float
    ) -> GoalTolerances:
        """Return tolerances of parameters, among which zero means no limit.

        Parameters
        ----------
        trajectory, goal : sequence of float
            Of the position of each joint before the end and at it [rad or m].
        stopped_velocity : float
            Of all velocities at the end [rad/s or m/s].
        goal_time : float
            [s]
        """
        unlimited = [0.0] * len(goal)
        path_limits = _limits(np.array([trajectory, unlimited], dtype=np.float64))
        goal_limits = _limits(np.array([goal, [stopped_velocity] * len(goal)], dtype=np.float64))
        return cls(path_limits, goal_limits, goal_time if goal_time > 0 else math.inf)

    def with_requests(
        self, joints: Sequence[str], path: Iterable[JointLimits], goal: Iterable[JointLimits], goal_time: float
    ) -> GoalTolerances:
        """Return these tolerances with those that a goal requests: zero keeps the default, -1 removes it.

        Parameters
        ----------
        joints : sequence of str
            Names of the n joints.
        path, goal : iterable of JointLimits
        goal_time : float
            [s]

        Raises
        ------
        InvalidInputError
            A joint is unknown, or a number is none of these.
        """
        return GoalTolerances(
            _with_requests(self.path, joints, path, "path_tolerance"),
            _with_requests(self.goal, joints, goal, "goal_tolerance"),
            _resolve(self.goal_time, goal_time, "goal_time_tolerance"),
        )


def describe_violation(errors: Array, limits: Array, joints: Sequence[str]) -> str:
    """Return which joint exceeds its tolerance, and by how much; empty if none does. Errors, limits: (2, n)."""
    excess = np.abs(errors) > limits
    if not excess.any():
        return ""
    quantity, joint = np.argwhere(excess)[0]
    unit = "rad or m" if quantity == 0 else "rad/s or m/s"
    return (
        f"{QUANTITIES[quantity]} of {joints[joint]} is {abs(errors[quantity, joint]):.4g} {unit} from its reference, "
        f"tolerance {limits[quantity, joint]:g}"
    )


def _limits(values: Array) -> Array:
    limits: Array = np.where(values > 0, values, np.inf)
    return limits


def _with_requests(defaults: Array, joints: Sequence[str], requests: Iterable[JointLimits], field: str) -> Array:
    limits: Array = defaults.copy()
    indices: Mapping[str, int] = {name: k for k, name in enumerate(joints)}
    for number, request in enumerate(requests):
        place = f"{field}[{number}]"
        if request.name not in indices:
            raise InvalidInputError(f"{place}: {describe_unknown_name('joint', request.name, joints)}")
        joint = indices[request.name]
        for row, quantity in enumerate(QUANTITIES):
            limits[row, joint] = _resolve(limits[row, joint], getattr(request, quantity), f"{place}.{quantity}")
    return limits


def _resolve(default: float, requested: float, place: str) -> float:
    if requested == UNSPECIFIED:
        return default
    if requested == ERASED:
        return math.inf
    if not requested > 0:
        raise InvalidInputError(f"{place} is {requested:g}: a positive number, 0 for the default or -1 for no limit")
    return requested
