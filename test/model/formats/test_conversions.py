"""URDF to MDH table and back: inverse and direct model and A stay what they are, to 1e-9, on real robots and random
trees, nearly parallel axes from 1e-12 to 1e-2 rad among them; names, frames and all else come along."""

import os
import re

import numpy as np
import pytest
from hypothesis import given, settings
from peers.described_robots import robots
from peers.random_robots import inertial, numbers, random_states, random_urdf
from peers.real_robots import REAL_ROBOTS, real_urdf

from robot_dynamics import Dynamics, Spring, shipped_robots
from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.model.formats.mdh_yaml.reader import read_mdh_yaml
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.formats.urdf.writer import write_urdf
from robot_dynamics.model.joint import Mimic
from robot_dynamics.model.joint_friction import FRICTION_FIELDS
from robot_dynamics.model.loading import load_robot
from robot_dynamics.model.minimal_frames import minimal_frames, snap_angles

pytestmark = pytest.mark.slow

TOLERANCE = 1e-9
TREES = int(os.environ.get("RANDOM_TREES", "50"))  # of each kind


def relative_error(actual, expected):
    return np.abs(actual - expected).max(initial=0) / max(np.abs(expected).max(initial=0), 1e-9)


def misaligned_urdf(seed):
    """Return a tree whose axes are turned from their parents' by whole right angles and by 1e-12 to 1e-2 rad more.

    Every link has mass: between two joints that slide the same way a link without it would leave A singular.
    """
    rng = np.random.default_rng(seed)

    def misalign(match):
        quarter = rng.integers(-1, 3, 3) * np.pi / 2
        tilt = rng.normal(size=3) * 10 ** rng.uniform(-12, -2)
        return f'rpy="{numbers(quarter + tilt)}"'

    text = re.sub(r'rpy="[^"]*"', misalign, random_urdf(seed))
    text = re.sub(r'(<link name="\w*">)(</link>)', lambda match: f"{match[1]}{inertial(rng)}{match[2]}", text)
    return re.sub(r'axis xyz="[^"]*"', 'axis xyz="0 0 1"', text)


def check_same(robot, converted, seed, frames=True):
    """The same motion needs the same efforts, with wrenches on links by name; link poses are equal."""
    before, after = Dynamics(robot), Dynamics(converted)
    order = [after.joint_names.index(name) for name in before.joint_names]
    assert sorted(order) == list(range(len(after.joint_names))) and converted.name == robot.name
    assert converted.moving_base == robot.moving_base
    assert set(robot.frames_by_name) <= set(converted.frames_by_name)
    states = random_states(robot, len(order), 10, seed)
    base, wrenches = states.base, states.wrenches

    def shuffled(values):
        permuted = np.zeros_like(values)
        permuted[..., order] = values
        return permuted

    q, qd, qdd = states.q, states.qd, states.qdd
    inverse = before.inverse(q, qd, qdd, base=base, external_wrenches=wrenches)
    result = after.inverse(shuffled(q), shuffled(qd), shuffled(qdd), base=base, external_wrenches=wrenches)
    assert relative_error(result[:, order], inverse) < TOLERANCE
    A, B = before.inertia_matrix(q), after.inertia_matrix(shuffled(q))
    rows = [*range(A.shape[-1] - len(order)), *(k + A.shape[-1] - len(order) for k in order)]
    assert relative_error(B[:, rows][:, :, rows], A) < TOLERANCE
    direct = before.direct(q, qd, inverse, base=base, external_wrenches=wrenches)
    again = after.direct(shuffled(q), shuffled(qd), shuffled(inverse), base=base, external_wrenches=wrenches)
    condition = np.linalg.cond(A).max() if A.size else 1
    assert relative_error(again[:, order], direct) < TOLERANCE * max(1, condition / 1e5)
    for name in robot.frames_by_name:
        expected = before.link_pose(name, q, base=base)
        np.testing.assert_allclose(after.link_pose(name, shuffled(q), base=base), expected, rtol=0, atol=1e-11)


def check_conversions(urdf, moving_base, seed):
    robot = read_urdf(urdf, moving_base=moving_base)
    text = write_mdh_yaml(minimal_frames(robot))
    from_yaml = read_mdh_yaml(text)
    check_same(robot, from_yaml, seed)
    from_urdf = read_urdf(write_urdf(from_yaml))
    check_same(robot, from_urdf, seed)
    for joint in robot.joints:
        for converted in (from_yaml, from_urdf):
            same = converted.joints[converted.joint_numbers[joint.name]]
            assert (same.limits.lower, same.limits.upper) == (joint.limits.lower, joint.limits.upper)
            assert same.mimic == joint.mimic and same.prismatic == joint.prismatic
            assert (same.viscous_friction, same.coulomb_friction) == (joint.viscous_friction, joint.coulomb_friction)


