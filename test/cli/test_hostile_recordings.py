"""Recordings and names that are damaged on purpose: a message or a verdict, never a traceback or an escape sequence."""

import tracemalloc

import numpy as np
import pytest
from peers.recorded import JOINTS, panda_motion

from robot_dynamics import Dynamics, InvalidInputError, load_robot, write_mdh_yaml
from robot_dynamics.cli.main import main
from robot_dynamics.cli.terminal_text import escape_controls, escape_line
from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings import tables
from robot_dynamics.recordings.drives import TableFiles, direct_drives
from robot_dynamics.recordings.recording import open_recording
from robot_dynamics.recordings.tables import MAX_COLUMNS, Table

MOTION = panda_motion(4.0)
HEAD = ["time", *(f"{name}.{field}" for name in JOINTS for field in ("position", "velocity", "effort"))]


def table(path, cells=(), head=HEAD):
    """A CSV of the motion, with {(row, column): text} in place of its numbers."""
    signals = np.stack([MOTION.q, MOTION.qd, MOTION.efforts], axis=-1).reshape(len(MOTION.times), -1)
    rows = [[f"{value:.12g}".encode() for value in row] for row in np.column_stack([MOTION.times, signals])]
    for (row, column), text in dict(cells).items():
        rows[row][column] = text
    path.write_bytes(b"\n".join([",".join(head).encode(), *map(b",".join, rows)]) + b"\n")
    return path


@pytest.mark.parametrize(
    ("cells", "note"),
    [
        ({(100, 1): b"0.1\xff"}, "cells have no number and were taken as missing"),
        (
            {(100, 1): b"1" * 131_073},
            "run.csv: 1 lines cannot be read and were skipped (the first one is line 102: field larger",
        ),
        ({(100, 0): b"1e300"}, "1 rows have a time that is no finite number, or beyond 9e+09 s"),
        ({(100, 1): b"1e300", (200, 1): b"-1e308"}, "2 samples have positions, velocities or efforts too large"),
        ({(100, 2): b"1e154"}, "1 samples have positions, velocities or efforts too large"),
        ({(100, 3): b"1e308"}, "1 samples have positions, velocities or efforts too large"),
        ({(row, 3): b"1e300" for row in range(100, 103)}, "3 samples have positions"),
    ],
)
def test_damaged_cells_are_left_out_with_a_note(cells, note, tmp_path, capsys):
    path = table(tmp_path / "run.csv", cells)
    recording = open_recording(path, direct_drives(JOINTS))
    assert sum(map(len, recording.signal_segments())) > 90
    main(["replay-check", str(path), "--robot", "panda", "--faults"])
    printed = capsys.readouterr()
    assert note in printed.out and printed.err == ""
    status = main(["identify", str(path), "--robot", "panda", "--friction", "viscous-coulomb"])
    printed = capsys.readouterr()
    assert (status in (0, 3) and note in printed.out) or "no sample is left to fit" in printed.err


def test_column_name_that_is_not_utf8_is_refused(tmp_path, capsys):
    path = table(tmp_path / "run.csv")
    path.write_bytes(path.read_bytes().replace(b"panda_joint1.position", b"panda\xff", 1))
    assert main(["replay-check", str(path), "--robot", "panda"]) == 1
    assert "the column 'panda\ufffd' is not UTF-8" in capsys.readouterr().err


def test_rows_after_an_unreadable_cell_are_read(tmp_path):
    path = table(tmp_path / "run.csv", {(100, 1): b"1" * 131_073, (200, 4): b"1" * 200_000})
    samples = list(Table(path).samples(()))
    assert len(samples) == len(MOTION.times) - 2
    np.testing.assert_allclose(samples[-1].position, MOTION.q[-1], rtol=1e-9)


def test_rows_of_several_files_stay_together_after_an_unreadable_cell(tmp_path):
    rows = 5000
    numbers = [f"{k}.5" for k in range(rows)]
    (tmp_path / "effort.csv").write_text("\n".join(["m1", *numbers]))
    numbers[100] = "1" * 131_073
    numbers[200] = '"' + numbers[200]  # without its end: the cell grows to the end of the file, or to the limit
    (tmp_path / "position.csv").write_text("\n".join(["m1", *numbers, *["0"] * 70_000]))
    source = Table(tmp_path, TableFiles(position="position.csv", effort="effort.csv", rate=100.0))
    samples = [sample for sample in source.samples(()) if np.isfinite(sample.position).all()]
    assert 190 < len(samples) <= rows
    for sample in samples:
        np.testing.assert_array_equal(sample.position, sample.effort)
    assert any("position.csv:" in note and "the first one is line 102" in note for note in source.notes)


