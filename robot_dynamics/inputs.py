"""Checks of the arguments of the dynamic models, and their conversion to the arguments of the recursions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robot_dynamics.array_checks import require_finite
from robot_dynamics.array_types import ArrayLike
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.newton_euler.screw import apply_transposed, wrench_to_antecedent

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot

ROTATION_TOLERANCE = 1e-6
"""Largest entry of R Rᵀ - 1 of a rotation matrix R in an argument."""

UNACTUATED_REASON = "no motor drives it, so the acceleration is part of the result and the effort is zero"
"""Why an unactuated joint takes neither an acceleration nor an effort."""

ExternalWrenches: TypeAlias = Mapping[str, ArrayLike]
"""Wrenches (..., 6) [N, N m] by link name: force, then torque, of the environment on the link, in the link frame at its
origin."""


@dataclass(frozen=True, eq=False)
class Base:
    """State of a moving base.

    Attributes
    ----------
    pose : (..., 4, 4)
        Homogeneous matrix of frame 0 in the world [m]. Default: frame 0 is the world frame.
    twist : (..., 6)
        Linear and angular velocity of the origin of frame 0 [m/s, rad/s], in frame 0. Default: zero.
    acceleration : (..., 6), optional
        Linear and angular acceleration of the origin of frame 0 [m/s², rad/s²], in frame 0, true (gravity is not
        subtracted) and classical. None: the base is free, only external wrenches act on it, and its acceleration is
        part of the result.
    """

    pose: ArrayLike = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
    twist: ArrayLike = (0, 0, 0, 0, 0, 0)
    acceleration: ArrayLike | None = None


@dataclass(frozen=True, eq=False)
class BaseState:
    """State of a fixed or moving base as the recursions take it.

    pose: (..., 4, 4) of frame 0 in the world; gravity: (..., 3) in frame 0; twist: (..., 6) in frame 0; acceleration:
    (..., 6) in frame 0 with gravity subtracted, None where it is unknown.
    """

    pose: Array
    gravity: Array
    twist: Array
    acceleration: Array | None

    @property
    def prescribed_acceleration(self) -> Array:
        """(..., 6) acceleration, gravity subtracted; InvalidInputError where it is unknown."""
        if self.acceleration is None:
            raise InvalidInputError("the acceleration of the moving base is needed: give it in Base")
        return self.acceleration

    @property
    def rest_acceleration(self) -> Array:
        """(..., 6) acceleration, gravity subtracted, of a base at rest."""
        return _rest_acceleration(self.gravity)

    def true_acceleration(self, acceleration: Array) -> Array:
        """Return accelerations (..., 6) with gravity restored."""
        return acceleration - self.rest_acceleration


def base_state(robot: Robot, base: Base | None) -> BaseState:
    """Return the BaseState of a robot; `base` is None where the base is fixed."""
    if not robot.moving_base:
        if base is not None:
            raise InvalidInputError(f"the base of {robot.name!r} is fixed: leave out the state of the base")
        return BaseState(np.eye(4), robot.gravity, np.zeros(6), _rest_acceleration(robot.gravity))
    if not isinstance(base, Base):
        raise InvalidInputError(
            f"the base of {robot.name!r} moves: give its state, base=Base(pose, twist), not {type(base).__name__}"
        )
    pose = require_pose(base.pose, "pose of the base")
    gravity = apply_transposed(pose[..., :3, :3], robot.gravity)
    twist = require_finite("twist of the base", base.twist, 6, "linear and angular components")
    if base.acceleration is None:
        return BaseState(pose, gravity, twist, None)
    acceleration = require_finite("acceleration of the base", base.acceleration, 6, "linear and angular components")
    return BaseState(pose, gravity, twist, acceleration + _rest_acceleration(gravity))


def _rest_acceleration(gravity: Array) -> Array:
    return np.concatenate([-gravity, np.zeros_like(gravity)], axis=-1)


def require_pose(pose: ArrayLike, label: str) -> Array:
    """Return homogeneous matrices (..., 4, 4); `label` names the pose in error messages."""
    try:
        shape = np.shape(pose)
    except ValueError:  # rows of different lengths
        shape = ()
    if shape[-2:] != (4, 4):
        raise InvalidInputError(f"{label} has shape {shape}: homogeneous matrices (..., 4, 4) are needed")
    matrices = require_finite(label, pose, 4, "columns")
    R = matrices[..., :3, :3]
    last_row = matrices[..., 3, :]
    is_skewed = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(initial=0) > ROTATION_TOLERANCE
    if is_skewed or (np.linalg.det(R) < 0).any() or (last_row != (0, 0, 0, 1)).any():
        raise InvalidInputError(f"{label} is not a homogeneous matrix [rotation, position; 0, 0, 0, 1]")
    return matrices


def link_wrenches(robot: Robot, external_wrenches: ExternalWrenches | None) -> dict[int, Array]:
    """Return Khalil's jf_e (..., 6) by link number, from external wrenches by frame name.

    This is the one place where the sign changes: users give the wrench of the environment on a link, in its link frame;
    Khalil's f_e is the wrench of the link on the environment, in frame j. Wrenches on frames of the same link add up.
    """
    if not isinstance(external_wrenches, Mapping | None):
        raise InvalidInputError("external_wrenches: a mapping {link name: (..., 6)} is needed")
    converted: dict[int, Array] = {}
    for name, wrench in (external_wrenches or {}).items():
        frame = robot.frame(name)
        wrench = require_finite(f"external wrench on {name!r}", wrench, 6, "force and torque components")
        R = frame.placement[:3, :3]
        P = frame.placement[:3, 3]
        converted[frame.link] = converted.get(frame.link, 0) - wrench_to_antecedent(R, P, wrench)
    return converted


def common_batch_shape(*arrays: Array | None) -> tuple[int, ...]:
    """Return the batch shape that arrays (..., m) broadcast to; None entries are skipped.

    Raises InvalidInputError where the batch shapes differ.
    """
    batches = [array.shape[:-1] for array in arrays if array is not None]
    try:
        return np.broadcast_shapes(*batches)
    except ValueError:
        shapes = " and ".join(map(str, sorted(set(batches) - {()})))
        raise InvalidInputError(
            f"batches of {shapes} samples do not match: give one sample, or batches of the same shape"
        ) from None
