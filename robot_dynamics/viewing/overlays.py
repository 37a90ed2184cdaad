"""What can be drawn over a robot: frames, MDH parameters, names, and efforts. `mass_overlays` has more."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from robot_dynamics.model.mdh import mdh_from_placement, placement_from_mdh
from robot_dynamics.viewing.scene import node_name
from robot_dynamics.viewing.viewer_quaternions import quaternions_wxyz

if TYPE_CHECKING:
    from viser import SceneApi

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.viewing.configuration import Configuration
    from robot_dynamics.viewing.scene import RobotScene

COMMON_NORMAL_COLOUR = (214, 69, 65)
OFFSET_COLOUR = (34, 112, 181)
ARC_COLOUR = (200, 40, 120)
ARC_POINTS = 25
FULL_ARC = 1.5 * np.pi  # [rad] of an effort at its limit
ARC_RADIUS = 6.0  # relative to the radius of the bones
ANCHORS: tuple[Literal["bottom-left", "top-left", "bottom-right", "top-right"], ...] = (
    "bottom-left",
    "top-left",
    "bottom-right",
    "top-right",
)
"""Where the points of labels are on them, in turn, so that the labels of joints at one place do not hide each other."""


class Overlay(Protocol):
    """Something drawn over a robot, which a checkbox shows and hides."""

    title: str
    is_inside: bool  # of the links, so that opaque ones hide it

    def show(self, is_visible: bool) -> None:
        """Show or hide it."""

    def update(self, configuration: Configuration, link_poses: Array) -> None:
        """Move it with the robot; link_poses: (links, 4, 4)."""


class FrameOverlay:
    """The frames of the links: x red, y green, z blue."""

    title = "Frames of links (x red, y green, z blue)"
    is_inside = True

    def __init__(self, scene: SceneApi, drawn: RobotScene, radius: float) -> None:
        robot = drawn.robot
        coordinate_joints = {index for platform in robot.platforms for index in platform.joints[:-1]}
        self._links = [number for number in range(len(robot.links)) if number - 1 not in coordinate_joints]
        count = len(self._links)
        self._axes = scene.add_batched_axes(
            f"{drawn.root}_frames",
            np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
            np.zeros((count, 3)),
            axes_length=7 * radius,
            axes_radius=0.35 * radius,
            visible=False,
        )

    def show(self, is_visible: bool) -> None:
        """Show or hide it."""
        self._axes.visible = is_visible

    def update(self, configuration: Configuration, link_poses: Array) -> None:
        """Move the axes."""
        poses = link_poses[self._links]
        self._axes.batched_wxyzs = quaternions_wxyz(poses[:, :3, :3]).astype(np.float32)
        self._axes.batched_positions = poses[:, :3, 3].astype(np.float32)


class MDHOverlay:
    """The six parameters between two frames: offsets b and r along z, the common normal d along x, and their values."""

    title = "MDH parameters (r, b blue; d red)"
    is_inside = True

    def __init__(self, scene: SceneApi, drawn: RobotScene, radius: float) -> None:
        robot = drawn.robot
        coordinate_joints = {index for platform in robot.platforms for index in platform.joints}
        self._corners: list[tuple[int, Array]] = []  # link, and corners of the line in its frame
        self._labels = []
        self._indices = [index for index in range(len(robot.joints)) if index not in coordinate_joints]
        for index in self._indices:
            joint = robot.joints[index]
            corners = mdh_corners(joint.placement)
            self._corners.append((joint.antecedent, corners))
            label = scene.add_label(
                f"{drawn.link_node(joint.antecedent)}/mdh_{index}_{node_name(joint.name)}",
                mdh_text(robot, index),
                position=np.vstack([corners, joint.placement[:3, 3]]).mean(axis=0),
                anchor=ANCHORS[index % len(ANCHORS)],
                visible=False,
            )
            self._labels.append(label)
        count = sum(len(corners) for _, corners in self._corners)
        colours = [
            OFFSET_COLOUR if number % 2 == 0 else COMMON_NORMAL_COLOUR
            for _, corners in self._corners
            for number in range(len(corners))
        ]
        self._lines = scene.add_line_segments(
            f"{drawn.root}_mdh",
            np.zeros((count, 2, 3), dtype=np.float32),
            np.repeat(np.array(colours, dtype=np.uint8)[:, None, :], 2, axis=1),
            thickness=0.7 * radius,
            visible=False,
        )

    def show(self, is_visible: bool) -> None:
        """Show or hide it."""
        self._lines.visible = is_visible
        for label in self._labels:
            label.visible = is_visible

    def update(self, configuration: Configuration, link_poses: Array) -> None:
        """Move the lines. The last one of each joint ends in the origin of its frame."""
        segments = []
        for index, (link, corners) in zip(self._indices, self._corners, strict=True):
            pose = link_poses[link]
            points = corners @ pose[:3, :3].T + pose[:3, 3]
            ends = np.vstack([points, link_poses[index + 1, :3, 3]])
            segments.append(np.stack([ends[:-1], ends[1:]], axis=1))
        self._lines.points = np.concatenate(segments).astype(np.float32)


def mdh_corners(matrix: Array) -> Array:
    """Return the corners (N, 3) of the line from frame i along z_i (b), x (d), ... to before the last r along z_j.

    There are two parameter rows where axes are nearly parallel.
    """
    corners = [np.zeros(3)]
    start = np.eye(4)
    for row in mdh_from_placement(matrix):
        along_z = row._replace(alpha=0.0, d=0.0, theta=0.0, r=0.0)
        along_x = row._replace(theta=0.0, r=0.0)
        corners += [(start @ placement_from_mdh(part))[:3, 3] for part in (along_z, along_x)]
        start = start @ placement_from_mdh(row)
    return np.array(corners)


def mdh_text(robot: Robot, index: int) -> str:
    """Return the parameters of a joint that are not zero, as a label: θ or r with the joint's variable."""
    joint = robot.joints[index]
    parts = []
    for row in mdh_from_placement(joint.placement):
        lengths = {"γ": row.gamma, "b": row.b, "α": row.alpha, "d": row.d, "θ": row.theta, "r": row.r}
        parts += [f"{symbol} {value:.4g}" for symbol, value in lengths.items() if value]
    variable = "r" if joint.prismatic else "θ"
    return f"{joint.name}: {', '.join(parts) or 'all zero'}; {variable} moves"


