"""Time to the first picture of the viewer, and its rates while a robot moves, in a headless Chromium.

    python benchmarks/viewer.py                        some robots that ship
    python benchmarks/viewer.py gough_stewart --seconds 10
    python benchmarks/viewer.py --without-browser      the server alone

Columns:

    update [ms]   CPU time of the server for an update: it moves the robot, closes loops, and sends what has changed
    panels [ms]   CPU time for sliders, efforts and the search for singular positions, at most ten times a second
    first [s]     from the call of the page to the first picture with coloured pixels, those of motors or platforms
    updates/s     updates that the server sends while a program moves the robot, with a page open
    dragged/s     updates while a slider of the page is dragged: the browser decides how often it tells the server
    pictures/s    pictures that the browser draws meanwhile
    alone/s       pictures that the browser draws while the camera turns and the server sends nothing
    load          mean number of processes that ran or waited, of the last minute

Chromium has no graphics card here: it draws by software (SwiftShader) on the processors that the server uses too. Its
rate is that of the renderer; `alone/s` is its limit.
"""

import argparse
import os
import threading
import time
from pathlib import Path

import numpy as np
from tabulate import tabulate

from robot_dynamics import load_robot
from robot_dynamics.viewing.viewer import Viewer

ROBOTS = ["gough_stewart", "delta", "five_bar", "panda"]
HEADER = [
    "robot",
    "update [ms]",
    "panels [ms]",
    "first [s]",
    "updates/s",
    "dragged/s",
    "pictures/s",
    "alone/s",
    "load",
]
CHROMIUM = "/usr/bin/chromium"
CHROMIUM_ARGUMENTS = ["--no-sandbox", "--enable-unsafe-swiftshader", "--disable-background-networking"]
VIEWPORT = {"width": 1000, "height": 700}
WAIT = 60_000  # [ms]
WARM_UP_UPDATES = 60
UPDATES = 200
# A picture is a turn of the browser in which something was drawn.
PROBE = """
let hasDrawn = false;
for (const name of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced"]) {
    const original = WebGL2RenderingContext.prototype[name];
    WebGL2RenderingContext.prototype[name] = function (...values) {
        hasDrawn = true;
        return original.apply(this, values);
    };
}
window.pictures = 0;
window.firstPicture = null;
const copy = document.createElement("canvas");
copy.width = 160; copy.height = 120;
function hasColour(canvas) {
    if (!canvas.width || !canvas.height) return false;
    const context = copy.getContext("2d", {willReadFrequently: true});
    context.clearRect(0, 0, copy.width, copy.height);
    context.drawImage(canvas, 0, 0, copy.width, copy.height);
    const pixels = context.getImageData(0, 0, copy.width, copy.height).data;
    let count = 0;
    for (let i = 0; i < pixels.length; i += 4) {
        const colour = [pixels[i], pixels[i + 1], pixels[i + 2]];
        if (pixels[i + 3] > 0 && Math.max(...colour) - Math.min(...colour) > 40) count += 1;
    }
    return count > 3;
}
function frame() {
    if (hasDrawn) window.pictures += 1;
    hasDrawn = false;
    if (window.firstPicture === null && [...document.querySelectorAll("canvas")].some(hasColour))
        window.firstPicture = performance.now();
    requestAnimationFrame(frame);
}
requestAnimationFrame(frame);
"""
# In the page: a program outside of it would wait for each motion of the mouse until the next picture.
DRAG = """
([x, y]) => {
    const move = () => {
        const place = {clientX: x + 12 * Math.sin(performance.now() / 250), clientY: y, bubbles: true, buttons: 1};
        document.dispatchEvent(new MouseEvent("mousemove", place));
        document.dispatchEvent(new PointerEvent("pointermove", place));
    };
    window.drag = setInterval(move, 16);
}
"""


