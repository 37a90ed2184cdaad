"""`robot-dynamics identify-payload`: from a bag to parameters of nodes."""

import json

import numpy as np
import pytest
import yaml
from peers.recorded import loaded_panda, messages, panda_motion, write_bag, write_table

from robot_dynamics import Inertia
from robot_dynamics.cli.main import main
from robot_dynamics.model.inertia import symmetric_matrix

MASS = 2.5


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A recording of a Panda with 2.5 kg, whose centre is 0.093 m before panda_link8."""
    run = panda_motion(8.0, 50.0, viscous=0.1, coulomb=0.1, model=loaded_panda(MASS, (0, 0, 0.2), 0.005))
    noise = np.random.default_rng(0).normal(scale=0.1, size=run.efforts.shape)
    return write_bag(tmp_path_factory.mktemp("bags") / "run", messages(run._replace(efforts=run.efforts + noise)))


def test_payload_is_printed_and_written_as_parameters_of_nodes(bag, tmp_path, capsys):
    file, figures = tmp_path / "payload.yaml", tmp_path / "payload.json"
    command = ["identify-payload", bag, "--robot", "panda", "--output", file, "--json", figures]
    assert main([*map(str, command)]) == 0
    printed = capsys.readouterr().out
    assert "payload on panda_link8: 2." in printed and "centre z [m]" in printed and "with payload" in printed
    results = json.loads(figures.read_text())
    assert results["determined"] and results["link"] == "panda_link8"
    assert results["mass"]["value"] == pytest.approx(MASS, abs=2 * results["mass"]["deviation"])
    assert results["centre"]["value"] == pytest.approx([0, 0, 0.093], abs=0.005)
    parameters = yaml.safe_load(file.read_text())["/**"]["ros__parameters"]["payload"]
    assert list(parameters)[-1] == "link"  # the payload is complete when the link is set
    numbers = [parameters["mass"], *parameters["first_moments"], *parameters["inertia"]]
    assert all(isinstance(number, float) for number in numbers)
    payload = Inertia(parameters["mass"], parameters["first_moments"], symmetric_matrix(*parameters["inertia"]))
    assert payload.first_moments / payload.mass == pytest.approx(results["centre"]["value"], abs=1e-5)
    assert payload.find_inconsistencies() == []
    assert results["parameters"]["payload.inertia"] == pytest.approx(parameters["inertia"], rel=1e-5)


def test_a_payload_on_another_link_is_in_its_frame(bag, capsys, tmp_path):
    figures = tmp_path / "payload.json"
    command = ["identify-payload", str(bag), "--robot", "panda", "--link", "panda_link7", "--json", str(figures)]
    assert main(command) == 0
    assert json.loads(figures.read_text())["centre"]["value"] == pytest.approx([0, 0, 0.2], abs=0.005)


def test_a_recording_that_does_not_determine_the_payload_has_another_exit_status(tmp_path, capsys):
    """No joint moves but a little."""
    run = panda_motion(4.0, model=loaded_panda(0.0), speed=0.02)
    noisy = run._replace(efforts=run.efforts + np.random.default_rng(0).normal(scale=2.0, size=run.efforts.shape))
    path = write_table(tmp_path / "run.csv", noisy)
    command = ["identify-payload", str(path), "--robot", "panda"]
    assert main(command) == 3
    assert "verdict: not determined" in capsys.readouterr().out
    assert main([*command, "--set-node", "/dynamics_server"]) == 1
    assert "no parameter was set" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--link", "panda_link0"], "link panda_link0: it is fixed to the base"),
        (["--link", "panda_link9"], "unknown link 'panda_link9'"),
        (["--effort-accuracy", "2"], "--effort-accuracy 2: a part of 0 to 1 is needed"),
        (["--output", "payload.txt"], "--output payload.txt: the path of the output file must end with"),
        (["--empty", "BAG"], "is named as one with and without the payload"),
    ],
)
def test_wrong_arguments_are_refused(bag, capsys, options, message):
    options = [str(bag) if option == "BAG" else option for option in options]
    assert main(["identify-payload", str(bag), "--robot", "panda", *options]) == 1
    assert message in capsys.readouterr().err


def test_a_description_without_masses_is_refused(bag, tmp_path, capsys):
    from peers.real_robots import real_urdf, without_inertials

    urdf = tmp_path / "panda.urdf"
    urdf.write_text(without_inertials(real_urdf("panda")))
    assert main(["identify-payload", str(bag), "--robot", str(urdf)]) == 1
    assert "has no masses" in capsys.readouterr().err
