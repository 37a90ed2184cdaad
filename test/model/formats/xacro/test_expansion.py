"""xacro files: the robot is that of the text which the command `xacro` prints; nothing else is expanded."""

import subprocess
import sys

import numpy as np
import pytest

from robot_dynamics import DescriptionError, Dynamics, MissingPackageError, load_robot
from robot_dynamics.cli.main import main
from robot_dynamics.model.formats import isolated_call
from robot_dynamics.model.formats.xacro.expansion import expand_xacro

pytest.importorskip("xacro")

ARM = """<?xml version="1.0"?>
<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="length" default="0.4"/>
  <xacro:arg name="prefix" default=""/>
  <xacro:include filename="$(find cell_description)/parts/link.xacro"/>
  <xacro:property name="load" value="${xacro.load_yaml('load.yaml')}"/>
  <link name="base"/>
  <xacro:rod name="$(arg prefix)upper" parent="base" length="$(arg length)" mass="${load['mass'] + 1}"/>
  <xacro:rod name="$(arg prefix)lower" parent="$(arg prefix)upper" length="${2*pi/20}" mass="0.7"/>
</robot>
"""
ROD = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="rod" params="name parent length mass">
    <link name="${name}">
      <visual><geometry><mesh filename="package://cell_description/meshes/rod.stl"/></geometry></visual>
      <inertial><origin xyz="${length/2} 0 0"/><mass value="${mass}"/>
        <inertia ixx="1e-3" ixy="0" ixz="0" iyy="${mass*length**2/12}" iyz="0" izz="${mass*length**2/12}"/></inertial>
    </link>
    <joint name="${name}_joint" type="revolute">
      <parent link="${parent}"/><child link="${name}"/><axis xyz="0 1 0"/><origin xyz="${length} 0 0"/>
      <limit lower="-${pi}" upper="${pi}" effort="9" velocity="1"/>
    </joint>
  </xacro:macro>
</robot>
"""


@pytest.fixture
def arm(tmp_path, monkeypatch):
    """Return the path of a xacro inside a package whose folder has another name."""
    for variable in ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH"):
        monkeypatch.delenv(variable, raising=False)
    files = {
        "package.xml": "<package><name>cell_description</name></package>",
        "parts/link.xacro": ROD,
        "urdf/load.yaml": "mass: 1.5",
        "urdf/arm.urdf.xacro": ARM,
    }
    for name, text in files.items():
        path = tmp_path / "checkout" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return path


def written(folder, body, name="robot.xacro", root="robot"):
    """Return the path of a xacro with some elements."""
    path = folder / name
    path.write_text(f'<{root} name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n{body}\n</{root}>')
    return path


def test_expands_as_the_command_does(arm, tmp_path, monkeypatch):
    """The command finds the package by an ament index, in another folder of the same content."""
    prefix = tmp_path / "prefix"
    (prefix / "share" / "ament_index" / "resource_index" / "packages").mkdir(parents=True)
    (prefix / "share" / "ament_index" / "resource_index" / "packages" / "cell_description").touch()
    (prefix / "share" / "cell_description").symlink_to(arm.parents[1])
    pytest.importorskip("ament_index_python")
    text = expand_xacro(arm, {"length": 0.3, "prefix": "left_"})
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(prefix))
    command = [sys.executable, "-c", "import xacro; xacro.main()", str(arm), "length:=0.3", "prefix:=left_"]
    printed = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    assert text == printed and "left_upper" in text

    robot = load_robot(arm, values={"length": 0.3, "prefix": "left_"})
    (tmp_path / "expanded.urdf").write_text(printed)
    expected = load_robot(tmp_path / "expanded.urdf")
    assert [joint.name for joint in robot.joints] == ["left_upper_joint", "left_lower_joint"]
    assert robot.joints[0].limits == expected.joints[0].limits
    np.testing.assert_array_equal(Dynamics(robot).gravity([0.3, 0.4]), Dynamics(expected).gravity([0.3, 0.4]))
    assert robot.visuals[0].shape.folder == arm.parent  # the folder of the xacro, not of a temporary file


def test_command_line_gives_values(arm, capsys):
    assert main(["show", str(arm), "--set", "length=0.5"]) == 0
    assert "upper_joint" in capsys.readouterr().out


def test_reads_elements_of_xacro_in_a_file_of_any_name(tmp_path):
    body = '<xacro:property name="m" value="2"/>\n<link name="a"/>'
    assert load_robot(written(tmp_path, body, "robot.urdf")).base_link == "a"
    text = written(tmp_path, body).read_text()
    with pytest.raises(DescriptionError, match=r"is xacro\. Expand it first"):
        load_robot(text)
    with pytest.raises(DescriptionError, match=r"is xacro\. Expand it first"):
        load_robot(text.encode())


ERRORS = {
    "argument without a value": ('<link name="$(arg a)"/>', {}, r"argument a. Give it a value: .*--set a="),
    "unknown value": ('<xacro:arg name="size" default="1"/><link name="l"/>', {"siz": 2}, "did you mean 'size'"),
    "name": ('<link name="${b}"/>', {}, "'b' is not defined when evaluating expression 'b' .when processing file"),
    "package": ('<link name="$(find nowhere)"/>', {}, "no package 'nowhere' is known: source its workspace"),
    "file": ('<xacro:include filename="gone.xacro"/>', {}, "No such file"),
    "macro": ('<xacro:arm/><link name="a"/>', {}, "unknown macro name: xacro:arm"),
    "endless macro": (
        '<xacro:macro name="m" params=""><xacro:m/></xacro:macro><xacro:m/>',
        {},
        "nested too deeply|recursion",
    ),
    "XML": ("<link", {}, "not well-formed"),
    "memory": ("<link name=\"${len('a' * 10**11)}\"/>", {}, "more than 4096 MB of memory|MemoryError"),
    "URDF": ('<link name="a"><inertial><mass value="-${1}"/></inertial></link>', {}, r"expanded text: xacro robot\."),
}


@pytest.mark.parametrize("case", ERRORS)
def test_errors_have_the_file_and_the_reason(case, tmp_path):
    body, values, message = ERRORS[case]
    path = written(tmp_path, body)
    with pytest.raises(DescriptionError, match=f"(?s){path}.*({message})"):
        load_robot(path, values=values)


def test_endless_expansion_is_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(isolated_call, "TIME_LIMIT", 0.5)
    with pytest.raises(DescriptionError, match=r"xacro takes more than 0.5 s"):
        load_robot(written(tmp_path, '<link name="${9**9**9}"/>'))


def test_long_expansion_is_refused(tmp_path):
    with pytest.raises(DescriptionError, match=r"expands to 2[0-9]+ characters: more than 10485760"):
        load_robot(written(tmp_path, "<link name=\"${'a' * 2 * 10**7}\"/>"))


def test_output_of_xacro_is_not_printed(tmp_path, capfd):
    load_robot(written(tmp_path, '${xacro.warning("loud")}<link name="a"/>'))
    assert capfd.readouterr() == ("", "")


def test_missing_package_is_named(tmp_path, monkeypatch):
    """A module of this name that cannot be imported stands for one that is not there."""
    (tmp_path / "xacro.py").write_text("raise ModuleNotFoundError(\"No module named 'xacro'\", name='xacro')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MissingPackageError, match=r"pip install xacro, part of the extra robot_dynamics\[xacro\]"):
        load_robot(written(tmp_path, '<link name="a"/>'))
