"""`robot-dynamics identify --friction`, with recordings of a Panda whose friction is known in closed form."""

import json
from argparse import Namespace
from dataclasses import replace

import numpy as np
import pytest
from peers.frictional_panda import PLAIN, VARIED, FrictionalPanda
from peers.recorded import JOINTS

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.cli.friction_arguments import dynamics_to_identify, parse_friction
from robot_dynamics.cli.main import main
from robot_dynamics.errors import RecordingError


def write_recording(path, further, motion_seed=0):
    recording = FrictionalPanda(further, motion_seed=motion_seed, duration=45.0)
    motion = recording.motion
    signals = np.stack([motion.q, motion.qd, recording.efforts], axis=-1).reshape(len(motion.q), -1)
    names = [f"{joint}.{signal}" for joint in JOINTS for signal in ("position", "velocity", "effort")]
    table = np.column_stack([motion.times, signals])
    np.savetxt(path, table, delimiter=",", header=",".join(["time", *names]), comments="")
    return str(path)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("frictional")
    return [write_recording(folder / f"run_{seed}.csv", VARIED, seed) for seed in (0, 5)]


@pytest.mark.slow
def test_chosen_friction_is_written_and_validated(recordings, tmp_path, capsys):
    fitted, drives, figures = (str(tmp_path / name) for name in ("fitted.yaml", "drives.yaml", "fit.json"))
    options = ["--robot", "panda", "--validate", recordings[1], "--json", figures]
    assert main(["identify", recordings[0], *options, "--output", fitted, "--output-drives", drives]) == 0
    printed = capsys.readouterr().out
    assert "Friction chosen by held-out data" in printed and "vs.panda_joint1" in printed
    results = json.loads((tmp_path / "fit.json").read_text())
    friction = results["friction"]
    assert friction["models"][:5] == [["stribeck"], ["load"], ["stribeck"], ["load"], []]
    plain, validated = (
        np.array(values) for values in (friction["validated_rms_viscous_coulomb"], results["validated"]["rms"])
    )
    assert (validated[:4] < 0.9 * plain[:4]).all()
    velocity = next(entry for entry in results["parameters"] if entry["name"] == "vs.panda_joint3")
    assert velocity["seen"] and abs(velocity["value"] - 0.2) < 3 * velocity["deviation"] < 0.3
    assert main(["replay-check", recordings[1], "--robot", fitted, "--drives", drives]) == 0
    written = load_robot(fitted)
    assert written.joints[0].stribeck_friction > 1 and written.joints[1].load_friction == pytest.approx(0.2, abs=0.05)
    assert main(["identify", recordings[0], "--robot", fitted, "--friction", "described", "--json", figures]) == 0
    again = json.loads((tmp_path / "fit.json").read_text())
    names = [entry["name"] for entry in again["parameters"]]
    assert "Fst.panda_joint1" in names and "vs.panda_joint1" not in names and again["friction"] is None


@pytest.mark.slow
def test_friction_may_be_named(recordings, tmp_path, capsys):
    figures = tmp_path / "fit.json"
    common = ["identify", recordings[0], "--robot", "panda", "--json", str(figures), "--friction"]
    assert main([*common, "viscous-coulomb"]) == 0
    assert json.loads(figures.read_text())["friction"] is None
    assert main([*common, "asymmetric,load"]) == 0
    assert json.loads(figures.read_text())["friction"]["models"] == [["asymmetric", "load"]] * 7
    assert "Friction of all joints" in capsys.readouterr().out


def test_plain_friction_is_kept(tmp_path, capsys):
    recording = write_recording(tmp_path / "plain.csv", PLAIN)
    assert main(["identify", recording, "--robot", "panda"]) == 0
    assert "friction: viscous and Coulomb friction; held-out data show no other" in capsys.readouterr().out


def test_wrong_models_are_refused():
    with pytest.raises(RecordingError, match="'stiction' is no model"):
        parse_friction(Namespace(friction="load,stiction", gains=False))
    with pytest.raises(RecordingError, match="with --gains the friction of the description"):
        parse_friction(Namespace(friction="load", gains=True))
    assert parse_friction(Namespace(friction=None, gains=True)).as_described


def test_friction_of_the_description_is_replaced_unless_it_is_fitted():
    robot = load_robot("panda")
    joints = tuple(replace(joint, coulomb_friction=1.0, load_friction=0.1) for joint in robot.joints)
    dynamics = Dynamics(replace(robot, joints=joints))
    kept = dynamics_to_identify(dynamics, parse_friction(Namespace(friction="described", gains=False)))
    assert kept is dynamics
    stripped = dynamics_to_identify(dynamics, parse_friction(Namespace(friction=None, gains=False)))
    assert [joint.load_friction for joint in stripped.robot.joints] == [0.0] * 7
    assert [joint.coulomb_friction for joint in stripped.robot.joints] == [1.0] * 7
