"""Pages of maps in a browser without a network: the pose under the cursor, and the values that the library computes."""

import re

import numpy as np
import pytest

from robot_dynamics import Dynamics, FrequencyMap, load_robot, pose_map
from robot_dynamics.cli.main import main
from robot_dynamics.parallel.platform_dynamics import pose_from_coordinates

pytest.importorskip("plotly")
from robot_dynamics.plots.colour_scale import ColourScale
from robot_dynamics.plots.map_page import frequency_map_page, pose_map_page

WAIT = 30_000  # [ms]
HOSTILE = '</script><img src=x onerror=alert(1)><b>"'
HOVER = ".hoverlayer text"


@pytest.fixture
def opened(browser):
    """Return a function that opens a page from a file without a network: (page, what it asks for and complains of)."""
    context = browser.new_context(offline=True, viewport={"width": 1200, "height": 800})

    def open_file(path):
        page, events = context.new_page(), []
        page.on("pageerror", lambda error: events.append(str(error)))
        page.on("console", lambda message: events.append(message.text) if message.type == "error" else None)
        page.on("request", lambda request: events.append(request.url))
        page.goto(f"file://{path}")
        page.wait_for_selector(".plot-container .bglayer rect, .plot-container .heatmaplayer image", timeout=WAIT)
        events.remove(f"file://{path}")
        return page, events

    yield open_file
    context.close()


def hovered(page, across, down, panel=0):
    """Return the text under the cursor at a part of a panel, 0 to 1 from its left and its top."""
    box = page.locator(".nsewdrag").nth(panel).bounding_box()
    x, y = box["x"] + across * box["width"], box["y"] + down * box["height"]
    page.mouse.move(x - 1, y)
    page.mouse.move(x, y)
    page.wait_for_selector(HOVER, timeout=WAIT)
    return "\n".join("\n".join(text.locator("tspan").all_text_contents()) for text in page.locator(HOVER).all())


def numbers(text):
    """Return {name: value} of lines such as `z: 1.2 m`."""
    return {name: float(value.replace("−", "-")) for name, value in re.findall(r"^(.+?): (\S+)", text, re.MULTILINE)}


@pytest.mark.slow
def test_pose_under_the_cursor_has_the_values_of_the_model(opened, tmp_path):
    path = tmp_path / "map.html"
    over = "x:-1.5:1.5:7,z:0.6:3.4:8"
    assert main(["map", "gough_stewart", "--over", over, "--at", "yaw=0.1", "--output", str(path)]) == 0
    page, events = opened(path)
    text = hovered(page, 0.55, 0.45)
    values = numbers(text)
    pose = pose_from_coordinates(np.array([values["x"], 0, values["z"], 0.1, 0, 0]))
    platform = Dynamics(load_robot("gough_stewart"), compiled=False).platform
    assert values["condition number"] == pytest.approx(platform.condition_number(platform.joint_positions(pose)), 1e-3)
    assert values["largest effort"] == pytest.approx(np.abs(platform.inverse(pose)).max(), rel=1e-3)
    assert "y = 0 m, yaw = 0.1 rad" in text
    assert "motors beyond their limits" in hovered(page, 0.02, 0.02)
    assert "motors beyond their limits" in page.locator(".legendtext").all_text_contents()
    assert events == []


@pytest.mark.slow
def test_frequencies_share_a_scale_and_hostile_names_are_text(opened, tmp_path):
    axes = {"x": np.array([0.0, 0.1, 0.2]), "y": np.array([0.0, 0.1])}
    frequencies = np.arange(12.0).reshape(3, 2, 2) + 20
    result = FrequencyMap(axes, np.ones((3, 2), dtype=bool), frequencies, {"yaw": 0.3})
    path = tmp_path / "frequencies.html"
    path.write_text(frequency_map_page(result, HOSTILE), encoding="utf-8")
    page, events = opened(path)
    values = numbers(hovered(page, 0.9, 0.9))
    assert values == {"x": 0.2, "y": 0.0, "frequency 1": 28.0}
    scales = page.evaluate("document.querySelector('.js-plotly-plot').data.map(trace => [trace.zmin, trace.zmax])")
    assert scales == [[20, 31], [20, 31]]
    assert page.title() == f"{HOSTILE}: natural frequencies" and not page.locator("img[src='x']").count()
    assert HOSTILE in page.locator(".gtitle").text_content() and events == []


def test_scale_that_is_asked_for_is_used():
    """A scale of a decade and more is drawn in logarithms."""
    robot = load_robot("gough_stewart")
    axes = {"x": np.array([-0.1, 0.1]), "z": np.array([1.9, 2.1])}
    result = pose_map(Dynamics(robot, compiled=False), axes)
    page = pose_map_page(result, robot, condition_scale=ColourScale(1, 10), effort_scale=ColourScale(10, 1e4))
    assert '"zmin":1.0,' in page and '"zmax":10.0,' in page and '"zmax":4.0,' in page


@pytest.mark.parametrize("text", ["5", "5:1", "a:b", "1:inf", "-1:2", "1:2:3", "2:2"])
def test_ranges_that_are_none_are_refused(text, capsys):
    for arguments in (
        ["map", "gough_stewart", "--over", "x:0:1:3", f"--effort-range={text}"],
        ["frequencies", "navaro", "--map", "x:0:0.1:2,y:0:0.1:2", f"--range={text}"],
    ):
        assert main(arguments) == 1
        assert "LOW:HIGH is needed" in capsys.readouterr().err
