"""The jobs of the page on CI are YAML, and their commands are those that the page runs."""

import re
from pathlib import Path

import pytest
import yaml

PAGE = Path(__file__).parents[2] / "docs" / "how_to" / "check_bags_in_ci.md"
TEXT = PAGE.read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def job(first_line):
    (block,) = [block for block in blocks("yaml") if block.startswith(f"# {first_line}")]
    return yaml.safe_load(block)


def options(command):
    """The options of a command, without its recordings and its robot, the drives, and what follows it."""
    words = command.split("||")[0].split()
    assert words[:2] == ["robot-dynamics", "replay-check"]
    words = words[min(number for number, word in enumerate(words) if word.startswith("--")) :]
    values = {}
    for word in words:
        if word.startswith("--"):
            values[option := word] = ""
        else:
            values[option] += word
    return {option: value for option, value in values.items() if option not in ("--robot", "--drives")}


def executed_commands():
    return [line for block in blocks("bash") for line in block.splitlines()]


@pytest.mark.parametrize("path", [".github/workflows/check-bags.yml", ".gitlab-ci.yml"])
def test_jobs_run_the_commands_of_the_page(path):
    description = job(path)
    if path.startswith(".github"):
        steps = description["jobs"]["check-bags"]["steps"]
        lines = [line for step in steps for line in step.get("run", "").splitlines()]
        (reporter,) = [step["with"]["report_paths"] for step in steps if "junit" in step.get("uses", "")]
    else:
        lines = description["check-bags"]["script"]
        reporter = description["check-bags"]["artifacts"]["reports"]["junit"]
    (check,) = [line for line in lines if line.startswith("robot-dynamics")]
    executed = [options(line) for line in executed_commands() if line.startswith("robot-dynamics")]
    assert options(check) in executed
    assert options(check)["--junit"] == reporter
    assert "python check_samples.py check.json" in lines
    assert "python check_samples.py check.json" in executed_commands()


def test_all_yaml_of_the_page_is_parsed():
    assert len(blocks("yaml")) >= 4 and all(yaml.safe_load(block) for block in blocks("yaml"))
