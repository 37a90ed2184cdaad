"""Maps of frequencies, and modes as they are drawn."""

import numpy as np
import pytest
from peers.navaro import BAR_LENGTH, GROUND, navaro_frame

from robot_dynamics import Dynamics, InvalidInputError, load_robot
from robot_dynamics.cli.frequency_plots import map_html, mode_html, save_map_png
from robot_dynamics.flexible.frequency_map import frequency_map
from robot_dynamics.parallel.platform_dynamics import pose_from_coordinates


@pytest.fixture(scope="module")
def dynamics():
    return Dynamics(load_robot("navaro"))


@pytest.fixture(scope="module")
def found(dynamics):
    axes = {"x": np.array([-0.15, 0.02, 0.5]), "y": np.array([-0.15, 0.07])}
    done = []
    found = frequency_map(dynamics, axes, {"yaw": -0.1}, count=5, threads=2, progress=done.append)
    assert done == [1.0]
    return found


def test_a_map_is_the_frame_of_finite_elements_at_each_pose(found):
    assert found.frequencies.shape == (3, 2, 5)
    assert found.reachable.tolist() == [[True, True], [True, True], [False, False]]
    assert np.isnan(found.frequencies[2]).all()
    for i, x in enumerate(found.axes["x"][:2]):
        for j, y in enumerate(found.axes["y"]):
            expected = navaro_frame(x, y, -0.1).frequencies()[:5]
            assert np.abs(found.frequencies[i, j] / expected - 1).max() < 1e-8


def test_coordinates_that_a_platform_has_not(dynamics):
    with pytest.raises(InvalidInputError, match="unknown coordinate of a platform 'w'"):
        frequency_map(dynamics, {"w": np.zeros(2)})


def test_welded_ends_move_together_and_feet_stay(dynamics):
    pose = pose_from_coordinates(np.array([0.02, -0.05, 0, 0.1, 0, 0]))
    elastodynamics = dynamics.elastodynamics
    q = elastodynamics.positions(pose=pose)
    answer = elastodynamics.natural_frequencies(q, count=6)
    for shape in answer.mode_shapes:
        rests, moves = elastodynamics.node_positions(q, shape)
        largest = np.abs(moves).max()
        welds = np.linalg.norm(rests - pose[:3, 3], axis=1) < 1e-9
        assert welds.sum() >= 4  # the platform, and the end of each leg
        assert np.ptp(moves[welds], axis=0).max() < 1e-9 * largest
        feet = np.abs(np.linalg.norm(rests, axis=1) - GROUND) < 1e-9
        assert feet.sum() >= 6
        assert not moves[feet].any()
    lengths = [np.linalg.norm(rests[a] - rests[b]) for a, b in elastodynamics.segments]
    assert sum(abs(length - BAR_LENGTH) < 1e-9 for length in lengths) == 15


def test_a_map_is_a_picture(found, tmp_path):
    save_map_png("navaro", found, tmp_path / "map.png")
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")


def test_pages_need_nothing_else(dynamics, found):
    pytest.importorskip("plotly", reason="plotly, which draws in HTML, is not installed")
    elastodynamics = dynamics.elastodynamics
    q = dynamics.initial_joint_positions
    shape = elastodynamics.natural_frequencies(q, count=1).mode_shapes[0]
    drawn = *elastodynamics.node_positions(q, shape), elastodynamics.segments
    pages = [map_html("navaro", found), mode_html("navaro", "mode 1", *drawn)]
    for page in pages:
        assert "<script src" not in page and "Plotly.newPlot" in page
    assert "addFrames" in pages[1]
