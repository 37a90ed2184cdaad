"""The platform of a parallel robot as data: a link that legs close on, and the joints that say where it is.

Nothing holds the platform but its legs. In the tree it hangs on its base by six joints without motor or inertia, which
are its coordinates: three that slide along x, y and z of the base, and three that turn, about z, then y, then x. Its
pose in the base is Trans(x, y, z) Rot(z, yaw) Rot(y, pitch) Rot(x, roll), and every leg is a branch of its own, which a
loop closes on it: the decomposition of Khalil's section 5, second solution. The base is frame 0, or a frame of any
link: that of another platform, where parallel modules stand on each other in series.
"""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.placement import invert_placement, placement

COORDINATES = ("x", "y", "z", "yaw", "pitch", "roll")
"""Of a platform, in the order of their joints; [m] and [rad]."""
CYCLIC_ROTATION = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
"""Turns axes so that z comes to lie along x: what was x, y, z is then z, x, y."""
COORDINATE_ROTATIONS = (
    CYCLIC_ROTATION,
    CYCLIC_ROTATION,
    CYCLIC_ROTATION,
    np.eye(3),
    CYCLIC_ROTATION.T,
    CYCLIC_ROTATION.T,
)
"""How the frame of each coordinate's joint stands in the one before: z along x, y, z, then z, y, x."""
BASE_FRAME = (0, np.eye(4))
"""Frame 0: number of the link, and placement in its frame."""
ALIGNMENT_TOLERANCE = 1e-9  # [m, rad] to which axes of coordinates are where they should be
PLATFORM_FRAME = placement(CYCLIC_ROTATION.T)
"""How the frame in which a platform is described stands in the frame of its link, whose z is along its x."""


@dataclass(frozen=True)
class Platform:
    """link: number of the platform's link; joints: numbers of the six joints of COORDINATES, in this order; free: the
    coordinates that its legs let it move by, as many as the mobility, such as ("x", "y", "z") of a Delta; base: the
    name of the frame on which it stands and in which its pose is told, None: frame 0; leads: whether motors are thought
    to be at its free coordinates, which the legs then follow."""

    link: int
    joints: tuple
    free: tuple = COORDINATES
    base: str | None = None
    is_virtually_actuated: bool = False

    def find_base_frame(self, robot):
        """(number of the link, placement (4, 4) in its frame) of the frame of a Robot on which the platform stands."""
        if self.base is None:
            return BASE_FRAME
        frame = robot.frame(self.base)
        return frame.link, frame.placement


def make_coordinate_joints(name, first, start=(0, 0, 0, 0, 0, 0), base=BASE_FRAME):
    """The six Joints of a platform: `name_x`, ... `name_roll`, which move links `first` to first + 5, the last of them
    the platform. start: (6,) initial positions [m, rad]; base: (number of the link, placement (4, 4) in its frame) of
    the frame on which the platform stands."""
    return [
        Joint(
            f"{name}_{coordinate}",
            antecedent=first + place - 1 if place else base[0],
            prismatic=place < 3,
            placement=placement(turn) if place else base[1] @ placement(turn),
            actuated=False,
            initial_position=position,
        )
        for place, (coordinate, turn, position) in enumerate(zip(COORDINATES, COORDINATE_ROTATIONS, start, strict=True))
    ]


def check_platform(platform, robot):
    """Refuse a Platform that a Robot has not."""
    if not 0 < platform.link < len(robot.links):
        raise DescriptionError(f"the platform is link {platform.link}, of 1 to {len(robot.links) - 1}")
    if platform.base is not None and platform.base not in robot.frames_by_name:
        raise DescriptionError(
            f"the base of a platform: {describe_unknown_name('link', platform.base, robot.frames_by_name)}"
        )
    (base, placed), way = platform.find_base_frame(robot), tuple(robot.path_to_base(platform.link)[::-1])
    way = way[-len(COORDINATES) :]
    if way != tuple(platform.joints) or len(way) < len(COORDINATES) or robot.joints[way[0]].antecedent != base:
        names = ", ".join(repr(robot.joints[number].name) for number in way)
        raise DescriptionError(
            "the platform must hang on the base by the six joints of its coordinates, in their order, not by "
            f"{names} on link {robot.links[robot.joints[way[0]].antecedent].name!r}"
        )
    if not platform.is_virtually_actuated and any(robot.joints[number].role != "passive" for number in way):
        raise DescriptionError("the joints that are the coordinates of the platform have neither motors nor springs")
    if not platform.free or not set(platform.free) <= set(COORDINATES):
        raise DescriptionError(f"free coordinates of a platform are some of {', '.join(COORDINATES)}")
    _check_axes(robot, way, placed, robot.frame(robot.links[platform.link].name))


def _check_axes(robot, way, base, frame):
    """Refuse joints that do not slide along x, y, z of the base (4, 4) and then turn about z, y, x of the platform's
    frame, which lies on that of the base where all are zero."""
    axes, placed = [], invert_placement(base)
    for number in way:
        placed = placed @ robot.joints[number].placement
        axes.append(np.append(placed[:3, 2], 0 if robot.joints[number].prismatic else np.cross(*placed[:3, 2:].T)))
    placed = placed @ frame.placement
    if placed.dtype == object:  # symbols have no value yet
        return
    kinds = [robot.joints[number].prismatic for number in way] == [True] * 3 + [False] * 3
    meant = [np.append(np.eye(3)[k], 0 if place < 3 else np.zeros(3)) for place, k in enumerate((0, 1, 2, 2, 1, 0))]
    aligned = kinds and all(np.allclose(a, b, atol=ALIGNMENT_TOLERANCE) for a, b in zip(axes, meant, strict=True))
    if not aligned or not np.allclose(placed, np.eye(4), atol=ALIGNMENT_TOLERANCE):
        raise DescriptionError(
            "the coordinates of the platform must slide along x, y and z of the base and then turn about z, y and x of "
            f"frame {frame.name!r}, which must lie on that of the base where they are zero"
        )
