"""`robot-dynamics collisions`: thresholds from sound recordings, and collisions in others."""

import json

import numpy as np
import pinocchio as pin
import pytest
import yaml
from peers.recorded import messages, panda_model, panda_motion, write_bag, write_table

from robot_dynamics.cli.main import main

NOISE = 0.2


def recorded(seed, push=None):
    """A motion of a Panda with noisy efforts; push: (begin, end) [s] of 20 N on the flange, downwards."""
    motion = panda_motion(12.0, 100.0, seed=seed, speed=2.0)
    efforts = motion.efforts + np.random.default_rng(seed).normal(scale=NOISE, size=motion.efforts.shape)
    model = panda_model()
    data, frame = model.createData(), model.getFrameId("panda_link8")
    for k in np.flatnonzero((motion.times >= push[0]) & (motion.times < push[1])) if push else ():
        J = pin.computeFrameJacobian(model, data, motion.q[k], frame, pin.LOCAL_WORLD_ALIGNED)
        efforts[k] -= J.T @ np.array([0, 0, -20.0, 0, 0, 0])
    return motion._replace(efforts=efforts)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    write_bag(folder / "sound", messages(recorded(0)))
    write_bag(folder / "other", messages(recorded(1)))
    write_table(folder / "pushed.csv", recorded(2, (6.0, 7.0)))
    return folder


@pytest.fixture(scope="module")
def thresholds(runs):
    command = ["collisions", str(runs / "sound"), "--robot", "panda", "--learn", str(runs / "t.yaml")]
    assert main([*command, "--bandwidth", "30", "--interval", "1", "--json", str(runs / "t.json")]) == 0
    return runs / "t.yaml"


def test_learnt_thresholds_are_written_and_printed(runs, thresholds, capsys):
    data = yaml.safe_load(thresholds.read_text())
    assert data["bandwidth"] == 30 and list(data["joints"]) == [f"panda_joint{k}" for k in range(1, 8)]
    figures = json.loads((runs / "t.json").read_text())
    for name, joint in figures["joints"].items():
        assert joint["largest"] < joint["moving"] < 1.0 and joint["rms"] < NOISE
        assert data["joints"][name]["moving"] == pytest.approx(joint["moving"])
    assert "One false alarm is expected in 1 h of motion like that of 11." in thresholds.read_text()
    command = ["collisions", str(runs / "sound"), "--robot", "panda", "--learn", str(runs / "again.yaml")]
    assert main([*command, "--bandwidth", "30", "--interval", "1"]) == 0
    printed = capsys.readouterr().out
    assert (
        printed.startswith("One false alarm")
        and "External efforts of sound motion" in printed
        and "more near standstill" in printed
    )
    assert "s are few for an interval of hours" in printed
    assert (runs / "again.yaml").read_text() == thresholds.read_text()


def test_collisions_are_found_where_there_are_any(runs, thresholds, capsys):
    figures = runs / "found.json"
    command = ["collisions", str(runs / "other"), str(runs / "pushed.csv"), "--robot", "panda"]
    assert main([*command, "--thresholds", str(thresholds), "--json", str(figures)]) == 3
    printed = capsys.readouterr().out
    assert printed.startswith("1 collision in 23.") and "pushed.csv" in printed
    (collision,) = json.loads(figures.read_text())["collisions"]
    assert collision["recording"].endswith("pushed.csv") and 6.0 <= collision["time"] < 6.05
    assert main(["collisions", str(runs / "other"), "--robot", "panda", "--thresholds", str(thresholds)]) == 0
    assert "no collisions in 11." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--learn", "t.txt"], "--learn t.txt: the path of the output file must end with"),
        (["--learn", "t.yaml", "--bandwidth", "0"], "--bandwidth 0: a number above 0 is needed"),
        (["--learn", "t.yaml", "--interval", "nan"], "--interval nan: a number above 0 is needed"),
        (["--thresholds", "absent.yaml"], "absent.yaml"),
        (["--learn", "t.yaml", "--to", "2"], "or more of motion like that of the application are needed"),
    ],
)
def test_wrong_arguments_are_refused(runs, tmp_path, monkeypatch, capsys, options, message):
    monkeypatch.chdir(tmp_path)
    assert main(["collisions", str(runs / "sound"), "--robot", "panda", *options]) == 1
    assert message in capsys.readouterr().err
