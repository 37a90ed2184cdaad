"""A robot as HTML: a picture, totals, and tables of its joints, links, loops and platforms."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from robot_dynamics.errors import MissingPackageError
from robot_dynamics.model.mdh_table import build_mdh_table
from robot_dynamics.newton_euler.centroid import moving_mass
from robot_dynamics.notebook.markup import (
    angle_text,
    block,
    heading,
    length_text,
    number_text,
    paragraph,
    picture,
    table,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lxml.html import HtmlElement

    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.notebook.markup import Cell

logger = logging.getLogger(__name__)

MAX_JOINTS = 60
"""Joints that are listed; larger robots are listed in part, and not drawn."""
HEADER = ("joint", "moves link", "mass [kg]", "on", "type", "γ", "b", "α", "d", "θ", "r", "lower", "upper")
RATE_HEADER = ("max. velocity", "max. effort")


def robot_html(robot: Robot) -> HtmlElement:
    """Return the page of a robot."""
    summary = block(heading(f"Robot {robot.name}"), *(paragraph(line) for line in _summary(robot)))
    return block(block(*_pictures(robot), summary, is_row=True), _joint_table(robot), *_loop_tables(robot))


def dynamics_html(dynamics: Dynamics) -> HtmlElement:
    """Return the page of a robot, with the joints that the models take."""
    lines = [f"Joints of the models (Dynamics.joint_names): {', '.join(dynamics.joint_names) or 'none'}"]
    if dynamics.dependent_joint_names:
        lines.append(f"Loops determine {', '.join(dynamics.dependent_joint_names)}")
    if dynamics.unactuated_joint_names:
        lines.append(f"Without motor: {', '.join(dynamics.unactuated_joint_names)}")
    return block(robot_html(dynamics.robot), *map(paragraph, lines))


def _pictures(robot: Robot) -> Iterator[HtmlElement]:
    """Yield the picture of a robot, or a line that says why there is none."""
    if len(robot.joints) > MAX_JOINTS:
        return
    try:
        from robot_dynamics.viewing.picture import robot_picture  # here: it needs packages of the extra `view`

        yield picture(robot_picture(robot), f"{robot.name} at its initial positions")
    except ModuleNotFoundError as error:
        yield paragraph(f"A picture needs {error.name}: pip install 'robot_dynamics[view]'")
    except MissingPackageError as error:
        yield paragraph(str(error))
    except Exception as error:  # loops that do not close, or bodies without extent: the tables are right without it
        logger.debug("no picture of robot %r", robot.name, exc_info=True)
        yield paragraph(f"There is no picture: {error}")


def _summary(robot: Robot) -> Iterator[str]:
    """Yield sentences about the robot as a whole."""
    base = "moves" if robot.moving_base else "is fixed"
    mass = number_text(moving_mass(robot))
    yield f"{len(robot.joints)} joints; base {robot.base_link!r} {base}; moving mass {mass} kg"
    yield f"gravity {' '.join(number_text(value) for value in robot.gravity)} m/s²"
    for name, platform in zip(robot.platform_links, robot.platforms, strict=True):
        yield f"platform {name!r}, free in {', '.join(platform.free)}"
    if robot.loops:
        yield "1 loop" if len(robot.loops) == 1 else f"{len(robot.loops)} loops"
    if robot.warnings:
        yield f"{len(robot.warnings)} warnings about the description: robot.warnings"


def _joint_table(robot: Robot) -> HtmlElement:
    """Return the table of all frames: joints with the links that they move, and fixed frames."""
    masses = {link.name: float(link.inertia.mass) for link in robot.links}
    rows: list[list[Cell]] = [["", robot.base_link, masses[robot.base_link] or None, "", "base"]]
    for row in build_mdh_table(robot, MAX_JOINTS):
        gamma, b, alpha, d, theta, r = row.parameters
        angles = [angle_text(gamma), length_text(b), angle_text(alpha), length_text(d), angle_text(theta)]
        joint = row.joint
        name = "" if joint is None else joint.name
        cells: list[Cell] = [name, row.name, masses.get(row.name) or None, row.antecedent, _type(joint), *angles]
        rows.append([*cells, length_text(r), *(() if joint is None else _limits(joint))])
    if len(robot.joints) > MAX_JOINTS:
        rows.append([f"and {len(robot.joints) - MAX_JOINTS} more"])
    for column in (HEADER.index("γ"), HEADER.index("b")):
        if all(
            row[column] == "0" for row in rows[1:] if len(row) > column
        ):  # of most robots: as in tables of textbooks
            rows = [[*row[:column], None, *row[column + 1 :]] for row in rows]
    return table((*HEADER, *RATE_HEADER), rows)


def _type(joint: Joint | None) -> str:
    """Return the type of a joint, and its role where it has no motor."""
    if joint is None:
        return "fixed"
    kind = "prismatic" if joint.prismatic else "revolute"
    return kind if joint.role == "actuated" else f"{kind}, {joint.role}"


def _limits(joint: Joint) -> list[Cell]:
    limits = joint.limits
    return [limits.lower, limits.upper, limits.velocity, limits.effort]


def _loop_tables(robot: Robot) -> Iterator[HtmlElement]:
    """Yield the table of the loops, and the units of all tables."""
    if robot.loops:
        rows = [
            [loop.name, robot.links[loop.moved.link].name, robot.links[loop.closed_on.link].name]
            for loop in robot.loops[:MAX_JOINTS]
        ]
        yield table(("loop is cut at", "on link", "closed on link"), rows)
    yield paragraph("Units: m, rad, s, kg, N m of revolute and N of prismatic joints. Empty: none.")
