"""The command robot-dynamics: printed tables, converted descriptions, generated code and error messages."""

import json
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from peers.real_robots import ROBOTS

from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.cli.main import main
from robot_dynamics.model.formats.mdh_yaml.reader import SCHEMA

UR5 = str(ROBOTS / "ur_description" / "urdf" / "ur5_robot.urdf")
LENGTHS = """\
robot: two_lengths
parameters: {a: 1, b: a/2}
joints:
  - {joint: j1, link: l1, mdh: {d: a}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
  - {joint: j2, link: l2, mdh: {d: b, alpha: 0.001}, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
"""
BARS = """\
robot: bars
joints:
  - {joint: j1, link: l1, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}, initial_position: 0.5}
  - {joint: j2, link: l2, mdh: {d: 1}, role: passive, mass: 1, inertia: {xx: 1, yy: 1, zz: 1}}
loops:
  - joint: knee
    type: prismatic
    moved: {antecedent: l2, mdh: {d: 1}}
    closed_on: {antecedent: base_link, xyz: [1/2, 0, 0], rpy: [0, 0, pi/2]}
  - {joint: ball, type: spherical, moved: {antecedent: l2, xyz: [2, 0, 0]}, closed_on: {antecedent: base_link}}
"""


def refused(arguments, capsys):
    assert main(list(map(str, arguments))) == 1
    printed = capsys.readouterr()
    assert not printed.out and "Traceback" not in printed.err
    return printed.err


def test_convert_turns_a_urdf_into_a_table_and_back(tmp_path, capsys):
    for source, target in ((UR5, "a.yaml"), (tmp_path / "a.yaml", "b.urdf"), (tmp_path / "b.urdf", "c.yml")):
        assert main(["convert", str(source), str(tmp_path / target)]) == 0
        assert f"{target}: robot 'ur5', 6 joints" in capsys.readouterr().out
    robots = [
        Dynamics(load_robot(path)) for path in (UR5, *(tmp_path / name for name in ("a.yaml", "b.urdf", "c.yml")))
    ]
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 6))
    for converted in robots[1:]:
        assert converted.joint_names == robots[0].joint_names
        np.testing.assert_allclose(converted.inverse(q, qd, qdd), robots[0].inverse(q, qd, qdd), rtol=1e-9)


def test_convert_writes_a_par_and_reports_losses(tmp_path, capsys):
    target = tmp_path / "puma.par"
    assert main(["convert", "puma560", str(target)]) == 0
    again, puma = Dynamics(load_robot(target)), Dynamics(load_robot("puma560"))
    np.testing.assert_allclose(again.inertia_matrix(np.ones(6)), puma.inertia_matrix(np.ones(6)), rtol=1e-9)
    capsys.readouterr()
    printed = refused(["convert", "puma560", tmp_path / "puma.urdf"], capsys)
    assert "rotor inertia 4.71" in printed and "lossy" in printed and not (tmp_path / "puma.urdf").exists()
    assert main(["convert", "puma560", str(tmp_path / "puma.urdf"), "--lossy"]) == 0
    assert "rotor inertia 4.71" in (tmp_path / "puma.urdf").read_text()


def test_convert_draws_what_has_no_shapes(tmp_path, capsys):
    """The bones of a table stay from URDF to URDF; --no-visuals leaves them out; other formats have none."""
    names = [tmp_path / name for name in ("a.urdf", "b.urdf", "bare.urdf", "a.yaml")]
    drawn, again, bare, table = names
    for arguments in (["rx90", drawn], [drawn, again], [drawn, bare, "--no-visuals"], [drawn, table]):
        assert main(["convert", *map(str, arguments), "--lossy"]) == 0
    notes = capsys.readouterr().err
    assert notes.count("has what the dynamics need and visual shapes") == 2
    counts = [path.read_text().count("<visual") for path in names]
    assert counts[0] == counts[1] > 10 and counts[2:] == [0, 0]
    shapes = [[(shape.frame, vars(shape.shape)) for shape in load_robot(path).visuals] for path in (drawn, again)]
    assert shapes[0] == shapes[1]
    assert main(["convert", "rx90", str(bare), "--lossy", "--no-visuals"]) == 0 and "<visual" not in bare.read_text()


