"""Settings of all tests, and the markers that follow from where a test is and from what its file imports."""

import re
from functools import cache
from pathlib import Path

import pytest
from hypothesis import settings

# How long an example takes depends on the machine: a busy one is no failure.
settings.register_profile("robot_dynamics", deadline=None)
settings.load_profile("robot_dynamics")

NODES = Path(__file__).parent / "nodes"
CHROMIUM = "/usr/bin/chromium"
# No screen and no graphics card, and no connections but those of the pages.
CHROMIUM_ARGUMENTS = ["--no-sandbox", "--enable-unsafe-swiftshader", "--disable-background-networking"]
REFERENCES = re.compile(
    r"^\s*(import|from) (pinocchio|mujoco|openseespy|peers\.(pinocchio_|mujoco_|flying_arm|real_robots))", re.MULTILINE
)


def pytest_collection_modifyitems(items):
    for item in items:
        if NODES in item.path.parents:
            item.add_marker(pytest.mark.ros)
        if compares_with_another_library(item.path):
            item.add_marker(pytest.mark.reference)


@cache
def compares_with_another_library(path):
    return bool(REFERENCES.search(path.read_text(encoding="utf-8")))


@pytest.fixture(scope="module")
def browser():
    """A headless Chromium. Not for a whole run: its event loop would be that of all later tests."""
    if not Path(CHROMIUM).exists():
        pytest.skip(f"no {CHROMIUM}: apt install chromium")
    api = pytest.importorskip("playwright.sync_api", reason="playwright, which opens pages, is not installed")
    with api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=CHROMIUM, args=CHROMIUM_ARGUMENTS)
        yield launched
        launched.close()
