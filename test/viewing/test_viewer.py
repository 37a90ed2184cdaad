"""The page of a robot in a real browser: it loads, sliders move the robot, and its loops stay closed."""

import io
import time

import numpy as np
import pytest
from PIL import Image
from viewing.drawn_loops import drawn_link_poses, largest_gap

from robot_dynamics import load_robot, shipped_robots

pytest.importorskip("viser")
from robot_dynamics.viewing.viewer import Viewer

WAIT = 30_000  # [ms]


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


def set_number(page, index, value):
    """Type a value into the number field beside a slider."""
    field = page.locator("input[inputmode=decimal], input[type=text].mantine-NumberInput-input").nth(index)
    field.fill(f"{value:.4f}")
    field.press("Enter")
    field.blur()


@pytest.mark.slow
@pytest.mark.parametrize("name", list(shipped_robots()))
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
