"""Panels of what a robot carries: an external wrench, by numbers or by an arrow, and a payload."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.model.inertia import Inertia
from robot_dynamics.viewing.wrench_arrow import WrenchArrow

if TYPE_CHECKING:
    from viser import GuiApi, SceneApi

    from robot_dynamics.viewing.robot_view import RobotView

MAX_MASS = 1e6
"""Largest mass of a payload [kg]."""


class WrenchPanel:
    """A force and a moment of the environment on a link, by numbers; the force by an arrow too.

    Parameters
    ----------
    gui : viser.GuiApi
    scene : viser.SceneApi
    view : RobotView
    """

    def __init__(self, gui: GuiApi, scene: SceneApi, view: RobotView) -> None:
        self._view = view
        names = [frame.name for frame in view.robot.frames]
        with gui.add_folder("External wrench", expand_by_default=False):
            self.link: Any = gui.add_dropdown("link", names, initial_value=names[-1])
            self.force: Any = gui.add_vector3("force [N]", (0.0, 0.0, 0.0), step=1.0)
            self._moment = gui.add_vector3("moment [N m]", (0.0, 0.0, 0.0), step=0.1)
            self._is_dragged = gui.add_checkbox("drag the force", initial_value=False)
            self.scale: Any = gui.add_number(
                "N per metre of arrow", default_force_scale(view), min=1e-3, max=1e6, step=1e-3
            )
        self.arrow = WrenchArrow(scene, view.extent)
        view.on_draw.append(self.arrow.move)
        for handle in (self.link, self.force, self._moment, self.scale):
            handle.on_update(lambda event: self.apply())
        self._is_dragged.on_update(lambda event: self.arrow.show_handle(bool(self._is_dragged.value)))
        self.arrow.handle.on_update(lambda event: self.drag())
        self.apply()

    def drag(self) -> None:
        """Set the force to the tip of the arrow."""
        force = np.asarray(self.arrow.handle.position, dtype=float) * float(self.scale.value)
        self.force.value = tuple(np.round(force, 3))

    def apply(self) -> None:
        """Exert the wrench, and draw it."""
        wrench = np.array([*self.force.value, *self._moment.value], dtype=float)
        name = str(self.link.value)
        self._view.external_wrenches = {name: wrench} if wrench.any() else {}
        frame = self._view.robot.frame(name)
        self.arrow.draw(frame, wrench[:3] / float(self.scale.value))
        self._view.refresh()


def default_force_scale(view: RobotView) -> float:
    """Return the force [N/m] of an arrow of a metre: the weight is as long as the robot, rounded to a digit."""
    weight = float(np.linalg.norm(view.robot.gravity)) * sum(float(link.inertia.mass) for link in view.robot.links[1:])
    scale = (weight or 10.0) / view.extent
    return float(f"{scale:.0e}")


class PayloadPanel:
    """A payload that is fixed to a link: a point mass.

    Parameters
    ----------
    gui : viser.GuiApi
    view : RobotView
    """

    def __init__(self, gui: GuiApi, view: RobotView) -> None:
        self._view = view
        names = [frame.name for frame in view.robot.frames]
        with gui.add_folder("Payload", expand_by_default=False):
            self._link = gui.add_dropdown("link", names, initial_value=names[-1])
            self.mass: Any = gui.add_number("mass [kg]", 0.0, min=0.0, max=MAX_MASS, step=0.1)
            self._centre = gui.add_vector3("centre of mass [m]", (0.0, 0.0, 0.0), step=0.01)
        for handle in (self._link, self.mass, self._centre):
            handle.on_update(lambda event: self._apply())

    def _apply(self) -> None:
        centre = np.array(self._centre.value, dtype=float)
        mass = min(max(float(self.mass.value), 0.0), MAX_MASS)  # while a number is typed, the page sends others too
        inertia = Inertia.about_centre_of_mass(mass, np.zeros((3, 3)), centre)
        self._view.carry(str(self._link.value), inertia)
