"""Placement of the frame of a joint at its position."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.joint import Joint


def joint_placement(joint: Joint, position: ScalarArray) -> tuple[ScalarArray, ScalarArray]:
    """iRj (..., 3, 3) and iPj (..., 3) of a joint's frame in its antecedent's, for joint positions (..., 1).

    iTj(q) = iTj(0) Rot(z, q) for a revolute joint, iTj(0) Trans(z, q) for a prismatic one.
    """
    R = joint.rotation
    P = joint.placement[:3, 3]
    if joint.prismatic:
        return R, P + position * R[..., 2]
    cosine = np.cos(position)
    sine = np.sin(position)
    x = cosine * R[..., 0] + sine * R[..., 1]
    y = cosine * R[..., 1] - sine * R[..., 0]
    return np.stack(np.broadcast_arrays(x, y, R[..., 2]), axis=-1), P
