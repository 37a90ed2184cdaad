"""Frequency maps, and pictures of modes."""

import numpy as np
import pytest
from peers.navaro import BAR_LENGTH, GROUND, navaro_frame

from robot_dynamics import Dynamics, InvalidInputError, load_robot
from robot_dynamics.flexible.frequency_map import frequency_map
from robot_dynamics.parallel.platform_dynamics import pose_from_coordinates
from robot_dynamics.plots.frequency_map_plot import draw_frequency_map
from robot_dynamics.plots.map_page import frequency_map_page


@pytest.fixture(scope="module")
def dynamics():
    return Dynamics(load_robot("navaro"))


@pytest.fixture(scope="module")
def frequencies_on_grid(dynamics):
    axes = {"x": np.array([-0.15, 0.02, 0.5]), "y": np.array([-0.15, 0.07])}
    done = []
    frequencies_on_grid = frequency_map(dynamics, axes, {"yaw": -0.1}, count=5, threads=2, progress=done.append)
    assert done == [1.0]
    return frequencies_on_grid


@pytest.mark.slow
def test_frequency_map_agrees_with_finite_elements_at_each_pose(frequencies_on_grid):
    assert frequencies_on_grid.frequencies.shape == (3, 2, 5)
    assert frequencies_on_grid.reachable.tolist() == [[True, True], [True, True], [False, False]]
    assert np.isnan(frequencies_on_grid.frequencies[2]).all()
    for i, x in enumerate(frequencies_on_grid.axes["x"][:2]):
        for j, y in enumerate(frequencies_on_grid.axes["y"]):
            expected = navaro_frame(x, y, -0.1).frequencies()[:5]
            assert np.abs(frequencies_on_grid.frequencies[i, j] / expected - 1).max() < 1e-8


def test_unknown_coordinate_is_refused(dynamics):
    with pytest.raises(InvalidInputError, match="unknown coordinate of a platform 'w'"):
        frequency_map(dynamics, {"w": np.zeros(2)})


def test_welded_ends_move_together_and_feet_stay(dynamics):
    pose = pose_from_coordinates(np.array([0.02, -0.05, 0, 0.1, 0, 0]))
    elastodynamics = dynamics.elastodynamics
    q = elastodynamics.positions(pose=pose)
    result = elastodynamics.natural_frequencies(q, count=6)
    for shape in result.mode_shapes:
        positions, displacements = elastodynamics.node_positions(q, shape)
        largest = np.abs(displacements).max()
        welds = np.linalg.norm(positions - pose[:3, 3], axis=1) < 1e-9
        assert welds.sum() >= 4  # the platform, and the end of each leg
        assert np.ptp(displacements[welds], axis=0).max() < 1e-9 * largest
        feet = np.abs(np.linalg.norm(positions, axis=1) - GROUND) < 1e-9
        assert feet.sum() >= 6
        assert not displacements[feet].any()
    lengths = [np.linalg.norm(positions[a] - positions[b]) for a, b in elastodynamics.segments]
    assert sum(abs(length - BAR_LENGTH) < 1e-9 for length in lengths) == 15


def test_frequency_map_is_saved_as_a_picture(frequencies_on_grid, tmp_path):
    draw_frequency_map(tmp_path / "map.png", frequencies_on_grid, "navaro")
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")


def test_html_page_of_a_map_is_self_contained(frequencies_on_grid):
    pytest.importorskip("plotly", reason="plotly, which draws in HTML, is not installed")
    page = frequency_map_page(frequencies_on_grid, "navaro")
    assert "<script src" not in page and "Plotly.newPlot" in page
