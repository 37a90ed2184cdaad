"""A robot as a still picture of some kilobytes: its shapes, drawn without a browser or a graphics card."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.model.visual import MeshShape
from robot_dynamics.optional_packages import import_optional
from robot_dynamics.viewing.body import LINK_COLOUR
from robot_dynamics.viewing.configuration import Configuration
from robot_dynamics.viewing.robot_bodies import robot_bodies

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.viewing.body import Body

    Pixels = NDArray[np.uint8]

VIEW_DIRECTION = np.array([1.0, -1.2, 0.65])
"""From the robot to the eye, in frame 0: as the first view of the viewer."""
LIGHT_DIRECTION = np.array([0.55, -0.35, 0.9])
SAMPLES = 2
"""Samples of a pixel in each direction, which soften edges."""
MARGIN = 0.04
AMBIENT = 0.45
COLOURS = 64
"""Colours of the picture."""


def robot_picture(robot: Robot, width: int = 420, height: int = 340) -> bytes:
    """Return a PNG picture of a robot at its initial positions, on a transparent ground.

    A robot whose description has mesh files is drawn as bones and joint symbols: meshes take seconds to read.

    Parameters
    ----------
    robot : Robot
    width, height : int
        Largest size [pixels]; what is empty is cut off.

    Raises
    ------
    MissingPackageError
        pillow is not installed.
    """
    image = import_optional("PIL.Image", "a picture of a robot")
    configuration = Configuration(robot)
    has_meshes = any(isinstance(visual.shape, MeshShape) for visual in robot.visuals)
    bodies, _ = robot_bodies(replace(robot, visuals=()) if has_meshes else robot, configuration.q)
    pixels = draw_bodies(bodies, configuration.link_poses(), width, height)
    stream = io.BytesIO()
    picture = image.fromarray(pixels)
    picture.crop(picture.getbbox()).quantize(COLOURS).save(stream, format="PNG", optimize=True)
    return stream.getvalue()


def draw_bodies(bodies: list[Body], link_poses: Array, width: int, height: int) -> Pixels:
    """Draw bodies in parallel projection, the nearest surface at each pixel.

    Parameters
    ----------
    bodies : list of Body
    link_poses : ndarray, shape (links, 4, 4)
        Poses of the link frames [m].
    width, height : int
        Size of the picture [pixels].

    Returns
    -------
    ndarray of uint8, shape (height, width, 4)
        Red, green, blue, opacity.
    """
    size = np.array([width, height]) * SAMPLES
    corners, colours = _triangles(bodies, link_poses)
    axes = view_axes(VIEW_DIRECTION)
    colours = colours * _brightness(corners)[:, None]
    points = _fit(corners @ axes.T, size)
    canvas = np.zeros((size[1], size[0], 4))
    depths = np.full((size[1], size[0]), -np.inf)
    for triangle, colour in zip(points, colours, strict=True):
        _fill(canvas, depths, triangle, colour)
    blocks = canvas.reshape(height, SAMPLES, width, SAMPLES, 4).mean(axis=(1, 3))
    opacity = blocks[..., 3:]
    blocks[..., :3] /= np.where(opacity > 0, opacity, 1)  # samples beside the robot have no colour
    blocks[..., 3] *= 255
    pixels: Pixels = blocks.round().clip(0, 255).astype(np.uint8)
    return pixels


def view_axes(direction: Array) -> Array:
    """Return the axes (3, 3) of a picture, as rows: to the right, upwards, and to the eye, z upright."""
    towards = direction / np.linalg.norm(direction)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])


def _triangles(bodies: list[Body], link_poses: Array) -> tuple[Array, Array]:
    """Return the corners (F, 3, 3) of all faces in frame 0 [m], and their colours (F, 3), 0 to 255."""
    corners, colours = [np.zeros((0, 3, 3))], [np.zeros((0, 3))]
    for body in bodies:
        pose = link_poses[body.link]
        vertices = np.asarray(body.mesh.vertices) @ pose[:3, :3].T + pose[:3, 3]
        faces = np.asarray(body.mesh.faces)
        corners.append(vertices[faces])
        colours.append(np.tile(np.array(body.colour or LINK_COLOUR, dtype=float), (len(faces), 1)))
    return np.concatenate(corners), np.concatenate(colours)


def _brightness(corners: Array) -> Array:
    """Return the brightness (F,) of faces, 0 to 1, whichever side is seen."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    towards = view_axes(VIEW_DIRECTION)[2]
    sides = np.where(normals @ towards < 0, -1.0, 1.0)
    light = LIGHT_DIRECTION / np.linalg.norm(LIGHT_DIRECTION)
    cosines = sides * (normals @ light) / np.where(lengths > 0, lengths, 1)
    return np.asarray(AMBIENT + (1 - AMBIENT) * np.clip(cosines, 0, 1))


def _fit(points: Array, size: NDArray[Any]) -> Array:
    """Return points (F, 3, 3) in pixels, so that they fill a picture of a size (2,), with depths in pixels."""
    flat = points.reshape(-1, 3)
    if not len(flat):
        return points
    low, high = flat.min(axis=0), flat.max(axis=0)
    extent = np.maximum(high - low, 1e-12 * float(np.ptp(flat)) + 1e-300)
    scale = float(((1 - 2 * MARGIN) * size / extent[:2]).min())
    fitted: Array = (points - (low + high) / 2) * scale
    fitted[..., 1] *= -1  # rows of a picture are counted downwards
    fitted[..., :2] += size / 2
    return fitted


def _fill(canvas: Array, depths: Array, triangle: Array, colour: Array) -> None:
    """Fill a triangle (3, 3) of columns, rows and depths where nothing is nearer."""
    (x0, y0, _), (x1, y1, _), (x2, y2, _) = triangle
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if not abs(area) > 1e-9:
        return
    left, top = np.maximum(np.floor(triangle[:, :2].min(axis=0)).astype(int), 0)
    right, bottom = np.ceil(triangle[:, :2].max(axis=0)).astype(int) + 1
    part = depths[top:bottom, left:right]
    x = left + 0.5 + np.arange(part.shape[1])
    y = (top + 0.5 + np.arange(part.shape[0]))[:, None]
    second = ((x - x0) * (y2 - y0) - (x2 - x0) * (y - y0)) / area
    third = ((x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)) / area
    first = 1 - second - third
    depth = triangle[:, 2] @ np.array([first, second, third]).reshape(3, -1)
    depth = depth.reshape(part.shape)
    visible = (first >= 0) & (second >= 0) & (third >= 0) & (depth > part)
    part[visible] = depth[visible]
    canvas[top:bottom, left:right][visible] = (*colour, 1.0)
