"""Panels of the page: sliders of joints and platforms, what is drawn, and efforts."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.viewing.markdown import escape_markdown, markdown_table

if TYPE_CHECKING:
    from viser import GuiApi

    from robot_dynamics.array_types import Array
    from robot_dynamics.viewing.overlays import Overlay
    from robot_dynamics.viewing.robot_view import RobotView
    from robot_dynamics.viewing.value_range import Range

STEPS = 1000
"""Steps of a slider."""
OPEN_FOLDER_JOINTS = 14
"""Sliders of more joints are in a folder that is closed at first."""


class JointPanel:
    """A slider for each independent joint, from its lower to its upper limit."""

    def __init__(self, gui: GuiApi, view: RobotView) -> None:
        self._view = view
        self.sliders: list[Any] = []
        self._is_following = False
        configuration = view.configuration
        mimics = {index for index in configuration.independent if view.robot.joints[index].mimic is not None}
        self._indices = [index for index in configuration.independent if index not in mimics]
        with gui.add_folder("Joints", expand_by_default=len(self._indices) <= OPEN_FOLDER_JOINTS):
            for index in self._indices:
                joint = view.robot.joints[index]
                limits = configuration.joint_range(index, view.extent)
                unit = "m" if joint.prismatic else "rad"
                slider = add_slider(gui, f"{joint.name} [{unit}]", limits, float(configuration.q[index]))
                slider.on_update(lambda event: self._move(event))
                self.sliders.append(slider)
        view.on_move.append(self._follow)

    def _move(self, event: Any) -> None:
        if event.client is None:
            return  # the value was set by this program
        positions = np.array([slider.value for slider in self.sliders])
        self._view.move(lambda configuration: configuration.move_joints(positions))

    def _follow(self) -> None:
        """Set the sliders to where the robot is, except where it could not follow."""
        if self._view.configuration.problem:
            return
        for index, slider in zip(self._indices, self.sliders, strict=True):
            set_slider(slider, float(self._view.configuration.q[index]))


class PlatformPanel:
    """A slider for each coordinate in which the legs let a platform move."""

    def __init__(self, gui: GuiApi, view: RobotView, link: str, free: tuple[str, ...]) -> None:
        self._view = view
        self._link = link
        self._free = [COORDINATES.index(coordinate) for coordinate in free]
        self.sliders: list[Any] = []
        start = view.configuration.platform_coordinates(link)
        joints = view.robot.platforms[view.robot.platform_links.index(link)].joints
        with gui.add_folder("Platform" if len(view.robot.platforms) == 1 else f"Platform {link}"):
            for column in self._free:
                limits = view.configuration.joint_range(joints[column], view.extent)
                label = f"{COORDINATES[column]} [{'m' if column < 3 else 'rad'}]"
                slider = add_slider(gui, label, limits, float(start[column]))
                slider.on_update(lambda event: self._move(event))
                self.sliders.append(slider)
        view.on_move.append(self._follow)

    def _move(self, event: Any) -> None:
        if event.client is None:
            return
        wanted = {column: slider.value for column, slider in zip(self._free, self.sliders, strict=True)}

        def motion(configuration: Any) -> bool:
            coordinates = configuration.platform_coordinates(self._link)
            coordinates[list(wanted)] = list(wanted.values())
            return bool(configuration.move_platform(self._link, coordinates))

        self._view.move(motion)

    def _follow(self) -> None:
        if self._view.configuration.problem:
            return
        coordinates = self._view.configuration.platform_coordinates(self._link)
        for column, slider in zip(self._free, self.sliders, strict=True):
            set_slider(slider, float(coordinates[column]))


class OverlayPanel:
    """A checkbox for each overlay. What lies inside of links makes the robot translucent."""

    def __init__(self, gui: GuiApi, view: RobotView) -> None:
        self._scene = view.scene
        self.boxes: dict[str, Any] = {}
        self._inside: list[Any] = []
        with gui.add_folder("Show", expand_by_default=False):
            for overlay in view.overlays:
                box: Any = gui.add_checkbox(overlay.title, initial_value=False)
                box.on_update(partial(self._show, overlay))
                self.boxes[overlay.title] = box
                if overlay.is_inside:
                    self._inside.append(box)

    def _show(self, overlay: Overlay, event: Any) -> None:
        overlay.show(bool(event.target.value))
        if overlay.is_inside:
            self._scene.make_translucent(any(box.value for box in self._inside))


class StatusPanel:
    """Where the robot cannot move, and a table of the efforts that hold it."""

    def __init__(self, gui: GuiApi, view: RobotView) -> None:
        self._view = view
        self._message = gui.add_markdown("")
        with gui.add_folder("Efforts that hold the robot", expand_by_default=False):
            self._table = gui.add_markdown("")
        view.on_move.append(self._show_problem)
        view.on_efforts.append(self._show_efforts)

    def _show_problem(self) -> None:
        self._message.content = escape_markdown(self._view.configuration.problem)

    def _show_efforts(self, efforts: Array, is_singular: bool) -> None:
        configuration = self._view.configuration
        if is_singular and not configuration.problem:
            self._message.content = "The loops are singular here, or nearly so."
        rows = []
        rounding = 1e-12 * np.abs(efforts).max(initial=0.0)
        for index, effort in zip(configuration.independent, efforts, strict=True):
            joint = self._view.robot.joints[index]
            unit = "N" if joint.prismatic else "N m"
            limit = f"{joint.limits.effort:g}" if np.isfinite(joint.limits.effort) else ""
            rows.append((escape_markdown(joint.name), f"{0.0 if abs(effort) < rounding else effort:.4g} {unit}", limit))
        self._table.content = markdown_table(("joint", "effort", "limit"), rows)


def add_slider(gui: GuiApi, label: str, limits: Range, value: float) -> Any:
    """Add a slider of 1000 steps over a range; a range without extent gets a slider that cannot move."""
    span = limits.upper - limits.lower
    return gui.add_slider(
        label,
        min=limits.lower,
        max=limits.upper if span > 0 else limits.lower + 1e-9,
        step=max(span, 1e-9) / STEPS,
        initial_value=limits.clip(value),
        disabled=not span > 0,
    )


def set_slider(slider: Any, value: float) -> None:
    """Set a slider to a value, widening its range where the value is outside."""
    slider.min = min(slider.min, value)
    slider.max = max(slider.max, value)
    if abs(slider.value - value) > (slider.max - slider.min) / STEPS:
        slider.value = value
