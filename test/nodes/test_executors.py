"""Nodes with an rclpy without EventsExecutor, as before 7.1.4: they work, and warn once."""

import os
import sys
import time
from contextlib import contextmanager

import pytest
from nodes.controller_probe import ControllerProbe
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.nodes.events_executor import make_executor
from robot_dynamics.nodes.processes import running_node
from robot_dynamics_interfaces.srv import InverseDynamicsBatch

WARNING = "this rclpy has no EventsExecutor"
HIDDEN = """
import sys

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[::2] == ("rclpy", "experimental"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Hidden())
"""


@pytest.fixture
def old_rclpy(tmp_path):
    """Variables of an environment whose Python cannot import rclpy.experimental, and a file for what nodes print."""
    (tmp_path / "sitecustomize.py").write_text(HIDDEN)
    path = os.pathsep.join(filter(None, [str(tmp_path), os.environ.get("PYTHONPATH")]))
    return {"PYTHONPATH": path}, tmp_path / "log"


@contextmanager
def node_of(executable, old_rclpy):
    environment, log = old_rclpy
    with log.open("w") as file:
        with running_node(executable, {"robot_file": "panda"}, "/old", environment, file) as process:
            yield
        assert process.returncode == 0, log.read_text()
    assert log.read_text().count(WARNING) == 1, log.read_text()


def test_computed_torque_without_events_executor(old_rclpy, client):
    with node_of("computed_torque", old_rclpy):
        stand = ControllerProbe("/old/computed_torque", client)
        try:
            stand.stream_until_steady()
            assert stand.set_parameters(mode="gravity_compensation").successful
        finally:
            stand.close()


def test_mobile_base_simulator_without_events_executor(old_rclpy, client):
    states = []
    subscription = client.node.create_subscription(JointState, "/old/joint_states", states.append, 10)
    with node_of("mobile_base_simulator", old_rclpy):
        until = time.monotonic() + 30
        while len(states) < 20:
            assert time.monotonic() < until, "no states"
            client.spin(0.1)
    client.node.destroy_subscription(subscription)


@pytest.mark.parametrize("executable", ["replay_check", "dynamics_server"])
def test_services_without_events_executor(executable, old_rclpy, client):
    with node_of(executable, old_rclpy):
        request = GetParameters.Request(names=["robot_file"])
        response = client.call(GetParameters, f"/old/{executable}/get_parameters", request)
        assert response.values[0].string_value == "panda"
        if executable == "dynamics_server":  # a request in many turns, and a short one
            joints = [f"panda_joint{k}" for k in range(1, 8)]
            rows = {name: [[0.0] * 7] for name in ("velocities", "accelerations")}
            for count in (20_000, 1):
                result = client.call_batch(
                    InverseDynamicsBatch,
                    "/old/dynamics_server/inverse_dynamics_batch",
                    joints,
                    positions=[[0.1] * 7] * count,
                    reaction_wrenches=True,
                    points_per_request=20_000,
                    **rows,
                )
                assert result["reactions"].shape == (count, 8, 6)
        if executable == "replay_check":
            assert client.call(Trigger, "/old/replay_check/report", Trigger.Request()).message


def test_client_without_events_executor(monkeypatch, ros, start_server):
    server = start_server({"robot_file": "panda"})
    monkeypatch.setitem(sys.modules, "rclpy.experimental.events_executor", None)
    assert isinstance(make_executor(), SingleThreadedExecutor)
    old_client = ServiceClient("old_client")
    try:
        request = GetParameters.Request(names=["robot_file"])
        response = old_client.call(GetParameters, f"{server}/get_parameters", request)
        assert response.values[0].string_value == "panda"
    finally:
        old_client.close()
