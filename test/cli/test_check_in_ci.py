"""What CI needs of `robot-dynamics replay-check`: JUnit XML, a baseline, and parts of recordings."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
from peers.recorded import messages, panda_motion, write_bag

from robot_dynamics.cli.main import main

MOTION = panda_motion(duration=12.0)
NOISE = 0.1


def bag_with(path, seed=0, factor=1.0, offset=0.0, motion=MOTION):
    """A bag with noise; the efforts of joint 4 times a factor, plus an offset [N m]."""
    efforts = motion.efforts + NOISE * np.random.default_rng(seed).normal(size=motion.efforts.shape)
    efforts[:, 3] = factor * efforts[:, 3] + offset
    return write_bag(path, messages(motion._replace(efforts=efforts)))


def run(*arguments):
    return main(["replay-check", *map(str, arguments), "--robot", "panda"])


def results_of(path):
    return json.loads(path.read_text())["recordings"]


def test_junit_has_a_suite_for_each_recording_and_a_case_for_each_joint(tmp_path, capsys):
    good, bad = bag_with(tmp_path / "good"), bag_with(tmp_path / "bad", offset=15.0)
    text = tmp_path / "notes\x07.mcap"  # a character that XML does not allow
    text.write_text("hello")
    file = tmp_path / "junit.xml"
    assert run(good, bad, text, "--junit", file) == 3
    root = ElementTree.parse(file).getroot()
    assert (root.tag, root.get("tests"), root.get("failures"), root.get("errors")) == ("testsuites", "17", "1", "1")
    suites = list(root)
    assert [suite.tag for suite in suites] == 3 * ["testsuite"] and suites[0].get("name") == str(good)
    for suite, counts in zip(suites, (("8", "0", "0"), ("8", "1", "0"), ("1", "0", "1")), strict=True):
        assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == counts
        assert int(suite.get("skipped")) == len(suite.findall("testcase/skipped"))
        assert all(case.get("classname") == suite.get("name") for case in suite)
    (failed,) = [case for case in suites[1] if case.find("failure") is not None]
    assert failed.get("name") == "panda_joint4" and "where" in failed.find("failure").get("message")
    assert "bias of 1" in failed.find("failure").text
    skipped = {case.get("name") for case in suites[0] if case.find("skipped") is not None}
    assert "panda_joint7" in skipped  # an effort as large as its noise
    assert "is no bag" in suites[2].find("testcase/error").get("message")
    printed = capsys.readouterr().out
    escaped = str(text).replace("\x07", "\\x07")  # a terminal does not get the character either
    assert f"not checked: {escaped}" in printed and max(
        map(len, printed.split("\n\n")[0].splitlines()[:5])
    ) < 60 + 2 * len(str(good))
    assert run(text, "--junit", file) == 1
    assert ElementTree.parse(file).getroot().get("errors") == "1"


def test_too_little_data_fails_the_case_of_the_recording(tmp_path, capsys):
    """Pieces of 0.3 s between pauses of 0.1 s are too short for the filter; one of 2 s is not."""
    times = np.arange(0, 12, 0.01)
    kept = times[(times < 2) | (times % 0.4 < 0.3)]
    bag = bag_with(tmp_path / "pieces", motion=panda_motion(times=kept))
    file, figures = tmp_path / "junit.xml", tmp_path / "check.json"
    assert run(bag, "--junit", file, "--json", figures) == 3
    (suite,) = ElementTree.parse(file).getroot()
    assert "% of the recorded time was compared" in suite.find("testcase[@name='recording']/failure").get("message")
    (result,) = results_of(figures)
    assert result["passed"] is False and result["coverage"] < 0.5 and "of the recorded time" in result["objections"][0]
    assert "of the recorded time was compared" in capsys.readouterr().out
    assert run(bag, "--tolerances", "quick") in (0, 3)
    tolerances = tmp_path / "tolerances.yaml"
    tolerances.write_text("format: 1\nmin_coverage: 0.1\n")
    assert run(bag, "--tolerances", tolerances) == 0


def test_baseline_names_joints_that_became_worse_and_not_those_that_vary(tmp_path, capsys):
    first, again = bag_with(tmp_path / "first", seed=1), bag_with(tmp_path / "again", seed=2)
    worse = bag_with(tmp_path / "worse", seed=3, factor=1.03)
    old, new = tmp_path / "old.json", tmp_path / "new.json"
    assert run(first, "--json", old) == 0
    for bag in (first, again):
        assert run(bag, "--baseline", old) == 0, capsys.readouterr().out
        assert "0 of 7 joints are worse" in capsys.readouterr().out
    assert run(worse, "--tolerances", "quick") == 0
    assert run(worse, "--baseline", old, "--json", new, "--junit", tmp_path / "junit.xml") == 3
    assert "panda_joint4: worse than the baseline: RMS" in capsys.readouterr().out
    (result,) = results_of(new)
    changes = {change["joint"]: change for change in result["baseline"]}
    assert [name for name, change in changes.items() if change["worse"]] == ["panda_joint4"]
    assert (
        changes["panda_joint4"]["rms"] > changes["panda_joint4"]["rms_before"] == results_of(old)[0]["joints"][3]["rms"]
    )
    assert result["passed"] is False and all(joint["passed"] is not False for joint in result["joints"])
    assert "worse than the baseline" in (tmp_path / "junit.xml").read_text()


def test_baseline_of_several_recordings_is_matched_by_name(tmp_path, capsys):
    first, second = bag_with(tmp_path / "first", seed=1), bag_with(tmp_path / "second", seed=2)
    old = tmp_path / "old.json"
    assert run(first, "--json", old) == 0
    assert run(first, second, "--baseline", old) == 0
    printed = capsys.readouterr().out
    assert f"note: {second} is not in the baseline {old}, and not compared with it. It has {first}\n" in printed
    assert "0 of 7 joints are worse" in printed
    third = bag_with(tmp_path / "third", seed=3)
    assert run(first, second, third, "--baseline", old) == 0
    printed = capsys.readouterr().out
    assert f"note: {second}, {third} are not in the baseline" in printed and printed.count("not in the base") == 1
    refused = '{"recordings": [{"recording": "a", "refused": "b"}]}'
    for text, expected in (("{}", "is no result of replay-check"), ("x", "is no result"), (None, "cannot be read"),
                           (refused, "no recording that was checked")):  # fmt: skip
        file = tmp_path / f"{len(expected)}.json"
        if text is not None:
            file.write_text(text)
        assert run(first, "--baseline", file) == 1
        assert expected in capsys.readouterr().err
    assert run(first, "--baseline", old, "--json", old) == 1
    assert "is an input file" in capsys.readouterr().err


@pytest.mark.parametrize("as_bag", [True, False])
def test_parts_of_a_recording_are_those_of_a_recording_that_was_cut(tmp_path, capsys, as_bag):
    def recording(name, rows):
        part = MOTION._replace(**{field: getattr(MOTION, field)[rows] for field in MOTION._fields})
        if as_bag:
            return write_bag(tmp_path / name, messages(part))
        columns = [
            f"panda_joint{number}.{signal}" for signal in ("position", "velocity", "effort") for number in range(1, 8)
        ]
        path = tmp_path / f"{name}.csv"
        values = np.column_stack([part.times, part.q, part.qd, part.efforts])
        np.savetxt(path, values, "%.12g", ",", header=",".join(["time", *columns]), comments="")
        return path

    whole = recording("whole", slice(None))
    figures = tmp_path / "check.json"
    for arguments, rows in (
        (["--from", 3, "--to", "8.5"], slice(300, 850)),
        (["--from", 7.2], slice(720, None)),
        (["--samples", "200:900"], slice(200, 900)),
        (["--samples", ":500"], slice(None, 500)),
        (["--from", 1, "--samples", ":500"], slice(100, 500)),
    ):
        name = f"cut_{rows.start}_{rows.stop}"
        assert run(whole, *arguments, "--json", figures) == 0
        (part,) = results_of(figures)
        assert run(recording(name, rows), "--json", figures) == 0
        (cut,) = results_of(figures)
        assert part["duration"] == pytest.approx(cut["duration"])
        for joint, expected in zip(part["joints"], cut["joints"], strict=True):
            assert joint["samples"] == expected["samples"] and joint["rms"] == pytest.approx(expected["rms"], rel=1e-6)
        assert part["notes"][0].startswith("a part is used: ")
    capsys.readouterr()


@pytest.mark.parametrize("verb", ["replay-check", "identify"])
def test_invalid_parts_are_refused(tmp_path, capsys, verb):
    bag = bag_with(tmp_path / "run")
    for arguments, expected in (
        (["--samples", "5"], "A:B with whole numbers is needed"), (["--samples", "9:3"], "must be larger"),
        (["--from", "-1"], "0 or more"), (["--from", "5", "--to", "3"], "a time after --from 5"),
        (["--from", "nan"], "0 or more"), (["--from", "100"], "from 100 s"),
    ):  # fmt: skip
        assert main([verb, str(bag), "--robot", "panda", *arguments]) == 1
        assert expected in capsys.readouterr().err


def test_baseline_of_another_motion_is_said(tmp_path, capsys):
    first, again = bag_with(tmp_path / "first", seed=1), bag_with(tmp_path / "again", seed=2)
    other = bag_with(tmp_path / "other", motion=panda_motion(duration=12.0, seed=3, speed=0.5))
    old = tmp_path / "old.json"
    assert run(first, "--json", old) == 0
    run(again, "--baseline", old)
    assert "another motion" not in capsys.readouterr().out
    run(other, "--baseline", old)
    assert f"note: {other}: another motion or load than in the baseline" in capsys.readouterr().out


def test_words_for_one_recording_are_those_for_many(tmp_path, capsys):
    good, bad = bag_with(tmp_path / "good"), bag_with(tmp_path / "bad", offset=15.0)
    assert run(bad, "--faults") == 3
    alone = capsys.readouterr().out
    assert run(good, bad, "--faults") == 3
    together = capsys.readouterr().out
    (since,) = [line.partition("since ")[2] for line in alone.splitlines() if line.startswith("FAILED, out of tol")]
    (row,) = [line for line in together.splitlines() if line.startswith(str(bad)) and "FAILED" in line]
    assert "out of tolerance since [s]" in together and f" {since.removesuffix(' s')} " in row
    assert row.endswith("failed: panda_joint4; not judged: panda_joint7")
    assert "no fault found" in alone and together.count("no fault found") == 1
    notes = [line for line in together.splitlines() if line.startswith("note: ")]
    assert notes[0].startswith("note: both recordings: 26 samples are at the ends")
    assert together.endswith("1 passed, 1 FAILED\n")
