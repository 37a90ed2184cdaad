"""`robot-dynamics identify`: from bags to a description that `replay-check` accepts."""

import json

import pytest
from peers.recorded import messages, panda_model, panda_motion, write_bag

from robot_dynamics import load_robot
from robot_dynamics.commands.main import main


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Two recordings of a Panda with a hand of 0.9 kg and friction, of which the description knows nothing."""
    folder, model = tmp_path_factory.mktemp("bags"), panda_model()
    model.inertias[7].mass += 0.9
    motions = [panda_motion(30.0, seed=seed, viscous=1.5, coulomb=0.6, model=model) for seed in (1, 2)]
    return [write_bag(folder / f"run_{k}", messages(motion)) for k, motion in enumerate(motions)]


def test_a_wrong_description_is_put_right(bags, tmp_path, capsys):
    fitted, drives, figures = (tmp_path / "out" / name for name in ("panda.yaml", "drives.yaml", "fit.json"))
    arguments = ["--robot", "panda", "--output", fitted, "--output-drives", drives, "--json", figures]
    tight = tmp_path / "tight.yaml"
    tight.write_text("format: 1\nnormalised_rms: 0.1\neffort_share: 0.004\nwindow_factor: 5")
    check = ["replay-check", bags[1], "--tolerances", tight, "--robot"]
    assert main([*map(str, check), "panda"]) == 3
    assert main(["identify", *map(str, [bags[0], "--validate", bags[1], *arguments])]) == 0
    told = capsys.readouterr().out
    assert "48 base parameters with 14 of friction and 7 of drives" in told and "validated" in told
    assert main([*map(str, check), str(fitted), "--drives", str(drives)]) == 0
    robot = load_robot(fitted)
    assert robot.warnings == ()
    assert [joint.viscous_friction for joint in robot.joints] == pytest.approx([1.5] * 7, abs=0.05)
    assert [joint.coulomb_friction for joint in robot.joints] == pytest.approx([0.6] * 7, abs=0.05)
    told = json.loads(figures.read_text())
    assert len(told["parameters"]) == 69 and max(told["validated"]["rms"]) < 0.2
    assert [each["value"] for each in told["parameters"] if each["name"] == "Fv.panda_joint1"] == pytest.approx(
        [1.5], abs=0.05
    )


def test_what_cannot_be_is_refused(bags, tmp_path, capsys):
    for arguments, expected in (
        (["--hold-out", "2"], "0 to 0.95"), (["--hold-out", "0.5", "--validate", bags[1]], "one of the two"),
        (["--band", "70"], "between 0 and 50"), (["--output", tmp_path], "cannot be written"),
    ):  # fmt: skip
        assert main(["identify", str(bags[0]), "--robot", "panda", *map(str, arguments)]) == 1
        assert expected in capsys.readouterr().err