def cpu_times(viewer):
    """CPU times [ms] of an update and of the efforts, once programs are compiled."""
    view = viewer.view
    configuration = view.configuration
    start = configuration.independent_positions
    size = 0.02 * configuration.robot.characteristic_length
    motions = [start + size * np.sin(number / 10) for number in range(WARM_UP_UPDATES + UPDATES)]
    times = {"update": [], "panels": []}
    for positions in motions:
        began = time.thread_time()
        configuration.move_joints(positions)
        view.draw()
        moved = time.thread_time()
        view._follow()
        times["update"].append(moved - began)
        times["panels"].append(time.thread_time() - moved)
    return [1e3 * np.mean(values[WARM_UP_UPDATES:]) for values in times.values()]


def update_rate(viewer, seconds):
    """Updates per second of the server while a program moves the robot."""
    view = viewer.view
    start = view.configuration.independent_positions
    size = 0.02 * view.robot.characteristic_length
    drawn = threading.Event()
    updates = []
    view.on_draw.append(lambda poses: (updates.append(1), drawn.set()))
    began = time.monotonic()
    while (elapsed := time.monotonic() - began) < seconds:
        positions = start + size * np.sin(4 * elapsed)
        view.move(lambda configuration, positions=positions: configuration.move_joints(positions))
        drawn.wait(1)
        drawn.clear()
    view.on_draw.pop()
    return len(updates) / elapsed


def drag_rates(viewer, page, seconds):
    """Updates of the server, and pictures of the browser, per second while the first slider is dragged."""
    box = page.locator("[role=slider]").first.bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    updates = []
    viewer.view.on_draw.append(lambda _: updates.append(1))
    page.mouse.move(*middle)
    page.mouse.down()
    before = page.evaluate("window.pictures")
    began = time.monotonic()
    page.evaluate(DRAG, middle)
    page.wait_for_timeout(1000 * seconds)
    page.evaluate("clearInterval(window.drag)")
    elapsed = time.monotonic() - began
    page.mouse.up()
    return len(updates) / elapsed, (page.evaluate("window.pictures") - before) / elapsed


def camera_rate(page, seconds):
    """Pictures per second while the camera turns."""
    page.mouse.move(100, 550)
    page.mouse.down()
    before = page.evaluate("window.pictures")
    began = time.monotonic()
    while (elapsed := time.monotonic() - began) < seconds:
        page.mouse.move(100 + 60 * np.sin(2 * elapsed), 550)
    page.mouse.up()
    return (page.evaluate("window.pictures") - before) / (time.monotonic() - began)


def measure(name, browser, seconds):
    """Row of the table for a robot."""
    viewer = Viewer(load_robot(name))
    try:
        row = [name, *cpu_times(viewer)]
        if browser is None:
            return [*row, "", "", "", "", "", os.getloadavg()[0]]
        page = browser.new_page(viewport=VIEWPORT)
        page.add_init_script(PROBE)
        page.goto(viewer.url)
        page.wait_for_function("window.firstPicture !== null", timeout=WAIT)
        first = 1e-3 * page.evaluate("window.firstPicture")
        page.locator(".mantine-Notification-closeButton").click(timeout=WAIT)
        row += [first, update_rate(viewer, seconds), *drag_rates(viewer, page, seconds), camera_rate(page, seconds)]
        page.close()
        return [*row, os.getloadavg()[0]]
    finally:
        viewer.close()


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", default=ROBOTS)
    parser.add_argument("--seconds", type=float, default=6.0, help="duration of each motion")
    parser.add_argument("--without-browser", action="store_true")
    arguments = parser.parse_args()
    if arguments.without_browser or not Path(CHROMIUM).exists():
        rows = [measure(name, None, arguments.seconds) for name in arguments.robots]
    else:
        from playwright.sync_api import sync_playwright

        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=CHROMIUM_ARGUMENTS)
            rows = [measure(name, browser, arguments.seconds) for name in arguments.robots]
            browser.close()
    print(tabulate(rows, headers=HEADER, floatfmt=".3g"))


if __name__ == "__main__":
    main()
