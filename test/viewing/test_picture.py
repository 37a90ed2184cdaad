"""Pictures without a browser: what is nearer hides what is farther, and shapes are where the projection puts them."""

import io

import numpy as np
import pytest

from robot_dynamics import load_robot
from robot_dynamics.model.loading import shipped_robots

pytest.importorskip("trimesh")
pytest.importorskip("PIL")
import trimesh
from PIL import Image
from scipy.spatial import ConvexHull

from robot_dynamics.viewing.body import Body
from robot_dynamics.viewing.picture import MARGIN, VIEW_DIRECTION, draw_bodies, robot_picture, view_axes

RED, BLUE = (200, 0, 0), (0, 0, 200)


def body(colour, centre, size):
    mesh = trimesh.creation.box([size] * 3)
    mesh.apply_translation(centre)
    return Body("box", 0, mesh, colour)


def test_nearer_body_hides_the_farther_one():
    towards = VIEW_DIRECTION / np.linalg.norm(VIEW_DIRECTION)
    for order in (1, -1):
        bodies = [body(RED, 3 * towards, 1.0), body(BLUE, -3 * towards, 2.0)][::order]
        pixels = draw_bodies(bodies, np.eye(4)[None], 200, 160)
        red, green, blue, opacity = pixels[80, 100]
        assert red > 50 and green == 0 and blue == 0 and opacity == 255
        border = pixels[:, 100][:: 160 - 1]
        assert (border[:, 3] == 0).all()  # nothing is drawn in the margin
        assert (pixels[..., 2] > 50).any()  # the larger one is seen around it


def test_outline_is_that_of_the_projected_corners():
    """The opaque area is the convex hull of the projected corners: its area, and its extent up to the margin."""
    pose = trimesh.transformations.random_rotation_matrix(np.array([0.2, 0.5, 0.7]))
    box = trimesh.creation.box([1.0, 0.5, 0.3])
    pixels = draw_bodies([Body("box", 0, box, RED)], pose[None], 300, 200)
    corners = (box.vertices @ pose[:3, :3].T) @ view_axes(VIEW_DIRECTION)[:2].T
    scale = ((1 - 2 * MARGIN) * np.array([300, 200]) / np.ptp(corners, axis=0)).min()
    expected = ConvexHull(corners).volume * scale**2  # of two dimensions: the area
    assert pixels[..., 3].sum() / 255 == pytest.approx(expected, rel=0.01)
    rows, columns = np.nonzero(pixels[..., 3])
    extents = np.array([np.ptp(columns), np.ptp(rows)]) + 1
    np.testing.assert_allclose(extents, np.ptp(corners, axis=0) * scale, atol=2)


@pytest.mark.parametrize("name", sorted({*shipped_robots()} - {"andrews_squeezer", "bricard"}))
@pytest.mark.slow
def test_shipped_robots_are_drawn_in_some_kilobytes(name):
    data = robot_picture(load_robot(name))
    picture = np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"))
    assert len(data) < 20_000 and (picture[..., 3] > 0).mean() > 0.02
    assert picture[..., 3].any(axis=1)[[0, -1]].all(), "empty rows are cut off"
