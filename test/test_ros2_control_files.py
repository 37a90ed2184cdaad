"""The files in config/ros2_control fit each other and the robot; ros2_control itself is not there."""

from pathlib import Path
from xml.etree import ElementTree

import yaml

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.control.control_law import actuated_joint_names

FOLDER = Path(__file__).parents[1] / "config" / "ros2_control"


def test_controllers_have_the_joints_and_interfaces_of_the_mock_panda_in_order():
    sections = yaml.safe_load((FOLDER / "effort_controllers.yaml").read_text())
    parameters = {name.removeprefix("/**/"): section["ros__parameters"] for name, section in sections.items()}
    block = ElementTree.parse(FOLDER / "panda_mock.xml").getroot()
    joints = {joint.get("name"): joint for joint in block.iter("joint")}
    expected = list(actuated_joint_names(Dynamics(load_robot("panda"))))
    assert list(joints) == expected
    for name, kind in parameters["controller_manager"].items():
        assert name == "update_rate" or parameters[name]["type"] == kind["type"]
    effort, trajectory = parameters["effort_controller"], parameters["joint_trajectory_controller"]
    assert effort["joints"] == trajectory["joints"] == expected
    assert set(effort["fallback_controllers"]) <= set(parameters)
    for joint in joints.values():
        commands = {interface.get("name") for interface in joint.iter("command_interface")}
        states = {interface.get("name") for interface in joint.iter("state_interface")}
        assert {effort["interface_name"], *trajectory["command_interfaces"]} <= commands
        assert set(trajectory["state_interfaces"]) <= states


def test_mock_panda_is_a_description_that_loads():
    text = (FOLDER.parent / "robots" / "panda.urdf").read_text()
    block = (FOLDER / "panda_mock.xml").read_text().partition("?>")[2]
    robot = load_robot(text.replace("</robot>", block + "</robot>"))
    assert [joint.name for joint in robot.joints] == [joint.name for joint in load_robot("panda").joints]
