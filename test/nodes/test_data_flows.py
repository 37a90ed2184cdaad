"""Data flows: a request, a message and a recording pass through the files of docs/explanation/architecture.md."""

import inspect
import re
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from peers.recorded import messages, panda_motion, write_bag
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

import robot_dynamics
from robot_dynamics.cli.main import main
from robot_dynamics.nodes.computed_torque.node import ComputedTorque
from robot_dynamics.nodes.dynamics_server.node import DynamicsServer
from robot_dynamics_interfaces.srv import InverseDynamics

from .service_requests import inverse

PACKAGE = Path(robot_dynamics.__file__).parent
ARCHITECTURE = Path(__file__).parents[2] / "docs" / "explanation" / "architecture.md"
MOST_FILES = {"request": 17, "message": 6, "recording": 25}
"""Most files that the documentation lists for each flow, as before the packages were laid out."""


def files_passed(call):
    """Files of the package whose functions a call runs, in the order of their first call; imports do not count."""
    files = {}

    def note(frame, event, argument):
        path = Path(frame.f_code.co_filename)
        is_function = frame.f_code.co_flags & inspect.CO_OPTIMIZED  # bodies of modules and classes are not
        if event == "call" and is_function and PACKAGE in path.parents:
            files.setdefault(path.relative_to(PACKAGE).as_posix())

    sys.setprofile(note)
    try:
        call()
    finally:
        sys.setprofile(None)
    return list(files)


def documented(flow):
    """The files that docs/explanation/architecture.md lists under the heading of a flow."""
    section = re.search(rf"^### [^\n]*\b{flow}\b[^\n]*$(.*?)(?=^##|\Z)", ARCHITECTURE.read_text(), re.M | re.S)[1]
    return re.findall(r"^\d+\. `([\w/]+\.py)`", section, re.M)


def check(flow, files):
    """The documented files run, in their order."""
    print(f"{flow}: {len(files)} files:", *files, sep="\n  ")
    listed = documented(flow)
    assert 0 < len(listed) <= MOST_FILES[flow]
    assert [file for file in files if file in listed] == listed


@pytest.fixture
def node_of(ros):
    nodes = []

    def make(node_class, **parameters):
        overrides = [Parameter(name, value=value) for name, value in {"robot_file": "panda", **parameters}.items()]
        nodes.append(node_class(parameter_overrides=overrides, namespace="/data_flows"))
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()


def test_request_of_inverse_dynamics(node_of):
    node = node_of(DynamicsServer)
    (service,) = [service for service in node.services if service.srv_name.endswith("inverse_dynamics")]
    request, responses = inverse(), []
    check("request", files_passed(lambda: responses.append(service.callback(request, InverseDynamics.Response()))))
    assert responses[0].success and len(responses[0].trajectory.points[0].effort) == 7


def test_message_of_joint_states(node_of):
    node = node_of(ComputedTorque, state_timeout=5.0)
    (subscription,) = [each for each in node.subscriptions if each.topic_name.endswith("joint_states")]

    def state():
        message = JointState(name=[f"panda_joint{k}" for k in range(1, 8)], position=np.zeros(7), velocity=np.zeros(7))
        message.header.stamp = node.get_clock().now().to_msg()
        subscription.callback((message, {"source_timestamp": time.time_ns(), "received_timestamp": time.time_ns()}))

    for _ in range(20):
        state()
    check("message", files_passed(state))


def test_recording_through_replay_check(tmp_path, capsys):
    bag = write_bag(tmp_path / "bag", messages(panda_motion(5.0)))
    statuses = []
    files = files_passed(lambda: statuses.append(main(["replay-check", str(bag), "--robot", "panda"])))
    with capsys.disabled():
        check("recording", files)
    assert statuses == [0]
