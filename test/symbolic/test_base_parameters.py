"""The closed-form rules gather all that can be gathered: as many parameters are left as the regressor has rank."""

from dataclasses import replace

import numpy as np
import pytest
from peers.random_robots import random_urdf
from peers.real_robots import real_urdf

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.model.formats.urdf import read_urdf
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.minimal_frames import minimal_frames
from robot_dynamics.model.robot import Link
from robot_dynamics.newton_euler.regressor import parameter_names, parameters, regressor
from robot_dynamics.symbolic.base_parameters import gathered, independent_columns

AT_REST = np.array([0, 0, 9.81, 0, 0, 0])


def with_random_bodies(robot, rng):
    """The robot with every inertial parameter another number than zero."""
    links = [robot.links[0]]
    for link in robot.links[1:]:
        root = rng.normal(size=(3, 3))
        links.append(Link(link.name, Inertia(rng.uniform(1, 2), rng.uniform(-1, 1, 3), root @ root.T)))
    return replace(robot, links=tuple(links))


def motions(robot, rng):
    """The regressor (rows, p) of random motions, some three times as many rows as columns."""
    joints = len(robot.joints)
    count = max(20, 39 * (joints + 1) // max(1, joints))
    Y = regressor(robot, *rng.uniform(-3, 3, (3, count, joints)), np.zeros(6), AT_REST)
    return Y.reshape(-1, Y.shape[-1])


ROBOTS = {
    "rx90": lambda: load_robot("rx90"),
    "ur5e": lambda: load_robot("ur5e"),
    "panda": lambda: load_robot("panda"),
    "anymal_c": lambda: read_urdf(real_urdf("anymal_c")),
    "random tree": lambda: read_urdf(random_urdf(1, joints=8).replace("prismatic", "revolute")),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_as_many_parameters_are_left_as_the_regressor_has_rank(name):
    rng = np.random.default_rng(0)
    robot = minimal_frames(with_random_bodies(ROBOTS[name](), rng))
    Y = motions(robot, rng)
    bodies = [k for k, key in enumerate(parameter_names(robot)) if key.split(".")[0] not in ("Ia", "Fv", "Fs")]
    rank = np.linalg.matrix_rank(Y[:, bodies], tol=1e-8 * np.linalg.norm(Y))
    left = parameters(gathered(robot))
    effective = [k for k in bodies if abs(left[k]) > 1e-12 and np.abs(Y[:, k]).max() > 1e-9]
    assert len(effective) == rank


def test_independent_columns_give_the_base_parameters_of_the_rx90():
    """40 of them, rotors counted: the published number; the efforts come from them alone."""
    rng = np.random.default_rng(1)
    robot = load_robot("rx90")
    Y = motions(robot, rng)
    drives = [k for k, key in enumerate(parameter_names(robot)) if key.split(".")[0] not in ("Fv", "Fs")]
    kept, dependent, K = independent_columns(Y[:, drives])
    assert len(kept) == 40 and len(kept) + len(dependent) == len(drives)
    theta = parameters(robot)[drives]
    base = theta[kept] + K @ theta[dependent]
    np.testing.assert_allclose(Y[:, drives][:, kept] @ base, Y[:, drives] @ theta, atol=1e-9)


def test_rotor_of_a_first_joint_is_gathered_and_efforts_stay():
    robot = load_robot("rx90")
    few = gathered(robot)
    assert few.joints[0].rotor_inertia == 0 and few.joints[1].rotor_inertia == robot.joints[1].rotor_inertia
    q, qd, qdd = np.random.default_rng(2).uniform(-1, 1, (3, 5, 6))
    expected = Dynamics(robot, compiled=False).inverse(q, qd, qdd)
    np.testing.assert_allclose(Dynamics(few, compiled=False).inverse(q, qd, qdd), expected, rtol=1e-10, atol=1e-10)
