"""Collects the pages of the documentation as tests: `pytest docs README.md`. See test/page_runner."""

import re
from functools import cache
from pathlib import Path

import pytest

try:
    from page_runner.collector import PageSybil
except ModuleNotFoundError as error:  # where only the packages of Ubuntu are installed, no page is tested
    if error.name != "sybil":
        raise
else:
    pytest_collect_file = PageSybil().pytest()

NODES = re.compile(
    r"^(import rclpy|ros2 |"
    r"(computed_torque|dynamics_server|joint_state_completer|mobile_base_simulator|payload_identifier|replay_check) )",
    re.MULTILINE,
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Items of one page share a namespace: one process of xdist runs them (--dist loadfile or loadgroup)."""
    for item in items:
        if item.path.suffix == ".md":
            item.add_marker(pytest.mark.xdist_group(str(item.path)))
            if runs_nodes(item.path):
                item.add_marker(pytest.mark.ros)


@cache
def runs_nodes(page: Path) -> bool:
    """Whether a page has code blocks that need ROS."""
    return bool(NODES.search(page.read_text(encoding="utf-8")))
