"""Fixtures: real nodes in processes of their own, in a DDS domain of this test run, and calls with a time limit."""

import os

import pytest
import rclpy

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.nodes.processes import running_node

os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


@pytest.fixture(scope="session")
def ros():
    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture(scope="module")
def client(ros):
    service_client = ServiceClient("test_client")
    yield service_client
    service_client.close()


@pytest.fixture
def start_server():
    """A function that starts a node with parameters and returns its fully qualified name; all end with the test."""
    with _servers() as start:
        yield start


@pytest.fixture(scope="module")
def start_module_server():
    with _servers() as start:
        yield start


class _servers:
    """Nodes in namespaces of their own, so that they do not receive messages for each other."""

    count = 0

    def __enter__(self):
        self.running = []
        return self.start

    def start(self, parameters=None, namespace=None, executable="dynamics_server"):
        _servers.count += 1
        namespace = namespace or f"/test_{os.getpid()}_{_servers.count}"
        node = running_node(executable, parameters, namespace)
        self.running.append((node, node.__enter__()))
        return f"{namespace}/{executable}"

    def __exit__(self, *_):
        for node, process in self.running:
            assert process.poll() is None, "the server died"
            node.__exit__(None, None, None)
            assert process.returncode == 0, "the server did not end cleanly"


@pytest.fixture(scope="module")
def panda(start_module_server):
    """A server of the shipped Panda."""
    return start_module_server({"robot_file": "panda"})


@pytest.fixture(scope="module")
def panda_dynamics():
    """The same robot without ROS."""
    return Dynamics(load_robot("panda"), compiled=False)
