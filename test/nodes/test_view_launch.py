"""view.launch.py: what robot_state_publisher and RViz are started with, and the nodes of this package as they run."""

import importlib.util
import subprocess
import sys
import time
from xml.etree import ElementTree

import numpy as np
import pinocchio
import pytest
import yaml
from nodes.completer_probe import CompleterProbe, values_by_name
from nodes.controller_probe import trajectory_message
from peers.cut_urdf import CutUrdf
from peers.launch_files import ROOT, performed, started, started_nodes
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics import Dynamics, load_robot, shipped_robots, write_urdf
from robot_dynamics.nodes.processes import terminate_process
from robot_dynamics.nodes.viewed_urdf import viewed_urdf

FILE = "view.launch.py"
RVIZ = ROOT / "config" / "rviz" / "view.rviz"


def parameters_of(node, context):
    """{name: text} of the parameters of a node."""
    return {name: value for parameters in node.parameters for name, value in parameters.items()}


def launched_nodes(*arguments):
    nodes, context = started_nodes(FILE, arguments)
    return {node.package: node for node in nodes}, context


@pytest.mark.parametrize("name", sorted(shipped_robots()))
def test_robot_state_publisher_has_the_joints_that_are_published(name):
    """And its root is the fixed frame; for a base that moves /tf has the way from odom to the root."""
    nodes, context = launched_nodes(f"robot:={name}")
    text = parameters_of(nodes["robot_state_publisher"], context)["robot_description"].evaluated(context)
    model = pinocchio.buildModelFromXML(text)
    robot = load_robot(name)
    assert set(model.names[1:]) == {joint.name for joint in robot.joints}
    assert 'type="floating"' not in text
    words = nodes["rviz2"].program_arguments(context)
    assert words[:3] == ["-d", str(RVIZ), "-f"]
    assert words[3] == ("odom" if robot.moving_base else robot.base_link)
    assert root_link(text) == robot.base_link


SDF = """<sdf version="1.9"><model name="pole"><link name="pole">
  <inertial><mass>3</mass></inertial><visual name="v"><geometry><box><size>1 2 3</size></box></geometry></visual></link>
  <joint name="swing" type="revolute"><parent>world</parent><child>pole</child></joint></model></sdf>"""


def test_sdf_with_shapes_is_shown_as_a_urdf(tmp_path):
    path = tmp_path / "pole.sdf"
    path.write_text(SDF)
    root = ElementTree.fromstring(viewed_urdf(str(path)))
    assert root.tag == "robot" and root.find(".//visual/geometry/box").get("size") == "1 2 3"


def root_link(urdf):
    root = ElementTree.fromstring(urdf.encode())
    children = {child.get("link") for child in root.findall("joint/child")}
    (name,) = {link.get("name") for link in root.findall("link")} - children
    return name


def test_urdf_is_shown_as_it_is_with_its_shapes(tmp_path):
    text = write_urdf(load_robot("panda"), lossy=True)
    assert "<visual" not in text and "<visual" in viewed_urdf("panda")
    shape = '<link name="panda_link0"><visual><geometry><mesh filename="package://a/b.dae"/></geometry></visual>'
    path = tmp_path / "robot.urdf"
    path.write_text(text.replace('<link name="panda_link0">', shape))
    nodes, context = launched_nodes(f"robot:={path}")
    assert parameters_of(nodes["robot_state_publisher"], context)["robot_description"].evaluated(context) == (
        path.read_text()
    )


def test_arguments_choose_what_is_started(tmp_path):
    nodes, context = launched_nodes("robot:=none", "rviz:=false", "namespace:=left")
    assert set(nodes) == {"robot_dynamics"}
    nodes, context = launched_nodes("robot:=none", "use_sim_time:=true", "clock:=clock")
    assert set(nodes) == {"robot_dynamics", "rviz2"} and nodes["rviz2"].program_arguments(context)[3] == "map"
    for node in nodes.values():
        assert parameters_of(node, context)["use_sim_time"].evaluated(context) is True
        remappings = {old: performed(new, context) for old, new in node.remappings}
        assert remappings["/clock"] == "clock"
    nodes, context = launched_nodes("fixed_frame:=table")
    assert nodes["rviz2"].program_arguments(context)[3] == "table"
    assert dict(nodes["robot_state_publisher"].remappings)["joint_states"] == "joint_state_completer/joint_states"


