"""Print a robot as tables: MDH parameters, joints, loops, inertias, named frames, totals and what is doubtful.

SI units: m, rad, kg, N m. Angles of the table as multiples of pi where they are.
"""

import numpy as np

from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.cli.text_table import format_cell, print_table
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.model.formats.expression import format_angle
from robot_dynamics.model.mdh_table import build_mdh_table
from robot_dynamics.model.placement import roll_pitch_yaw
from robot_dynamics.newton_euler.kinematics import link_placements

NAME = "show"


def add_arguments(parser):
    add_robot_arguments(parser)


def run(told):
    robot = load_robot_argument(told)
    base = "moves" if robot.moving_base else "is fixed"
    gravity = " ".join(map(format_cell, robot.gravity.tolist()))
    print(f"robot {robot.name!r}: {len(robot.joints)} joints, base {robot.base_link!r} {base}, gravity {gravity} m/s²")
    print_platforms(robot)
    print_mdh_table(robot)
    print_joints(robot)
    print_loops(robot)
    print_inertias(robot)
    print_beams(robot)
    print_frames(robot)
    print_totals(robot)
    for warning in robot.warnings:
        print(f"warning: {warning}")


def print_platforms(robot):
    for name, platform in zip(robot.platform_links, robot.platforms, strict=True):
        coordinates, free = ", ".join(robot.joints[number].name for number in platform.joints), ", ".join(platform.free)
        stands = "" if platform.base is None else f" stands on {platform.base!r};"
        print(f"platform {name!r}:{stands} coordinates {coordinates}; its legs let it move by {free}")


def print_mdh_table(robot):
    rows = []
    for row in build_mdh_table(robot):
        gamma, alpha, theta = (
            _angle(angle) for angle in (row.parameters.gamma, row.parameters.alpha, row.parameters.theta)
        )
        b, d, r = row.parameters.b, row.parameters.d, row.parameters.r
        kind = "fixed" if row.joint is None else "prismatic" if row.joint.prismatic else "revolute"
        variable = {"fixed": "", "revolute": "theta", "prismatic": "r"}[kind]
        name = "" if row.joint is None else row.joint.name
        rows.append([name, row.name, row.antecedent, kind, gamma, b, alpha, d, theta, r, variable])
    head = ["joint", "link", "antecedent", "type", "gamma", "b", "alpha", "d", "theta", "r", "plus variable"]
    print_table(head, rows, "Modified Denavit-Hartenberg parameters, joint variables zero [rad, m]")


def print_joints(robot):
    rows = []
    for joint in robot.joints:
        limits, spring = joint.limits, joint.spring
        follows = f"{joint.mimic.multiplier:g}*{joint.mimic.joint}{joint.mimic.offset:+g}" if joint.mimic else None
        sprung = [spring.stiffness, spring.rest, spring.damping] if spring else [None] * 3
        frictions = [joint.rotor_inertia or None, joint.viscous_friction or None, joint.coulomb_friction or None]
        bounds = [limits.lower, limits.upper, limits.velocity, limits.effort]
        start = joint.initial_position or None
        rows.append([joint.name, joint.role, *frictions, *sprung, follows, *bounds, start])
    head = ["joint", "role", "rotor inertia", "viscous", "Coulomb", "stiffness", "rest", "damping", "follows"]
    print_table([*head, "lower", "upper", "velocity", "effort", "initial position"], rows, "Joints")


def print_loops(robot):
    """Two rows for each loop: its frame k, and its frame k+B."""
    rows, cut = [], cut_joints(robot)
    for number, loop in enumerate(robot.loops):
        kind = "spherical" if loop.is_spherical else "fixed"
        if number in cut:
            kind = "prismatic" if robot.joints[cut[number]].prismatic else "revolute"
        rows.append([loop.name, kind, "k", *_placed(robot, *loop.moved)])
        rows.append(["", "", "k+B", *_placed(robot, *loop.closed_on)])
    if rows:
        head = ["cut joint", "type", "frame", "on link", "x", "y", "z", "roll", "pitch", "yaw"]
        print_table(head, rows, "Loops: frames that coincide, in the frames above; spherical: their origins do")


def print_inertias(robot):
    rows = []
    for link in robot.links:
        J = link.inertia.second_moments
        moments = [J[0, 0], J[0, 1], J[0, 2], J[1, 1], J[1, 2], J[2, 2]]
        rows.append([link.name, *map(float, (link.inertia.mass, *link.inertia.first_moments, *moments))])
    head = ["link", "mass", "MX", "MY", "MZ", "XX", "XY", "XZ", "YY", "YZ", "ZZ"]
    print_table(head, rows, "Inertias about the origins of the frames above, with all that is fixed to the links")


def print_beams(robot):
    rows = []
    for link in robot.links:
        for beam in link.flexibility.beams if link.flexibility is not None else ():
            x, y, z = (float(round(value, 12)) for value in beam.placement[:3, 3])
            numbers = [*vars(beam.section).values(), *vars(beam.material).values()]
            rows.append([link.name, x, y, z, float(round(beam.length, 12)), beam.elements, *map(float, numbers)])
    if rows:
        head = ["link", "x", "y", "z", "length", "elements", "A", "I_y", "I_z", "I_0", "I_p", "E", "G", "density"]
        print_table(head, rows, "Beams: where they begin on their links, sections and materials")


def print_frames(robot):
    rows = []
    for frame in robot.frames:
        link = robot.links[frame.link].name
        if frame.name != link or not np.allclose(frame.placement, np.eye(4), atol=1e-12):
            rows.append([frame.name, *_placed(robot, frame.link, frame.placement)])
    if rows:
        print_table(
            ["frame", "on link", "x", "y", "z", "roll", "pitch", "yaw"],
            rows,
            "Named frames, in which wrenches and payloads are given, in the frames above",
        )


def print_totals(robot):
    """Mass and centre of all that moves, joint variables zero; of loops the mass alone, which need not close there."""
    if robot.loops:
        print(f"\nmoving mass {sum(link.inertia.mass for link in robot.links[0 if robot.moving_base else 1 :]):.6g} kg")
        return
    placed = link_placements(robot, Dynamics(robot).expand_positions(np.zeros(len(Dynamics(robot).joint_names))))
    first = 0 if robot.moving_base else 1
    bodies = [(R @ link.inertia.first_moments + link.inertia.mass * P, link.inertia.mass)
              for link, (R, P) in zip(robot.links[first:], placed[first:], strict=True)]  # fmt: skip
    mass = sum(mass for _, mass in bodies)
    told = f"moving mass {mass:.6g} kg"
    if mass > 0:
        centre = sum(moment for moment, _ in bodies) / mass
        told += f", centre at {' '.join(f'{x:.6g}' for x in centre)} m with all joint variables zero"
    print(f"\n{told}")


def _placed(robot, link, placement):
    """Name of a link, and position and angles of a placement (4, 4) in its frame."""
    position = (float(round(x, 12)) for x in placement[:3, 3])
    return [robot.links[link].name, *position, *map(_angle, roll_pitch_yaw(placement[:3, :3]))]


def _angle(angle):
    text = format_angle(float(angle))
    return text if "pi" in text else float(angle)
