"""Thresholds of external efforts for the decision of collisions, and their YAML file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import describe_unknown_name
from robot_dynamics.model.formats.expression import format_number
from robot_dynamics.model.formats.mdh_yaml.document import DOCUMENT_END
from robot_dynamics.recordings.documents import read_document

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.dynamics import Dynamics

SCHEMA = Path(__file__).with_name("collision_thresholds.schema.json")
EXPECTED = "a YAML file of collision thresholds"
SLOW_VELOCITY = 0.05
"""Velocity [rad/s or m/s] below which friction is not that of the model."""

STICTION_RATIO = 1.5
"""Friction that holds a joint at rest, relative to its dry friction in the model."""


@dataclass(frozen=True, eq=False)
class CollisionThresholds:
    """Thresholds of n joints.

    Attributes
    ----------
    joint_names : tuple of str
    moving : ndarray, shape (n,)
        Of the external effort while the joint moves [N m or N]; inf: the joint decides nothing.
    slow : ndarray, shape (n,)
        Added near standstill and at reversals [N m or N].
    bandwidth : float
        Of the observer for which they hold [1/s].
    slow_velocity : float
        Velocity below which a joint counts as slow [rad/s or m/s].
    """

    joint_names: tuple[str, ...]
    moving: Array
    slow: Array
    bandwidth: float
    slow_velocity: float = SLOW_VELOCITY

    def bounds(self, slowness: Array) -> Array:
        """Thresholds (..., n) at parts (..., n) of the additional thresholds."""
        bounds: Array = self.moving + self.slow * slowness
        return bounds

    def is_slow(self, velocities: Array) -> BoolArray:
        """Whether joints (..., n) are near standstill."""
        slow: BoolArray = np.abs(velocities) < self.slow_velocity
        return slow


def dry_friction(dynamics: Dynamics, slow_velocity: float = SLOW_VELOCITY) -> Array:
    """Largest friction (n,) of the independent joints below a velocity, without viscous friction [N m or N]."""
    numbers = dynamics.robot.joint_numbers
    frictions = []
    for name in dynamics.joint_names:
        joint = dynamics.robot.joints[numbers[name]]
        at_limit = joint.stribeck_friction
        if at_limit:
            at_limit /= 1 + (slow_velocity / joint.stribeck_velocity) ** 2
        stribeck = max(joint.stribeck_friction, at_limit)
        frictions.append(max(0.0, joint.coulomb_friction + stribeck) + abs(joint.coulomb_asymmetry))
    return np.array(frictions)


def default_thresholds(dynamics: Dynamics, effort_share: float, bandwidth: float) -> CollisionThresholds:
    """Thresholds without a recording: a share of the effort limits; inf for joints without a limit."""
    numbers = dynamics.robot.joint_numbers
    limits = np.array([dynamics.robot.joints[numbers[name]].limits.effort for name in dynamics.joint_names])
    moving = np.where(np.isfinite(limits) & (limits > 0), effort_share * limits, np.inf)
    return CollisionThresholds(dynamics.joint_names, moving, STICTION_RATIO * dry_friction(dynamics), bandwidth)


def load_thresholds(path: str | Path, joint_names: Sequence[str]) -> CollisionThresholds:
    """Read thresholds from a YAML file.

    Parameters
    ----------
    path : path of the file, as `write_thresholds` gives its text.
    joint_names : names of all independent joints of the robot. Joints that the file leaves out decide nothing.

    Raises
    ------
    DescriptionError
        The file cannot be read, or does not fit its schema or the joints.
    """
    document = read_document(Path(path), SCHEMA, EXPECTED)
    data = document.data
    for name in data["joints"]:
        if name not in joint_names:
            document.fail(("joints", name), describe_unknown_name("joint", name, joint_names))
    rows = [data["joints"].get(name, {"moving": np.inf}) for name in joint_names]
    return CollisionThresholds(
        joint_names=tuple(joint_names),
        moving=np.array([float(row["moving"]) for row in rows]),
        slow=np.array([float(row.get("slow", 0.0)) for row in rows]),
        bandwidth=float(data["bandwidth"]),
        slow_velocity=float(data.get("slow_velocity", SLOW_VELOCITY)),
    )


def write_thresholds(thresholds: CollisionThresholds, comments: Sequence[str] = ()) -> str:
    """The YAML text of thresholds, for `load_thresholds` to read; comments: lines at its beginning."""
    lines = ["%YAML 1.2", "---", "# Thresholds of external efforts [N m or N] for the node contact_monitor."]
    lines += [f"# {comment}" for comment in comments]
    lines += ["format: 1"]
    lines += [f"bandwidth: {format_number(thresholds.bandwidth)}  # of the observer [1/s]"]
    lines += [f"slow_velocity: {format_number(thresholds.slow_velocity)}  # [rad/s or m/s]", "joints:"]
    for name, moving, slow in zip(thresholds.joint_names, thresholds.moving, thresholds.slow, strict=True):
        if np.isfinite(moving):
            entries = f"moving: {format_number(float(moving))}, slow: {format_number(float(slow))}"
            lines.append(f"  {json.dumps(name)}: {{{entries}}}")
    return "\n".join([*lines, DOCUMENT_END]) + "\n"