def test_convert_of_a_urdf_with_a_yaml_writes_minimal_frames(tmp_path, capsys):
    loop = "{joint: closing, moved: {antecedent: tool0}, closed_on: {antecedent: base_link, xyz: [0.5, 0, 0.5]}}"
    (tmp_path / "ur5.yaml").write_text(f"urdf: {UR5}\nroles: {{elbow_joint: passive}}\nloops: [{loop}]\n")
    assert main(["convert", str(tmp_path / "ur5.yaml"), str(tmp_path / "table.yaml")]) == 0
    table, robot = (tmp_path / "table.yaml").read_text(), load_robot(tmp_path / "table.yaml")
    assert (
        "gamma" not in table.split("joints:")[1].split("loops:")[0]
        and "joint: closing\n    link: closing_link" in table
    )
    assert robot.joints[2].role == "passive" and [loop.name for loop in robot.loops] == ["closing"]
    capsys.readouterr()
    printed = refused(["convert", tmp_path / "table.yaml", tmp_path / "out.urdf"], capsys)
    assert "loop 'closing', which closes link" in printed and "lossy" in printed


def test_parameters_are_set_from_a_file_and_on_the_command_line(tmp_path, capsys):
    (tmp_path / "lengths.yaml").write_text(LENGTHS)
    (tmp_path / "values.yaml").write_text("a: 3\nb: 2*pi\n")
    arguments = [str(tmp_path / "lengths.yaml"), str(tmp_path / "out.yaml")]
    assert main(["convert", *arguments, "--values", str(tmp_path / "values.yaml"), "--set", "b=0.25"]) == 0
    written = (tmp_path / "out.yaml").read_text()
    assert "d: 3," in written and "d: 0.25," in written
    capsys.readouterr()
    assert "unknown parameter 'c'" in refused(["show", arguments[0], "--set", "c=1"], capsys)
    assert "NAME=VALUE is needed" in refused(["show", arguments[0], "--set", "c"], capsys)
    (tmp_path / "values.yaml").write_text("a: [1]\n")
    printed = refused(["show", arguments[0], "--values", tmp_path / "values.yaml"], capsys)
    assert "values.yaml, line 1, column 4: a is [1]: a number or an expression is needed" in printed


def test_verbs_lock_joints(tmp_path, capsys):
    (tmp_path / "tips.yaml").write_text(LENGTHS.rpartition(", mass")[0] + "}\n")
    assert main(["show", UR5, "--lock", "elbow_joint=0.5", "--lock", "wrist_1_joint=-1e-1"]) == 0
    printed = capsys.readouterr().out
    assert "robot 'ur5': 4 joints" in printed and "locked: elbow_joint at 0.5, wrist_1_joint at -0.1\n" in printed
    assert main(["convert", str(tmp_path / "tips.yaml"), str(tmp_path / "out.yaml"), "--lock-massless"]) == 0
    assert "'j2' moves nothing with inertia: it is locked at 0\n" in capsys.readouterr().err
    assert [joint.name for joint in load_robot(tmp_path / "out.yaml").joints] == ["j1"]
    for lock, reason in (
        ("elbow_joint", "JOINT=POSITION is needed"),
        ("elbow_joint=bent", "JOINT=POSITION is needed"),
        ("elbow_join=1", "unknown moving joint 'elbow_join': did you mean 'elbow_joint'"),
    ):
        assert reason in refused(["show", UR5, "--lock", lock], capsys)


