"""Jacobian and bias acceleration of a named frame, by the independent joints.

    V = J [V0; q̇],   V̇ = J [V̇0; q̈] + bias

V is the twist of the frame at its origin, V̇ its classical acceleration, V0 the twist of a moving base. In loops the
joints between the base and the frame move as the constrained state says.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.constraints.constrained_state import projection_matrix
from robot_dynamics.model.vector_product import skew
from robot_dynamics.newton_euler.joint_chain import chain_end, jacobian_from_columns, joint_chain
from robot_dynamics.newton_euler.screw import apply

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.constraints.constrained_state import ConstrainedState
    from robot_dynamics.model.robot import Frame, Robot
    from robot_dynamics.newton_euler.joint_chain import ChainEnd


class FrameMotion(NamedTuple):
    """Motion of a frame, in the axes of frame 0.

    placement: (..., 4, 4) in frame 0; jacobian: (..., 6, m) and bias_acceleration: (..., 6), as `frame_jacobian` and
    `frame_bias_acceleration` return them.
    """

    placement: ScalarArray
    jacobian: ScalarArray
    bias_acceleration: ScalarArray


def frame_placement(robot: Robot, q: ScalarArray, frame: Frame) -> ScalarArray:
    """Pose (..., 4, 4) of a frame in frame 0 at positions q (..., all joints)."""
    return _placement(_end(robot, q, frame))


def frame_jacobian(state: ConstrainedState, frame: Frame, in_frame_axes: bool) -> ScalarArray:
    """Jacobian of the twist of a frame at its origin.

    Parameters
    ----------
    state : ConstrainedState
    frame : Frame
        Of a link that `state.robot` has.
    in_frame_axes : bool
        Whether the twist is in the axes of the frame; else in those of frame 0.

    Returns
    -------
    ndarray, shape (..., 6, m)
        m = n, or 6 + n with a moving base, whose twist in frame 0 comes first.
    """
    end = _end(state.robot, state.chart_q, frame)
    J = _jacobian(state, end)
    return rotate_to(end.R, J) if in_frame_axes else J


def frame_bias_acceleration(
    state: ConstrainedState,
    frame: Frame,
    rates: ScalarArray,
    drift: ScalarArray,
    omega: ScalarArray,
    in_frame_axes: bool,
) -> ScalarArray:
    """Classical acceleration (..., 6) of a frame where the independent joints, and the base, do not accelerate.

    Parameters
    ----------
    state, frame, in_frame_axes
        As of `frame_jacobian`.
    rates, drift : ndarray, shape (..., all joints)
        Rates of all joints, and their accelerations where those of the independent joints are zero.
    omega : ndarray, shape (..., 3)
        Angular velocity of the base in frame 0 [rad/s].
    """
    end = _end(state.robot, state.chart_q, frame, rates, omega)
    acceleration = _bias_acceleration(state, end, drift)
    return rotate_to(end.R, acceleration[..., None])[..., 0] if in_frame_axes else acceleration


def frame_motion(
    state: ConstrainedState, frame: Frame, rates: ScalarArray, drift: ScalarArray, omega: ScalarArray
) -> FrameMotion:
    """The FrameMotion of a frame at one state; arguments as of `frame_bias_acceleration`."""
    end = _end(state.robot, state.chart_q, frame, rates, omega)
    return FrameMotion(_placement(end), _jacobian(state, end), _bias_acceleration(state, end, drift))


def rotate_to(R: ScalarArray, screws: ScalarArray) -> ScalarArray:
    """Screws (..., 6, k), as columns, in the axes that R (..., 3, 3) has as its columns."""
    transposed = np.swapaxes(R, -1, -2)
    return np.concatenate([transposed @ screws[..., :3, :], transposed @ screws[..., 3:, :]], axis=-2)


def _placement(end: ChainEnd) -> ScalarArray:
    """Pose (..., 4, 4) of the end in the link where the chain starts."""
    columns = [*(end.R[..., k] for k in range(3)), end.P]
    upper = np.stack(np.broadcast_arrays(*columns), axis=-1)
    last_row = np.broadcast_to(np.array([[0, 0, 0, 1]]), (*upper.shape[:-2], 1, 4))
    return np.concatenate([upper, last_row], axis=-2)


def _jacobian(state: ConstrainedState, end: ChainEnd) -> ScalarArray:
    """Jacobian (..., 6, m) in the axes of frame 0."""
    base_rows = 6 if state.robot.moving_base else 0
    J: ScalarArray = _tree_jacobian(state.robot, end) @ projection_matrix(state.G, base_rows)
    return J


def _bias_acceleration(state: ConstrainedState, end: ChainEnd, drift: ScalarArray) -> ScalarArray:
    """Acceleration (..., 6) in the axes of frame 0 with joint accelerations `drift` (..., all joints)."""
    acceleration: ScalarArray = end.drift + apply(jacobian_from_columns(end.columns, len(state.robot.joints)), drift)
    return acceleration


def _end(
    robot: Robot, q: ScalarArray, frame: Frame, rates: ScalarArray | None = None, omega: ScalarArray | None = None
) -> ChainEnd:
    """The frame as the end of the chain of joints that begins at the base."""
    numbers = robot.path_to_base(frame.link)[::-1]
    chain = joint_chain(robot, numbers, q, rates, omega)
    return chain_end(robot, chain, frame.placement, has_velocities=rates is not None)


def _tree_jacobian(robot: Robot, end: ChainEnd) -> ScalarArray:
    """Jacobian (..., 6, joints) of the open tree in the axes of frame 0; (..., 6, 6 + joints) with a moving base."""
    J = jacobian_from_columns(end.columns, len(robot.joints))
    if not robot.moving_base:
        return J
    identity = np.eye(3, dtype=int)
    coupling = -skew(end.P)  # ω0 × P
    batch = np.broadcast_shapes(J.shape[:-2], coupling.shape[:-2])
    base = np.zeros((*batch, 6, 6), dtype=coupling.dtype)
    base[..., :3, :3] = base[..., 3:, 3:] = identity
    base[..., :3, 3:] = coupling
    return np.concatenate([base, np.broadcast_to(J, (*batch, *J.shape[-2:]))], axis=-1)
