"""Joints and links of messages, matched with those of the robot by name, never by position."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import InvalidInputError, describe_unknown_name

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray
    from robot_dynamics.dynamics import Dynamics


def resolve_name(kind: str, name: str, known: Collection[str], namespace: str) -> str:
    """Return the name among `known` that a message means; the namespace of the node may precede it.

    kind: of thing the name is of, for errors. Raises InvalidInputError.
    """
    if name in known:
        return name
    local_name = name.lstrip("/").removeprefix(namespace.strip("/") + "/")
    if local_name in known:
        return local_name
    raise InvalidInputError(describe_unknown_name(kind, name, known))


@dataclass(frozen=True, eq=False)
class JointOrder:
    """The order of the joints of a request, relative to the order of the robot.

    Attributes
    ----------
    requested_names : names as the message has them.
    numbers : for each of them the index in dynamics.all_joint_names.
    appended : indices of the dependent joints that the message leaves out.
    """

    dynamics: Dynamics
    requested_names: tuple[str, ...]
    numbers: IntArray
    appended: IntArray

    @cached_property
    def response_order(self) -> IntArray:
        """Indices of all joints in the order of the response: that of the request, then those left out."""
        return np.concatenate([self.numbers, self.appended])

    @cached_property
    def response_names(self) -> list[str]:
        """Names of all joints in the order of the response."""
        return [*self.requested_names, *(self.dynamics.all_joint_names[number] for number in self.appended)]

    @cached_property
    def independent_order(self) -> IntArray:
        """Indices in dynamics.joint_names of the independent joints, in the order of the request."""
        indices = {name: index for index, name in enumerate(self.dynamics.joint_names)}
        names = (self.dynamics.all_joint_names[number] for number in self.numbers)
        return np.array([indices[name] for name in names if name in indices], dtype=int)

    @cached_property
    def independent(self) -> list[int]:
        """Indices in dynamics.all_joint_names of the independent joints."""
        return [self.dynamics.robot.joint_numbers[name] for name in self.dynamics.joint_names]

    @cached_property
    def dependent(self) -> list[int]:
        """Indices in dynamics.all_joint_names of the joints that loops determine."""
        return [self.dynamics.robot.joint_numbers[name] for name in self.dynamics.dependent_joint_names]

    @cached_property
    def has_independent_only(self) -> bool:
        """Whether the message has the independent joints and no others."""
        return len(self.numbers) == len(self.independent)

    @cached_property
    def is_unactuated(self) -> BoolArray:
        """For each joint of the message, whether neither it nor the joint that it depends on has a motor."""
        robot = self.dynamics.robot
        return np.array(
            [not robot.joints[robot.mimic_relations[number][0]].actuated for number in self.numbers], dtype=bool
        )

    @cached_property
    def are_all_independent(self) -> bool:
        """Whether all joints of the robot are independent, so that vectors of these and of all joints are the same."""
        return self.independent == list(range(len(self.dynamics.all_joint_names)))

    @cached_property
    def is_plain(self) -> bool:
        """Whether all joints of the robot are independent and have motors, and its base is fixed."""
        robot = self.dynamics.robot
        return self.are_all_independent and not (
            robot.moving_base or robot.loops or robot.platforms or self.dynamics.unactuated_joint_names
        )

    @cached_property
    def _independent_columns(self) -> IntArray | None:
        """Columns of the independent joints in the message; None where these are all its columns in the same order."""
        columns = [list(self.numbers).index(number) for number in self.independent]
        return None if columns == list(range(len(self.numbers))) else np.array(columns, dtype=int)

    @cached_property
    def _response_columns(self) -> IntArray | None:
        """`response_order`; None where it is the order of the robot."""
        same = np.array_equal(self.response_order, np.arange(len(self.response_order)))
        return None if same else self.response_order

    def embed_efforts(self, efforts: Array) -> Array:
        """Return efforts (..., all joints), zero at dependent joints, of those (..., n) of the independent joints."""
        return efforts if self.are_all_independent else self.dynamics.embed_efforts(efforts)

    def select_independent(self, requested: Array) -> Array:
        """Return values (..., n) of the independent joints, in the robot's order, of values in that of the message."""
        return requested if self._independent_columns is None else requested[..., self._independent_columns]

    def to_response(self, values: Array) -> Array:
        """Return values (..., all joints) in the order of the response."""
        return values if self._response_columns is None else values[..., self._response_columns]


def match_joints(names: Sequence[str], dynamics: Dynamics, namespace: str) -> JointOrder:
    """Return the JointOrder of the joint names of a message.

    Every independent joint must be among them; dependent joints may be. Raises InvalidInputError with the names that
    are missing, unknown or repeated.
    """
    return _match_joints(tuple(names), dynamics, namespace)


@lru_cache(maxsize=16)
def _match_joints(names: tuple[str, ...], dynamics: Dynamics, namespace: str) -> JointOrder:
    known = dynamics.robot.joint_numbers
    locked = ", ".join(repr(joint.name) for joint in dynamics.robot.locked_joints if joint.name in names)
    if locked:
        raise InvalidInputError(f"joint {locked} is locked: leave it out, or change parameter locked_joints")
    resolved = [resolve_name("joint", name, known, namespace) for name in names]
    repeated = [name for name, count in Counter(resolved).items() if count > 1]
    if repeated:
        raise InvalidInputError(f"joint {', '.join(map(repr, repeated))} is named more than once: name each joint once")
    missing = [name for name in dynamics.joint_names if name not in set(resolved)]
    if missing:
        raise InvalidInputError(f"joints missing: {', '.join(map(repr, missing))}. Every joint must be named")
    numbers = np.array([known[name] for name in resolved], dtype=int)
    appended = np.setdiff1d(np.arange(len(known)), numbers)
    return JointOrder(dynamics, names, numbers, appended)