def test_snap_makes_axes_parallel_and_is_suggested(tmp_path, capsys):
    (tmp_path / "lengths.yaml").write_text(LENGTHS)
    arguments = ["convert", str(tmp_path / "lengths.yaml"), str(tmp_path / "out.yaml")]
    assert main(arguments) == 0
    assert "1 axes are nearly parallel" in capsys.readouterr().err
    assert len(re.findall("link: l2_offset", (tmp_path / "out.yaml").read_text())) == 1
    assert main([*arguments, "--snap", "0.01"]) == 0
    assert not capsys.readouterr().err and "offset" not in (tmp_path / "out.yaml").read_text()
    assert "an angle between 0 and 0.1 rad is needed" in refused([*arguments, "--snap", "1"], capsys)


@pytest.mark.parametrize("name", shipped_robots())
def test_show_prints_the_table_the_inertias_and_the_totals(name, capsys):
    assert main(["show", name]) == 0
    printed, robot = capsys.readouterr().out, load_robot(name)
    assert "Modified Denavit-Hartenberg parameters" in printed and "Inertias about the origins" in printed
    rows = printed.split("plus variable")[1].split("\n\n")[0]
    for joint, link in zip(robot.joints, robot.links[1:], strict=True):
        assert re.search(rf"^{joint.name} +{link.name} ", rows, re.MULTILINE)
    first = 0 if robot.moving_base else 1
    mass = sum(link.inertia.mass for link in robot.links[first:])
    assert f"moving mass {mass:.6g} kg" + ("" if robot.loops else ", centre at") in printed
    for warning in robot.warnings:
        assert f"warning: {warning}" in printed


def test_show_prints_springs_and_angles_with_pi(capsys):
    assert main(["show", "manutec_r3"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"spring_2 +elastic .* 352800 +0 +441", printed)
    assert re.search(r"motor_2 .* pi/2 +0 +pi/2 ", printed)
    assert main(["show", "manutec_r3", "--frames", "minimal"]) == 0
    assert not re.search(r"motor_2 .* pi/2 +0 +pi/2 ", capsys.readouterr().out)


def test_show_prints_loops_with_both_frames(tmp_path, capsys):
    (tmp_path / "bars.yaml").write_text(BARS)
    assert main(["show", str(tmp_path / "bars.yaml")]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"joint +role +initial position\n.*\nj1 +actuated +0.5\n", printed)
    assert re.search(r"\nknee +prismatic +k +knee_link +0 .*\n +k\+B +base_link +0.5 +0 +0 +0 +0 +pi/2\n", printed)
    assert re.search(r"\nball +spherical +k +l2 +2 .*\n +k\+B +base_link +0 ", printed)
    assert "moving mass 2 kg\n" in printed


def test_convert_keeps_loops_from_a_table_to_a_par_and_back(tmp_path, capsys):
    (tmp_path / "bars.yaml").write_text(BARS.replace("type: spherical", "type: fixed").replace("0.5}", "0}"))
    for source, target in (("bars.yaml", "a.par"), ("a.par", "b.yaml"), ("b.yaml", "c.par"), ("c.par", "d.yaml")):
        assert main(["convert", str(tmp_path / source), str(tmp_path / target)]) == 0
    assert (tmp_path / "a.par").read_text() == (tmp_path / "c.par").read_text()
    assert (tmp_path / "b.yaml").read_text() == (tmp_path / "d.yaml").read_text()
    assert [loop.name for loop in load_robot(tmp_path / "d.yaml").loops] == ["knee", "ball"]
    capsys.readouterr()
    (tmp_path / "bars.yaml").write_text(BARS)
    printed = refused(["convert", tmp_path / "bars.yaml", tmp_path / "a.par"], capsys)
    assert "'j1' has an initial position; loop 'ball' is cut at a ball joint" in printed and "--lossy" in printed


def test_show_prints_the_centre_of_mass_of_the_gravity_torque(capsys):
    """With gravity along x, the torque of the vertical joint 1 of the UR5e is weight times y of the centre of mass."""
    assert main(["show", "ur5e"]) == 0
    mass, _, y, _ = map(
        float, re.search(r"moving mass (\S+) kg, centre at (\S+) (\S+) (\S+) m", capsys.readouterr().out).groups()
    )
    torque = Dynamics(load_robot("ur5e", gravity=(9.81, 0, 0))).gravity(np.zeros(6))[0]
    assert torque == pytest.approx(9.81 * mass * y, rel=1e-4)


def test_robots_and_schema_are_listed(capsys):
    assert main(["robots"]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in shipped_robots())
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(SCHEMA.read_text())


def test_generated_python_agrees_with_the_library(tmp_path, capsys):
    """The generated Python computes the efforts of the library, with a wrench; missing folders are created."""
    arguments = ["generate", "panda", "--lang", "python", "--output", str(tmp_path / "new"), "--prefix", "panda_"]
    assert main([*arguments, "--wrench", "panda_link8"]) == 0
    printed = capsys.readouterr().out
    assert "inverse of 'panda'" in printed and " × / " in printed
    scope = runpy.run_path(str(tmp_path / "new" / "panda_inverse.py"))
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 7))
    expected = Dynamics(load_robot("panda")).inverse(q, qd, qdd, external_wrenches={"panda_link8": np.ones(6)})
    result = next(value for name, value in scope.items() if name.endswith("inverse"))(q, qd, qdd, np.ones(6))
    np.testing.assert_allclose(result, expected, rtol=1e-10)


