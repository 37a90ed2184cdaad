"""`robot-dynamics replay-check`: its output, files and exit status."""

import json

import numpy as np
import pytest
from matplotlib.image import imread
from peers.closed_pipe import run_with_closed_stdout
from peers.recorded import BEGINNING, JOINTS, messages, panda_motion, store, write_bag

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.cli.main import main
from robot_dynamics.model.loading import shipped_robots
from robot_dynamics.recordings.bags import Bag

MOTION = panda_motion(duration=12.0)


def faulty():
    efforts = MOTION.efforts.copy()
    efforts[700:, 3] += 10.0
    return MOTION._replace(efforts=efforts)


def run(*arguments):
    return main(["replay-check", *map(str, arguments)])


def test_exit_status_is_0_for_a_fitting_model_and_3_for_a_fault(tmp_path, capsys):
    good, bad = (write_bag(tmp_path / name, messages(motion)) for name, motion in (("good", MOTION), ("bad", faulty())))
    assert run(good, "--robot", "panda") == 0
    printed = capsys.readouterr()
    assert printed.out.endswith("\npassed\n") and printed.err == ""  # no progress bar in a pipe
    assert all(name in printed.out for name in JOINTS) and "1174 samples at 100 Hz" in printed.out
    assert run(bad, "--robot", "panda") == 3
    printed = capsys.readouterr().out
    assert "panda_joint4: out of tolerance from 7 s on" in printed and printed.endswith("since 7 s\n")
    assert printed.count("FAILED") == 2


def test_robot_that_rests_throughout_is_not_judged(tmp_path, capsys):
    dynamics = Dynamics(load_robot("panda"))
    rng = np.random.default_rng(0)
    times = np.arange(0, 6, 0.01)
    positions = np.tile([0, -0.3, 0, -1.9, 0, 1.9, 0.3], (len(times), 1))
    zero = np.zeros_like(positions)
    efforts = dynamics.inverse(positions, zero, zero) + 0.1 * rng.normal(size=positions.shape)
    columns = [f"{name}.{signal}" for name in dynamics.joint_names for signal in ("position", "velocity", "effort")]
    values = np.stack([positions, zero, efforts], axis=-1).reshape(len(times), -1)
    table = np.column_stack([times, values])
    hold = tmp_path / "hold.csv"
    np.savetxt(hold, table, delimiter=",", header=",".join(["time", *columns]), comments="")
    outputs = ["--json", tmp_path / "check.json", "--junit", tmp_path / "junit.xml"]
    assert run(hold, "--robot", "panda", *outputs) == 1
    printed = capsys.readouterr().out
    assert "panda_joint1: the joint rests throughout" in printed
    assert printed.endswith("no joint can be judged\n\nnot judged\n")
    results = json.loads((tmp_path / "check.json").read_text())
    assert results["passed"] is False and results["recordings"][0]["passed"] is None
    assert '<error message="no joint can be judged"' in (tmp_path / "junit.xml").read_text()
    good = write_bag(tmp_path / "good", messages(MOTION))
    assert run(hold, good, "--robot", "panda") == 1
    assert "1 passed, 0 FAILED, 1 not judged\n" in capsys.readouterr().out


@pytest.mark.slow
def test_json_and_pictures_agree_with_the_check(tmp_path, capsys):
    bag = write_bag(tmp_path / "bad", messages(faulty()))
    assert run(bag, "--robot", "panda", "--json", tmp_path / "out" / "check.json", "--pictures", tmp_path / "png") == 3
    results = json.loads((tmp_path / "out" / "check.json").read_text())
    assert results["passed"] is False and results["joints"][3]["failed"] == [str(bag)]
    (result,) = results["recordings"]
    assert result["recording"] == str(bag) and result["since"] == 7.0
    assert [joint["joint"] for joint in result["joints"] if not joint["passed"]] == ["panda_joint4"]
    residual = np.zeros(1174)  # without 13 samples at each end, which the filter needs
    residual[687:] = 10
    assert result["joints"][3]["rms"] == pytest.approx(np.sqrt((residual**2).mean()), rel=0.02)
    for name in ("efforts", "histograms", "friction"):
        picture = imread(tmp_path / "png" / f"{name}.png")
        assert picture.shape[1] > 1000 and picture[..., :3].std() > 0.05


