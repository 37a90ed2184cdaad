"""The page of a robot as one file: it opens without a network, plays a motion, and shows names as text alone."""

import io

import numpy as np
import pytest
from PIL import Image

from robot_dynamics import load_robot
from robot_dynamics.model.loading import read_robot

pytest.importorskip("viser")
from robot_dynamics.viewing.page import robot_page
from robot_dynamics.viewing.played_motion import PlayedMotion

WAIT = 30_000  # [ms]
HOSTILE = '"></script><script>document.title="taken"</script><img src=x onerror=alert(1)>'
HOSTILE_TABLE = f"""
format: 1
robot: {HOSTILE!r}
base: {{link: base}}
joints:
  - joint: {HOSTILE!r}
    link: {"../../" + HOSTILE!r}
    mdh: {{alpha: 0, d: 0.3, theta: 0, r: 0}}
    mass: 1
    centre_of_mass: [0.4, 0, 0]
"""


@pytest.fixture
def opened(browser, tmp_path):
    """Return a function that opens a page from a file without a network: (page, errors, requests)."""
    context = browser.new_context(offline=True, viewport={"width": 640, "height": 480})

    def open_text(text):
        file = tmp_path / "robot.html"
        file.write_text(text, encoding="utf-8")
        page, errors, requests = context.new_page(), [], []
        page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(f"file://{file}")
        page.wait_for_selector("canvas", timeout=WAIT)
        # the notice that WebGL is drawn by software is as coloured as a robot
        page.locator(".mantine-Notification-closeButton").click(timeout=WAIT)
        page.locator(".mantine-Notification-root").wait_for(state="detached", timeout=WAIT)
        return page, errors, requests

    yield open_text
    context.close()


def picture(page):
    return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), dtype=int)


def wait_for_robot(page):
    """Wait until there is colour in the picture, and return the picture."""
    for _ in range(100):
        image = picture(page)[:420]
        if (np.ptp(image, axis=-1) > 40).sum() > 20:
            return image
        page.wait_for_timeout(200)
    pytest.fail("no robot is drawn")


@pytest.mark.slow
def test_page_opens_without_network_and_plays(opened):
    text, warnings = robot_page(load_robot("gough_stewart"))
    assert warnings == ()
    assert len(text) < 3e6
    page, errors, requests = opened(text)
    first = wait_for_robot(page)
    assert page.title() == "gough_stewart"
    page.wait_for_timeout(2500)
    assert (np.abs(picture(page)[:420] - first).max(axis=-1) > 30).sum() > 50, "nothing moves"
    assert errors == []
    assert [url for url in requests if not url.startswith(("file:", "data:", "blob:"))] == []


@pytest.mark.slow
def test_reference_is_a_second_robot_in_orange(opened):
    """The other robot has no colour in which red is far above blue, and green is between them."""
    robot = load_robot("rx90")
    nothing = np.full((2, 6), np.nan)
    motion = PlayedMotion(np.array([0.0, 0.1]), np.zeros((2, 6)), nothing, nothing)
    reference = PlayedMotion(motion.times, np.full((2, 6), 0.4), nothing, nothing)
    page, errors, _ = opened(robot_page(robot, motion.beside(reference))[0])
    red, green, blue = np.moveaxis(wait_for_robot(page), -1, 0)
    assert ((red > green + 20) & (green > blue + 20)).sum() > 200
    assert errors == []


@pytest.mark.slow
def test_hostile_names_are_text(opened):
    robot = read_robot(HOSTILE_TABLE, source="a table")
    assert robot.name == HOSTILE
    page, errors, requests = opened(robot_page(robot)[0])
    wait_for_robot(page)
    assert page.title() == HOSTILE and errors == []
    assert page.locator("img").count() == 0
    assert [url for url in requests if not url.startswith(("file:", "data:", "blob:"))] == []
