"""Geometry of one platform at one sample, as procedures: positions of all joints from its pose, and its pose.

They follow `PlatformClosure.close_legs` and `PlatformKinematics.pose`. Samples that need another way have a status that
is not zero, and the caller takes these functions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.constraints.closure_procedures import SampleProcedure
from robot_dynamics.constraints.sample_closure import SampleClosure
from robot_dynamics.inputs import ROTATION_TOLERANCE
from robot_dynamics.parallel.platform_motion import POSE_TOLERANCE, coordinates_from_pose, pose_from_coordinates
from robot_dynamics.procedures import is_finite, largest, magnitude, procedure, select

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.constraints.closure_procedures import StepFunction
    from robot_dynamics.constraints.topology import ConstraintTopology

POSE_ENTRIES = np.arange(16).reshape(4, 4)
"""Where the entries of a pose are in a vector (16,)."""


class SampleGeometry:
    """Procedures for the inverse geometry of a platform.

    Parameters
    ----------
    topology : ConstraintTopology
        With coordinates of the platform as independent joints.
    coordinate_joints : sequence of int
        Numbers of the joints of x, y, z, yaw, pitch and roll.
    closure : SampleClosure
        Of this topology.
    """

    def __init__(self, topology: ConstraintTopology, coordinate_joints: Sequence[int], closure: SampleClosure) -> None:
        self._topology = topology
        self._closure = closure
        self._joints = list(coordinate_joints)
        self._reference = topology.joint_positions(topology.reference_positions)
        # entries of the coordinates of which the independent joints take their positions, and their columns in (n,)
        self._free = [row for row, number in enumerate(self._joints) if number in topology.independent]
        self._free_joints = [self._joints[row] for row in self._free]
        self._columns = [topology.independent.index(number) for number in self._free_joints]

    @procedure
    def joint_positions(self, pose: Any) -> Any:
        """Positions (all joints,) for a pose (16,), in the assembly mode of the reference positions; status (1,)."""
        pose = pose[POSE_ENTRIES]
        x = coordinates_from_pose(pose, self._reference[self._joints])
        q = _replace_entries(self._reference[self._topology.independent], self._columns, x[self._free])
        return self._checked(pose, self._closure.close_from_reference(q))

    @procedure
    def joint_positions_near(self, pose: Any, seed: Any) -> Any:
        """Positions (all joints,) for a pose (16,), near a seed (all joints,) without unknown entries; status (1,)."""
        pose = pose[POSE_ENTRIES]
        x = coordinates_from_pose(pose, seed[self._joints])
        q = _replace_entries(seed[: len(self._reference)], self._free_joints, x[self._free])
        return self._checked(pose, self._closure.close_near(q))

    @procedure
    def _checked(self, pose: Any, closed: Any) -> Any:
        q = self._closure.joint_positions(closed.t)
        is_valid = _is_pose(pose) & (closed.status == 0)
        if len(self._free) < len(self._joints):  # more than one pose may have the free coordinates
            is_valid = is_valid & self._has_pose(q, pose)
        return q, np.array([select(is_valid, 0.0, 1.0)])

    def _has_pose(self, q: Any, pose: Any) -> Any:
        """As PlatformClosure._has_poses, for joint positions (all joints,)."""
        difference = pose_from_coordinates(q[self._joints]) - pose
        length = self._topology.robot.characteristic_length
        is_near = largest(magnitude(difference[:3, 3])) <= POSE_TOLERANCE * length
        return is_near & (largest(magnitude(difference[:3, :3])) <= POSE_TOLERANCE)


def _replace_entries(values: Any, columns: Sequence[int], entries: Any) -> Any:
    """A copy of values (n,) with other entries in some columns; for symbols."""
    replaced = list(values)
    for column, entry in zip(columns, entries, strict=True):
        replaced[column] = entry
    return np.array(replaced)


def inverse_geometry(
    topology: ConstraintTopology, coordinate_joints: Sequence[int], has_seed: bool, newton_step: StepFunction
) -> SampleProcedure:
    """The SampleProcedure for joint positions at a pose (16,), and a seed (all joints,). See SampleGeometry."""
    geometry = SampleGeometry(topology, coordinate_joints, SampleClosure(topology, newton_step))
    joints = len(topology.robot.joints)
    if has_seed:
        inputs = {"pose": POSE_ENTRIES.size, "seed": joints}
        return SampleProcedure(geometry.joint_positions_near, inputs, "positions", (joints,))
    return SampleProcedure(geometry.joint_positions, {"pose": POSE_ENTRIES.size}, "positions", (joints,))


def direct_geometry(
    topology: ConstraintTopology, coordinate_joints: Sequence[int], of_all_joints: bool, newton_step: StepFunction
) -> SampleProcedure:
    """The SampleProcedure for the pose (4, 4) of a platform at positions of the motors or of all joints.

    topology: of the robot, with its motors as independent joints.
    """
    closure = SampleClosure(topology, newton_step)
    close: Callable[..., Any] = closure.close_near if of_all_joints else closure.close_from_reference
    size = len(topology.robot.joints) if of_all_joints else len(topology.independent)
    function = partial(_pose, closure, close, list(coordinate_joints))
    return SampleProcedure(function, {"positions": size}, "pose", POSE_ENTRIES.shape)


@procedure
def _pose(closure: SampleClosure, close: Callable[..., Any], coordinate_joints: list[int], q: Any) -> Any:
    """The pose (4, 4) at positions q, and the status (1,)."""
    closed = close(q)
    x: Array = closure.joint_positions(closed.t)[coordinate_joints]
    return pose_from_coordinates(x), np.array([closed.status])


def _is_pose(pose: Any) -> Any:
    """Whether a matrix (4, 4) is a pose, as inputs.require_pose checks it."""
    R = pose[:3, :3]
    error = R @ R.T - np.eye(3)
    determinant = np.cross(R[0], R[1]) @ R[2]
    is_affine = (pose[3, 0] == 0) & (pose[3, 1] == 0) & (pose[3, 2] == 0) & (pose[3, 3] == 1)
    return is_finite(pose) & (largest(magnitude(error)) <= ROTATION_TOLERANCE) & (determinant > 0) & is_affine