def test_exit_status_is_1_for_recordings_that_cannot_be_checked(tmp_path, capsys):
    text = tmp_path / "notes.mcap"
    text.write_text("hello")
    short = write_bag(tmp_path / "short", messages(MOTION)[:2])
    string = store().types["std_msgs/msg/String"]("hello")
    chatter = write_bag(tmp_path / "chatter", [("/chatter", string)])
    lame = write_bag(tmp_path / "lame", messages(MOTION._replace(q=MOTION.q[:, :6]), JOINTS[:6]))
    silent = write_bag(tmp_path / "silent", messages(MOTION._replace(efforts=0 * MOTION.efforts)))
    for path, expected in (
        (text, "is no bag"), (tmp_path / "nowhere", "does not exist"), (short, "2 samples of the joints"),
        (chatter, "has no topic of sensor_msgs/msg/JointState"), (lame, "joints missing: panda_joint7"),
        (silent, "nothing was measured"),
    ):  # fmt: skip
        assert run(path, "--robot", "panda") == 1
        printed = capsys.readouterr()
        assert printed.err.startswith("robot-dynamics replay-check: ") and expected in printed.err, printed.err
    good = write_bag(tmp_path / "good", messages(MOTION))
    for arguments, expected in (
        (["--topic", "/joint_state"], "did you mean '/joint_states'"), (["--cutoff", "60"], "between 0 and 50"),
        (["--drives", "none.yaml"], "cannot be read"), (["--tolerances", "strickt"], "quick, normal or strict"),
        (["--rate", "-3"], "--rate -3"),
    ):  # fmt: skip
        assert run(good, "--robot", "panda", *arguments) == 1
        assert expected in capsys.readouterr().err


def test_a_recording_that_cannot_be_read_is_in_the_json(tmp_path, capsys):
    figures = tmp_path / "check.json"
    assert run(tmp_path / "nowhere", "--robot", "panda", "--json", figures) == 1
    assert "does not exist" in capsys.readouterr().err
    results = json.loads(figures.read_text())
    (result,) = results["recordings"]
    assert results["passed"] is False and results["joints"] == []
    assert result["passed"] is None and "does not exist" in result["refused"]


@pytest.mark.slow
def test_outputs_have_one_form_with_and_without_jobs(tmp_path, capsys):
    bag = write_bag(tmp_path / "good", messages(MOTION))
    reports = tmp_path / "reports"
    assert run(bag, "--robot", "panda", "--report", reports, "--json", tmp_path / "alone.json") == 0
    assert [path.name for path in reports.iterdir()] == ["good.html"]
    (reports / "good.html").unlink()
    assert run(bag, "--robot", "panda", "--report", reports, "--json", tmp_path / "jobs.json", "--jobs", "1") == 0
    assert [path.name for path in reports.iterdir()] == ["good.html"]
    assert json.loads((tmp_path / "alone.json").read_text()) == json.loads((tmp_path / "jobs.json").read_text())
    assert run(bag, "--robot", "panda", "--report", tmp_path / "good.HTML", "--jobs", "1") == 0
    assert (tmp_path / "good.HTML").is_file()
    capsys.readouterr()


def test_outputs_that_cannot_be_written_are_refused_before_the_check(tmp_path, capsys, monkeypatch):
    def checked(*_, **__):
        raise AssertionError("the recording was read")

    monkeypatch.setattr("robot_dynamics.checking.batch_check.check_recording", checked)
    bag = write_bag(tmp_path / "good", messages(MOTION)[:20])
    file = tmp_path / "file"
    file.touch()
    for arguments, expected in (
        (["--json", tmp_path], "Is a directory"), (["--json", file / "check.json"], "File exists"),
        (["--report", file], "File exists"), (["--report", file / "report.html"], "File exists"),
        (["--pictures", file], "File exists"),
        ([tmp_path / "other", "--report", tmp_path / "report.html"], "name a folder, without .html"),
    ):  # fmt: skip
        assert run(bag, *arguments, "--robot", "panda") == 1
        assert expected in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "good"] and file.read_bytes() == b""


@pytest.mark.parametrize("jobs", [[], ["--jobs", "1"]])
def test_closed_pipe_keeps_the_files_and_the_verdict(jobs, tmp_path):
    bag, figures = write_bag(tmp_path / "bad", messages(faulty())), tmp_path / "check.json"
    assert run_with_closed_stdout("replay-check", bag, "--robot", "panda", "--json", figures, *jobs) == (3, "")
    assert json.loads(figures.read_text())["passed"] is False


