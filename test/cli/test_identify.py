"""`robot-dynamics identify`: from bags to a description that `replay-check` accepts."""

import json
import re
import sys
from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from peers.closed_pipe import run_with_closed_stdout
from peers.real_robots import real_urdf, without_inertials
from peers.recorded import JOINTS, loaded_panda, messages, panda_model, panda_motion, uneven_times, write_bag

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.cli.main import main
from robot_dynamics.cli.parameter_rows import describe_negative_values
from robot_dynamics.cli.payload_arguments import parse_known_payloads
from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.identification.drive_gains import Payload
from robot_dynamics.recordings.drives import direct_drives, load_drives
from robot_dynamics.recordings.recording import open_recording


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Two recordings of a Panda with a hand of 0.9 kg and friction, which the description does not contain."""
    folder, model = tmp_path_factory.mktemp("bags"), panda_model()
    model.inertias[7].mass += 0.9
    motions = [panda_motion(30.0, seed=seed, viscous=1.5, coulomb=0.6, model=model) for seed in (1, 2)]
    return [write_bag(folder / f"run_{k}", messages(motion)) for k, motion in enumerate(motions)]


@pytest.mark.slow
def test_identify_corrects_a_wrong_description(bags, tmp_path, capsys):
    fitted, drives, figures = (tmp_path / "out" / name for name in ("panda.yaml", "drives.yaml", "fit.json"))
    arguments = ["--robot", "panda", "--output", fitted, "--output-drives", drives, "--json", figures]
    tight = tmp_path / "tight.yaml"
    tight.write_text("format: 1\nnormalised_rms: 0.1\neffort_share: 0.004\nwindow_factor: 5")
    check = ["replay-check", bags[1], "--tolerances", tight, "--robot"]
    assert main([*map(str, check), "panda"]) == 3
    assert main(["identify", *map(str, [bags[0], "--validate", bags[1], *arguments])]) == 0
    printed = capsys.readouterr().out
    assert "48 base parameters with 14 of friction and 7 of drives" in printed and "validated" in printed
    assert main([*map(str, check), str(fitted), "--drives", str(drives)]) == 0
    robot = load_robot(fitted)
    assert robot.warnings == ()
    assert [joint.viscous_friction for joint in robot.joints] == pytest.approx([1.5] * 7, abs=0.05)
    assert [joint.coulomb_friction for joint in robot.joints] == pytest.approx([0.6] * 7, abs=0.05)
    results = json.loads(figures.read_text())
    assert len(results["parameters"]) == 69 and max(results["validated"]["rms"]) < 0.2
    assert max(results["consistent_validated"]["rms"]) < 0.2 and results["verdict"] == "well"
    assert not any(results["validation_failed"]) and "validation fails" not in printed
    mass = next(entry for entry in results["parameters"] if entry["name"] == "MX.panda_link6")
    assert mass["seen"] and mass["value"] > mass["description"] + 20 * mass["deviation"]  # the hand
    assert mass["deviation_within_run"] == mass["deviation"]
    viscous = next(entry for entry in results["parameters"] if entry["name"] == "Fv.panda_joint1")
    assert viscous["value"] == pytest.approx(1.5, abs=0.05)
    assert viscous["written"] == pytest.approx(robot.joints[0].viscous_friction, abs=1e-9)


def test_a_recording_that_does_not_determine_the_robot_has_another_exit_status(tmp_path, capsys):
    motion = panda_motion(4.0, viscous=1.5, coulomb=0.6, speed=0.2)
    noisy = motion._replace(efforts=motion.efforts + np.random.default_rng(0).normal(scale=0.3, size=motion.q.shape))
    bag, figures = write_bag(tmp_path / "run", messages(noisy)), tmp_path / "fit.json"
    assert main(["identify", str(bag), "--robot", "panda", "--json", str(figures)]) == 3
    printed = capsys.readouterr().out
    assert "verdict: not determined" in printed and "not seen" in printed and "uncertain: panda_joint" in printed
    results = json.loads(figures.read_text())
    assert results["verdict"] == "not determined" and results["main_unknown_parameters"]
    unseen = [entry for entry in results["parameters"] if not entry["seen"]]
    assert len(unseen) > 10 and not any(entry["essential"] for entry in unseen)


def test_a_robot_that_has_changed_fails_the_validation(bags, tmp_path, capsys):
    """The robot of the second recording carries 2 kg."""
    pytest.importorskip("clarabel", reason="clarabel, which computes physically consistent inertias, is not installed")
    changed = panda_motion(20.0, seed=3, viscous=1.5, coulomb=0.6, model=loaded_panda(2.0))
    bag, figures = write_bag(tmp_path / "run", messages(changed)), tmp_path / "fit.json"
    assert main(["identify", str(bags[0]), "--robot", "panda", "--validate", str(bag), "--json", str(figures)]) == 0
    printed = capsys.readouterr().out
    assert "written: validated" in printed and "validation fails" in printed
    results = json.loads(figures.read_text())
    assert max(results["validation_growth"]) > 1.5 and any(results["validation_failed"])
    assert any("the residuals are larger than on fitted data: panda_joint" in text for text in results["warnings"])
    assert max(results["consistent_validated"]["rms"]) > 3 * max(results["consistent"]["rms"])
    (alternative,) = results["alternatives"]
    assert alternative["option"] == "--no-rotor-inertia" and len(alternative["held_out_rms"]) == 7


def test_values_that_the_written_robot_cannot_have_are_said(tmp_path, capsys):
    """Joints that efforts drive along: negative viscous friction, which no written robot has."""
    pytest.importorskip("clarabel", reason="clarabel, which computes physically consistent inertias, is not installed")
    motion = panda_motion(20.0, viscous=-0.5, coulomb=1.0)
    bag, figures, fitted = (
        write_bag(tmp_path / "run", messages(motion)),
        tmp_path / "fit.json",
        tmp_path / "fitted.yaml",
    )
    assert main(["identify", str(bag), "--robot", "panda", "--json", str(figures), "--output", str(fitted)]) == 0
    printed = capsys.readouterr().out
    assert "below zero in the fit, and not in the written robot: " in printed and "Fv.panda_joint1 -0.5" in printed
    parameters = {entry["name"]: entry for entry in json.loads(figures.read_text())["parameters"]}
    joints = load_robot(fitted).joints
    for number, name in enumerate(JOINTS):
        assert parameters[f"Fv.{name}"]["value"] < -0.4 and joints[number].viscous_friction < 1e-3
        for key, written in (("Fv", joints[number].viscous_friction), ("Fs", joints[number].coulomb_friction)):
            assert parameters[f"{key}.{name}"]["written"] == pytest.approx(written, abs=1e-5)


def test_sums_of_friction_below_zero_are_said():
    model = SimpleNamespace(
        names=("Fv.a", "Fs.a", "Fva.a", "Fst.a", "Fv.b", "Fs.b", "Fst.b"),
        dynamics=SimpleNamespace(joint_names=("a", "b")),
    )
    fit = SimpleNamespace(model=model, values=np.array([1, 2, -1.5, -2.5, -0.1, 2, -1.0]), seen=np.ones(7, dtype=bool))
    fit.standard_deviations = np.full(7, 0.2)
    assert describe_negative_values(fit) == ["Fs + Fst of a -0.5", "Fv - |Fva| of a -0.5"]


def test_the_written_robot_is_not_needed_without_its_solver(bags, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "clarabel", None)
    assert main(["identify", str(bags[0]), "--robot", "panda"]) == 0
    printed = capsys.readouterr().out
    assert "note: the physically consistent robot was not computed" in printed and "written: fitted" not in printed


def test_short_pieces_between_gaps_are_left_out_and_reported(bags, tmp_path, capsys):
    motion = panda_motion(times=uneven_times("pieces", 40.0), viscous=1.5, coulomb=0.6)
    bag, figures = write_bag(tmp_path / "run", messages(motion)), tmp_path / "fit.json"
    assert main(["identify", str(bag), "--robot", "panda", "--json", str(figures)]) == 0
    assert "samples are in segments too short to be filtered and were skipped" in capsys.readouterr().out
    parameters = json.loads(figures.read_text())["parameters"]
    friction = [parameter["value"] for parameter in parameters if parameter["name"][:2] == "Fv"]
    assert friction == pytest.approx([1.5] * 7, abs=0.15)


def test_closed_pipe_keeps_the_files(bags, tmp_path):
    files = tmp_path / "fitted.yaml", tmp_path / "drives.yaml", tmp_path / "fit.json"
    outputs = "--output", files[0], "--output-drives", files[1], "--json", files[2]
    assert run_with_closed_stdout("identify", bags[0], "--robot", "panda", *outputs) == (0, "")
    assert [file.stat().st_size > 100 for file in files] == [True] * 3


@pytest.mark.slow
def test_identify_completes_a_description_without_masses(tmp_path, capsys):
    """The robot is a Unitree Z1 without <inertial> elements; the fitted robot has the efforts of the original."""
    text = real_urdf("z1")
    model = pin.buildModelFromXML(text)
    bare, fitted = tmp_path / "bare.urdf", tmp_path / "fitted.yaml"
    bare.write_text(re.sub(r"<dynamics[^>]*>", "", without_inertials(text)))
    names = list(model.names)[1:]
    recorded = panda_motion(40.0, seed=1, model=model, speed=1.5)
    bag = write_bag(tmp_path / "run", messages(recorded, names))
    assert main(["identify", str(bag), "--robot", str(bare), "--output", str(fitted)]) == 0
    assert "48 base parameters with 14 of friction and 7 of drives" in capsys.readouterr().out
    robot = load_robot(fitted)
    assert not robot.is_massless
    validation = panda_motion(5.0, seed=2, model=model)
    order = [names.index(name) for name in Dynamics(robot).joint_names]
    efforts = Dynamics(robot).inverse(*(values[:, order] for values in (validation.q, validation.qd, validation.qdd)))
    assert np.abs(efforts - validation.efforts[:, order]).max() < 0.02 * np.abs(validation.efforts).max()


@pytest.mark.slow
def test_wrong_options_are_refused(bags, tmp_path, capsys):
    folder = tmp_path / "folder.yaml"
    folder.mkdir()
    for arguments, expected in (
        (["--hold-out", "2"], "0 to 0.95"), (["--hold-out", "0.5", "--validate", bags[1]], "use one of the two"),
        (["--band", "70"], "between 0 and 50"), (["--output", folder], "folder.yaml cannot be written"),
        (["--output", tmp_path / "x.urdf"], "x.urdf: the path of the output file must end with"),
        (["--output-drives", tmp_path / "x"], "--output-drives"),
        (["--json", bags[0] / "metadata.yaml"], "metadata.yaml is an input file"),
    ):  # fmt: skip
        assert main(["identify", str(bags[0]), "--robot", "panda", *map(str, arguments)]) == 1
        assert expected in capsys.readouterr().err


def test_input_files_are_not_overwritten(tmp_path, capsys):
    files = {name: tmp_path / name for name in ("run.csv", "other.csv", "drives.yaml", "values.yaml", "robot.yaml")}
    for name, file in files.items():
        file.write_text(f"kept {name}")
    run, validation, drives, values, robot = map(str, files.values())
    command = ["identify", run, "--validate", validation, "--robot", robot, "--drives", drives, "--values", values]
    same = str(tmp_path / ".." / tmp_path.name / "run.csv")
    for output in (["--output", same], ["--output-drives", drives], ["--json", validation], ["--output", values],
                    ["--output", robot]):  # fmt: skip
        assert main([*command, *output]) == 1
        assert f"{output[1]} is an input file" in capsys.readouterr().err
    for arguments, expected in ((["replay-check", run, "--robot", robot, "--report", run], run),
                                (["excite", robot, "--output", robot], robot),
                                (["map", robot, "--over", "x:0:1:2", "--csv", robot], robot)):  # fmt: skip
        assert main(arguments) == 1
        assert f"{expected} is an input file" in capsys.readouterr().err
    assert all(file.read_text() == f"kept {name}" for name, file in files.items())


def test_missing_efforts_are_not_fitted_as_zeros(tmp_path, capsys):
    motion = panda_motion(12.0)
    columns = np.column_stack([motion.times, motion.q])
    path, header = tmp_path / "run.csv", ",".join(["time", *(f"{name}.position" for name in JOINTS)])
    np.savetxt(path, columns, delimiter=",", header=header, comments="")
    assert main(["identify", str(path), "--robot", "panda"]) == 1
    message = capsys.readouterr().err
    assert "no measured efforts of panda_joint1" in message and "columns panda_joint1.effort" in message
    efforts = motion.efforts.copy()
    efforts[:, 2] = np.nan
    bag = write_bag(tmp_path / "run", messages(motion._replace(efforts=efforts)))
    assert main(["identify", str(bag), "--robot", "panda"]) == 1
    assert (
        "no measured efforts of panda_joint3: identification needs the efforts of all joints" in capsys.readouterr().err
    )


CONSTANTS = np.array([9.1, 12.8, 11.0, 10.2, 6.3, 7.7, 5.9])  # [N m/A]


@pytest.fixture(scope="module")
def currents(tmp_path_factory):
    """Currents without noise of a bare Panda and of one with a payload of 2.5 kg at an unknown position."""
    folder, bags = tmp_path_factory.mktemp("currents"), []
    for name, model in (("bare", None), ("loaded", loaded_panda(2.5, (0.02, 0.01, 0.18), 0.01))):
        motion = panda_motion(30.0, 50.0, seed=len(bags), viscous=1.5, coulomb=0.6, model=model)
        bags.append(write_bag(folder / name, messages(motion._replace(efforts=motion.efforts / CONSTANTS))))
    return bags


@pytest.mark.slow
def test_drive_gains_are_identified_from_currents_and_written(currents, tmp_path, capsys):
    bare, loaded = map(str, currents)
    fitted, drives, figures = (str(tmp_path / name) for name in ("panda.yaml", "drives.yaml", "fit.json"))
    command = ["identify", bare, loaded, "--robot", "panda", "--gains", "--known-payload", f"{loaded}=panda_link8:2.5"]
    assert main([*command, "--output", fitted, "--output-drives", drives, "--json", figures, "--jobs", "2"]) == 0
    printed = capsys.readouterr().out
    assert "Drive gains: motor efforts per measured value" in printed and "48 base parameters" in printed
    assert load_drives(drives, JOINTS).effort_gains == pytest.approx(CONSTANTS, rel=0.01)
    gains = json.loads(open(figures).read())["gains"]
    assert [gain["name"] for gain in gains] == list(JOINTS)
    assert [gain["gain"] for gain in gains] == pytest.approx(CONSTANTS, rel=0.01)
    assert not any(gain["uncertain"] for gain in gains)
    assert main(["replay-check", bare, "--robot", fitted, "--drives", drives]) == 0
    assert main(["replay-check", bare, "--robot", "panda"]) == 3


def test_gains_without_suitable_recordings_are_refused(currents, capsys):
    bare, loaded = map(str, currents)
    assert main(["identify", bare, loaded, "--robot", "panda", "--gains"]) == 1
    assert "twice the masses and twice the gains" in capsys.readouterr().err
    everywhere = [f"--known-payload={path}=panda_link8:2.5" for path in currents]
    assert main(["identify", bare, loaded, "--robot", "panda", "--gains", *everywhere]) == 1
    assert "runs without it" in capsys.readouterr().err


def test_known_payloads_are_parsed_or_refused(currents):
    robot = load_robot("panda")
    recordings = [open_recording(path, direct_drives(JOINTS)) for path in currents]
    loaded = str(currents[1])

    def parse(*payloads, gains=True, fitted=2):
        arguments = Namespace(known_payload=list(payloads), gains=gains, recordings=currents[:fitted])
        return parse_known_payloads(arguments, robot, recordings)

    assert parse(f"{loaded}=panda_link8:2.5") == {loaded: Payload("panda_link8", 2.5)}
    for payloads, expected in (
        ([f"{loaded}=panda_link8"], "RECORDING=LINK:MASS is needed"), ([loaded], "RECORDING=LINK:MASS is needed"),
        ([f"{loaded}=panda_link8:-1"], "RECORDING=LINK:MASS is needed"), ([f"{loaded}=panda_link9:1"], "panda_link9"),
        ([f"{loaded}=panda_link0:1"], "no joint carries it"), (["nowhere=panda_link8:1"], "not one of the recordings"),
        (2 * [f"{loaded}=panda_link8:1"], "has a payload already"),
        (["nowhere=panda_link8:1"], f"Name one of: {currents[0]}, {currents[1]}"),
    ):  # fmt: skip
        with pytest.raises(RobotDynamicsError, match=expected):
            parse(*payloads)
    assert parse(f"{Path(loaded).name}=panda_link8:2.5") == {loaded: Payload("panda_link8", 2.5)}
    with pytest.raises(RobotDynamicsError, match="only with --gains"):
        parse(f"{loaded}=panda_link8:1", gains=False)
    with pytest.raises(RobotDynamicsError, match="in no recording that is fitted"):
        parse(f"{loaded}=panda_link8:1", fitted=1)
