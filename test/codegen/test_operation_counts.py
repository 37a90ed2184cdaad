"""The operation counts in the README are those of the programs."""

import re
from pathlib import Path

import pytest
from peers.real_robots import real_urdf

from robot_dynamics import load_robot
from robot_dynamics.codegen.trace.models import direct_model, inverse_model

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
ROBOTS = {"RX90": "rx90", "UR5e": "ur5e", "Panda": "panda", "Puma 560, with friction": "puma560"}


@pytest.mark.parametrize("title", [*ROBOTS, "Talos, 28 joints"])
def test_operation_counts_of_the_readme_agree_with_the_programs(title):
    robot = load_robot(ROBOTS[title] if title in ROBOTS else real_urdf("talos_reduced"))
    row = re.search(rf"^\| {title} \| (\d+) / (\d+) \| (\d+) / (\d+) \|", README, re.MULTILINE)
    operation_counts = [model(robot).operations for model in (inverse_model, direct_model)]
    counts = [(operations.multiplications, operations.additions) for operations in operation_counts]
    assert counts == [(int(row[1]), int(row[2])), (int(row[3]), int(row[4]))]
