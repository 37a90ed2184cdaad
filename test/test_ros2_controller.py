"""What is written twice about the controller of ros2_control agrees: parameters, defaults, names, the example."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import yaml

from robot_dynamics import Dynamics, Inertia, load_robot
from robot_dynamics.control.modes import FIXED_MODEL_MODES, FRICTION_VELOCITIES, NO_REFERENCE_ACTIONS
from robot_dynamics.model.inertia import symmetric_matrix

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "robot_dynamics_control"
BRINGUP = PACKAGE / "bringup"
PAGE = (ROOT / "docs" / "how_to" / "ros2_control.md").read_text(encoding="utf-8")
CHOICES = {
    "mode": FIXED_MODEL_MODES,
    "friction_velocity": FRICTION_VELOCITIES,
    "without_reference": NO_REFERENCE_ACTIONS,
}


def flattened(parameters, prefix=""):
    """Return {name: declaration} of nested parameters."""
    found = {}
    for name, value in parameters.items():
        found.update({prefix + name: value} if "type" in value else flattened(value, f"{prefix}{name}."))
    return found


@pytest.fixture(scope="module")
def declared():
    path = PACKAGE / "src" / "controller" / "computed_torque_controller_parameters.yaml"
    (parameters,) = yaml.safe_load(path.read_text(encoding="utf-8")).values()
    return flattened(parameters)


@pytest.fixture(scope="module")
def controllers():
    """Return the parameters of the example by controller."""
    text = (BRINGUP / "panda_controllers.yaml").read_text(encoding="utf-8")
    return {name: section["ros__parameters"] for name, section in yaml.safe_load(text).items()}


@pytest.fixture(scope="module")
def urdf():
    return ElementTree.parse(ROOT / "config" / "robots" / "panda.urdf").getroot()


def test_parameters_are_those_of_the_node(declared):
    pytest.importorskip("rclpy")
    from robot_dynamics.nodes.computed_torque.parameters import PARAMETERS

    in_both = set(declared) & set(PARAMETERS)
    assert {"mode", "kp", "kd", "effort_limits", "state_timeout", "reference_timeout", "ramp_time"} <= in_both
    for name in in_both:
        default = PARAMETERS[name].default
        assert declared[name]["default_value"] == (default if default != "" else []), name


def test_payload_is_that_of_the_node(declared):
    pytest.importorskip("rclpy")
    from robot_dynamics.nodes.robot_parameters import PARAMETERS

    for name in ("payload.mass", "payload.first_moments", "payload.inertia"):
        assert declared[name]["default_value"] == PARAMETERS[name].default, name


def test_choices_are_those_of_the_library(declared):
    for name, values in CHOICES.items():
        assert declared[name]["validation"]["one_of<>"] == [list(values)], name


def test_page_has_all_parameters_and_their_defaults(declared):
    section = PAGE.partition("## Parameters")[2].partition("\n## ")[0]
    rows = dict(re.findall(r"^\| ((?:`[\w.]+`(?:, )?)+) \| (.*?) \|", section, re.MULTILINE))
    in_page = {}
    for names, defaults in rows.items():
        names = re.findall(r"`([\w.]+)`", names)
        defaults = defaults.replace("`", "")
        values = re.findall(r"\[[^]]*\]", defaults) if len(names) == 2 else [defaults] * len(names)
        in_page.update(dict(zip(names, values, strict=True)))
    assert set(in_page) == set(declared)
    for name, text in in_page.items():
        default = declared[name]["default_value"]
        if not name.startswith("payload."):
            assert (yaml.safe_load(text) or "") == (default or ""), name


def test_example_has_known_parameters(controllers, declared):
    parameters = dict(controllers["computed_torque_controller"])
    assert parameters.pop("type") == "robot_dynamics_control/ComputedTorqueController"
    assert set(parameters) <= set(declared)


def test_example_chains_the_controllers(controllers, urdf):
    joints = [joint.get("name") for joint in urdf.iter("joint") if joint.get("type") == "revolute"]
    trajectory = controllers["joint_trajectory_controller"]
    assert trajectory["joints"] == joints == controllers["effort_controller"]["joints"]
    assert trajectory["command_joints"] == [f"computed_torque_controller/{joint}" for joint in joints]


@pytest.mark.parametrize(
    "path",
    [
        BRINGUP / "panda_simulated.ros2_control.xml",
        BRINGUP / "panda_mujoco.ros2_control.xml",
        ROOT / "config" / "ros2_control" / "panda_mock.xml",
    ],
)
def test_hardware_of_the_example_has_the_interfaces_of_the_controller(path, urdf):
    system = ElementTree.parse(path).getroot()
    limits = {joint.get("name"): joint.find("limit") for joint in urdf.iter("joint") if joint.get("type") == "revolute"}
    assert [joint.get("name") for joint in system.iter("joint")] == list(limits)
    for joint in system.iter("joint"):
        assert "effort" in {interface.get("name") for interface in joint.iter("command_interface")}
        assert {"position", "velocity"} <= {interface.get("name") for interface in joint.iter("state_interface")}
        initial = float(joint.find("state_interface/param").text)
        limit = limits[joint.get("name")]
        assert float(limit.get("lower")) < initial < float(limit.get("upper"))


def test_panda_of_mujoco_is_that_of_the_description_with_the_payload_of_the_example(urdf):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(BRINGUP / "panda_mujoco.xml"))
    joints = [joint for joint in urdf.iter("joint") if joint.get("type") == "revolute"]
    assert [model.joint(number).name for number in range(model.njnt)] == [joint.get("name") for joint in joints]
    assert [model.actuator(number).name for number in range(model.nu)] == [joint.get("name") for joint in joints]
    lower, upper, effort = (
        [float(joint.find("limit").get(key)) for joint in joints] for key in ("lower", "upper", "effort")
    )
    assert model.actuator_ctrlrange[:, 1] == pytest.approx(effort)
    assert model.jnt_range - np.column_stack([lower, upper]) == pytest.approx(np.tile([0.05, -0.05], (7, 1)))

    system = ElementTree.parse(BRINGUP / "panda_simulated.ros2_control.xml").getroot()
    mass, *numbers = map(float, system.find("hardware/param[@name='payload']").text.split())
    payload = Inertia(mass, numbers[:3], symmetric_matrix(*numbers[3:]))
    dynamics = Dynamics(load_robot("panda").with_payload("panda_link8", payload))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT  # forces of the joint limits
    data = mujoco.MjData(model)
    read = Dynamics(load_robot(BRINGUP / "panda_mujoco.xml"))
    rng = np.random.default_rng(0)
    for _ in range(10):
        data.qpos[:], data.qvel[:], data.qacc[:] = (
            rng.uniform(model.jnt_range.T[0], model.jnt_range.T[1]),
            *rng.normal(size=(2, 7)),
        )
        mujoco.mj_inverse(model, data)
        for each in (dynamics, read):
            assert data.qfrc_inverse == pytest.approx(each.inverse(data.qpos, data.qvel, data.qacc), abs=1e-11)


def test_launch_file_fills_in_what_the_tags_leave_open():
    launch_file = (BRINGUP / "panda_ros2_control.launch.py").read_text(encoding="utf-8")
    for path in BRINGUP.glob("*.ros2_control.xml"):
        for name in re.findall(r"\{\w+\}", path.read_text(encoding="utf-8")):
            assert f'.replace("{name}", ' in launch_file, f"{name} of {path.name}"
    installed = (BRINGUP / "CMakeLists.txt").read_text(encoding="utf-8")
    assert all(path.name in installed for path in BRINGUP.iterdir() if path.suffix in {".xml", ".yaml", ".py"})


def test_plugins_are_those_that_are_exported():
    for path in PACKAGE.glob("src/*/*_plugins.xml"):
        library = ElementTree.parse(path).getroot()
        sources = "".join(source.read_text(encoding="utf-8") for source in path.parent.glob("*.cpp"))
        cmake = (path.parent / "CMakeLists.txt").read_text(encoding="utf-8")
        assert f"add_library({library.get('path')} SHARED" in cmake
        for plugin in library.iter("class"):
            exported = rf"PLUGINLIB_EXPORT_CLASS\(\s*{plugin.get('type')}, {plugin.get('base_class_type')}\)"
            assert re.search(exported, sources), plugin.get("name")
        assert str(path.relative_to(PACKAGE)) in (PACKAGE / "CMakeLists.txt").read_text(encoding="utf-8")


def test_manifest_has_a_key_for_each_package_that_cmake_finds():
    manifest = ElementTree.parse(PACKAGE / "package.xml").getroot()
    keys = {element.text for element in manifest if element.tag.endswith("depend")}
    cmake = (PACKAGE / "CMakeLists.txt").read_text(encoding="utf-8")
    found = set(re.findall(r"find_package\((\w+)", cmake)) | set(
        re.search(r"foreach\(dependency ([^)]*)\)", cmake)[1].split()
    )
    assert found - {"dependency"} <= keys
