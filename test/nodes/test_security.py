"""Access control: the policies name exactly what running nodes open, and no node starts without protection."""

import importlib.util
import os
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rclpy.expand_topic_name import expand_topic_name

from robot_dynamics.nodes.processes import running_node

POLICIES = Path(__file__).parents[2] / "config" / "sros2" / "policies.xml"
MOVING = {"robot_file": "free_flying_arm", "use_sim_time": True}
CONFIGURATIONS = {
    "computed_torque": [{"robot_file": "panda", "use_sim_time": True}],
    "contact_monitor": [
        MOVING,
        {"robot_file": "panda", "frame": "panda_link8", "effort_topic": "computed_torque/effort"},
    ],
    "dynamics_server": [{"robot_file": "panda", "use_sim_time": True}],
    "joint_state_completer": [{"robot_file": "delta", "use_sim_time": True}],
    "mobile_base_simulator": [MOVING, {"robot_file": "panda", "publish_clock": False, "use_sim_time": True}],
    "payload_identifier": [{"robot_file": "panda", "use_sim_time": True}, MOVING],
    "replay_check": [{"robot_file": "panda", "use_sim_time": True}, MOVING],
}
"""Parameters of each node: together they open all interfaces that it can open."""
KINDS = {
    ("topics", "publish"): "get_publisher_names_and_types_by_node",
    ("topics", "subscribe"): "get_subscriber_names_and_types_by_node",
    ("services", "reply"): "get_service_names_and_types_by_node",
    ("services", "request"): "get_client_names_and_types_by_node",
}
ACTION_SERVER = {
    ("topics", "publish"): ("feedback", "status"),
    ("services", "reply"): ("send_goal", "cancel_goal", "get_result"),
}
"""What the server of an action opens."""
NOT_INSTALLED = {name for name in ("tf2_msgs", "control_msgs") if importlib.util.find_spec(name) is None}
"""Interfaces that nodes do without. Read before any test runs: test_trajectory_action.py imports what it builds."""


def allowed(name):
    """{kind: full names} that the policy of a node allows."""
    (profile,) = ElementTree.parse(POLICIES).getroot().findall(f".//profile[@node='{name}']")
    names = {kind: set() for kind in KINDS}
    for rule in profile:
        ((access, value),) = rule.attrib.items()
        assert value == "ALLOW"
        if rule.tag == "actions":
            assert access == "execute"
            for entry in rule:
                for kind, parts in ACTION_SERVER.items():
                    names[kind] |= {expand_topic_name(f"{entry.text}/_action/{part}", name, "/") for part in parts}
            continue
        names[rule.tag, access] |= {expand_topic_name(entry.text, name, "/") for entry in rule}
    return names


def opened(name, parameters, client, log):
    """{kind: full names} that a running node opens. The graph of ROS says so, once it no longer grows."""
    names, last_change = {}, time.monotonic()
    with log.open("w") as file, running_node(name, parameters, log=file):
        deadline = time.monotonic() + 60
        while not names or time.monotonic() - last_change < 3:
            assert time.monotonic() < deadline, log.read_text()
            time.sleep(0.1)
            if (name, "/") not in client.node.get_node_names_and_namespaces():
                last_change = time.monotonic()
                continue
            seen = {kind: {topic for topic, _ in getattr(client.node, get)(name, "/")} for kind, get in KINDS.items()}
            if seen != names:
                names, last_change = seen, time.monotonic()
    return names


@pytest.mark.slow
@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_policies_name_what_nodes_open_and_nothing_else(name, client, tmp_path):
    expected = allowed(name)
    if "tf2_msgs" in NOT_INSTALLED:
        expected["topics", "publish"].discard("/tf")
    if "control_msgs" in NOT_INSTALLED:  # test_trajectory_action.py looks at the rest
        expected["topics", "publish"].discard("/computed_torque/controller_state")
        for names in expected.values():
            names -= {topic for topic in names if "/_action/" in topic}
    graphs = [opened(name, parameters, client, tmp_path / "log") for parameters in CONFIGURATIONS[name]]
    assert {kind: set().union(*(graph[kind] for graph in graphs)) for kind in KINDS} == expected


@pytest.mark.parametrize("strategy", ["", "Permissive", "enforce"])
def test_node_that_could_start_without_protection_is_refused(strategy, tmp_path):
    done = start({"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": strategy}, tmp_path)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 1 and "ROS_SECURITY_STRATEGY=Enforce" in line


def test_middleware_without_security_is_named(tmp_path):
    (tmp_path / "enclaves" / "robot_dynamics" / "dynamics_server").mkdir(parents=True)
    keys = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce", "ROS_SECURITY_KEYSTORE": str(tmp_path)}
    done = start(keys, tmp_path)
    if "built without security" not in done.stderr:
        pytest.skip("the middleware here has security")
    assert done.returncode == 1 and "Use ROS 2 installed with apt" in done.stderr


def start(environment, folder):
    """Run a node that ends by itself because it cannot start."""
    command = [sys.executable, "-m", "robot_dynamics.nodes.dynamics_server", "--ros-args"]
    command += ["--enclave", "/robot_dynamics/dynamics_server", "-p", "robot_file:=panda"]
    variables = {**os.environ, **environment}
    return subprocess.run(command, env=variables, cwd=folder, capture_output=True, text=True, timeout=60)
