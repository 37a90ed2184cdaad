"""States of all joints from messages with the independent ones: the loops are closed, from message to message."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from sensor_msgs.msg import JointState

from robot_dynamics.errors import InvalidInputError, SingularModelError
from robot_dynamics.nodes.codecs.joint_order import resolve_name
from robot_dynamics.nodes.codecs.joint_states import JointStateReader

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.codecs.joint_states import JointMapping

SEARCH_INTERVAL = 1.0  # [s] of the machine between two searches for the assembly mode, which can take as long


@dataclass(frozen=True, eq=False)
class CompleteState:
    """The state of all joints at one message.

    Attributes
    ----------
    positions : (all joints,) that close the loops [rad or m].
    velocities : (all joints,) [rad/s or m/s]; None where the message has none, or they do not exist.
    efforts : (n,) of the independent joints [N m or N], nan where the message has none.
    """

    positions: Array
    velocities: Array | None
    efforts: Array


class StateCompletion:
    """Closes the loops of a robot at each message, so that it stays in its assembly mode.

    Parameters
    ----------
    namespace : of the node, which may precede joint names.

    Attributes
    ----------
    unknown_names : names in the last message that the robot does not have.
    new_modes : how often the assembly mode was chosen anew, since the motion from the last state does not lead on.
    """

    def __init__(self, dynamics: Dynamics, namespace: str) -> None:
        robot = dynamics.robot
        self.dynamics = dynamics
        self.unknown_names: list[str] = []
        self.new_modes = 0
        self._namespace = namespace
        self._independent = [robot.joint_numbers[name] for name in dynamics.joint_names]
        self._dependent = [robot.joint_numbers[name] for name in dynamics.dependent_joint_names]
        self._q = np.zeros(len(self._independent))
        self._qd = np.zeros(len(self._independent))
        self._passive = np.full(len(self._dependent), np.nan)
        self._reader = JointStateReader(dynamics, dynamics.joint_names, namespace, self._q, self._qd, self._passive)
        self._mapping: JointMapping | None = None
        self._previous = dynamics.initial_joint_positions
        self._searched_at = -np.inf

    def complete(self, message: JointState, uses_passive_positions: bool) -> CompleteState | None:
        """Return the state of all joints; None for a message without joints that are needed.

        uses_passive_positions: whether positions of passive joints in messages choose the assembly mode. Raises
        InvalidInputError or SingularModelError.
        """
        mapping = self._reader.find_mapping(message)
        if mapping is not self._mapping:
            self._mapping = mapping
            locked = {joint.name for joint in self.dynamics.robot.locked_joints}
            self.unknown_names = [name for name in message.name if name not in locked and not self._is_known(name)]
        if not self._reader.read(message, velocities_required=False):
            return None
        self._require_finite_positions()
        passive = self._passive.copy()
        self._passive[:] = np.nan  # a position chooses the mode once
        positions = self._close(passive if uses_passive_positions else self._passive)
        self._previous = positions
        return CompleteState(
            positions, self._velocities(positions) if len(message.velocity) else None, self._efforts(message, mapping)
        )

    def _is_known(self, name: str) -> bool:
        try:
            resolve_name("joint", name, self.dynamics.robot.joint_numbers, self._namespace)
        except InvalidInputError:
            return False
        return True

    def _require_finite_positions(self) -> None:
        is_finite = np.isfinite(self._q)
        if not is_finite.all():
            column = int(np.argmin(is_finite))
            raise InvalidInputError(
                f"joint_states has position {self._q[column]} of {self.dynamics.joint_names[column]!r}: a finite "
                "number is needed"
            )

    def _close(self, passive: Array) -> Array:
        """Return positions (all joints,) at those of the independent joints.

        passive: positions (dependent,) that choose the assembly mode, nan where unknown.
        """
        dynamics = self.dynamics
        if not dynamics.robot.loops:
            return dynamics.expand_positions(self._q)
        seed = self._previous.copy()
        seed[self._independent] = self._q
        is_known = np.isfinite(passive)
        if is_known.any():
            seed[self._dependent] = np.where(is_known, passive, seed[self._dependent])
            return dynamics.expand_positions(seed)
        try:
            return dynamics.expand_positions(self._q, previous=self._previous)
        except SingularModelError:
            positions = self._close_anew(seed)
        self.new_modes += 1
        return positions

    def _close_anew(self, seed: Array) -> Array:
        """Return positions (all joints,) near a seed, else in the assembly mode of the description."""
        try:
            return self.dynamics.expand_positions(seed)
        except SingularModelError:
            if time.monotonic() - self._searched_at < SEARCH_INTERVAL:
                raise
        try:
            return self.dynamics.expand_positions(self._q)
        finally:
            self._searched_at = time.monotonic()

    def _velocities(self, positions: Array) -> Array | None:
        """Return velocities (all joints,), None if they are not finite: drivers without velocities publish nan.

        None also at singular positions, which the motion passes, where the loops determine no velocities.
        """
        if not np.isfinite(self._qd).all():
            return None
        try:
            velocities = self.dynamics.expand_velocities(self._qd, positions)
        except SingularModelError:
            return None
        return velocities if np.isfinite(velocities).all() else None

    def _efforts(self, message: JointState, mapping: JointMapping) -> Array:
        efforts = np.full(len(self._q), np.nan)
        if len(message.effort) == len(message.name):
            efforts[mapping.joint_indices] = np.frombuffer(message.effort)[mapping.message_indices]
        return efforts
