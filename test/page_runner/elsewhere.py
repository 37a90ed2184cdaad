"""Commands of the documentation that the runner does not run, and what runs them, or why nothing can.

A command must match one entry as a whole. Add an entry for a new command; `part` is the name of a part of `.ci/run`.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from page_runner.command_lines import words

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Elsewhere:
    """A pattern of a command; the part of .ci/run that runs it; the reason if no part does."""

    pattern: str
    part: str = ""
    reason: str = ""


INSTALLATION = "installs packages of the system or of ROS: the machine of the tests has no root and no ROS"
NO_ROS2_COMMAND = "needs a ROS installation with this package; the tests run without one"

ELSEWHERE = (
    Elsewhere(r"make venv", part="virtual environment"),
    Elsewhere(r"make demo", part="demo"),
    Elsewhere(r"(\.venv/bin/)?demo|ros2 run robot_dynamics demo", part="demo"),
    Elsewhere(r"make test", part="tests"),
    Elsewhere(r"make lint", part="lint"),
    Elsewhere(r"make jazzy", part="apt Jazzy"),
    Elsewhere(r"make colcon", part="colcon build"),
    Elsewhere(r"make control", part="control package"),
    Elsewhere(r"make docs", part="documentation"),
    Elsewhere(r"make wheels( PYTHONS=.*)?", part="wheels"),
    Elsewhere(
        r"make (bench|soak|faults|fuzz|quick|format|clean|help).*", reason="takes long, or is a task of developers"
    ),
    Elsewhere(r"pip install (--find-links dist )?(\.|robot_dynamics)(\[[\w,]+\])?", part="wheels"),
    Elsewhere(r"python3? -m venv \S+", part="wheels"),
    Elsewhere(r"pip install .*", reason=INSTALLATION),
    Elsewhere(r"colcon build --base-paths \S+( \S+)+", part="colcon build"),
    Elsewhere(r"source install/setup\.bash", part="colcon build: import"),
    Elsewhere(r"source (/opt/ros/jazzy/setup\.bash|\S+/bin/activate)", reason="changes the shell"),
    Elsewhere(r"git clone \S+( \S+)?", reason="the CI begins with a fresh clone"),
    Elsewhere(r"(PIP_BREAK_SYSTEM_PACKAGES=1 )?rosdep .*", reason=INSTALLATION),
    Elsewhere(r"(sudo )?apt(-get)? (install|update).*", reason=INSTALLATION),
    Elsewhere(r"cd \S+", reason="the folder of the reader; all commands of a page run in one folder"),
    Elsewhere(r"ros2 run controller_manager spawner .*", reason=NO_ROS2_COMMAND),
    Elsewhere(r"xacro .*", reason=NO_ROS2_COMMAND),
    Elsewhere(r"ros2 (bag record|control|doctor|interface|pkg) .*", reason=NO_ROS2_COMMAND),
)


def entry_for(command: str) -> Elsewhere | None:
    """The entry of a command that is not run; None: it must be run."""
    text = " ".join(words(command))
    matching = (entry for entry in ELSEWHERE if re.fullmatch(entry.pattern, text, re.DOTALL))
    entry = next(matching, None)
    target = re.match(r"make (\w+)", text)
    if entry and target:
        makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
        assert re.search(rf"^{target[1]}:", makefile, re.MULTILINE), f"the Makefile has no target {target[1]}"
    return entry
