"""Kinematics of many frames at one state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.array_checks import broadcast_result
from robot_dynamics.constraints.attitude_charts import virtual_links
from robot_dynamics.constraints.frame_motion import frame_motion, rotate_to
from robot_dynamics.joint_space.frame_kinematics import concatenated_rates, products

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.inputs import Base
    from robot_dynamics.joint_space.dynamics_terms import DynamicsTerms
    from robot_dynamics.joint_space.frame_kinematics import Axes


class FrameState(NamedTuple):
    """Kinematics of a frame at one state: results of the methods of FrameKinematics of these names."""

    pose: Array
    jacobian: Array
    twist: Array
    bias_acceleration: Array


def frame_states(
    dynamics: DynamicsTerms, names: Sequence[str], q: Array, qd: Array, axes: Axes, base: Base | None
) -> list[FrameState]:
    """Kinematics of several frames at one state.

    The loops are closed once for all frames, not once for each.

    Parameters
    ----------
    dynamics : DynamicsTerms
    names : sequence of str
        Names of frames.
    q, qd, axes, base
        As of FrameKinematics.twist, of one sample.
    """
    frames = [dynamics.robot.frame(name) for name in names]
    virtual = virtual_links(dynamics.robot)
    uses_charts = {frame.link not in virtual for frame in frames}
    states = {use_charts: dynamics._state(q, qd, base, use_charts=use_charts) for use_charts in uses_charts}
    rates = concatenated_rates(dynamics, qd, base)
    results = []
    for frame in frames:
        state = states[frame.link not in virtual]
        with np.errstate(all="ignore"):
            motion = frame_motion(state.constrained_state, frame, state.qd, state.drift, state.base.twist[..., 3:])
            pose = state.base.pose @ motion.placement
            R = motion.placement[:3, :3] if axes == "frame" else state.base.pose[:3, :3].T
            columns = np.column_stack([motion.jacobian, motion.bias_acceleration])
            screws = broadcast_result(rotate_to(R, columns), (), axes=2)
        J = screws[:, :-1]
        results.append(FrameState(broadcast_result(pose, (), axes=2), J, products(J, rates), screws[:, -1]))
    return results
