"""Loops stay closed while a user moves joints and platforms."""

import numpy as np
import pytest
from viewing.drawn_loops import largest_gap

from robot_dynamics import Inertia, InvalidInputError, load_robot, shipped_robots
from robot_dynamics.model.loading import read_robot
from robot_dynamics.viewing.configuration import Configuration
from robot_dynamics.viewing.value_range import Range

LOOPED = [name for name in shipped_robots() if load_robot(name).loops]
PARALLEL = [name for name in LOOPED if load_robot(name).platforms]


def gap(configuration):
    return largest_gap(configuration.robot, dict(enumerate(configuration.link_poses())))


@pytest.mark.parametrize("name", LOOPED)
def test_loops_stay_closed_while_joints_move(name):
    configuration = Configuration(load_robot(name))
    start = configuration.independent_positions
    size = 0.05 * configuration.robot.characteristic_length
    moved = 0
    for sample in np.random.default_rng(0).uniform(-size, size, (6, len(start))):
        moved += configuration.move_joints(start + sample)
        assert gap(configuration) < 1e-9
    assert moved > 0
    assert np.abs(configuration.independent_positions - start).max() > 0


@pytest.mark.parametrize("name", PARALLEL)
def test_platforms_move_to_their_coordinates(name):
    configuration = Configuration(load_robot(name))
    for link, platform in zip(configuration.robot.platform_links, configuration.robot.platforms, strict=True):
        free = ["xyz".index(coordinate) for coordinate in platform.free if coordinate in "xyz"]
        wanted = configuration.platform_coordinates(link)
        wanted[free] += 0.02 * configuration.robot.characteristic_length
        assert configuration.move_platform(link, wanted)
        assert np.abs(configuration.platform_coordinates(link)[free] - wanted[free]).max() < 1e-9
        assert gap(configuration) < 1e-9


def test_robot_stays_where_a_platform_cannot_go():
    configuration = Configuration(load_robot("delta"))
    before = configuration.q
    assert not configuration.move_platform("platform", [0, 0, -9, 0, 0, 0])
    assert configuration.problem and np.array_equal(configuration.q, before)
    assert configuration.move_platform("platform", [0.1, 0, -0.9, 0, 0, 0]) and not configuration.problem


def test_unknown_platform_is_refused():
    with pytest.raises(InvalidInputError, match="platfrom"):
        Configuration(load_robot("delta")).move_platform("platfrom", np.zeros(6))


@pytest.mark.parametrize("name", ["four_bar", "five_bar", "delta", "gough_stewart"])
def test_singularity_is_the_largest_rate_by_finite_differences(name):
    configuration = Configuration(load_robot(name))
    joints = configuration.robot.joints
    length = configuration.robot.characteristic_length
    units = np.array([1.0 if joint.prismatic else length for joint in joints])
    start = configuration.independent_positions
    rates = []
    for column, index in enumerate(configuration.independent):
        ends = []
        for step in (-1e-6, 1e-6):
            assert configuration.move_joints(start + step * np.eye(len(start))[column])
            ends.append(configuration.q)
        rates.append((ends[1] - ends[0]) / 2e-6 * units / units[index])
    assert configuration.move_joints(start)
    assert configuration.singularity() == pytest.approx(np.abs(rates).max(), rel=1e-5)


def test_delta_is_singular_where_its_rods_are_stretched():
    """At the lower end of the workspace arms and rods are in line."""
    configuration = Configuration(load_robot("delta"))
    before = configuration.platform_condition()
    z = configuration.platform_coordinates("platform")[2]
    while configuration.move_platform("platform", [0, 0, z, 0, 0, 0]):
        z -= 1e-4
        assert z > -5
    assert configuration.problem and not configuration.move_platform("platform", [0, 0, z, 0, 0, 0])
    assert configuration.platform_condition() > 4 * before


def test_ranges_contain_the_present_position():
    configuration = Configuration(load_robot("panda"))
    for index, joint in enumerate(configuration.robot.joints):
        limits = configuration.joint_range(index, 1.0)
        assert (limits.lower, limits.upper) == (joint.limits.lower, joint.limits.upper)
    assert Range(-1.0, 2.0).clip(3.0) == 2.0 and Range(-1.0, 2.0).clip(-3.0) == -1.0


INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
GRIPPER = f"""<robot name="gripper"><link name="base"/>
<link name="left"><inertial><mass value="2"/>{INERTIA}</inertial></link>
<link name="right"><inertial><mass value="3"/>{INERTIA}</inertial></link>
<joint name="first" type="prismatic"><parent link="base"/><child link="left"/><axis xyz="0 0 1"/>
<limit lower="0" upper="1" effort="9" velocity="1"/></joint>
<joint name="second" type="prismatic"><parent link="base"/><child link="right"/><axis xyz="0 0 1"/>
<limit lower="0" upper="2" effort="9" velocity="1"/><mimic joint="first" multiplier="2"/></joint></robot>"""


def test_efforts_of_a_robot_with_a_mimic_joint_and_no_loops():
    """The work of the motor lifts 2 kg by a metre and 3 kg by two."""
    configuration = Configuration(read_robot(GRIPPER, source="a gripper"))
    assert configuration.move_joints([0.5]) and configuration.q == pytest.approx([0.5, 1.0])
    weight = -configuration.robot.gravity[2]
    assert configuration.holding_efforts() == pytest.approx([weight * (2 + 2 * 3)])


@pytest.mark.parametrize("name", ["panda", "five_bar"])
def test_payload_is_held_by_the_derivative_of_its_potential_energy(name):
    """The efforts change by dV/dq of a mass at a point of the last frame, by finite differences of its height."""
    configuration = Configuration(load_robot(name))
    frame = configuration.robot.frames[-1]
    mass, centre = 2.0, np.array([0.05, -0.1, 0.2])
    start = configuration.independent_positions

    def height(step):
        assert configuration.move_joints(start + step)
        return (configuration.link_poses()[frame.link] @ frame.placement @ [*centre, 1])[2]

    rates = [(height(1e-5 * e) - height(-1e-5 * e)) / 2e-5 for e in np.eye(len(start))]
    configuration.move_joints(start)
    without = configuration.holding_efforts()
    configuration.carry(frame.name, Inertia.about_centre_of_mass(mass, np.zeros((3, 3)), centre))
    change = configuration.holding_efforts() - without
    assert change == pytest.approx(-configuration.robot.gravity[2] * mass * np.array(rates), abs=1e-6)
    configuration.carry(frame.name, Inertia())
    assert configuration.holding_efforts() == pytest.approx(without, abs=1e-12)


def test_ranges_of_a_platform_are_its_limits_or_parts_of_the_robot():
    delta, start = Configuration(load_robot("delta")), Configuration(load_robot("delta")).q
    x, _, z, yaw, *_ = delta.robot.platforms[0].joints
    assert delta.joint_range(x, 2.0) == Range(-0.4, 0.4) and delta.joint_range(z, 2.0) == Range(-1.15, -0.85)
    assert delta.joint_range(yaw, 2.0) == Range(start[yaw] - np.pi / 3, start[yaw] + np.pi / 3)
