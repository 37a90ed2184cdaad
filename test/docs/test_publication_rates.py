"""Commands to the simulator are published faster than they time out.

What is published once a second, as `ros2 topic pub` does without --rate, acts for a tenth of the time.
"""

import re
from pathlib import Path

from robot_dynamics.nodes.mobile_base_simulator.parameters import PARAMETERS

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def test_commands_are_published_faster_than_they_time_out():
    count = 0
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        timeouts = [float(value) for value in re.findall(r"command_timeout: ([\d.]+)", text)]
        for options, topic in re.findall(r"^ros2 topic pub (.*?) ?(/\S+) ", text, re.MULTILINE):
            is_latest_kept = topic.startswith("/fault_controller/")  # of a controller without a time-out
            if is_latest_kept or topic.endswith(("/reference", "/joint_states")):
                continue
            timeout = max(timeouts, default=0.5) if topic == "/cmd_vel" else PARAMETERS["command_timeout"].default
            rate = re.fullmatch(r"--rate ([\d.]+)", options)
            assert rate and float(rate[1]) > 2 / timeout, (page.name, topic, options)
            count += 1
    assert count >= 3
