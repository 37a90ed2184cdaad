"""Bones and joint symbols: each joint is drawn where both its links are."""

import numpy as np
import pytest

from robot_dynamics import Dynamics, add_skeleton, load_robot, shipped_robots
from robot_dynamics.model.visual import HullShape
from robot_dynamics.newton_euler.kinematics import link_placements
from robot_dynamics.viewing.body import ACTUATED_COLOUR, PLATFORM_COLOUR
from robot_dynamics.viewing.robot_bodies import hull_of_balls, robot_bodies
from robot_dynamics.viewing.skeleton import Skeleton


@pytest.mark.parametrize("name", list(shipped_robots()))
def test_drawn_robot_is_in_one_piece(name):
    """The shapes that touch each other at closed positions are connected, and every mass is among them or inside."""
    robot = load_robot(name)
    q = Dynamics(robot).initial_joint_positions
    bodies = robot_bodies(add_skeleton(robot), q)[0]
    placements = link_placements(robot, q)
    clouds = []
    for body in bodies:
        R, P = placements[body.link]
        low, high = body.mesh.bounds
        corners = np.array(np.meshgrid(*np.transpose([low, high]))).reshape(3, -1).T @ R.T + P
        clouds.append((corners.min(axis=0) - 1e-9, corners.max(axis=0) + 1e-9))
    reached, waiting = {0}, [0]
    while waiting:
        low, high = clouds[waiting.pop()]
        for number, (other_low, other_high) in enumerate(clouds):
            if number not in reached and (other_low <= high).all() and (other_high >= low).all():
                reached.add(number)
                waiting.append(number)
    missing = [bodies[number].name for number in range(len(bodies)) if number not in reached]
    assert not missing


@pytest.mark.parametrize("name", list(shipped_robots()))
def test_every_joint_with_a_motor_has_a_symbol(name):
    robot = load_robot(name)
    q = Dynamics(robot).initial_joint_positions
    skeleton = Skeleton(robot, q)
    bodies = robot_bodies(robot, q)[0]
    named = {body.name for body in bodies if body.colour == ACTUATED_COLOUR}
    expected = {
        joint.name
        for index, joint in enumerate(robot.joints)
        if joint.actuated and index not in skeleton.coordinate_joints
    }
    assert named == expected
    assert len({body.link for body in bodies if body.colour == PLATFORM_COLOUR}) == len(robot.platforms)


def test_symbols_lie_on_the_axes_of_their_joints():
    robot = load_robot("rx90")
    for body in robot_bodies(robot, np.zeros(6))[0]:
        if body.colour == ACTUATED_COLOUR:
            assert np.abs(body.mesh.center_mass).max() < 1e-9  # in the frame of the link, whose z is the axis
            x, y, z = np.ptp(body.mesh.bounds, axis=0)
            assert x == pytest.approx(y, rel=0.05) and z > x


def test_hull_of_two_balls_is_a_rod():
    """Its length is the distance of the centres and two radii, its thickness two radii."""
    mesh = hull_of_balls(HullShape(np.array([[0.0, 0, 0], [0, 0, 1.0]]), 0.1))
    assert np.ptp(mesh.bounds, axis=0) == pytest.approx([0.2, 0.2, 1.2], abs=0.02)
    assert mesh.is_watertight
