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