@pytest.mark.parametrize(
    "model", ["direct", "inertia_matrix", "gravity", "coriolis", "bias", "regressor", "pose", "direct_derivatives"]
)
def test_generated_c_compiles_without_a_warning(model, tmp_path, capsys):
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    assert main(["generate", "ur5e", "--model", model, "--frame", "tool0", "--output", str(tmp_path)]) == 0
    command = [compiler, "-std=c99", "-Wall", "-Wextra", "-Werror", "-c", f"{model}.c"]
    process = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert process.returncode == 0, process.stderr


@pytest.mark.parametrize("lang", ["c", "python"])
def test_generated_code_of_a_robot_with_loops_names_the_entries_of_q(lang, tmp_path, capsys):
    for model in ("inverse", "closure"):
        assert main(["generate", "four_bar", "--model", model, "--lang", lang, "--output", str(tmp_path)]) == 0
    dynamics = Dynamics(load_robot("four_bar"))
    printed, closure = (
        " ".join((tmp_path / f"{name}.{'h' if lang == 'c' else 'py'}").read_text().replace(" * ", "").split())
        for name in ("inverse", "closure")
    )
    all_entries = ", ".join(f"{index} {name}" for index, name in enumerate(dynamics.all_joint_names))
    dependent_entries = ", ".join(f"{index} {name}" for index, name in enumerate(dynamics.dependent_joint_names))
    assert "Joints, by index: 0 crank." in printed
    assert f"q has all joints, at positions that close the loops: {all_entries}." in printed
    assert f"Joints of q, by index: {all_entries}. Joints of step: {dependent_entries}." in closure


def test_generate_refuses_missing_or_meaningless_options(tmp_path, capsys):
    assert "needs --frame" in refused(["generate", "ur5e", "--model", "pose"], capsys)
    assert "unknown link 'tol0': did you mean 'tool0'" in refused(
        ["generate", "ur5e", "--model", "pose", "--frame", "tol0"], capsys
    )
    assert "inverse, direct and their derivatives, not to gravity" in refused(
        ["generate", "ur5e", "--model", "gravity", "--wrench", "tool0"], capsys
    )
    assert "cannot be written" in refused(["generate", "ur5e", "--output", "/proc/nowhere"], capsys)


def test_count_of_operations_is_below_that_of_symoro(capsys):
    """SYMORO's own inverse model of the RX90 has 343 × and 300 + after dead code is removed."""
    assert main(["count", "rx90"]) == 0
    row = re.search(r"inverse +(\d+) +(\d+)", capsys.readouterr().out)
    assert int(row[1]) < 343 and int(row[2]) < 300


