"""Warnings about robots without masses, as many industrial URDFs are: one warning, with the remedy."""

import pytest
from peers.real_robots import real_urdf, without_inertials

from robot_dynamics import DescriptionError, Inertia, SingularModelError, load_robot
from robot_dynamics.cli.main import main
from robot_dynamics.model.robot import MASSLESS_WARNING
from robot_dynamics.simulation.simulation import Simulation

BODY = Inertia(1.0, [0.0, 0.0, 0.1], [[0.02, 0, 0], [0, 0.02, 0], [0, 0, 0.01]])


@pytest.mark.parametrize("name", ["ur5", "panda", "z1", "kinova", "allegro"])
def test_robot_without_masses_logs_one_warning_at_load(name, caplog):
    whole, bare = load_robot(real_urdf(name)), load_robot(without_inertials(real_urdf(name)))
    assert not whole.is_massless and bare.is_massless
    assert bare.warnings.count(MASSLESS_WARNING) == 1
    assert not any("moves nothing with inertia" in warning for warning in bare.warnings)
    assert caplog.text.count(MASSLESS_WARNING) == 1
    with pytest.raises(DescriptionError, match="none of its moving links has a mass"):
        load_robot(without_inertials(real_urdf(name)), strict=True)


def test_masslessness_depends_on_moving_links_only():
    bare = load_robot(without_inertials(real_urdf("ur5")))
    links = [frame.name for frame in bare.frames]
    assert bare.with_payload(bare.base_link, BODY).is_massless  # it is held, or carries its own mass alone
    assert not bare.with_payload("wrist_3_link", BODY).is_massless and "wrist_3_link" in links
    moving = load_robot(without_inertials(real_urdf("ur5")), moving_base=True)
    assert moving.is_massless and any("no model has a solution" in warning for warning in moving.warnings)
    assert not load_robot('<robot name="stone"><link name="base"/></robot>').is_massless  # nothing moves


def test_show_command_prints_the_warning_about_missing_masses(tmp_path, capsys):
    path = tmp_path / "bare.urdf"
    path.write_text(without_inertials(real_urdf("z1")))
    assert main(["show", str(path)]) == 0
    output = capsys.readouterr().out
    assert f"warning: {MASSLESS_WARNING}" in output and "moving mass 0 kg" in output and output.count("warning:") == 1


def test_simulation_of_a_robot_without_masses_is_refused_with_the_remedy():
    with pytest.raises(SingularModelError, match="complete the description, or identify the masses"):
        Simulation(load_robot(without_inertials(real_urdf("ur5"))))