def test_rviz_shows_topics_that_exist(client, tmp_path):
    """Of the nodes that are started, in their namespace; the state of a Delta is closed in the URDF that is shown."""
    displays = yaml.safe_load(RVIZ.read_text())["Visualization Manager"]["Displays"]
    topics = {display["Topic"]["Value"] for display in displays if "Topic" in display}
    assert topics == {"joint_state_completer/markers"}
    (model,) = [display for display in displays if display["Class"] == "rviz_default_plugins/RobotModel"]
    assert model["Description Topic"]["Value"] == "robot_description"
    dynamics = Dynamics(load_robot("delta"), compiled=False)
    urdf = CutUrdf(dynamics.robot)
    names = list(dynamics.joint_names)
    ((executable, words),) = started(FILE, ["robot:=delta", "namespace:=viewed", "rviz:=false"], tmp_path)
    command = [sys.executable, "-m", f"robot_dynamics.nodes.{executable}", "--ros-args", *words]
    process = subprocess.Popen(command)
    try:
        probe = CompleterProbe("/viewed/joint_state_completer", client, "mobile_base_simulator/external_wrench")
        for topic in topics:
            assert client.node.count_publishers(f"/viewed/{topic}") == 1
        state = probe.complete(1, names, np.array([0.5, 0.3, 0.2]))
    finally:
        terminate_process(process)
    urdf.move(values_by_name(state))
    assert np.abs(urdf.gaps()).max() < 1e-9


def test_delta_that_computed_torque_moves_is_closed(client, tmp_path):
    """computed_torque publishes no joint states. Those of the robot's motors are completed beside it."""
    dynamics = Dynamics(load_robot("delta"), compiled=False)
    motors = list(dynamics.joint_names)
    urdf = CutUrdf(dynamics.robot)
    patient = tmp_path / "patient.yaml"
    controller = {"kp": [400.0], "kd": [40.0], "state_timeout": 1.0, "deadline": 1.0}
    values = {"/**/mobile_base_simulator": {"wait_for_commands": "each"}, "/**/computed_torque": controller}
    patient.write_text(yaml.safe_dump({node: {"ros__parameters": of_node} for node, of_node in values.items()}))
    common = ("robot:=delta", "namespace:=moved")
    nodes = started("closed_loop.launch.py", [*common, f"parameters:={patient}"], tmp_path)
    nodes += started(FILE, [*common, "rviz:=false", "joint_states:=motor_states"], tmp_path)
    python = [sys.executable, "-m"]
    processes = [
        subprocess.Popen([*python, f"robot_dynamics.nodes.{name}", "--ros-args", *words]) for name, words in nodes
    ]
    publisher = client.node.create_publisher(JointTrajectory, "/moved/computed_torque/reference", 1)
    motor_states = client.node.create_publisher(JointState, "/moved/motor_states", 10)
    names, reports = set(), []

    def relay(message):
        """Publish the joints with motors only, as a driver does."""
        names.add(tuple(message.name))
        values = values_by_name(message)
        motor_states.publish(JointState(header=message.header, name=motors, position=[values[name] for name in motors]))

    relays = client.node.create_subscription(JointState, "/moved/joint_states", relay, 10)
    outputs = client.node.create_subscription(JointTrajectory, "/moved/computed_torque/state", reports.append, 1)
    try:
        probe = CompleterProbe("/moved/joint_state_completer", client, "mobile_base_simulator/external_wrench")
        probe.wait_until(lambda: probe.states and reports, "states of a robot under control")
        probe.wait_until(publisher.get_subscription_count, "the controller, which takes references")
        goal = positions(probe.states[-1], motors) + np.array([0.3, 0.1, 0.2])
        sent = []

        def is_at_the_goal():
            if not sent or time.monotonic() > sent[-1] + 5.0:  # a reference is dropped while efforts are zero
                publisher.publish(trajectory_message(motors, [0.3], [goal], [np.zeros(3)]))
                sent.append(time.monotonic())
            return np.abs(positions(probe.states[-1], motors) - goal).max() < 5e-3

        probe.wait_until(is_at_the_goal, "the goal")
        publishers = client.node.get_publishers_info_by_topic("/moved/joint_states")
        assert {node.node_name for node in publishers} == {"mobile_base_simulator", client.node.get_name()}
    finally:
        for process in processes:
            terminate_process(process)
        for subscription in (relays, outputs):
            client.node.destroy_subscription(subscription)
    assert all(set(dynamics.all_joint_names) <= set(published) for published in names) and names
    for message in probe.states[:: max(1, len(probe.states) // 50)]:
        urdf.move(values_by_name(message))
        assert np.abs(urdf.gaps()).max() < 1e-9


def positions(message, names):
    values = values_by_name(message)
    return np.array([values[name] for name in names])


def test_configuration_of_rviz_has_the_namespaces_of_the_markers():
    from robot_dynamics.nodes.joint_state_completer import markers

    displays = yaml.safe_load(RVIZ.read_text())["Visualization Manager"]["Displays"]
    (display,) = [display for display in displays if display["Class"] == "rviz_default_plugins/MarkerArray"]
    source = importlib.util.find_spec(markers.__name__).loader.get_source(markers.__name__)
    for namespace in display["Namespaces"]:
        assert f'"{namespace}"' in source
