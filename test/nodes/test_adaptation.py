"""computed_torque adapts its model: while efforts are sent, not in faults; the adapted description is for others."""

import numpy as np
import pytest
from nodes.controller_probe import PANDA, ControllerProbe, Q, trajectory_message
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from std_srvs.srv import Trigger

from robot_dynamics import load_robot
from robot_dynamics.newton_euler.regressor import parameters

QUIET = {"robot_file": "panda", "deadline": 1.0, "state_timeout": 0.2}
ADAPTIVE = {**QUIET, "mode": "adaptive_computed_torque"}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def start_controller(start_server, client):
    probes = []

    def start(parameter_values):
        probes.append(ControllerProbe(start_server(parameter_values, executable="computed_torque"), client))
        return probes[-1]

    yield start
    for probe in probes:
        probe.close()


def adapted(probe, client):
    """Parameters of the description that the node publishes."""
    texts = []
    subscription = probe.node.create_subscription(
        String, f"{probe.target}/adapted_description", lambda message: texts.append(message.data), LATCHED
    )
    try:
        response = client.call(Trigger, f"{probe.target}/publish_adapted_description", Trigger.Request())
        assert response.success, response.message
        probe.wait_until(lambda: texts, "the adapted description")
    finally:
        probe.node.destroy_subscription(subscription)
    return parameters(load_robot(texts[-1]))


def follow(probe):
    """Send a reference beside the robot, which stands still."""
    goal, rest = Q + 0.2, np.zeros((1, 7))
    probe.reference.publish(trajectory_message(PANDA, [0.0], [goal], rest, rest))


def test_parameters_adapt_while_efforts_are_sent_and_freeze_in_a_fault(start_controller, client):
    probe = start_controller({**ADAPTIVE, "effort_limits": [1e4] * 7})
    described = parameters(load_robot("panda"))
    probe.stream_until(lambda: probe.efforts, "efforts")
    np.testing.assert_allclose(adapted(probe, client), described, rtol=1e-8, atol=1e-12)
    follow(probe)
    is_active = lambda: any(values.get("adaptation") == "active" for *_, values in probe.diagnostics)  # noqa: E731
    probe.stream_until(is_active, "adaptation")
    assert float(probe.diagnostics[-1][2]["largest change of a parameter"].removesuffix(" times")) > 1.01
    probe.stream(0.3, q=np.full(7, np.nan))
    since = len(probe.diagnostics)
    probe.stream_until(lambda: probe.has_diagnostic("efforts go to zero", since), "fault", q=np.full(7, np.nan))
    before = adapted(probe, client)
    assert np.abs(before - described).max() > 1e-3
    probe.stream(0.5, q=np.full(7, np.nan))
    np.testing.assert_array_equal(adapted(probe, client), before)
    assert probe.diagnostics[-1][2]["adaptation"] == "frozen: fault"
    response = client.call(Trigger, f"{probe.target}/reset_adaptation", Trigger.Request())
    assert response.success, response.message
    np.testing.assert_allclose(adapted(probe, client), described, rtol=1e-8, atol=1e-12)


def test_saturated_efforts_adapt_nothing(start_controller, client):
    probe = start_controller({**ADAPTIVE, "effort_limits": [5.0] * 7})
    probe.stream_until(lambda: probe.efforts, "efforts")
    follow(probe)
    is_frozen = lambda: any(  # noqa: E731
        values.get("adaptation") == "frozen: an effort is at its limit" for *_, values in probe.diagnostics
    )
    probe.stream_until(is_frozen, "saturation")
    probe.stream(0.5)
    np.testing.assert_allclose(adapted(probe, client), parameters(load_robot("panda")), rtol=1e-8, atol=1e-12)


def test_mode_is_prepared_at_configuration(start_controller, client):
    probe = start_controller(QUIET)
    probe.stream_until(lambda: probe.efforts, "efforts")
    result = client.set_parameters(probe.target, {"mode": "adaptive_computed_torque"})
    assert not result.successful and "prepared when the node is configured" in result.reason
    for service in ("publish_adapted_description", "reset_adaptation"):
        response = client.call(Trigger, f"{probe.target}/{service}", Trigger.Request())
        assert not response.success and "configure the node with mode adaptive_computed_torque" in response.message


def test_gains_that_do_not_fit_are_refused(start_controller, client):
    probe = start_controller(ADAPTIVE)
    probe.stream_until(lambda: probe.efforts, "efforts")
    result = client.set_parameters(probe.target, {"kd": [0.0]})
    assert not result.successful and "needs gains above 0" in result.reason
    result = client.set_parameters(probe.target, {"mode": "computed_torque"})
    assert result.successful
    result = client.set_parameters(probe.target, {"mode": "adaptive_computed_torque"})
    assert result.successful, result.reason
