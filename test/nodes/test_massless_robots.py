"""Robots without masses, or with effort limits of zero: services warn, and no efforts are sent for them."""

import re

import numpy as np
import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import GetState
from nodes.controller_probe import ControllerProbe
from nodes.controller_probe import Q as POSE
from nodes.service_requests import (
    PANDA,
    QD,
    Q,
    call_service,
    call_successfully,
    direct_request,
    equilibrium_request,
    field,
    inverse,
    terms_request,
)
from peers.real_robots import without_inertials

from robot_dynamics import shipped_robots
from robot_dynamics.nodes.client import ServiceClient

SAID = "none of its moving links has a mass"
WHOLE = shipped_robots()["panda"].read_text()
BARE = without_inertials(WHOLE)
POWERLESS = re.sub(r'effort="[^"]*"', 'effort="0"', WHOLE)
PAYLOAD = {"payload.link": "panda_link8", "payload.mass": 2.0}
PATIENT = {"deadline": 1.0, "state_timeout": 0.5, "mode": "gravity_compensation"}


def test_services_compute_and_warn_that_masses_are_missing(client, start_server):
    server = start_server({"robot_description": BARE})
    requests = [inverse(), terms_request(PANDA, Q[0], QD[0]), equilibrium_request(PANDA, Q)]
    for request in requests:
        response = call_service(client, server, request)
        assert response.success and SAID in response.message and "robot-dynamics identify" in response.message
    assert np.abs(field(call_service(client, server, inverse()).trajectory, "effort")).max() == 0
    refused = call_service(client, server, direct_request(PANDA, Q, QD, QD))
    assert not refused.success and "nothing with inertia" in refused.message
    # a payload is no mass of the robot
    assert client.set_parameters(server, PAYLOAD).successful
    response = call_service(client, server, inverse())
    assert response.success and SAID in response.message
    assert np.abs(field(response.trajectory, "effort")).max() > 1
    # and what was refused in between changes nothing
    assert not client.set_parameters(server, {"robot_description": WHOLE, "payload.link": "nothing"}).successful
    assert SAID in call_service(client, server, inverse()).message
    assert client.set_parameters(server, {"robot_description": WHOLE}).successful
    call_successfully(client, server, inverse())  # without a message


@pytest.fixture
def control(start_server):
    """Start computed_torque of a description; gives its Stand."""
    clients, probes = [], []

    def start(text, **parameters):
        parameters_of_node = {"robot_description": text, **PATIENT, **parameters}
        clients.append(ServiceClient("test_client"))
        probes.append(ControllerProbe(start_server(parameters_of_node, executable="computed_torque"), clients[-1]))
        return probes[-1]

    yield start
    for each in (*probes, *clients):
        each.close()


def state(probe):
    return probe.client.call(GetState, f"{probe.target}/get_state", GetState.Request()).current_state.id


@pytest.mark.parametrize(
    ("text", "expected_text", "remedy", "sent"),
    [
        (BARE, SAID, {"allow_massless": True}, 0.0),
        (POWERLESS, "nothing but zeros could be sent: set effort_limits", {"effort_limits": [5.0] * 7}, 5.0),
    ],
    ids=["massless", "powerless"],
)
def test_efforts_are_sent_only_after_a_parameter_allows_it(text, expected_text, remedy, sent, control):
    probe = control(text, **(PAYLOAD if text is BARE else {}))
    probe.wait_until(lambda: probe.has_diagnostic(expected_text), "the refusal on /diagnostics")
    assert state(probe) == State.PRIMARY_STATE_UNCONFIGURED
    assert not probe.change_state(Transition.TRANSITION_CONFIGURE)
    probe.stream(0.2, q=POSE)
    assert not probe.commands
    assert probe.set_parameters(**remedy).successful
    probe.wait_until(lambda: state(probe) == State.PRIMARY_STATE_ACTIVE, "the node is active")
    probe.stream_until(lambda: np.abs(probe.commands[-1][1]).max() >= sent if probe.commands else False, "efforts")
    if text is BARE:
        doubt = f"gravity_compensation; robot 'panda': {SAID}"
        probe.stream_until(lambda: probe.has_diagnostic(doubt), "the doubt on /diagnostics")
        refused = probe.set_parameters(allow_massless=False)
        assert not refused.successful and SAID in refused.reason
