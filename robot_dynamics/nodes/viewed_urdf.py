"""The URDF that robot_state_publisher shows of a robot, with the joints of joint_state_completer."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from robot_dynamics.model.formats.mjcf.document import is_mjcf
from robot_dynamics.model.formats.sdf.document import is_sdf
from robot_dynamics.model.formats.urdf.document import decode_urdf
from robot_dynamics.model.formats.urdf.writer import write_urdf
from robot_dynamics.model.formats.xacro.expansion import expand_xacro, is_xacro
from robot_dynamics.model.loading import is_urdf, read_description, read_robot
from robot_dynamics.viewing.skeleton import add_skeleton

if TYPE_CHECKING:
    from robot_dynamics.model.robot import Robot


def viewed_urdf(description: str) -> str:
    """Return the text of a URDF in which loops are cut, and the base link is the root.

    A URDF with shapes and a fixed base stays as it is. Robots without shapes get bones and joint
    symbols. robot_state_publisher takes a floating joint for a fixed one: a base that moves has no joint here, since
    its pose comes on /tf.

    Parameters
    ----------
    description : path of a URDF, an MDH table or a .par, or the name of a robot that ships.

    Raises
    ------
    DescriptionError
        The description cannot be read.
    """
    text, source = read_description(description)
    robot = read_robot(text, source=source)
    is_other_xml = is_mjcf(text) or is_sdf(text)
    if is_urdf(text) and not is_other_xml and robot.visuals and not robot.moving_base:
        return expand_xacro(source) if is_xacro(text, source) else decode_urdf(text, source)
    return write_urdf(replace(add_skeleton(robot), moving_base=False), lossy=True)


def view_frame(robot: Robot) -> str:
    """Return the frame that does not move in a view: the base link, or `odom` if the base moves."""
    return "odom" if robot.moving_base else robot.base_link
