"""Joints and links of messages, matched with those of the robot by name, never by position."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import InvalidInputError, describe_unknown_name

if TYPE_CHECKING:
    from robot_dynamics.array_types import IntArray
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

    @property
    def response_order(self) -> IntArray:
        """Indices of all joints in the order of the response: that of the request, then those left out."""
        return np.concatenate([self.numbers, self.appended])

    @property
    def response_names(self) -> list[str]:
        """Names of all joints in the order of the response."""
        return [*self.requested_names, *(self.dynamics.all_joint_names[number] for number in self.appended)]

    @property
    def independent_order(self) -> IntArray:
        """Indices in dynamics.joint_names of the independent joints, in the order of the request."""
        indices = {name: index for index, name in enumerate(self.dynamics.joint_names)}
        names = (self.dynamics.all_joint_names[number] for number in self.numbers)
        return np.array([indices[name] for name in names if name in indices], dtype=int)


def match_joints(names: Sequence[str], dynamics: Dynamics, namespace: str) -> JointOrder:
    """Return the JointOrder of the joint names of a message.

    Every independent joint must be among them; dependent joints may be. Raises InvalidInputError with the names that
    are missing, unknown or repeated.
    """
    known = dynamics.robot.joint_numbers
    resolved = [resolve_name("joint", name, known, namespace) for name in names]
    repeated = [name for name, count in Counter(resolved).items() if count > 1]
    if repeated:
        raise InvalidInputError(f"joint {', '.join(map(repr, repeated))} is named more than once: name each joint once")
    missing = [name for name in dynamics.joint_names if name not in set(resolved)]
    if missing:
        raise InvalidInputError(f"joints missing: {', '.join(map(repr, missing))}. Every joint must be named")
    numbers = np.array([known[name] for name in resolved], dtype=int)
    appended = np.setdiff1d(np.arange(len(known)), numbers)
    return JointOrder(dynamics, tuple(names), numbers, appended)
