"""Draw docs/images/map.png and docs/images/map_page.png: a map of a Gough-Stewart platform, as a picture and as a page.

Run ``python docs/images/workspace_map.py`` by hand after a change of the maps. It needs the extras `view` and `plots`,
playwright, and Chromium.
"""

from __future__ import annotations

import io
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

from robot_dynamics.cli.main import main

FOLDER = Path(__file__).parent
CHROMIUM = "/usr/bin/chromium"
OVER = ["--over", "yaw:-2:2:81,z:0.5:3.3:81"]
VIEW = {"width": 1170, "height": 620}
CURSOR = (330, 300)
COLOURS = 256


def write_palette(data: bytes, path: Path) -> None:
    """Write a picture with few colours, which is a small file."""
    Image.open(io.BytesIO(data)).convert("RGB").quantize(COLOURS).save(path, optimize=True)
    print(path, path.stat().st_size)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        picture, page = Path(folder) / "map.png", Path(folder) / "map.html"
        for output in (picture, page):
            main(["map", "gough_stewart", *OVER, "--output", str(output)])
        write_palette(picture.read_bytes(), FOLDER / "map.png")
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
            tab = browser.new_page(viewport=VIEW)
            tab.goto(f"file://{page}")
            tab.wait_for_selector(".heatmaplayer image")
            tab.mouse.move(*CURSOR)
            tab.mouse.move(CURSOR[0] + 1, CURSOR[1])
            tab.wait_for_selector(".hoverlayer text")
            write_palette(tab.screenshot(), FOLDER / "map_page.png")
