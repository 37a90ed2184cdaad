"""Joints and links of a message matched by name with those of the robot, never by position."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import InvalidInputError, describe_unknown_name


def resolve_name(kind, name, known, namespace):
    """The one of `known` that a message calls `name`; the namespace of the node may stand in front of it."""
    if name in known:
        return name
    local = name.lstrip("/").removeprefix(namespace.strip("/") + "/")
    if local in known:
        return local
    raise InvalidInputError(describe_unknown_name(kind, name, known))


@dataclass(frozen=True, eq=False)
class JointOrder:
    """How the joints of a message stand to those of a robot.

    asked: names as the message has them. numbers: for each its number in dynamics.all_joint_names. appended: numbers of
    the joints that the message leaves out because they depend on others.
    """

    dynamics: object
    requested_names: tuple
    numbers: np.ndarray
    appended: np.ndarray

    @property
    def response_order(self):
        """Numbers of all joints in the order of an answer: the asker's, then those left out."""
        return np.concatenate([self.numbers, self.appended])

    @property
    def response_names(self):
        return [*self.requested_names, *(self.dynamics.all_joint_names[number] for number in self.appended)]

    @property
    def independent_order(self):
        """Numbers in dynamics.joint_names of the independent joints, in the asker's order."""
        places = {name: place for place, name in enumerate(self.dynamics.joint_names)}
        names = (self.dynamics.all_joint_names[number] for number in self.numbers)
        return np.array([places[name] for name in names if name in places], dtype=int)


def match_joints(names, dynamics, namespace):
    """The JointOrder of the joint names of a message.

    Every independent joint must be among them; one that depends on others may be. Raises QuestionError naming the
    joints that are missing, unknown or there more than once.
    """
    known = dynamics.robot.joint_numbers
    resolved = [resolve_name("joint", name, known, namespace) for name in names]
    repeated = [name for name, times in Counter(resolved).items() if times > 1]
    if repeated:
        raise InvalidInputError(f"joint {', '.join(map(repr, repeated))} is named more than once: once is right")
    missing = [name for name in dynamics.joint_names if name not in set(resolved)]
    if missing:
        raise InvalidInputError(f"joints missing: {', '.join(map(repr, missing))}. Every joint must be named")
    numbers = np.array([known[name] for name in resolved], dtype=int)
    appended = np.setdiff1d(np.arange(len(known)), numbers)
    return JointOrder(dynamics, tuple(names), numbers, appended)
