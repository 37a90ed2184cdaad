"""The verb motion-report: tables, JSON, pictures and re-timed motions."""

import json
import re

import numpy as np
import pytest
from scipy.integrate import trapezoid

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.cli.main import main
from robot_dynamics.cli.motion_report import _percent, _rounded_mean


@pytest.fixture(scope="module")
def excited(tmp_path_factory):
    """The trajectory that excite designs for a UR5e: 2 s, by its first guess."""
    path = tmp_path_factory.mktemp("excited") / "trajectory.csv"
    arguments = ["--duration", "2", "--harmonics", "2", "--iterations", "1", "--rate", "100"]
    assert main(["excite", "ur5e", "--output", str(path), *arguments]) == 0
    return path


def read_table(path):
    names = path.read_text().partition("\n")[0].split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


def test_report_has_the_figures_of_the_inverse_model(excited, tmp_path, capsys):
    assert main(["motion-report", "ur5e", str(excited), "--json", str(tmp_path / "report.json")]) == 0
    printed = capsys.readouterr().out
    figures = json.loads((tmp_path / "report.json").read_text())
    table, dynamics = read_table(excited), Dynamics(load_robot("ur5e"))
    q, qd, qdd = (
        np.column_stack([table[f"{name}.{kind}"] for name in dynamics.joint_names])
        for kind in ("position", "velocity", "acceleration")
    )
    efforts = dynamics.inverse(q, qd, qdd)
    limits = np.array([joint.limits.effort for joint in dynamics.robot.joints])
    for column, (name, actuator) in enumerate(zip(dynamics.joint_names, figures["actuators"], strict=True)):
        assert actuator["name"] == name
        assert actuator["rms_effort"] == pytest.approx(np.sqrt(trapezoid(efforts[:, column] ** 2, dx=0.01) / 2))
        peak = np.abs(efforts[:, column]).max()
        assert abs(actuator["peak_effort"]) == pytest.approx(peak)
        assert actuator["effort_usage"] == pytest.approx(peak / limits[column])
        assert re.search(rf"^{name} +N m +{actuator['rms_effort']:.4g} +", printed, re.MULTILINE)
    assert "201 samples, 2 s, planned" in printed and figures["duration"] == pytest.approx(2)
    scale = figures["time_scale"]
    assert f"{scale['scale']:.4g} times its time" in printed and scale["quantity"] in ("effort", "velocity")
    supplied = sum(joint["supplied"] - joint["regenerated"] for joint in figures["joints"])
    assert supplied == pytest.approx(0, abs=1e-3)  # from rest to rest at the same place, without friction


def test_retimed_motion_and_its_picture_are_written(excited, tmp_path, capsys):
    new, picture, report = (tmp_path / name for name in ("new.csv", "new.png", "new.json"))
    outputs = ["--output", str(new), "--output", str(picture), "--json", str(report)]
    assert main(["motion-report", "ur5e", str(excited), "--retime", *outputs]) == 0
    printed = capsys.readouterr().out
    duration = json.loads(report.read_text())["retimed"]["duration"]
    assert f"re-timed: {duration:.4g} s" in printed and re.search(r"at most 99\.99\d% of a limit is used", printed)
    assert duration < 1.8 and picture.read_bytes().startswith(b"\x89PNG")
    table, dynamics = read_table(new), Dynamics(load_robot("ur5e"))
    assert table["time"][-1] == pytest.approx(duration, abs=0.02)
    states = [
        np.column_stack([table[f"{name}.{kind}"] for name in dynamics.joint_names])
        for kind in ("position", "velocity", "acceleration", "effort")
    ]
    np.testing.assert_allclose(dynamics.inverse(*states[:3]), states[3], atol=1e-5)
    limits = [joint.limits for joint in dynamics.robot.joints]
    usage = np.abs(states[3] / [limit.effort for limit in limits]).max(axis=1)
    speed = np.abs(states[1] / [limit.velocity for limit in limits]).max(axis=1)
    assert np.maximum(usage, speed).max() <= 1 + 1e-9 and np.median(np.maximum(usage, speed)) > 0.98
    assert main(["motion-report", "ur5e", str(new), "--output", str(tmp_path / "report.pdf")]) == 0
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")


