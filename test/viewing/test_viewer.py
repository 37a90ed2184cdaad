"""The page of a robot in a real browser: it loads, sliders move the robot, and its loops stay closed."""

import io
import time

import numpy as np
import pytest
from peers.large_robots import each_robot
from PIL import Image
from scipy.spatial.transform import Rotation
from viewing.drawn_loops import drawn_link_poses, largest_gap

from robot_dynamics import load_robot, shipped_robots

pytest.importorskip("viser")
from robot_dynamics.viewing.viewer import Viewer

WAIT = 60_000  # [ms]
LEFT_TO_SOAK = (
    "andrews_squeezer",
    "bricard",
    "delta",
    "delta_wrist",
    "five_bar",
    "hexapod_stack",
    "irb460",
    "manutec_r3",
    "navaro",
    "orthoglide",
    "puma560",
    "rx90",
    "sr400",
    "turtlebot3_burger",
    "ur5e",
)
"""Robots that are like others of which each run opens the page."""


@pytest.fixture
def open_page(browser):
    """Return a function that opens the page of a robot: (viewer, page, errors)."""
    opened = []

    def open_robot(robot, **options):
        viewer = Viewer(robot, **options)
        page = browser.new_page(viewport={"width": 800, "height": 600})
        opened.append((viewer, page))
        errors = []
        page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(viewer.url)
        page.wait_for_selector("canvas", timeout=WAIT)
        page.get_by_text(robot.name, exact=True).first.wait_for(timeout=WAIT)
        return viewer, page, errors

    yield open_robot
    for viewer, page in opened:
        page.close()
        viewer.close()


def coloured_pixels(page):
    """Number of pixels of the scene that are neither white nor grey: those of motors and platforms."""
    image = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), dtype=int)[:, :480]
    return int((np.ptp(image, axis=-1) > 40).sum())


def wait_until(condition, seconds=20.0):
    """Wait for a condition, and return whether it came true."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.05)
    return False


def on_screen(viewer, page, point):
    """Return where a point (3,) of frame 0 is on the page [px], by the camera that the browser reports."""
    camera = next(iter(viewer.server.get_clients().values())).camera
    w, x, y, z = camera.wxyz
    local = Rotation.from_quat([x, y, z, w]).as_matrix().T @ (point - camera.position)
    box = page.locator("canvas").first.bounding_box()
    scale = box["height"] / (2 * np.tan(camera.fov / 2))
    horizontal, vertical = scale * local[:2] / local[2]
    return box["x"] + box["width"] / 2 + horizontal, box["y"] + box["height"] / 2 + vertical


def set_number(page, index, value):
    """Type a value into the number field beside a slider."""
    field = page.locator("input[inputmode=decimal], input[type=text].mantine-NumberInput-input").nth(index)
    field.fill(f"{value:.4f}")
    field.press("Enter")
    field.blur()


@pytest.mark.slow
@pytest.mark.parametrize("name", each_robot(shipped_robots(), LEFT_TO_SOAK))
def test_every_robot_loads_and_moves_with_its_loops_closed(open_page, name):
    robot = load_robot(name)
    viewer, page, errors = open_page(robot)
    assert wait_until(lambda: coloured_pixels(page) > 20), "no robot is drawn"
    configuration = viewer.view.configuration
    before = configuration.q
    panel = viewer.platform_panels[0] if viewer.platform_panels else viewer.joint_panel
    slider = panel.sliders[0]
    target = slider.value + 0.03 * (slider.max - slider.min)
    set_number(page, 0, target)
    assert wait_until(lambda: not np.array_equal(configuration.q, before)), "the slider does not move the robot"
    assert viewer.view.tasks.wait(10)
    assert not configuration.problem
    poses = drawn_link_poses(viewer.view.scene)
    assert largest_gap(robot, poses) < 1e-9
    expected = configuration.link_poses()
    assert max(np.abs(pose - expected[link]).max() for link, pose in poses.items()) < 1e-12
    assert errors == []


@pytest.mark.slow
def test_arrow_of_a_force_is_dragged_and_a_clicked_part_shows_its_name(open_page):
    viewer, page, errors = open_page(load_robot("five_bar"))
    assert wait_until(lambda: coloured_pixels(page) > 20)
    page.locator(".mantine-Notification-closeButton").click(timeout=WAIT)  # of the warning about software WebGL
    page.get_by_text("External wrench").click(timeout=WAIT)
    page.get_by_label("drag the force").check(timeout=WAIT)
    panel, view = viewer.wrench_panel, viewer.view
    tool = view.configuration.link_poses()[view.robot.frame("tool").link] @ view.robot.frame("tool").placement
    size = panel.arrow.handle.scale
    ends = [on_screen(viewer, page, (tool @ [length, 0, 0, 1])[:3]) for length in (0.8 * size, 0.8 * size + 0.5)]
    assert wait_until(lambda: page.evaluate("document.readyState") == "complete")

    def drag():
        page.mouse.move(*ends[0])
        page.wait_for_timeout(500)
        page.mouse.down()
        for share in (0.3, 0.6, 1.0):
            page.mouse.move(*(np.array(ends[0]) + share * np.subtract(ends[1], ends[0])))
            page.wait_for_timeout(200)
        page.mouse.up()
        return wait_until(lambda: bool(view.external_wrenches), 3)

    assert drag() or drag(), "the arrow does not follow the mouse"
    assert view.tasks.wait(10)
    force = np.array(panel.force.value)
    assert force[0] == pytest.approx(0.5 * panel.scale.value, rel=0.15) and not force[1:].any()
    assert view.external_wrenches["tool"][:3] == pytest.approx(force)
    body = next(body for body, _ in view.scene.meshes if body.name == "left_rod")
    centre = view.configuration.link_poses()[body.link] @ [*body.mesh.bounds.mean(axis=0), 1]
    page.mouse.click(*on_screen(viewer, page, centre[:3]))
    page.get_by_text("1 kg, moved by left_rod").wait_for(timeout=WAIT)
    assert errors == []
