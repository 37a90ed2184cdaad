"""Print a robot as tables: MDH parameters, joints, inertias, named frames, totals and what is doubtful.

SI units: m, rad, kg, N m. Angles of the table as multiples of pi where they are.
"""

import numpy as np

from robot_dynamics.commands.robot_arguments import add_robot_arguments, robot_of
from robot_dynamics.commands.text_table import print_table, short
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.model.formats.expression import angle_text
from robot_dynamics.model.mdh_table import table
from robot_dynamics.model.placement import roll_pitch_yaw
from robot_dynamics.newton_euler.kinematics import link_placements

NAME = "show"


def add_arguments(parser):
    add_robot_arguments(parser)


def run(told):
    robot = robot_of(told)
    base = "moves" if robot.moving_base else "is fixed"
    gravity = " ".join(map(short, robot.gravity.tolist()))
    print(f"robot {robot.name!r}: {len(robot.joints)} joints, base {robot.base_link!r} {base}, gravity {gravity} m/s²")
    print_mdh_table(robot)
    print_joints(robot)
    print_inertias(robot)
    print_frames(robot)
    print_totals(robot)
    for warning in robot.warnings:
        print(f"warning: {warning}")


def print_mdh_table(robot):
    rows = []
    for row in table(robot):
        gamma, alpha, theta = (_angle(angle) for angle in (row.row.gamma, row.row.alpha, row.row.theta))
        b, d, r = row.row.b, row.row.d, row.row.r
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
        rows.append([joint.name, joint.role, *frictions, *sprung, follows, *bounds])
    head = ["joint", "role", "rotor inertia", "viscous", "Coulomb", "stiffness", "rest", "damping", "follows"]
    print_table([*head, "lower", "upper", "velocity", "effort"], rows, "Joints")


def print_inertias(robot):
    rows = []
    for link in robot.links:
        J = link.inertia.second_moments
        moments = [J[0, 0], J[0, 1], J[0, 2], J[1, 1], J[1, 2], J[2, 2]]
        rows.append([link.name, *map(float, (link.inertia.mass, *link.inertia.first_moments, *moments))])
    head = ["link", "mass", "MX", "MY", "MZ", "XX", "XY", "XZ", "YY", "YZ", "ZZ"]
    print_table(head, rows, "Inertias about the origins of the frames above, with all that is fixed to the links")


def print_frames(robot):
    rows = []
    for frame in robot.frames:
        link = robot.links[frame.link].name
        if frame.name != link or not np.allclose(frame.placement, np.eye(4), atol=1e-12):
            position = (float(round(x, 12)) for x in frame.placement[:3, 3])
            rows.append([frame.name, link, *position, *map(_angle, roll_pitch_yaw(frame.placement[:3, :3]))])
    if rows:
        print_table(
            ["frame", "on link", "x", "y", "z", "roll", "pitch", "yaw"],
            rows,
            "Named frames, in which wrenches and payloads are given, in the frames above",
        )


def print_totals(robot):
    """Mass and centre of all that moves, joint variables zero."""
    placed = link_placements(robot, Dynamics(robot).expand(np.zeros(len(Dynamics(robot).joint_names))))
    first = 0 if robot.moving_base else 1
    bodies = [(R @ link.inertia.first_moments + link.inertia.mass * P, link.inertia.mass)
              for link, (R, P) in zip(robot.links[first:], placed[first:], strict=True)]  # fmt: skip
    mass = sum(mass for _, mass in bodies)
    told = f"moving mass {mass:.6g} kg"
    if mass > 0:
        centre = sum(moment for moment, _ in bodies) / mass
        told += f", centre at {' '.join(f'{x:.6g}' for x in centre)} m with all joint variables zero"
    print(f"\n{told}")


def _angle(angle):
    text = angle_text(float(angle))
    return text if "pi" in text else float(angle)
