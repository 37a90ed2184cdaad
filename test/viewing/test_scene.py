"""Shapes in a scene: those with several colours are drawn in them, and in red where a robot is singular."""

import numpy as np
import pytest
import trimesh

from robot_dynamics import load_robot
from robot_dynamics.viewing.body import SINGULAR_COLOUR, Body

pytest.importorskip("viser")
from robot_dynamics.viewing.page_server import HOST, make_server, stop_server
from robot_dynamics.viewing.scene import MAX_COLOURS, RobotScene, parts_by_colour


@pytest.fixture
def scene():
    server = make_server("test", 8591, HOST)
    yield server.scene
    stop_server(server)


def coloured_box(colours):
    """A box whose faces have colours (12, 4)."""
    mesh = trimesh.creation.box((1, 2, 3))
    mesh.visual = trimesh.visual.ColorVisuals(mesh, face_colors=np.array(colours, np.uint8))
    return Body("box", 1, mesh, None)


def test_shape_with_colours_is_drawn_in_them_and_in_red_where_singular(scene):
    colours = [[255, 0, 0, 255]] * 5 + [[0, 0, 255, 255]] * 4 + [[0, 90, 0, 128]] * 3
    drawn = RobotScene(scene, load_robot("rx90"), [coloured_box(colours)])
    expected = {(255, 0, 0): 5, (0, 0, 255): 4, (0, 90, 0): 3}
    assert {tuple(handle.color): len(body.mesh.faces) for body, handle in drawn.meshes} == expected
    assert {handle.color: handle.opacity for _, handle in drawn.meshes}[(0, 90, 0)] == pytest.approx(128 / 255)
    assert sum(body.mesh.area for body, _ in drawn.meshes) == pytest.approx(22)
    drawn.mark_singular(True)
    assert [tuple(handle.color) for _, handle in drawn.meshes] == [SINGULAR_COLOUR] * 3
    drawn.mark_singular(False)
    assert {tuple(handle.color) for _, handle in drawn.meshes} == set(expected)


def test_shape_of_very_many_colours_gets_the_most_frequent_ones():
    mesh = trimesh.creation.icosphere(2)
    colours = np.full((len(mesh.faces), 4), 255, np.uint8)
    colours[:, 0] = np.arange(len(mesh.faces)) % 250
    mesh.visual = trimesh.visual.ColorVisuals(mesh, face_colors=colours)
    parts = parts_by_colour(Body("ball", 1, mesh, None))
    assert len(parts) == MAX_COLOURS and sum(len(part.mesh.faces) for part in parts) == len(mesh.faces)


def test_node_of_a_link_without_shapes_moves_with_it(scene):
    robot = load_robot("rx90")
    drawn = RobotScene(scene, robot, [])
    name = drawn.link_node(3)
    poses = np.tile(np.eye(4), (len(robot.links), 1, 1))
    poses[3, :3, 3] = [1, 2, 3]
    drawn.move(poses)
    assert drawn.link_frames[3].name == name and drawn.link_frames[3].position.tolist() == [1, 2, 3]
