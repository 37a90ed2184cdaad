"""Shapes of a robot: the visual geometry of its description, else bones and joint symbols."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.viewing.body import Body
    from robot_dynamics.viewing.skeleton import Skeleton


def robot_bodies(robot: Robot, skeleton: Skeleton) -> list[Body]:
    """Return the shapes of a robot, in the frames of its links."""
    return skeleton.bodies()
