"""The operation counts of the documentation are those of the programs."""

import re
import runpy
from pathlib import Path

import pytest
from peers.real_robots import real_urdf

from robot_dynamics import load_robot
from robot_dynamics.codegen.trace.models import direct_model, inverse_model

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "explanation" / "customised_programs.md"
BENCHMARK = ROOT / "benchmarks" / "operation_counts.py"
ROBOTS = {
    "RX90": "rx90",
    "UR5e": "ur5e",
    "Panda": "panda",
    "Puma 560, with friction": "puma560",
    "Gough-Stewart platform, 24 joints": "gough_stewart",
}


ROBOTS_OF_THE_BENCHMARK = {"Puma 560, without friction": "puma_560", "Stanford arm": "stanford_arm"}


def robot_of(title):
    """The robot of a row of the page."""
    if title in ROBOTS_OF_THE_BENCHMARK:
        return runpy.run_path(str(BENCHMARK))[ROBOTS_OF_THE_BENCHMARK[title]]()
    return load_robot(ROBOTS[title] if title in ROBOTS else real_urdf("talos_reduced"))


@pytest.mark.parametrize("title", [*ROBOTS, *ROBOTS_OF_THE_BENCHMARK, "Talos, 28 joints"])
def test_operation_counts_of_the_page_agree_with_the_programs(title):
    robot = robot_of(title)
    page = PAGE.read_text(encoding="utf-8")
    row = re.search(rf"^\| {title} \| (\d+) / (\d+) \| (\d+) / (\d+) \|", page, re.MULTILINE)
    operation_counts = [model(robot).operations for model in (inverse_model, direct_model)]
    counts = [(operations.multiplications, operations.additions) for operations in operation_counts]
    assert counts == [(int(row[1]), int(row[2])), (int(row[3]), int(row[4]))]
