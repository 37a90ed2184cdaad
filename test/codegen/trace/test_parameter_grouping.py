"""The closed-form rules group all parameters: as many remain as the rank of the regressor."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from peers.random_robots import random_urdf
from peers.real_robots import real_urdf

from robot_dynamics import Dynamics, Robot, load_robot
from robot_dynamics.codegen.trace.models import inverse_model
from robot_dynamics.codegen.trace.parameter_grouping import group_inertial_parameters, select_independent_columns
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh
from robot_dynamics.model.minimal_frames import minimal_frames
from robot_dynamics.model.robot import Frame, Link
from robot_dynamics.newton_euler.regressor import parameter_names, parameters, regressor

AT_REST = np.array([0, 0, 9.81, 0, 0, 0])


def with_random_bodies(robot, rng):
    """The robot with no inertial parameter equal to zero."""
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
    "random tree that slides": lambda: read_urdf(random_urdf(3, joints=8)),
}
KINDS = ["".join(kinds) for length in (2, 3, 4) for kinds in itertools.product("RP", repeat=length)]


def chain(kinds, right_angles):
    """A chain of revolute (R) and prismatic (P) joints, with axes at right or arbitrary angles."""
    rng = np.random.default_rng([len(kinds), KINDS.index(kinds), right_angles])
    links, joints = [Link("base", Inertia())], []
    for j, kind in enumerate(kinds, start=1):
        row = MDHParameters(
            alpha=rng.uniform(-3, 3), d=rng.uniform(-1, 1), theta=rng.uniform(-3, 3), r=rng.uniform(-1, 1)
        )
        if right_angles:
            row = row._replace(alpha=rng.choice([0.0, np.pi / 2, -np.pi / 2]), theta=rng.choice([0.0, np.pi / 2]))
        joints.append(Joint(f"joint_{j}", j - 1, kind == "P", placement_from_mdh(row)))
        links.append(Link(f"link_{j}", Inertia()))
    frames = tuple(Frame(link.name, number, np.eye(4)) for number, link in enumerate(links))
    return with_random_bodies(Robot(kinds, tuple(links), tuple(joints), frames), rng)


def check_exhaustive(robot, rng):
    """Assert that as many parameters remain as the rank of the regressor, with the same efforts."""
    Y = motions(robot, rng)
    bodies = [k for k, key in enumerate(parameter_names(robot)) if key.split(".")[0] not in ("Ia", "Fv", "Fs")]
    rank = np.linalg.matrix_rank(Y[:, bodies], tol=1e-8 * np.linalg.norm(Y))
    left = parameters(group_inertial_parameters(robot))
    effective = [k for k in bodies if abs(left[k]) > 1e-12 and np.abs(Y[:, k]).max() > 1e-9]
    assert len(effective) == rank
    expected = Y @ parameters(robot)
    np.testing.assert_allclose(Y @ left, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", ROBOTS)
def test_grouped_parameters_are_as_many_as_the_regressor_rank(name):
    rng = np.random.default_rng(0)
    check_exhaustive(minimal_frames(with_random_bodies(ROBOTS[name](), rng)), rng)


@pytest.mark.parametrize("right_angles", [True, False])
@pytest.mark.parametrize("kinds", KINDS)
def test_prismatic_links_keep_no_more_parameters_than_the_regressor_rank(kinds, right_angles):
    rng = np.random.default_rng(0)
    check_exhaustive(minimal_frames(chain(kinds, right_angles)), rng)


def test_prismatic_links_need_fewer_operations_and_a_moving_base_keeps_its_parameters():
    robot = chain("RPP", False)
    with_rules = inverse_model(robot).operations
    assert (with_rules.multiplications, with_rules.additions) <= (116, 89)  # 126, 102 if first moments are not grouped
    free = replace(robot, moving_base=True)
    few = group_inertial_parameters(free)
    assert all(
        link.inertia.first_moments.all() for number, link in enumerate(few.links) if robot.name[number - 1] == "P"
    )
    rng = np.random.default_rng(1)
    q, qd, qdd, base = rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3), rng.uniform(-1, 1, (2, 6))
    Y = regressor(free, q, qd, qdd, *base)
    np.testing.assert_allclose(Y @ parameters(few), Y @ parameters(free), rtol=1e-11, atol=1e-11)


def test_independent_columns_give_the_base_parameters_of_the_rx90():
    """Their number is the published one, 40 with rotor inertias, and the efforts depend on them alone."""
    rng = np.random.default_rng(1)
    robot = load_robot("rx90")
    Y = motions(robot, rng)
    drives = [k for k, key in enumerate(parameter_names(robot)) if key.split(".")[0] not in ("Fv", "Fs")]
    kept, dependent, K, _ = select_independent_columns(Y[:, drives])
    assert len(kept) == 40 and len(kept) + len(dependent) == len(drives)
    theta = parameters(robot)[drives]
    base = theta[kept] + K @ theta[dependent]
    np.testing.assert_allclose(Y[:, drives][:, kept] @ base, Y[:, drives] @ theta, atol=1e-9)


def test_rotor_of_a_first_joint_is_grouped_without_changing_efforts():
    robot = load_robot("rx90")
    few = group_inertial_parameters(robot)
    assert few.joints[0].rotor_inertia == 0 and few.joints[1].rotor_inertia == robot.joints[1].rotor_inertia
    q, qd, qdd = np.random.default_rng(2).uniform(-1, 1, (3, 5, 6))
    expected = Dynamics(robot, compiled=False).inverse(q, qd, qdd)
    np.testing.assert_allclose(Dynamics(few, compiled=False).inverse(q, qd, qdd), expected, rtol=1e-10, atol=1e-10)