@pytest.mark.parametrize("verb", ["replay-check", "identify"])
def test_robots_with_unactuated_joints_are_refused_before_reading(verb, capsys):
    assert main([verb, "nowhere.csv", "--robot", "manutec_r3"]) == 1
    message = capsys.readouterr().err
    assert "no motor drives spring_1, spring_2, spring_3: recordings are read for robots whose independent" in message


def test_golden_bag_contains_the_predictions_and_detects_changes(tmp_path, capsys):
    bag, golden = write_bag(tmp_path / "run", messages(MOTION)), tmp_path / "golden"
    assert run(bag, "--robot", "panda", "--write-golden", golden) == 0
    written = list(Bag(golden).samples(["/predicted_effort"]))
    assert len(written) == 1174 and written[0].names == JOINTS
    stamps = np.array([sample.stamp for sample in written])
    assert np.abs(stamps - BEGINNING - np.round(MOTION.times[13:-13] * 1e9)).max() <= 1
    assert np.abs(np.array([sample.effort for sample in written]) - MOTION.efforts[13:-13])[100:-100].max() < 0.05
    capsys.readouterr()
    assert run(bag, "--robot", "panda", "--golden", golden) == 0
    printed = capsys.readouterr().out
    assert printed.count("predicted efforts are those of the golden bag") == 1 and printed.endswith("\npassed\n")
    heavier = tmp_path / "heavier.urdf"
    heavier.write_text(shipped_robots()["panda"].read_text().replace('mass value="0.735522"', 'mass value="0.7356"'))
    assert heavier.read_text() != shipped_robots()["panda"].read_text()
    figures = tmp_path / "check.json"
    assert run(bag, "--robot", heavier, "--golden", golden, "--json", figures) == 3
    printed = capsys.readouterr().out
    assert "panda_joint4: predicted effort differs from the golden bag" in printed and printed.endswith("\nFAILED\n")
    assert "predicted efforts are those" not in printed and "\npassed" not in printed
    results = json.loads(figures.read_text())
    assert results["passed"] is False and any(
        "panda_joint4" in difference for difference in results["recordings"][0]["golden"]
    )
    for arguments, expected in (
        (["--write-golden", golden], "exists already"), (["--golden", bag], "unknown topic '/predicted_effort'"),
        (["--golden", golden, "--cutoff", "5"], "stamps differ"), (["--golden", "nogolden"], "nogolden does not exist"),
    ):  # fmt: skip
        assert run(bag, "--robot", "panda", *arguments) == 1
        assert expected in capsys.readouterr().err


@pytest.mark.slow
def test_report_opens_in_a_browser_without_network(tmp_path, browser):
    bag = write_bag(tmp_path / "bad", messages(faulty()))
    assert run(bag, "--robot", "panda", "--report", tmp_path / "report.html") == 3
    page, errors, requests = browser.new_page(), [], []
    page.on("console", lambda message: errors.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(f"file://{tmp_path / 'report.html'}")
    page.wait_for_function("document.querySelectorAll('.plotly-graph-div .main-svg').length > 0", timeout=30_000)
    assert [url for url in requests if not url.startswith(("file:", "data:", "blob:"))] == []
    rows = page.locator("#joints tr").all_inner_texts()
    assert len(rows) == 8 and [name for name, row in zip(JOINTS, rows[1:], strict=True) if name in row] == list(JOINTS)
    assert page.locator("#joints .failed").count() == 1 and page.locator("#segments tr").count() == 2
    for number in range(7):
        traces = page.evaluate(f"document.getElementById('joint-{number}').data.map(t => [t.name, t.x.length || 1200])")
        assert [name for name, _ in traces] == ["measured", "predicted", "residual"]
        lines = page.locator(f"#joint-{number} .scatterlayer .trace path.js-line")
        lengths = [len(line.get_attribute("d")) for line in lines.all()]  # the residual may be a straight line
        assert len(lengths) == 3 and min(lengths) > 10 and min(lengths[:2]) > 500
    before = page.evaluate("document.getElementById('joint-3').layout.xaxis.range")
    plot = page.locator("#joint-3 .nsewdrag").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.3 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.7 * box["height"], steps=5)
    page.mouse.up()
    page.wait_for_timeout(800)
    after = page.evaluate("document.getElementById('joint-3').layout.xaxis.range")
    assert after[1] - after[0] == pytest.approx(0.1 * (before[1] - before[0]), rel=0.15)
    assert errors == []
    page.close()