def test_numbers_that_rounding_leaves_are_zero_and_a_passed_limit_is_seen():
    assert _rounded_mean(-4e-14, 200.0) == 0.0 and _rounded_mean(-4e-6, 200.0) == -4e-6
    assert _percent(1.002, 87.0) == 100.2 and _percent(1.002, np.inf) is None


def test_recordings_are_filtered(excited, tmp_path, capsys):
    table = read_table(excited)
    names = ["time", *(name for name in table if name.endswith(".position"))]
    columns = np.column_stack([table[name] for name in names])
    recorded = tmp_path / "recorded.csv"
    np.savetxt(recorded, columns, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    assert main(["motion-report", "ur5e", str(recorded), "--json", str(tmp_path / "recorded.json")]) == 0
    assert "filtered at 8 Hz" in capsys.readouterr().out
    assert main(["motion-report", "ur5e", str(excited), "--json", str(tmp_path / "planned.json")]) == 0
    recorded_rms, planned_rms = (
        [actuator["rms_effort"] for actuator in json.loads((tmp_path / name).read_text())["actuators"]]
        for name in ("recorded.json", "planned.json")
    )
    np.testing.assert_allclose(recorded_rms, planned_rms, rtol=0.1)


def test_planned_positions_are_not_filtered_and_their_path_is_kept_to_its_ends(excited, tmp_path, capsys):
    """The accelerations that `excite` wrote are those of the spline; the re-timed motion has the ends of the path."""
    table = read_table(excited)
    names = ["time", *(name for name in table if name.endswith(".position"))]
    columns = np.column_stack([table[name] for name in names])
    path, faster = tmp_path / "path.csv", tmp_path / "faster.csv"
    np.savetxt(path, columns, delimiter=",", header=",".join(names), comments="", fmt="%.12g")
    for options, figures in (([str(path), "--planned"], "path.json"), ([str(excited)], "excited.json")):
        assert main(["motion-report", "ur5e", *options, "--json", str(tmp_path / figures)]) == 0
    assert capsys.readouterr().out.count(", planned") == 2
    by_spline, given = (
        [actuator["rms_effort"] for actuator in json.loads((tmp_path / name).read_text())["actuators"]]
        for name in ("path.json", "excited.json")
    )
    np.testing.assert_allclose(by_spline, given, rtol=1e-3)
    for options, error, has_note in ((["--planned"], 1e-8, False), ([], np.inf, True)):
        arguments = ["motion-report", "ur5e", str(path), "--retime", "--output", str(faster), *options]
        assert main(arguments) == 0
        assert ("note: begins at" in capsys.readouterr().out) == has_note
        new = read_table(faster)
        ends = [[new[name][k] - table[name][k] for name in names[1:]] for k in (0, -1)]
        assert np.abs(ends).max() < error
    for options in (["--planned", "--cutoff", "5"], ["--planned", "--from", "1"]):
        assert main(["motion-report", "ur5e", str(path), *options]) == 1
        assert "leave out --cutoff, --from, --to and --samples" in capsys.readouterr().err
    np.savetxt(path, columns[:5], delimiter=",", header=",".join(names), comments="")
    assert main(["motion-report", "ur5e", str(path), "--planned"]) == 1
    assert "6 or more are needed for a spline" in capsys.readouterr().err


def test_outputs_that_cannot_be_written_are_refused(excited, tmp_path, capsys):
    for arguments, reason in (
        (["--output", str(tmp_path / "new.csv")], "is written with --retime, which is missing"),
        (["--output", str(tmp_path / "new.txt")], "must end with .png, .pdf, .svg or .csv"),
        (["--retime", "--output", str(excited)], "is an input file of this command"),
    ):
        assert main(["motion-report", "ur5e", str(excited), *arguments]) == 1
        assert reason in capsys.readouterr().err
    assert main(["motion-report", "ur5e", str(tmp_path / "missing.csv")]) == 1
    assert "does not exist" in capsys.readouterr().err
