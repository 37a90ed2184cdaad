"""Assembly modes: those of planar linkages against closed forms, those of a Gough-Stewart platform by its geometry."""

import numpy as np
import pytest
from viewing.drawn_loops import largest_gap

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.viewing.assembly_search import find_assembly_modes
from robot_dynamics.viewing.configuration import Configuration


def circle_intersections(first, first_radius, second, second_radius):
    """Return the two points (2, 2) at these distances from two points."""
    along = np.subtract(second, first)
    distance = np.linalg.norm(along)
    share = (first_radius**2 - second_radius**2 + distance**2) / (2 * distance)
    height = np.sqrt(first_radius**2 - share**2)
    along = along / distance
    normal = np.array([-along[1], along[0]])
    return np.array([first + share * along + side * height * normal for side in (1, -1)])


def end_of_link(configuration, q, link, length):
    """Return (x, z) of the end of a bar along x of its link."""
    configuration.q = q
    pose = configuration.link_poses()[configuration.robot.frame(link).link]
    return (pose @ [length, 0, 0, 1])[[0, 2]]


def check_points(found, expected):
    assert len(found) == len(expected)
    order = [int(np.argmin(np.linalg.norm(found - point, axis=1))) for point in expected]
    assert sorted(order) == list(range(len(expected)))
    assert np.abs(found[order] - expected).max() < 1e-9


@pytest.mark.parametrize("crank", [0.3, 2.0, -2.5])
def test_four_bar_has_the_two_modes_of_the_closed_form(crank):
    configuration = Configuration(load_robot("four_bar"))
    q = configuration.dynamics.expand_positions([crank])
    modes = find_assembly_modes(configuration.dynamics, q)
    hinge = 2 * np.array([np.cos(crank), np.sin(crank)])
    knees = np.array([end_of_link(configuration, mode.q, "coupler", 8) for mode in modes])
    check_points(knees, circle_intersections(hinge, 8, np.array([10.0, 0.0]), 5))
    assert np.array_equal(modes[0].q, q) and modes[0].distance == 0


def test_five_bar_has_the_two_modes_of_the_closed_form():
    configuration = Configuration(load_robot("five_bar"))
    left, right = 0.4, 2.6
    modes = find_assembly_modes(configuration.dynamics, configuration.dynamics.expand_positions([left, right]))
    ends = [0.5 * np.array([np.cos(angle), np.sin(angle)]) for angle in (left, right)]
    apexes = np.array([end_of_link(configuration, mode.q, "left_rod", np.sqrt(4.25)) for mode in modes])
    expected = circle_intersections(ends[0], np.sqrt(4.25), ends[1] + [3.0, 0.0], np.sqrt(10.25))
    check_points(apexes, expected)


def test_modes_of_a_gough_stewart_platform_keep_its_legs_and_are_mirrored_by_its_flat_ground():
    """Ground and platform are flat here: the mirror image of a pose about the ground has the same leg lengths."""
    robot = load_robot("gough_stewart")
    dynamics = Dynamics(robot)
    configuration = Configuration(robot, dynamics)
    batches = iter(range(4))
    modes = find_assembly_modes(dynamics, configuration.q, lambda: next(batches, None) is None)
    heights = []
    for mode in modes:
        assert np.array_equal(mode.q[configuration.independent], configuration.independent_positions)
        configuration.q = mode.q
        assert largest_gap(robot, dict(enumerate(configuration.link_poses()))) < 1e-9
        heights.append(configuration.platform_coordinates(robot.platform_links[0])[2])
    assert len(modes) >= 4
    assert np.sort(heights) == pytest.approx(-np.sort(heights)[::-1], abs=1e-8)


def test_sliders_go_on_in_the_chosen_mode():
    configuration = Configuration(load_robot("five_bar"))
    other = find_assembly_modes(configuration.dynamics, configuration.q)[1]
    assert configuration.place(other.q) and configuration.is_at(other.q)
    start = configuration.independent_positions
    for share in np.linspace(0, 1, 12):
        assert configuration.move_joints(start + share * np.array([0.5, 0.4]))
        apex = end_of_link(configuration, configuration.q, "left_rod", np.sqrt(4.25))
        assert apex[1] < 0, "it went back to the mode of the description"


def test_tree_has_one_mode():
    configuration = Configuration(load_robot("rx90"))
    assert len(find_assembly_modes(configuration.dynamics, configuration.q)) == 1
