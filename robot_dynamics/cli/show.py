"""Print a robot as tables: MDH parameters, joints, loops, inertias, named frames, totals and warnings.

Units are SI: m, rad, kg, N m. Angles are printed as multiples of pi where possible.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.cli.robot_arguments import add_robot_arguments, read_robot_argument
from robot_dynamics.cli.text_table import format_cell, print_table
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.model.formats.expression import format_angle
from robot_dynamics.model.inertia import symmetric_entries
from robot_dynamics.model.mdh_table import build_mdh_table
from robot_dynamics.model.placement import roll_pitch_yaw
from robot_dynamics.newton_euler.kinematics import link_placements

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.cli.text_table import Cell
    from robot_dynamics.model.robot import Robot

NAME = "show"
PLACEMENT_HEADER = ["on link", "x", "y", "z", "roll", "pitch", "yaw"]
DECIMALS = 9  # of lengths and angles: smaller parts are rounding errors of the text of a URDF
VARIABLES = {"fixed": "", "revolute": "theta", "prismatic": "r"}


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_robot_arguments(parser)


def run(arguments: Namespace) -> None:
    """Print the tables."""
    robot = read_robot_argument(arguments)
    base = "moves" if robot.moving_base else "is fixed"
    gravity = " ".join(map(format_cell, robot.gravity.tolist()))
    print(f"robot {robot.name!r}: {len(robot.joints)} joints, base {robot.base_link!r} {base}, gravity {gravity} m/s²")
    print_platforms(robot)
    print_locked_joints(robot)
    print_mdh_table(robot)
    print_joints(robot)
    print_loops(robot)
    print_inertias(robot)
    print_beams(robot)
    print_frames(robot)
    print_totals(robot)
    for warning in robot.warnings:
        print(f"warning: {warning}")


def print_platforms(robot: Robot) -> None:
    """Print one line for each platform."""
    for name, platform in zip(robot.platform_links, robot.platforms, strict=True):
        coordinates = ", ".join(robot.joints[index].name for index in platform.joints)
        base = "" if platform.base is None else f" base {platform.base!r};"
        print(f"platform {name!r}:{base} coordinates {coordinates}; its legs leave {', '.join(platform.free)} free")


def print_locked_joints(robot: Robot) -> None:
    """Print one line with the locked joints, if there are any."""
    if robot.locked_joints:
        print(f"locked: {', '.join(f'{joint.name} at {joint.position:g}' for joint in robot.locked_joints)}")


def print_mdh_table(robot: Robot) -> None:
    """Print the MDH parameters."""
    rows: list[list[Cell]] = []
    for row in build_mdh_table(robot):
        parameters = row.parameters
        kind = "fixed" if row.joint is None else "prismatic" if row.joint.prismatic else "revolute"
        rows.append(
            [
                "" if row.joint is None else row.joint.name,
                row.name,
                row.antecedent,
                kind,
                _angle_cell(parameters.gamma),
                _length_cell(parameters.b),
                _angle_cell(parameters.alpha),
                _length_cell(parameters.d),
                _angle_cell(parameters.theta),
                _length_cell(parameters.r),
                VARIABLES[kind],
            ]
        )
    header = ["joint", "link", "antecedent", "type", "gamma", "b", "alpha", "d", "theta", "r", "plus variable"]
    print_table(header, rows, "Modified Denavit-Hartenberg parameters, joint variables zero [rad, m]")


def print_joints(robot: Robot) -> None:
    """Print the roles, frictions, springs and limits of the joints."""
    rows: list[list[Cell]] = []
    for joint in robot.joints:
        limits = joint.limits
        spring = joint.spring
        mimic = joint.mimic
        rows.append(
            [
                joint.name,
                joint.role,
                joint.rotor_inertia or None,
                joint.viscous_friction or None,
                joint.coulomb_friction or None,
                joint.viscous_asymmetry or None,
                joint.coulomb_asymmetry or None,
                joint.stribeck_friction or None,
                joint.stribeck_velocity or None,
                joint.load_friction or None,
                spring.stiffness if spring else None,
                spring.rest if spring else None,
                spring.damping if spring else None,
                f"{mimic.multiplier:g}*{mimic.joint}{mimic.offset:+g}" if mimic else None,
                limits.lower,
                limits.upper,
                limits.velocity,
                limits.effort,
                joint.initial_position or None,
            ]
        )
    header = ["joint", "role", "rotor inertia", "viscous", "Coulomb", "viscous asymmetry", "Coulomb asymmetry"]
    header += ["Stribeck", "Stribeck velocity", "load friction", "stiffness", "rest", "damping", "follows"]
    print_table([*header, "lower", "upper", "velocity", "effort", "initial position"], rows, "Joints")


def print_loops(robot: Robot) -> None:
    """Print two rows for each loop: its frame k, and its frame k+B."""
    rows: list[list[Cell]] = []
    cut = cut_joints(robot)
    for index, loop in enumerate(robot.loops):
        kind = "spherical" if loop.is_spherical else "fixed"
        if index in cut:
            kind = "prismatic" if robot.joints[cut[index]].prismatic else "revolute"
        rows.append([loop.name, kind, "k", *_placement_cells(robot, *loop.moved)])
        rows.append(["", "", "k+B", *_placement_cells(robot, *loop.closed_on)])
    if rows:
        header = ["cut joint", "type", "frame", *PLACEMENT_HEADER]
        print_table(
            header, rows, "Loops: pairs of frames that coincide, in the frames above; spherical: only their origins"
        )


def print_inertias(robot: Robot) -> None:
    """Print the inertial parameters of the links."""
    rows: list[list[Cell]] = []
    for link in robot.links:
        J = link.inertia.second_moments
        first_moments = _without_noise(link.inertia.first_moments)
        second_moments = _without_noise(np.array(symmetric_entries(J)))
        rows.append([link.name, float(link.inertia.mass), *first_moments, *second_moments])
    header = ["link", "mass", "MX", "MY", "MZ", "XX", "XY", "XZ", "YY", "YZ", "ZZ"]
    print_table(header, rows, "Inertias about the origins of the frames above, with all bodies fixed to the links")


def print_beams(robot: Robot) -> None:
    """Print the beams of flexible links."""
    rows: list[list[Cell]] = []
    for link in robot.links:
        for beam in link.flexibility.beams if link.flexibility is not None else ():
            x, y, z = (float(round(value, 12)) for value in beam.placement[:3, 3])
            numbers = [*vars(beam.section).values(), *vars(beam.material).values()]
            rows.append([link.name, x, y, z, float(round(beam.length, 12)), beam.elements, *map(float, numbers)])
    if rows:
        header = ["link", "x", "y", "z", "length", "elements", "A", "I_y", "I_z", "I_0", "I_p", "E", "G", "density"]
        print_table(header, rows, "Beams: start points on their links, sections and materials")


def print_frames(robot: Robot) -> None:
    """Print the named frames that are not frames of links."""
    rows: list[list[Cell]] = []
    for frame in robot.frames:
        link = robot.links[frame.link].name
        if frame.name != link or not np.allclose(frame.placement, np.eye(4), atol=1e-12):
            rows.append([frame.name, *_placement_cells(robot, frame.link, frame.placement)])
    if rows:
        print_table(
            ["frame", *PLACEMENT_HEADER],
            rows,
            "Named frames, in which wrenches and payloads are expressed, relative to the frames above",
        )


def print_totals(robot: Robot) -> None:
    """Print the mass of the moving links, and their centre of mass with all joint variables zero.

    With loops only the mass is printed: the loops need not close with all joint variables zero.
    """
    first = 0 if robot.moving_base else 1
    links = robot.links[first:]
    mass = sum(link.inertia.mass for link in links)
    text = f"moving mass {mass:.6g} kg"
    if robot.loops:
        print(f"\n{text}")
        return
    dynamics = Dynamics(robot)
    placements = link_placements(robot, dynamics.expand_positions(np.zeros(len(dynamics.joint_names))))
    if mass > 0:
        moment = np.zeros(3)
        for link, (R, P) in zip(links, placements[first:], strict=True):
            moment = moment + (R @ link.inertia.first_moments + link.inertia.mass * P)
        centre = moment / mass
        text += (
            f", centre at {' '.join(f'{round(x, DECIMALS) + 0.0:.6g}' for x in centre)} m with all joint variables zero"
        )
    print(f"\n{text}")


def _placement_cells(robot: Robot, link: int, placement: Array) -> list[Cell]:
    """Return the name of a link, and the position and the angles of a placement (4, 4) in its frame."""
    position = [_length_cell(x) for x in placement[:3, 3]]
    return [robot.links[link].name, *position, *map(_angle_cell, roll_pitch_yaw(placement[:3, :3]))]


def _angle_cell(angle: float) -> Cell:
    text = format_angle(float(angle))
    return text if "pi" in text else float(round(angle, DECIMALS)) + 0.0


def _length_cell(length: float) -> Cell:
    return float(round(length, DECIMALS)) + 0.0


def _without_noise(values: Array) -> list[float]:
    """Return values (k,) with zeros for those that are rounding errors beside the largest one."""
    noise = 10.0**-DECIMALS * np.abs(values).max()
    return [float(value) if abs(value) > noise else 0.0 for value in values]
