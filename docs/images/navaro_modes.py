"""Draw docs/images/navaro_modes.png: the first six modes of the NaVARo at pose (c) of Briot and Khalil.

Run ``python docs/images/navaro_modes.py`` by hand after a change of the viewer. It needs the extras `view` and `plots`,
playwright, and Chromium.
"""

from __future__ import annotations

import io
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.plots.plot_style import PAGE_WIDTH, new_figure, plot_style
from robot_dynamics.viewing.mode_geometry import ModeGeometry
from robot_dynamics.viewing.mode_view import ModeView
from robot_dynamics.viewing.page_server import HOST, make_server, stop_server

OUTPUT = Path(__file__).with_suffix(".png")
CHROMIUM = "/usr/bin/chromium"
CHROMIUM_ARGUMENTS = ["--no-sandbox", "--enable-unsafe-swiftshader"]
POSE_C = (0.0, -0.135)  # x, y of the platform [m]
AMPLITUDE = 0.11  # relative to the extent of the robot
FIELD_OF_VIEW = np.radians(18)  # nearly a parallel projection
FROM_ABOVE, OBLIQUE = np.array([0.0, -3e-3, 3.4]), np.array([0.95, -2.3, 1.35])
"""From the centre of the robot to the eye, relative to the extent of the robot."""
SIZE = 640  # pixels of a picture
TIMEOUT = 60_000  # [ms]
CAPTIONS = (
    "the platform moves along x",
    "the platform moves along y",
    "the platform turns about z",
    "out of the plane: the platform along z",
    "arm and rod of leg 1 sway",
    "arm and rod of leg 2 sway",
)


def mode_pages() -> tuple[list[str], np.ndarray]:
    """Return a page for each mode at its largest displacement, and the frequencies [Hz]."""
    elastodynamics = Dynamics(load_robot("navaro")).elastodynamics
    pose = np.eye(4)
    pose[:2, 3] = POSE_C
    q = elastodynamics.positions(pose=pose)
    modes = elastodynamics.natural_frequencies(q, count=len(CAPTIONS))
    geometry = ModeGeometry(elastodynamics, q)
    pages = []
    for shape in modes.mode_shapes:
        twists = geometry.displacements(shape)
        is_in_plane = np.abs(twists[:, 2]).max() < np.abs(twists[:, :2]).max()
        server = make_server("navaro", 0, HOST)
        try:
            view = ModeView(server.scene, geometry)
            view.choose(shape, AMPLITUDE)
            view.draw(np.pi / 2)
            direction = FROM_ABOVE if is_in_plane else OBLIQUE
            camera = server.initial_camera
            camera.fov = float(FIELD_OF_VIEW)
            camera.look_at = geometry.bounds.mean(axis=0)
            camera.position = camera.look_at + geometry.extent * direction
            pages.append(str(server.get_scene_serializer().as_html()))
        finally:
            stop_server(server)
    return pages, modes.frequencies


def photograph(pages: list[str]) -> list[Image.Image]:
    """Return a picture of the scene of each page."""
    pictures = []
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=CHROMIUM_ARGUMENTS)
        for number, page in enumerate(pages):
            path = Path(folder) / f"{number}.html"
            path.write_text(page, encoding="utf-8")
            tab = browser.new_page(viewport={"width": SIZE, "height": SIZE})
            tab.goto(f"file://{path}", timeout=TIMEOUT)
            canvas = tab.locator("canvas").first
            canvas.wait_for(timeout=TIMEOUT)
            tab.add_style_tag(content="body *:not(:has(canvas)):not(canvas) { visibility: hidden }")
            tab.wait_for_timeout(3000)  # the scene is drawn some time after its canvas exists
            pictures.append(Image.open(io.BytesIO(tab.screenshot())).convert("RGB"))
            tab.close()
        browser.close()
    return pictures


@plot_style()
def main() -> None:
    """Write the figure."""
    pages, frequencies = mode_pages()
    figure = new_figure(PAGE_WIDTH, 5.4)
    panels = figure.subplots(2, 3).flat
    for number, (axes, picture) in enumerate(zip(panels, photograph(pages), strict=True)):
        axes.imshow(np.asarray(picture))
        axes.axis("off")
        axes.set_title(f"{number + 1}: {frequencies[number]:.2f} Hz\n{CAPTIONS[number]}", y=-0.16)
    stream = io.BytesIO()
    figure.savefig(stream, dpi=160)
    Image.open(stream).convert("RGB").quantize(96).save(OUTPUT, optimize=True)
    print(OUTPUT, OUTPUT.stat().st_size)


if __name__ == "__main__":
    main()
