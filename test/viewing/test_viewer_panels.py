"""Panels of the page on the server: assembly modes, payload, external wrench, reference. No browser is needed."""

from types import SimpleNamespace

import numpy as np
import pytest

from robot_dynamics import load_robot

pytest.importorskip("viser")
from robot_dynamics.viewing.body import SINGULAR_COLOUR
from robot_dynamics.viewing.link_poses import frame_poses, link_matrices
from robot_dynamics.viewing.name_panel import describe_body
from robot_dynamics.viewing.played_motion import PlayedMotion
from robot_dynamics.viewing.scene import INSIDE_OPACITY
from robot_dynamics.viewing.viewer import Viewer


@pytest.fixture
def open_viewer():
    """Return a function that serves the page of a robot."""
    opened = []

    def open_robot(name, **options):
        opened.append(Viewer(load_robot(name), **options))
        return opened[-1]

    yield open_robot
    for viewer in opened:
        viewer.close()


def test_chosen_mode_is_taken_and_forgotten_where_the_robot_moves_on(open_viewer):
    viewer = open_viewer("five_bar")
    panel, view = viewer.assembly_panel, viewer.view
    panel.search()
    names = panel.choice.options
    assert len(names) == 2 and names[0] == "1 (description)" and panel.choice.value == names[0]
    panel.choice.value = names[1]
    panel._choose(SimpleNamespace(client=object()))
    assert view.tasks.wait(10)
    tool = len(view.robot.frames) - 1
    assert frame_poses(view.robot, view.configuration.q)[tool, 2, 3] < 0
    assert panel.choice.value == names[1]
    start = view.configuration.independent_positions
    view.move(lambda configuration: configuration.move_joints(start + 0.1))
    assert view.tasks.wait(10)
    assert len(panel.choice.options) == 1
    panel.search()
    assert panel.choice.value.startswith("2 (") and len(panel.choice.options) == 2


def test_payload_moves_the_drawn_centre_of_mass(open_viewer):
    viewer = open_viewer("five_bar")
    overlay = next(overlay for overlay in viewer.view.overlays if "mass" in overlay.title)
    before = np.array(overlay._total.position)
    masses = sum(float(link.inertia.mass) for link in viewer.view.robot.links)
    viewer.payload_panel.mass.value = 3.0
    viewer.payload_panel._apply()
    assert viewer.view.tasks.wait(10)
    tool = frame_poses(viewer.view.robot, viewer.view.configuration.q)[-1, :3, 3]
    assert np.array(overlay._total.position) == pytest.approx((masses * before + 3 * tool) / (masses + 3), abs=1e-9)


def test_negative_payload_counts_as_none(open_viewer):
    viewer = open_viewer("five_bar")
    moving_mass = sum(link.inertia.mass for link in viewer.view.configuration.robot.links)
    for typed, carried in ((2.0, 2.0), (-3.0, 0.0)):  # the page sends numbers below the minimum while they are typed
        viewer.payload_panel.mass.value = typed
        viewer.payload_panel._apply()
        assert viewer.view.tasks.wait(10)
        robot = viewer.view.configuration.robot
        assert sum(link.inertia.mass for link in robot.links) == pytest.approx(moving_mass + carried, abs=1e-12)


def test_robot_is_translucent_while_something_inside_of_it_is_shown(open_viewer):
    viewer = open_viewer("five_bar")
    panel, overlays = viewer.overlay_panel, {overlay.title: overlay for overlay in viewer.view.overlays}

    def opacities(title, is_shown):
        panel.boxes[title].value = is_shown
        panel._show(overlays[title], SimpleNamespace(target=panel.boxes[title]))
        return {handle.opacity for _, handle in viewer.view.scene.meshes}

    frames, parameters = (title for title in overlays if title.startswith(("Frames", "MDH")))
    assert opacities("Names", True) == {None}
    assert opacities(frames, True) == opacities(parameters, True) == opacities(frames, False) == {INSIDE_OPACITY}
    assert opacities(parameters, False) == {None}


def test_arrow_starts_at_the_frame_and_has_the_direction_and_length_of_the_force(open_viewer):
    viewer = open_viewer("panda")
    panel, view = viewer.wrench_panel, viewer.view
    scale = panel.scale.value
    without = view.configuration.holding_efforts()
    panel.force.value = (0.0, 3.0, -4.0)
    panel.apply()
    assert view.tasks.wait(10)
    assert panel.arrow.handle.position * scale == pytest.approx([0, 3, -4], rel=1e-9)
    assert panel.arrow.arrow.visible and panel.arrow.arrow.points[0, 1] * scale == pytest.approx([0, 3, -4], rel=1e-6)
    view.move(lambda configuration: configuration.move_joints(configuration.independent_positions + 0.2))
    assert view.tasks.wait(10)
    pose = frame_poses(view.robot, view.configuration.q)[view.robot.frames.index(view.robot.frame(panel.link.value))]
    assert panel.arrow.root.position == pytest.approx(pose[:3, 3], abs=1e-12)
    w, x, y, z = panel.arrow.root.wxyz
    assert 2 * (y * z - w * x) == pytest.approx(pose[1, 2], abs=1e-9)
    # the tip is dragged: numbers and efforts follow
    panel.arrow.handle.position = (0.1, 0.0, 0.0)
    panel.drag()
    assert view.tasks.wait(10)
    assert np.array(panel.force.value) == pytest.approx([0.1 * scale, 0, 0], abs=1e-3)
    view.move(lambda configuration: configuration.move_joints(configuration.independent_positions - 0.2))
    assert view.tasks.wait(10)
    change = view.configuration.holding_efforts(view.external_wrenches) - without
    assert np.abs(change).max() > 0.01 * scale


def test_reference_is_drawn_at_its_own_positions(open_viewer):
    robot = load_robot("rx90")
    motion = PlayedMotion(np.array([0.0, 1.0]), np.zeros((2, 6)), *np.full((2, 2, 6), np.nan))
    reference = PlayedMotion(motion.times, np.array([np.full(6, 0.1), np.full(6, 0.3)]), motion.efforts, motion.efforts)
    viewer = open_viewer("rx90", motion=motion.beside(reference))
    assert viewer.view.tasks.wait(10)
    start = link_matrices(robot, np.full(6, 0.1))  # before anything is played
    for link, node in viewer.view.reference_scene.link_frames.items():
        assert node.position == pytest.approx(start[link, :3, 3], abs=1e-12)
    viewer.motion_panel.move_to(1.0)
    assert viewer.view.tasks.wait(10)
    expected = link_matrices(robot, np.full(6, 0.3))
    for link, node in viewer.view.reference_scene.link_frames.items():
        assert node.position == pytest.approx(expected[link, :3, 3], abs=1e-12)
    for link, node in viewer.view.scene.link_frames.items():
        assert node.position == pytest.approx(link_matrices(robot, np.zeros(6))[link, :3, 3], abs=1e-12)
    _, positions, references, lower, upper = viewer.motion_panel.position_plot.data
    limits = robot.joints[0].limits
    assert references.tolist() == [0.1, 0.3] and positions.tolist() == [0, 0]
    assert lower[0] == limits.lower and upper[0] == limits.upper


def test_clicked_part_is_described(open_viewer):
    view = open_viewer("five_bar").view
    texts = [describe_body(view.robot, body) for body, _ in view.scene.meshes]
    assert any("right\\_rod" in text and "2 kg" in text and "without a motor" in text for text in texts)
    assert any("the base" in text for text in texts)
    view.scene.mark_singular(True)
    assert all(tuple(handle.color) == SINGULAR_COLOUR for _, handle in view.scene.meshes)
