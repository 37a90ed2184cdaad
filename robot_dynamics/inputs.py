"""What is asked of a robot, checked once: shapes, names and numbers; and its conversion to what the recursions take."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from robot_dynamics.array_checks import require_finite
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.newton_euler.screw import apply_transposed, wrench_to_antecedent

__all__ = [
    "Base",
    "BaseState",
    "base_state",
    "common_batch_shape",
    "link_wrenches",
    "require_finite",
    "require_pose",
]


@dataclass(frozen=True, eq=False)
class Base:
    """The state of a moving base.

    pose: (..., 4, 4) of frame 0 in the world; twist: (..., 6) [m/s, rad/s] and acceleration: (..., 6) [m/s², rad/s²]
    of the origin of frame 0, linear then angular, expressed in frame 0; the acceleration true and classical.
    acceleration None: only external wrenches act on the base, and its acceleration is part of the answer.
    Left out, the pose is that of the world and the twist is zero.
    """

    pose: np.ndarray = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))
    twist: np.ndarray = (0, 0, 0, 0, 0, 0)
    acceleration: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class BaseState:
    """The base as the recursions take it, fixed or moving.

    pose: (..., 4, 4); gravity: (..., 3) in frame 0; twist: (..., 6); acceleration: (..., 6) with gravity taken off,
    None if unknown.
    """

    pose: np.ndarray
    gravity: np.ndarray
    twist: np.ndarray
    acceleration: np.ndarray | None

    @property
    def rest_acceleration(self):
        """(..., 6) acceleration, gravity taken off, of a base that does not accelerate."""
        return _at_rest(self.gravity)

    def true_acceleration(self, acceleration):
        """(..., 6) with gravity restored."""
        return acceleration - self.rest_acceleration


def base_state(robot, base):
    """The BaseState of a Base, or of a base that is fixed."""
    if not robot.moving_base:
        if base is not None:
            raise InvalidInputError(f"the base of {robot.name!r} is fixed: it has no state to be given")
        return BaseState(np.eye(4), robot.gravity, np.zeros(6), _at_rest(robot.gravity))
    if not isinstance(base, Base):
        given = type(base).__name__
        raise InvalidInputError(
            f"the base of {robot.name!r} moves: give its state, base=Base(pose, twist), not {given}"
        )
    pose = require_pose(base.pose, "pose of the base")
    gravity = apply_transposed(pose[..., :3, :3], robot.gravity)
    twist = require_finite("twist of the base", base.twist, 6, "linear and angular components")
    if base.acceleration is None:
        return BaseState(pose, gravity, twist, None)
    acceleration = require_finite("acceleration of the base", base.acceleration, 6, "linear and angular components")
    return BaseState(pose, gravity, twist, acceleration + _at_rest(gravity))


def _at_rest(gravity):
    return np.concatenate([-gravity, np.zeros_like(gravity)], axis=-1)


def require_pose(pose, what):
    """Homogeneous matrices (..., 4, 4). what: what to call them in the QuestionError of what is none."""
    if np.shape(pose)[-2:] != (4, 4):
        raise InvalidInputError(f"{what} has shape {np.shape(pose)}: homogeneous matrices (..., 4, 4) are needed")
    pose = require_finite(what, pose, 4, "columns")
    R, last = pose[..., :3, :3], pose[..., 3, :]
    skewed = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(initial=0) > 1e-6
    if skewed or (np.linalg.det(R) < 0).any() or (last != (0, 0, 0, 1)).any():
        raise InvalidInputError(f"{what} is no homogeneous matrix [rotation, position; 0, 0, 0, 1]")
    return pose


def link_wrenches(robot, external_wrenches):
    """{link number: jf_e (..., 6)} of {frame name: (..., 6)}: the one place where the sign turns.

    Users say what the environment does to a link, in its own link frame; Khalil's f_e is what the link does to the
    environment, in frame j. Wrenches on frames of the same link add up.
    """
    if not isinstance(external_wrenches, Mapping | None):
        raise InvalidInputError("external_wrenches: a mapping {link name: (..., 6)} is needed")
    converted = {}
    for name, wrench in (external_wrenches or {}).items():
        frame = robot.frame(name)
        wrench = require_finite(f"external wrench on {name!r}", wrench, 6, "force and torque components")
        R, P = frame.placement[:3, :3], frame.placement[:3, 3]
        converted[frame.link] = converted.get(frame.link, 0) - wrench_to_antecedent(R, P, wrench)
    return converted


def common_batch_shape(*arrays):
    """The shape of the batch axes that arrays (..., m) share, None left out. Raises QuestionError where they differ."""
    batches = [array.shape[:-1] for array in arrays if array is not None]
    try:
        return np.broadcast_shapes(*batches)
    except ValueError:
        told = " and ".join(map(str, sorted(set(batches) - {()})))
        raise InvalidInputError(
            f"batches of {told} samples do not go together: give one sample or equally many"
        ) from None