def test_tables_with_many_columns_are_read(tmp_path):
    joints = [f"joint_{number}" for number in range(MAX_COLUMNS // 3)]
    head = ["time", *(f"{name}.{field}" for name in joints for field in ("position", "velocity", "effort"))]
    path = tmp_path / "wide.csv"
    path.write_text(",".join(head) + "\n" + ",".join(map(str, range(len(head)))) + "\n")
    (sample,) = Table(path).samples(())
    assert list(sample.names) == joints
    np.testing.assert_array_equal(sample.effort, np.arange(3, len(head), 3))


def test_memory_does_not_grow_with_columns_and_short_rows(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "CELLS_PER_CHUNK", 10 * MAX_COLUMNS)
    head = ["time", "a.position", "a.effort", *(f"unused_{number}" for number in range(MAX_COLUMNS - 3))]
    path = tmp_path / "short.csv"
    path.write_text(",".join(head) + "\n" + "".join(f"{number},1,2\n" for number in range(200)))
    tracemalloc.start()
    try:
        assert sum(1 for _ in Table(path).samples(())) == 200
        assert tracemalloc.get_traced_memory()[1] < 12e6
    finally:
        tracemalloc.stop()
    path.write_text(",".join(head) + ",more\n0,1,2\n")
    with pytest.raises(RecordingError, match=r"short\.csv has 10001 columns: at most 10000 can be read"):
        Table(path)


def test_dollar_signs_in_names_are_no_formulas_in_pictures(tmp_path):
    panda = load_robot("panda")
    text = write_mdh_yaml(panda).replace("panda_joint1", '"$x^{$"')
    robot = tmp_path / "robot.yaml"
    robot.write_text(text)
    head = [name.replace("panda_joint1", "$x^{$") for name in HEAD]
    path = table(tmp_path / "run.csv", head=head)
    pictures = tmp_path / "pictures"
    assert main(["replay-check", str(path), "--robot", str(robot), "--pictures", str(pictures)]) in (0, 3)
    assert len(list(pictures.iterdir())) == 3


def test_escape_sequences_in_names_do_not_reach_the_terminal(tmp_path, capsys):
    name = "\x1b[2J\x9b31m\rarm"
    quoted = '"\\x1b[2J\\x9b31m\\rarm"'
    robot = tmp_path / "robot.yaml"
    robot.write_text(write_mdh_yaml(load_robot("panda")).replace("panda_joint1", quoted))
    path = table(tmp_path / "run.csv", head=[column.replace("panda_joint1", "\x1b[31m") for column in HEAD])
    assert Dynamics(load_robot(robot)).joint_names[0] == name
    for arguments in (
        ["show", robot],
        ["replay-check", path, "--robot", robot],
        ["replay-check", tmp_path / "\x1b[31m.csv", "--robot", "panda"],
    ):
        main(list(map(str, arguments)))
        printed = capsys.readouterr()
        text = printed.out + printed.err
        assert "\\x1b[" in text and not any(character in text for character in "\x1b\x9b\r"), text


def test_names_and_errors_have_one_line(tmp_path, capsys):
    robot = tmp_path / "robot.yaml"
    robot.write_text(write_mdh_yaml(load_robot("panda")).replace("panda_joint1", '"a\\nb"'))
    assert main(["show", str(robot)]) == 0
    assert "a\\nb" in capsys.readouterr().out
    assert main(["show", "no\nrobot"]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert escape_controls("a\tb\n\x07\u202e") == "a\tb\n\\x07\\u202e" and escape_line("a\n") == "a\\n"
    with pytest.raises(InvalidInputError) as refusal:
        Dynamics(load_robot("panda")).gravity(np.array([["x"] * 7] * 3))
    assert "\n" not in str(refusal.value)
