"""Loading of a robot while a node runs: requests are answered by the present robot until the new one is ready."""

import time

import numpy as np
import pytest
from nodes.service_requests import PANDA, QD, QDD, Q, assert_still_serves, call_service, inverse, inverse_request
from peers.hostile_descriptions import chain, legs
from rcl_interfaces.msg import Log, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_parameters
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from robot_dynamics.nodes import parameter_requests
from robot_dynamics_interfaces.srv import InverseDynamics

LONG = legs(4)  # its loops are refused after half a second or more
REASON = "its loops cannot be closed"


def send_parameters(client, node, kind, **values):
    """Send a request to set parameters, and return the future of its response."""
    service = "set_parameters_atomically" if kind is SetParametersAtomically else "set_parameters"
    requester = client.node.create_client(kind, f"{node}/{service}")
    assert requester.wait_for_service(30)
    parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    return requester.call_async(kind.Request(parameters=parameters))


def requests_answered_before(client, node, is_done, request, seconds=120):
    """Number of requests that the node answers, one after the other, until a condition is true."""
    count = 0
    deadline = time.monotonic() + seconds
    while not is_done():
        assert time.monotonic() < deadline
        assert call_service(client, node, request).success
        count += 1
    return count


@pytest.mark.parametrize("kind", [SetParameters, SetParametersAtomically])
def test_requests_are_answered_while_a_parameter_loads_a_robot(kind, client, panda, panda_dynamics):
    """Before, the first request waited until the description was refused, so that only one was answered."""
    assert_still_serves(client, panda, panda_dynamics)
    text = f"{LONG}# {kind.__name__}\n"  # the reason of a refusal is kept for the same text
    future = send_parameters(client, panda, kind, robot_description=text)
    assert requests_answered_before(client, panda, future.done, inverse()) >= 5
    response = future.result()
    result: SetParametersResult = response.result if kind is SetParametersAtomically else response.results[0]
    assert not result.successful and REASON in result.reason
    assert_still_serves(client, panda, panda_dynamics)


def test_other_parameters_are_set_meanwhile_and_robots_in_the_order_of_their_requests(client, start_server):
    server = start_server({"robot_file": "panda"})
    assert client.set_parameters(server, {"max_points": 100}).successful
    call_service(client, server, inverse())
    loading = send_parameters(client, server, SetParametersAtomically, robot_description=LONG)
    second = send_parameters(client, server, SetParameters, robot_file="ur5e", base="floating", strict=False)
    assert client.set_parameters(server, {"max_points": 7}).successful
    assert not loading.done()
    deadline = time.monotonic() + 120
    while not (loading.done() and second.done()):  # a client may receive responses of two services in any order
        assert time.monotonic() < deadline
        client.spin(0.1)
    assert not loading.result().result.successful
    assert [result.successful for result in second.result().results] == [True, False, True]
    assert "fixed, moving" in second.result().results[1].reason
    zero = np.zeros((1, 6))
    names = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
    assert call_service(client, server, inverse_request(names, zero, zero, zero)).success
    refusal = call_service(client, server, inverse_request(names, *[np.zeros((8, 6))] * 3))
    assert not refusal.success and "7" in refusal.message


def test_requests_are_answered_while_the_topic_loads_a_robot(client, start_server):
    """Before, requests were answered when the description was refused, which the log on /rosout says at once."""
    server = start_server({"robot_file": "panda"}, namespace="/beside")
    call_service(client, server, inverse())
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = client.node.create_publisher(String, "/beside/robot_description", qos)
    logs = []
    subscription = client.node.create_subscription(Log, "/rosout", logs.append, 100)

    def is_logged(text):
        return any(text in log.msg for log in logs)

    deadline = time.monotonic() + 60
    while not is_logged("is not used: robot_file is set"):
        assert time.monotonic() < deadline
        publisher.publish(String(data=chain(2 + len(logs))))
        client.spin(0.5)
    publisher.publish(String(data=LONG))
    assert requests_answered_before(client, server, lambda: is_logged(REASON), inverse()) >= 10
    client.node.destroy_publisher(publisher)
    client.node.destroy_subscription(subscription)


def test_too_many_waiting_requests_are_refused(client, start_server):
    server = start_server({"robot_file": "panda"})
    call_service(client, server, inverse())
    requester = client.node.create_client(SetParameters, f"{server}/set_parameters", qos_profile=qos_profile_parameters)
    assert requester.wait_for_service(30)
    client.spin(1.0)
    request = SetParameters.Request(parameters=[Parameter("robot_description", value=LONG).to_parameter_msg()])
    futures = [requester.call_async(request) for _ in range(parameter_requests.MAX_WAITING + 5)]
    requests_answered_before(client, server, lambda: all(future.done() for future in futures), inverse())
    reasons = [future.result().results[0].reason for future in futures]
    assert sum(REASON in reason for reason in reasons) == parameter_requests.MAX_WAITING
    assert sum("changes of the robot are waiting" in reason for reason in reasons) == 5


def test_node_ends_at_once_while_it_loads(client, start_server):
    """The fixture checks that it ends cleanly."""
    server = start_server({"robot_file": "panda"})
    call_service(client, server, inverse())
    send_parameters(client, server, SetParametersAtomically, robot_description=LONG)
    assert client.call(InverseDynamics, f"{server}/inverse_dynamics", inverse_request(PANDA, Q, QD, QDD)).success


def test_simulation_goes_on_while_that_of_another_robot_is_compiled(client, start_server, monkeypatch, tmp_path):
    """Before, the next step waited until the programs of the new simulation were compiled."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # no program is there
    simulator = start_server({"robot_file": "panda"}, executable="mobile_base_simulator", namespace="/compiles")
    states = []
    subscription = client.node.create_subscription(
        JointState, "/compiles/joint_states", lambda state: states.append((time.monotonic(), state.name)), 2000
    )
    deadline = time.monotonic() + 60
    while not states:
        assert time.monotonic() < deadline
        client.spin(0.02)
    began = time.monotonic()
    future = send_parameters(client, simulator, SetParameters, robot_file="delta")
    while states[-1][1] == PANDA:
        assert time.monotonic() < deadline
        client.spin(0.02)
    assert future.result().results[0].successful
    moments = np.array([moment for moment, _ in states if moment > began])
    assert np.diff(moments).max() < (moments[-1] - began) / 3
    client.node.destroy_subscription(subscription)
