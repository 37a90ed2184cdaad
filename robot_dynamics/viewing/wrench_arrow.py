"""The arrow of an external force, whose tip can be dragged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.viewing.viewer_quaternions import quaternions_wxyz

if TYPE_CHECKING:
    from viser import SceneApi

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Frame

ROOT = "/wrench"
FORCE_COLOUR = (204, 48, 48)
SHAFT_RADIUS = 0.008  # relative to the extent of the robot, like the lengths below
HEAD_RADIUS = 0.02
HEAD_LENGTH = 0.05
HANDLE_SIZE = 0.25
SHORTEST = 1e-3
"""Length below which no arrow is drawn."""


class WrenchArrow:
    """An arrow from the origin of a frame along the force that acts there, and a handle at its tip.

    Parameters
    ----------
    scene : viser.SceneApi
    extent : float
        Extent of the robot [m].

    Attributes
    ----------
    root : viser.FrameHandle
        Node of the frame.
    arrow : viser.ArrowsHandle
    handle : viser.TransformControlsHandle
        Its position is the tip of the arrow [m], in the frame.
    """

    def __init__(self, scene: SceneApi, extent: float) -> None:
        self._frame: Frame | None = None
        self._extent = extent
        self._poses: Array | None = None
        self.root = scene.add_frame(ROOT, show_axes=False)
        self.arrow = scene.add_arrows(
            f"{ROOT}/force",
            np.zeros((1, 2, 3), dtype=np.float32),
            FORCE_COLOUR,
            shaft_radius=SHAFT_RADIUS * extent,
            head_radius=HEAD_RADIUS * extent,
            head_length=HEAD_LENGTH * extent,
            visible=False,
        )
        self.handle: Any = scene.add_transform_controls(
            f"{ROOT}/handle", scale=HANDLE_SIZE * extent, disable_rotations=True, depth_test=False, visible=False
        )

    def show_handle(self, is_visible: bool) -> None:
        """Show or hide the handle."""
        self.handle.visible = is_visible

    def draw(self, frame: Frame, tip: Array) -> None:
        """Draw the arrow from the origin of a frame to a tip (3,) [m], in the frame."""
        self._frame = frame
        self.arrow.points = np.array([[np.zeros(3), tip]], dtype=np.float32)
        self.arrow.visible = bool(np.linalg.norm(tip) > SHORTEST * self._extent)
        if not np.allclose(self.handle.position, tip, atol=SHORTEST * self._extent, rtol=0):
            self.handle.position = tip  # not while it is dragged: it is there already
        if self._poses is not None:
            self.move(self._poses)

    def move(self, link_poses: Array) -> None:
        """Move it with the robot; link_poses: (links, 4, 4)."""
        self._poses = link_poses
        if self._frame is None:
            return
        pose = link_poses[self._frame.link] @ self._frame.placement
        self.root.wxyz = quaternions_wxyz(pose[:3, :3])
        self.root.position = pose[:3, 3]
