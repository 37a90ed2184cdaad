"""The units and frames of programs leave the efforts as they are, and make parameters and lengths simple."""

import numpy as np
import pytest
from peers.random_robots import random_urdf

from robot_dynamics import load_robot
from robot_dynamics.codegen.trace.preparation import prepare_robot
from robot_dynamics.codegen.trace.program_frames import program_length_unit, turn_last_frames, with_length_unit
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.newton_euler import inverse
from robot_dynamics.newton_euler.kinematics import run_forward_pass

PANDA_OFFSET = 0.0825  # of the elbow, in link 3 and back in link 4


def joint_forces(robot, q, qd, qdd):
    at_rest = np.concatenate([-robot.gravity, np.zeros(3)])
    forces, _ = inverse.inverse_dynamics(robot, run_forward_pass(robot, q, qd, np.zeros(6), {}), qdd, at_rest)
    return forces


@pytest.mark.parametrize("name", ["panda", "ur5e", "puma560", "rx90"])
def test_robots_in_another_unit_of_length_have_the_same_torques(name):
    robot = load_robot(name)
    motion = np.random.default_rng(0).uniform(-2, 2, (3, 4, len(robot.joints)))
    unit = program_length_unit(robot)
    assert unit != 1
    forces = joint_forces(robot, *motion)
    assert np.abs(joint_forces(with_length_unit(robot, unit), *motion) - forces).max() < 1e-12 * np.abs(forces).max()


def test_unit_of_length_is_the_most_frequent_length():
    robot, _ = prepare_robot(load_robot("panda"))
    assert program_length_unit(robot) == PANDA_OFFSET
    scaled = with_length_unit(robot, PANDA_OFFSET)
    assert [scaled.joints[number].placement[0, 3] for number in (3, 4)] == [1, -1]


@pytest.mark.parametrize("name", ["free_flying_arm", "gough_stewart"])
def test_unit_of_length_is_a_metre_where_lengths_or_forces_are_arguments(name):
    assert program_length_unit(load_robot(name)) == 1


@pytest.mark.parametrize("seed", range(20))
def test_turned_last_frames_leave_the_forces_and_one_parameter_less(seed):
    robot = read_urdf(random_urdf(seed))
    motion = np.random.default_rng(seed).uniform(-2, 2, (3, 4, len(robot.joints)))
    turned, shifts = turn_last_frames(robot)
    q, qd, qdd = motion
    forces = joint_forces(robot, *motion)
    assert np.abs(joint_forces(turned, q + shifts, qd, qdd) - forces).max() < 1e-12 * max(np.abs(forces).max(), 1)
    antecedents = {joint.antecedent for joint in robot.joints}
    ends = [
        number
        for number, joint in enumerate(robot.joints, start=1)
        if number not in antecedents and not joint.prismatic and robot.links[number].inertia.first_moments[:2].all()
    ]
    assert all(turned.links[number].inertia.first_moments[1] == 0 for number in ends)
    assert np.array_equal(shifts != 0, np.isin(np.arange(len(robot.joints)) + 1, ends))
