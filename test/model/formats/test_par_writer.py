"""Robots written as SYMORO+ .par and read back: the same names, frames and dynamics, or a refusal that says why."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from peers.random_robots import random_states, random_urdf

from robot_dynamics import DescriptionError, Dynamics
from robot_dynamics.model.formats.par.reader import read_par
from robot_dynamics.model.formats.par.writer import find_harmless_losses, write_par
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint, Limits, Mimic, Spring
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh
from robot_dynamics.model.minimal_frames import minimal_frames
from robot_dynamics.model.robot import Frame, Link, Robot


def same(robot, back):
    """Return whether two robots are equal but for rounding and for parameters that have no effect."""
    assert back.name == robot.name and back.moving_base == robot.moving_base
    assert [link.name for link in back.links] == [link.name for link in robot.links]
    assert back.frames_by_name.keys() == robot.frames_by_name.keys()
    for name, frame in robot.frames_by_name.items():
        assert back.frames_by_name[name].link == frame.link
        np.testing.assert_allclose(back.frames_by_name[name].placement, frame.placement, atol=1e-13)
    for joint, read in zip(robot.joints, back.joints, strict=True):
        np.testing.assert_allclose(read.placement, joint.placement, atol=1e-13)
        for key in read.__dict__.keys() - {"placement"}:
            assert getattr(read, key) == getattr(joint, key)
    for link, read in list(zip(robot.links, back.links, strict=True))[0 if robot.moving_base else 1 :]:
        np.testing.assert_array_equal(read.inertia.spatial, link.inertia.spatial)
    np.testing.assert_array_equal(back.gravity, robot.gravity)


def without_limits(robot):
    return replace(robot, joints=tuple(replace(joint, limits=Limits()) for joint in robot.joints))


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("frames", [minimal_frames, lambda robot: robot], ids=["minimal", "as read"])
@pytest.mark.parametrize("seed", range(6))
def test_par_of_a_robot_has_the_same_dynamics(seed, frames, moving):
    robot = without_limits(read_urdf(random_urdf(seed), moving_base=moving, gravity=(1, -2, -9)))
    written = frames(robot)
    back = read_par(write_par(written))
    same(written, back)
    joints = len(robot.joints)
    states = random_states(robot, joints, 3, seed)
    expected, actual = Dynamics(robot), Dynamics(back)
    assert actual.joint_names == expected.joint_names
    inputs = {"base": states.base, "external_wrenches": states.wrenches}
    efforts = expected.inverse(states.q, states.qd, states.qdd, **inputs)
    np.testing.assert_allclose(actual.inverse(states.q, states.qd, states.qdd, **inputs), efforts, rtol=1e-9, atol=1e-9)
    A = expected.inertia_matrix(states.q)
    np.testing.assert_allclose(actual.inertia_matrix(states.q), A, rtol=1e-9, atol=1e-9)
    accelerations = expected.direct(states.q, states.qd, efforts, **inputs)
    again = actual.direct(states.q, states.qd, efforts, **inputs)
    np.testing.assert_allclose(again, accelerations, rtol=1e-7, atol=1e-9 * max(1, np.abs(accelerations).max()))


def small_robot(joint=None, name="robot", tool="tool", placement=None, second=None):
    """Return a robot with two joints: `joint` and a prismatic one."""
    joint = joint or Joint("j1", 0, False, placement_from_mdh(MDHParameters(theta=math.pi / 3)))
    second = second or Joint("j2", 1, True, placement_from_mdh(MDHParameters(alpha=1e-4, d=0.3, r=-0.1)))
    frames = [
        Frame("base", 0, np.eye(4)),
        Frame("l1", 1, placement_from_mdh(MDHParameters(0.1, 0.2, 0.3, 0.4, 0.5, 0.6))),
    ]
    frames += [Frame("l2", 2, np.eye(4)), Frame(tool, 2, np.eye(4) if placement is None else placement)]
    links = tuple(Link(link, Inertia(1.0, (0.1, 0, 0), np.eye(3))) for link in ("base", "l1", "l2"))
    return Robot(name, links, (joint, second), tuple(frames))


@pytest.mark.parametrize("placement", [None, placement_from_mdh(MDHParameters(alpha=-1e-5, theta=0.2, r=0.3))])
def test_named_frames_are_unchanged_in_a_par(placement):
    robot = small_robot(placement=placement)
    text = write_par(robot)
    same(robot, read_par(text))
    assert "theta = {th1 + pi/3," in text and "(* Lost: the inertia of the fixed base" in text


def test_joint_variables_are_written_with_their_constants():
    second = Joint(
        "j2", 1, True, placement_from_mdh(MDHParameters(alpha=math.pi / 2, d=0.3, theta=-5 * math.pi / 12, r=-0.125))
    )
    text = write_par(small_robot(second=second))
    assert "\ntheta = {th1 + pi/3,-5*pi/12," in text and "\nr = {0,r2 - 0.125," in text
    assert "\nalpha = {0,pi/2," in text and "\nsigma = {0,1,2}" in text


def test_roles_are_written():
    elastic = Joint("j1", 0, False, np.eye(4), actuated=False, spring=Spring(12.5))
    passive = Joint("j1", 0, False, np.eye(4), actuated=False)
    for robot in (small_robot(elastic), small_robot(passive)):
        same(robot, read_par(write_par(robot)))


@pytest.mark.slow
@given(st.text(min_size=0, max_size=12), st.text(max_size=5))
@settings(max_examples=200, deadline=None)
def test_name_is_unchanged_or_refused(tool, name):
    try:
        text = write_par(small_robot(name=name, tool=tool, placement=placement_from_mdh(MDHParameters(d=1))))
    except DescriptionError as error:
        assert "cannot stand in a comment" in str(error) or "more than once" in str(error)
    else:
        back = read_par(text.encode())
        assert back.name == name and back.frames_by_name[tool].placement[0, 3] == 1


LOST = {
    "mimics joint 'j2'": {"mimic": Mimic("j2")},
    "has asymmetric friction": {"coulomb_friction": 1.0, "coulomb_asymmetry": 0.5},
    "has Stribeck friction and has load-dependent friction": {
        "stribeck_friction": 1.0,
        "stribeck_velocity": 0.1,
        "load_friction": 0.2,
    },
    "has a spring beside its motor": {"spring": Spring(1)},
    "has a spring with a rest position other than zero and has a spring with damping": {
        "spring": Spring(1, 2, 3),
        "actuated": False,
    },
}


@pytest.mark.parametrize("loss", LOST)
def test_losses_of_a_par_are_refused_or_listed_in_a_comment(loss):
    robot = small_robot(Joint("j1", 0, False, np.eye(4), **LOST[loss]))
    with pytest.raises(DescriptionError, match=f"joint 'j1' {loss}"):
        write_par(robot)
    text = write_par(robot, lossy=True)
    assert f"(* Lost: joint 'j1' {loss} *)" in text
    assert read_par(text).joints[0].role == ("elastic" if "rest" in loss else "actuated")


def test_limits_are_left_out_of_a_par_without_refusal():
    robot = small_robot(Joint("j1", 0, False, np.eye(4), limits=Limits(upper=1)))
    text = write_par(robot)
    assert "(* Lost: limits of 'j1', which enter no equation *)" in text
    assert read_par(text).joints[0].limits == Limits()
    assert find_harmless_losses(robot)[0] == "limits of 'j1', which enter no equation"


def test_passive_joints_alone_are_refused():
    passive = [Joint(f"j{k + 1}", k, False, np.eye(4), actuated=False) for k in range(2)]
    with pytest.raises(DescriptionError, match="at least one actuated joint"):
        write_par(small_robot(passive[0], second=passive[1]))


@pytest.mark.slow
def test_a_chain_of_two_thousand_rows_is_read_back():
    joints = [
        Joint(f"j{k}", k, False, placement_from_mdh(MDHParameters(0, 0, 0.1, 0.1, k / 7, 0.3))) for k in range(2000)
    ]
    links = [Link(f"l{k}", Inertia(1 / 3, (0.1, 0.2, 0.3), np.eye(3) / 7)) for k in range(2001)]
    robot = Robot("snake", tuple(links), tuple(joints), tuple(Frame(f"l{k}", k, np.eye(4)) for k in range(2001)))
    same(robot, read_par(write_par(robot)))
    with pytest.raises(DescriptionError, match="the maximum is 2000"):
        write_par(replace(robot, frames=(*robot.frames, Frame("tool", 5, placement_from_mdh(MDHParameters(d=1))))))
