"""Kinematics of many frames at one state."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.array_checks import broadcast_result
from robot_dynamics.constraints.attitude_charts import virtual_links
from robot_dynamics.constraints.frame_motion import frame_motion, rotate_to
from robot_dynamics.joint_space.frame_kinematics import concatenated_rates, products

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.inputs import Base
    from robot_dynamics.joint_space.dynamics_terms import DynamicsTerms, ModelState
    from robot_dynamics.joint_space.frame_kinematics import Axes


class FrameState(NamedTuple):
    """Kinematics of a frame at one state: results of the methods of FrameKinematics of these names."""

    pose: Array
    jacobian: Array
    twist: Array
    bias_acceleration: Array


class FrameStates:
    """Kinematics of frames at one state. The loops are closed once for all frames, not once for each.

    Parameters
    ----------
    dynamics : DynamicsTerms
    q, qd, axes, base
        As of FrameKinematics.twist, of one sample.
    """

    def __init__(self, dynamics: DynamicsTerms, q: Array, qd: Array, axes: Axes, base: Base | None) -> None:
        self._dynamics = dynamics
        self._q = q
        self._qd = qd
        self._axes = axes
        self._base = base
        self._rates = concatenated_rates(dynamics, qd, base)
        self._states: dict[bool, ModelState] = {}  # with charts of attitudes, and without

    def of(self, name: str) -> FrameState:
        """Kinematics of the frame with a name. Raises InvalidInputError and SingularModelError."""
        frame = self._dynamics.robot.frame(name)
        state = self._state(frame.link not in virtual_links(self._dynamics.robot))
        with np.errstate(all="ignore"):
            motion = frame_motion(state.constrained_state, frame, state.qd, state.drift, state.base.twist[..., 3:])
            pose = state.base.pose @ motion.placement
            R = motion.placement[:3, :3] if self._axes == "frame" else state.base.pose[:3, :3].T
            columns = np.column_stack([motion.jacobian, motion.bias_acceleration])
            screws = broadcast_result(rotate_to(R, columns), (), axes=2)
        J = screws[:, :-1]
        return FrameState(broadcast_result(pose, (), axes=2), J, products(J, self._rates), screws[:, -1])

    def _state(self, use_charts: bool) -> ModelState:
        """The state of the robot, computed when it is first needed."""
        if use_charts not in self._states:
            self._states[use_charts] = self._dynamics._state(self._q, self._qd, self._base, use_charts=use_charts)
        return self._states[use_charts]
