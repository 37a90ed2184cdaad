"""The name of the part of a robot that was clicked."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from robot_dynamics.viewing.markdown import escape_markdown

if TYPE_CHECKING:
    from viser import GuiApi, SceneApi

    from robot_dynamics.model.robot import Robot
    from robot_dynamics.viewing.body import Body
    from robot_dynamics.viewing.robot_view import RobotView

PROMPT = "Click a part of the robot for its name."


class NamePanel:
    """Shows what a clicked part is: its link, its mass, and the joint that moves it.

    Parameters
    ----------
    gui : viser.GuiApi
    scene : viser.SceneApi
    view : RobotView
    """

    def __init__(self, gui: GuiApi, scene: SceneApi, view: RobotView) -> None:
        self._scene = scene
        self._view = view
        self._label: Any = None
        self.text = gui.add_markdown(PROMPT)
        for body, handle in view.scene.meshes:
            handle.on_click(partial(self._show, body))

    def _show(self, body: Body, event: Any) -> None:
        self.text.content = describe_body(self._view.robot, body)
        if self._label is not None:
            self._label.remove()
        self._label = self._scene.add_label(
            f"{self._view.scene.link_node(body.link)}/clicked", body.name, position=body.mesh.bounds.mean(axis=0)
        )


def describe_body(robot: Robot, body: Body) -> str:
    """Return a sentence on a shape, as markdown: its name, its link and mass, and the joint that moves the link."""
    link = robot.links[body.link]
    parts = [f"**{escape_markdown(body.name)}**"]
    if body.name != link.name:
        parts.append(f"on link {escape_markdown(link.name)}")
    parts.append(f"{float(link.inertia.mass):.4g} kg")
    if body.link > 0:
        joint = robot.joints[body.link - 1]
        kind = "prismatic" if joint.prismatic else "revolute"
        motor = "with a motor" if joint.actuated else "without a motor"
        parts.append(f"moved by {escape_markdown(joint.name)}, {kind}, {motor}")
    else:
        parts.append("the base")
    return ", ".join(parts)
