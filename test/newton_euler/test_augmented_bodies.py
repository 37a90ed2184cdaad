"""Augmented bodies have the efforts of the links, and fewer parameters."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from peers.random_chains import random_chain
from peers.random_robots import random_urdf

from robot_dynamics import load_robot
from robot_dynamics.codegen.trace.preparation import prepare_robot
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.newton_euler import inverse
from robot_dynamics.newton_euler.augmented_bodies import augmented_bodies
from robot_dynamics.newton_euler.kinematics import run_forward_pass

AT_REST = np.array([0, 0, 9.81, 0, 0, 0])


def joint_forces(robot, motion):
    forward_pass = run_forward_pass(robot, *motion[:2], np.zeros(6), {})
    return inverse.inverse_dynamics(robot, forward_pass, motion[2], AT_REST)[0]


def with_augmented_bodies(robot, with_point_masses):
    bodies = augmented_bodies(robot, with_point_masses)
    inertias = [body + Inertia(mass) for body, mass in zip(bodies.inertias, bodies.point_masses, strict=True)]
    links = [replace(link, inertia=inertia) for link, inertia in zip(robot.links, inertias, strict=True)]
    augmented = copy.copy(robot)  # a Robot refuses negative masses
    object.__setattr__(augmented, "links", tuple(links))
    return bodies, augmented


@pytest.mark.parametrize("with_point_masses", [False, True])
@pytest.mark.parametrize("seed", range(30))
def test_augmented_bodies_have_the_same_joint_forces(seed, with_point_masses):
    robot = random_chain(seed) if seed % 2 else read_urdf(random_urdf(seed))
    motion = np.random.default_rng(seed).uniform(-2, 2, (3, 4, len(robot.joints)))
    bodies, augmented = with_augmented_bodies(robot, with_point_masses)
    expected = joint_forces(robot, motion)
    assert np.abs(joint_forces(augmented, motion) - expected).max() < 1e-11 * max(np.abs(expected).max(), 1)
    for joint, inertia, flat in zip(robot.joints, bodies.inertias[1:], bodies.is_flat[1:], strict=True):
        J = inertia.second_moments
        scale = max(np.abs(J).max(), 1)
        if not joint.prismatic:
            assert inertia.mass == 0 and inertia.first_moments[2] == 0
            assert abs(J[0, 0] + J[1, 1] - J[2, 2] if flat else J[1, 1]) < 1e-12 * scale


def test_point_masses_take_a_first_moment_from_links_whose_force_has_an_effect():
    """Panda: from links 4 and 6; the origins of links 1 to 3 are in the shoulder, so their forces have none."""
    robot, _ = prepare_robot(load_robot("panda"))
    bodies = augmented_bodies(robot, with_point_masses=True)
    assert [number for number, mass in enumerate(bodies.point_masses) if mass] == [5, 7]
    assert bodies.inertias[4].first_moments[1] == 0 and bodies.inertias[6].first_moments[0] == 0
    assert not any(augmented_bodies(robot, with_point_masses=False).point_masses)