class NameOverlay:
    """The names of joints and of links."""

    title = "Names"
    is_inside = False

    def __init__(self, scene: SceneApi, drawn: RobotScene) -> None:
        self._labels = [
            scene.add_label(
                f"{drawn.link_node(body.link)}/name_{number}_{node_name(body.name)}",
                body.name,
                position=body.mesh.bounds.mean(axis=0),
                anchor=ANCHORS[number % len(ANCHORS)],
                visible=False,
            )
            for number, body in enumerate(drawn.bodies)
        ]

    def show(self, is_visible: bool) -> None:
        """Show or hide it."""
        for label in self._labels:
            label.visible = is_visible

    def update(self, configuration: Configuration, link_poses: Array) -> None:
        """Do nothing: the labels move with their links."""


class EffortOverlay:
    """Efforts at the joints that hold the robot: arcs about axes of revolute joints, lines along prismatic ones.

    At its limit an effort is three quarters of a circle; without limits the largest one is.
    """

    title = "Efforts that hold the robot"
    is_inside = False

    def __init__(self, scene: SceneApi, drawn: RobotScene, radius: float, independent: list[int]) -> None:
        self._robot = drawn.robot
        self._joints = [index for index in independent if self._robot.joints[index].actuated]
        self._columns = [independent.index(index) for index in self._joints]
        self._radius = ARC_RADIUS * radius
        count = len(self._joints) * (ARC_POINTS - 1)
        self._lines = scene.add_line_segments(
            f"{drawn.root}_efforts",
            np.zeros((count, 2, 3), dtype=np.float32),
            ARC_COLOUR,
            thickness=0.9 * radius,
            visible=False,
        )

    def show(self, is_visible: bool) -> None:
        """Show or hide it."""
        self._lines.visible = is_visible

    def update(self, configuration: Configuration, link_poses: Array) -> None:
        """Do nothing: `draw` has the efforts."""

    def draw(self, efforts: Array, link_poses: Array) -> None:
        """Draw efforts (n,) of the independent joints at link poses (links, 4, 4)."""
        efforts = np.nan_to_num(efforts[self._columns])
        limits = np.array([self._robot.joints[index].limits.effort for index in self._joints])
        largest = np.abs(efforts).max(initial=0.0) or 1.0
        shares = np.clip(efforts / np.where(np.isfinite(limits), limits, largest), -1.0, 1.0)
        segments = []
        for index, share in zip(self._joints, shares, strict=True):
            line = effort_line(self._robot.joints[index].prismatic, share) * self._radius
            pose = link_poses[index + 1]
            points = line @ pose[:3, :3].T + pose[:3, 3]
            segments.append(np.stack([points[:-1], points[1:]], axis=1))
        if segments:
            self._lines.points = np.concatenate(segments).astype(np.float32)


def effort_line(is_prismatic: bool, share: float) -> Array:
    """Return the line (ARC_POINTS, 3) with an arrowhead that shows an effort, in the frame of its joint.

    share: of the limit, -1 to 1. Lengths are relative to the radius of the arc.
    """
    parameter = np.linspace(0.0, 1.0, ARC_POINTS - 3)
    if is_prismatic:
        points = np.outer(parameter * share, [0.0, 0.0, 1.5])
        tangent, normal = np.array([0.0, 0.0, np.sign(share)]), np.array([1.0, 0.0, 0.0])
    else:
        angles = parameter * share * FULL_ARC
        points = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)
        normal = points[-1]
        tangent = np.sign(share) * np.array([-np.sin(angles[-1]), np.cos(angles[-1]), 0.0])
    size = min(0.35, 2 * abs(share))
    head = [points[-1] + size * (side * 0.5 * normal - tangent) for side in (1.0, -1.0)]
    return np.vstack([points, head[0], points[-1], head[1]])
