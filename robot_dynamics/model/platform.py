"""The platform of a parallel robot as data: a link on which legs are closed, and the joints that are its coordinates.

Only the legs hold the platform. In the tree, six joints without motor or inertia connect it to its base and are its
coordinates: three slide along x, y and z of the base, and three turn about z, then y, then x. Its pose in the base is
Trans(x, y, z) Rot(z, yaw) Rot(y, pitch) Rot(x, roll). Every leg is a branch of its own, which a loop closes on the
platform: the decomposition of Khalil's section 5, second solution. The base is frame 0 or a frame of any link: that of
another platform where parallel modules are in series.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.placement import invert_placement, placement

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray
    from robot_dynamics.model.robot import Frame, Robot

COORDINATES = ("x", "y", "z", "yaw", "pitch", "roll")
"""Coordinates of a platform [m] and [rad], in the order of their joints."""
CYCLIC_ROTATION: Array = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
"""Rotation that permutes axes: its z is the old x, its x the old y, its y the old z."""
COORDINATE_ROTATIONS: tuple[Array, ...] = (
    CYCLIC_ROTATION,
    CYCLIC_ROTATION,
    CYCLIC_ROTATION,
    np.eye(3),
    CYCLIC_ROTATION.T,
    CYCLIC_ROTATION.T,
)
"""Rotation of each coordinate's joint frame in the one before: z is along x, y, z, then z, y, x."""
BASE_FRAME: tuple[int, ScalarArray] = (0, np.eye(4))
"""Frame 0: number of the link, and placement in its frame."""
ALIGNMENT_TOLERANCE = 1e-9  # [m, rad] on the directions of the coordinates
PLATFORM_FRAME = placement(CYCLIC_ROTATION.T)
"""Placement of the frame in which a platform is described in the frame of its link, whose z is along its x."""


@dataclass(frozen=True)
class Platform:
    """The platform of a parallel robot.

    Parameters
    ----------
    link : int
        Number of the platform's link.
    joints : tuple of int
        Numbers of the six joints of COORDINATES, in this order.
    free : tuple of str
        The coordinates in which the legs let the platform move, as many as the mobility: ("x", "y", "z") of a Delta.
    base : str, optional
        Name of the frame on which the platform stands and in which its pose is given. Default: frame 0.
    is_virtually_actuated : bool
        Whether the model has motors at the free coordinates, and the legs follow them.

    Notes
    -----
    Source: Khalil, section 5, second solution.
    """

    link: int
    joints: tuple[int, ...]
    free: tuple[str, ...] = COORDINATES
    base: str | None = None
    is_virtually_actuated: bool = False

    def find_base_frame(self, robot: Robot) -> tuple[int, ScalarArray]:
        """Return the frame on which the platform stands: number of the link, and placement (4, 4) in its frame."""
        if self.base is None:
            return BASE_FRAME
        frame = robot.frame(self.base)
        return frame.link, frame.placement


def make_coordinate_joints(
    name: str,
    first: int,
    start: Sequence[float] = (0, 0, 0, 0, 0, 0),
    base: tuple[int, ScalarArray] = BASE_FRAME,
) -> list[Joint]:
    """Return the six joints of a platform, `name_x` to `name_roll`.

    Parameters
    ----------
    name : str
        Name of the platform.
    first : int
        Number of the first link that they move. They move links `first` to first + 5; the last is the platform.
    start : (6,) sequence of float
        Initial positions [m, rad].
    base : tuple of int and (4, 4) array
        Frame on which the platform stands: number of the link, and placement in its frame.
    """
    joints = []
    coordinates = zip(COORDINATES, COORDINATE_ROTATIONS, start, strict=True)
    for index, (coordinate, rotation, position) in enumerate(coordinates):
        pose = placement(rotation)
        joint = Joint(
            f"{name}_{coordinate}",
            antecedent=first + index - 1 if index else base[0],
            prismatic=index < 3,
            placement=pose if index else base[1] @ pose,
            actuated=False,
            initial_position=position,
        )
        joints.append(joint)
    return joints


def check_platform(platform: Platform, robot: Robot) -> None:
    """Raise DescriptionError where a platform does not fit its robot."""
    if not 0 < platform.link < len(robot.links):
        raise DescriptionError(f"the platform is link {platform.link}, of 1 to {len(robot.links) - 1}")
    if platform.base is not None and platform.base not in robot.frames_by_name:
        raise DescriptionError(
            f"the base of a platform: {describe_unknown_name('link', platform.base, robot.frames_by_name)}"
        )
    base_link, base_frame = platform.find_base_frame(robot)
    path = tuple(robot.path_to_base(platform.link)[::-1])[-len(COORDINATES) :]
    antecedent = robot.joints[path[0]].antecedent
    if path != tuple(platform.joints) or len(path) < len(COORDINATES) or antecedent != base_link:
        names = ", ".join(repr(robot.joints[number].name) for number in path)
        raise DescriptionError(
            "the six joints of its coordinates, in their order, must connect the platform to its base, not "
            f"{names} on link {robot.links[antecedent].name!r}"
        )
    if not platform.is_virtually_actuated and any(robot.joints[number].role != "passive" for number in path):
        raise DescriptionError("the joints that are the coordinates of the platform have neither motors nor springs")
    if not platform.free or not set(platform.free) <= set(COORDINATES):
        raise DescriptionError(f"free coordinates of a platform are some of {', '.join(COORDINATES)}")
    _check_axes(robot, path, base_frame, robot.frame(robot.links[platform.link].name))


def _check_axes(robot: Robot, path: Sequence[int], base: ScalarArray, frame: Frame) -> None:
    """Raise DescriptionError unless the joints of a path slide along x, y, z and turn about z, y, x.

    The first three slide along the axes of the base (4, 4), the others turn about the axes of the platform's frame,
    which coincides with that of the base at zero positions.
    """
    axes = []
    pose = invert_placement(base)
    for number in path:
        joint = robot.joints[number]
        pose = pose @ joint.placement
        moment = 0 if joint.prismatic else np.cross(*pose[:3, 2:].T)
        axes.append(np.append(pose[:3, 2], moment))
    pose = pose @ frame.placement
    if pose.dtype == object:  # symbols have no value yet
        return
    expected_axes = [np.append(np.eye(3)[k], 0) for k in (0, 1, 2)]
    expected_axes += [np.append(np.eye(3)[k], np.zeros(3)) for k in (2, 1, 0)]
    kinds_fit = [robot.joints[number].prismatic for number in path] == [True] * 3 + [False] * 3
    axes_fit = kinds_fit and all(
        np.allclose(axis, expected, atol=ALIGNMENT_TOLERANCE)
        for axis, expected in zip(axes, expected_axes, strict=True)
    )
    if not axes_fit or not np.allclose(pose, np.eye(4), atol=ALIGNMENT_TOLERANCE):
        raise DescriptionError(
            "the coordinates of the platform must slide along x, y and z of the base and then turn about z, y and x of "
            f"frame {frame.name!r}, which must coincide with that of the base where they are zero"
        )
