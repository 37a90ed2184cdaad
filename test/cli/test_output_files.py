"""Endings of output files: one check and one message for all verbs that write files of fixed formats."""

import os

import pytest

from robot_dynamics.cli.main import main
from robot_dynamics.cli.output_files import check_ending, check_writable
from robot_dynamics.errors import InvalidInputError


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["convert", "panda", "robot.txt"], "robot.txt: {} .yaml, .yml, .urdf or .par\n"),
        (
            ["map", "gough_stewart", "--over", "x:0:1:2", "--output", "map"],
            "--output map: {} .png, .pdf, .svg, .jpg or .html\n",
        ),
        (["frequencies", "navaro", "--mode", "1", "--output", "mode.png"], "--output mode.png: {} .html\n"),
        (
            ["frequencies", "navaro", "--map", "x:0:1:2,y:0:1:2", "--output", "a.csv"],
            "--output a.csv: {} .html, .png, .pdf or .svg\n",
        ),
        (["identify", "run", "--robot", "panda", "--output", "a.par"], "--output a.par: {} .yaml or .yml. The verb"),
        (
            ["identify", "run", "--robot", "panda", "--output-drives", "b"],
            "--output-drives b: {} .yaml or .yml. The verb",
        ),
    ],
)
def test_endings_of_output_files_are_checked_before_the_work(arguments, expected, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 1
    message = f"robot-dynamics {arguments[0]}: {expected.format('the path of the output file must end with')}"
    assert capsys.readouterr().err.startswith(message)
    assert not list(tmp_path.iterdir())


def test_endings_are_compared_without_case():
    assert check_ending("folder/Robot.YAML", (".yaml", ".yml")) == ".yaml"
    with pytest.raises(InvalidInputError, match=r"must end with \.csv"):
        check_ending("table", [".csv"])


def test_check_before_the_work_changes_no_file(tmp_path):
    empty, full, new, pipe = (tmp_path / name for name in ("empty", "full", "new/new", "pipe"))
    empty.touch()
    full.write_text("text")
    os.mkfifo(pipe)  # without a reader: opening it would wait
    for path in (empty, full, new, pipe):
        check_writable(path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "full", "new", "pipe"]
    assert full.read_text() == "text" and not new.exists() and pipe.is_fifo()
