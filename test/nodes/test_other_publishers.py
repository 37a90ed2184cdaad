"""Other publishers on the topics of mobile_base_simulator: named, and a second simulator is a warning."""

import time

import pytest
import rclpy
from sensor_msgs.msg import JointState

from robot_dynamics.nodes.diagnostics import OK, WARN
from robot_dynamics.nodes.processes import running_node

from .simulator_probe import SimulatorProbe

PARAMETERS = {"robot_file": "free_flying_arm", "publish_clock": False, "step": 0.01}


@pytest.fixture
def simulator(start_server, client):
    return SimulatorProbe(start_server(PARAMETERS, executable="mobile_base_simulator"), client)


def wait_for(simulator, level, *texts):
    """Wait for a report with a level and texts."""
    since = len(simulator.diagnostics)
    simulator.wait_until(
        lambda: any(
            report[0] == level and all(text in report[1] for text in texts) for report in simulator.diagnostics[since:]
        ),
        f"{level!r} with {texts}",
    )


def publisher_endpoints(client, topic):
    """Words that name the publishers of a topic, from the graph as this process has it."""
    return [
        f"{info.node_namespace}/{info.node_name} (endpoint {'.'.join(f'{byte:02x}' for byte in info.endpoint_gid)})"
        for info in client.node.get_publishers_info_by_topic(topic)
    ]


@pytest.mark.parametrize("name", ["twin", "mobile_base_simulator"])
def test_second_simulator_on_the_same_topics_is_named_as_a_warning_and_in_the_log(name, simulator, client, tmp_path):
    namespace = simulator.name.rpartition("/")[0]
    wait_for(simulator, OK)
    log = tmp_path / "log"
    with log.open("w") as file:
        twin = running_node("mobile_base_simulator", PARAMETERS, namespace, log=file, remappings={"__node": name})
        with twin:
            for topic in (f"{namespace}/joint_states", f"{namespace}/odom"):
                deadline = time.monotonic() + 30
                while len(names := publisher_endpoints(client, topic)) < 2 or "UNKNOWN" in "".join(names):
                    assert time.monotonic() < deadline, names
                    time.sleep(0.05)
                wait_for(simulator, WARN, f"{topic} is published by", *names)
            time.sleep(1.5)  # a report of the second one
    text = log.read_text()
    assert f"{namespace}/odom is published by" in text and f"{simulator.name} (endpoint " in text
    wait_for(simulator, OK)


def test_publisher_of_other_joints_is_named_without_a_warning(simulator, ros):
    namespace = simulator.name.rpartition("/")[0]
    wait_for(simulator, OK)
    node = rclpy.create_node("gripper", namespace=namespace)
    try:
        node.create_publisher(JointState, "joint_states", 10)
        wait_for(simulator, OK, f"{namespace}/joint_states is published by {namespace}/gripper (endpoint ")
    finally:
        node.destroy_node()