def test_wrong_arguments_are_named_in_messages(tmp_path, capsys):
    assert "no robot of that name ships" in refused(["show", "pand"], capsys)
    assert "did you mean 'panda'" in refused(["convert", "pandas", tmp_path / "a.yaml"], capsys)
    assert "the path of the output file must end with .yaml, .yml, .urdf or .par" in refused(
        ["convert", "panda", tmp_path / "a.txt"], capsys
    )
    assert "cannot be written" in refused(["convert", "panda", "/proc/nowhere/a.yaml"], capsys)
    (tmp_path / "a.yaml").write_text(LENGTHS)
    assert "is an input file" in refused(["convert", tmp_path / "a.yaml", tmp_path / "a.yaml"], capsys)
    assert "is an input file" in refused(["convert", "rx90", shipped_robots()["rx90"]], capsys)
    (tmp_path / "v.yaml").write_text("a: 2\n")
    arguments = ["convert", tmp_path / "a.yaml", tmp_path / "v.yaml", "--values", tmp_path / "v.yaml"]
    assert "is an input file" in refused(arguments, capsys)
    assert "cannot be written" in refused(["convert", "panda", tmp_path / f"{'x' * 300}.yaml"], capsys)
    assert "cannot be written" in refused(["convert", "panda", "a\0b.yaml"], capsys)
    with pytest.raises(SystemExit):
        main([])
    assert "VERB" in capsys.readouterr().err


@pytest.mark.slow
def test_installed_command_runs_and_accepts_a_closed_pipe():
    command = Path(sys.executable).with_name("robot-dynamics")
    process = subprocess.run([command, "show", "panda"], capture_output=True, text=True, timeout=60)
    assert process.returncode == 0 and "panda_joint7" in process.stdout and not process.stderr
    piped = subprocess.run(f"{command} show panda | head -1", shell=True, capture_output=True, text=True, timeout=60)
    assert piped.stdout.startswith("robot 'panda'") and "Traceback" not in piped.stderr


def test_ctrl_c_ends_with_130_and_one_line(monkeypatch, capsys):
    def interrupted(printed):
        raise KeyboardInterrupt

    monkeypatch.setattr("robot_dynamics.cli.count.run", interrupted)
    assert main(["count", "rx90"]) == 130
    assert capsys.readouterr().err == "robot-dynamics count: interrupted\n"


def test_urdf_is_shown_without_rounding_errors_and_converted_with_notes(tmp_path, capsys):
    path = tmp_path / "arm.urdf"
    body = '<mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    path.write_text(
        '<robot name="arm"><link name="a"/><link name="b"><visual/></link><link name="c">'
        f'<inertial><origin xyz="0 0 0.5" rpy="0 1.57079632679 0"/>{body}</inertial></link>'
        '<joint name="j" type="continuous"><parent link="a"/><child link="b"/><origin rpy="1.57079632679 0 0"/></joint>'
        '<joint name="k" type="revolute"><parent link="b"/><child link="c"/>'
        '<origin xyz="0 0 1" rpy="0 1.57079632679 0"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    assert main(["show", str(path)]) == 0
    printed = capsys.readouterr()
    assert not re.search(r"e-1\d", printed.out) and not printed.err
    assert "warning: link 'b' has a shape and moves" in printed.out
    assert main(["convert", str(path), str(tmp_path / "arm.par")]) == 0
    printed = capsys.readouterr().err
    assert "WARNING: " in printed and "link 'b' has a shape and moves" in printed
    assert "left out: limits of 'k'" in printed and "robot_state_publisher" not in printed
    assert main(["convert", str(path), str(tmp_path / "out.urdf")]) == 0
    assert "without collision shapes" in capsys.readouterr().err


def test_misspelt_verb_is_refused_with_the_nearest_ones(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["shwo", "panda"])
    assert "unknown verb 'shwo': did you mean 'show'?" in capsys.readouterr().err