@pytest.mark.slow
@pytest.mark.parametrize("moving_base", [False, True], ids=["fixed", "moving"])
@pytest.mark.parametrize("name", REAL_ROBOTS)
def test_real_robot_is_unchanged_as_a_table_and_as_a_urdf(name, moving_base):
    check_conversions(real_urdf(name), moving_base, seed=3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(TREES))
def test_random_tree_is_unchanged_as_a_table_and_as_a_urdf(seed):
    check_conversions(random_urdf(seed), bool(seed % 2), seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(TREES))
def test_tree_with_nearly_parallel_axes_is_unchanged_as_a_table_and_as_a_urdf(seed):
    check_conversions(misaligned_urdf(seed), bool(seed % 2), seed)


@pytest.mark.parametrize("name", REAL_ROBOTS)
def test_serial_links_need_neither_gamma_nor_b(name):
    """In the first branch of each link but the base; axes that are nearly parallel made parallel before."""
    robot = minimal_frames(snap_angles(read_urdf(real_urdf(name)), 1e-3))
    text = write_mdh_yaml(robot)
    first = {}
    for number, joint in enumerate(robot.joints, start=1):
        first.setdefault(joint.antecedent, robot.links[number].name)
    rows = re.findall(r"link: (\S+)\n.*antecedent: (\S+)\n(?:    type: \S+\n)?    mdh: (.*)\n", text)
    simple = [mdh for link, antecedent, mdh in rows if antecedent != robot.base_link and link in first.values()]
    assert len(simple) == len({joint.antecedent for joint in robot.joints} - {0})
    assert all("gamma" not in mdh and "b:" not in mdh for mdh in simple)


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped_robots())
def test_shipped_robot_is_unchanged_by_write_and_read(name):
    robot = load_robot(name)
    again = read_mdh_yaml(write_mdh_yaml(robot))
    for joint, same in zip(robot.joints, again.joints, strict=True):
        assert_same_joint(same, joint)
    q = random_states(robot, len(Dynamics(robot).joint_names), 1, 0).q
    assert relative_error(Dynamics(again).inertia_matrix(q), Dynamics(robot).inertia_matrix(q)) < 1e-12


def assert_same_joint(actual, expected):
    """Assert that two joints are equal but for the placement, to rounding."""
    assert (actual.name, actual.antecedent, actual.prismatic) == (
        expected.name,
        expected.antecedent,
        expected.prismatic,
    )
    assert actual.role == expected.role and getattr(actual.mimic, "joint", "") == getattr(expected.mimic, "joint", "")
    np.testing.assert_allclose(numbers_of(actual), numbers_of(expected), rtol=1e-15, atol=0)


def numbers_of(joint):
    mimic = joint.mimic or Mimic("", 0.0, 0.0)
    spring = joint.spring or Spring(np.nan)
    limits = joint.limits
    return [
        *(joint.rotor_inertia, mimic.multiplier, mimic.offset),
        *(getattr(joint, field) for field in FRICTION_FIELDS),
        *(spring.stiffness, spring.rest, spring.damping),
        *(limits.lower, limits.upper, limits.velocity, limits.effort, joint.initial_position),
    ]


def assert_same_loops(actual, expected):
    assert [(loop.name, loop.is_spherical) for loop in actual.loops] == [
        (loop.name, loop.is_spherical) for loop in expected.loops
    ]
    for loop, same in zip(expected.loops, actual.loops, strict=True):
        for end, again in zip(loop.ends, same.ends, strict=True):
            assert again.link == end.link
            np.testing.assert_allclose(again.placement, end.placement, rtol=0, atol=1e-12)


@pytest.mark.slow
@settings(deadline=None, max_examples=300)
@given(robots())
def test_robots_are_unchanged_by_write_and_read(robot):
    again = read_mdh_yaml(write_mdh_yaml(robot))
    assert set(read_mdh_yaml(write_mdh_yaml(again)).frames_by_name) == set(robot.frames_by_name)
    assert (again.name, again.moving_base) == (robot.name, robot.moving_base)
    np.testing.assert_allclose(again.gravity, robot.gravity, rtol=1e-15, atol=0)
    assert [link.name for link in again.links] == [link.name for link in robot.links]
    for link, same in zip(robot.links, again.links, strict=True):
        np.testing.assert_allclose(same.inertia.spatial, link.inertia.spatial, rtol=1e-15, atol=0)
    for joint, same in zip(robot.joints, again.joints, strict=True):
        assert_same_joint(same, joint)
        np.testing.assert_allclose(same.placement, joint.placement, rtol=0, atol=1e-12)
    for frame in robot.frames:
        assert again.frames_by_name[frame.name].link == frame.link
        np.testing.assert_allclose(again.frames_by_name[frame.name].placement, frame.placement, rtol=0, atol=1e-12)
    assert_same_loops(again, robot)
    assert cut_joints(again) == cut_joints(robot)
