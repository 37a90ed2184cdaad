"""Natural frequencies over real services: those of the paper, and refusals that the node survives."""

import numpy as np
import pytest
from nodes.service_requests import call_service, call_successfully

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.flexible.elastodynamics import Elastodynamics
from robot_dynamics_interfaces.srv import NaturalFrequencies


@pytest.fixture(scope="module")
def server(start_module_server):
    return start_module_server({"robot_file": "navaro"})


def at(x, y, **others):
    request = NaturalFrequencies.Request(**others)
    request.platform.position.x, request.platform.position.y = x, y
    return request


def test_natural_frequencies_of_pose_d_are_those_of_the_paper(client, server):
    response = call_successfully(client, server, at(0.0, -0.21, count=5))
    np.testing.assert_allclose(response.frequencies, [40.17, 50.32, 52.99, 67.36, 91.52], atol=0.01)
    assert len(response.coordinates) == 144
    assert len(response.mode_shapes) == 5 * 144
    assert len(call_successfully(client, server, at(0.0, 0.0)).frequencies) == 90


def test_natural_frequencies_at_a_pose_given_by_joints(client, server):
    dynamics = Dynamics(load_robot("navaro"), compiled=False)
    q = dynamics.initial_joint_positions
    request = NaturalFrequencies.Request(joint_names=dynamics.all_joint_names, positions=q.tolist())
    expected = dynamics.elastodynamics.frequencies(q)
    np.testing.assert_allclose(call_successfully(client, server, request).frequencies, expected, rtol=1e-8)
    request.held = ["crank_1", "crank_2", "crank_3", "arm_1", "arm_2"]
    expected = Elastodynamics(dynamics, list(request.held)).frequencies(q)
    np.testing.assert_allclose(call_successfully(client, server, request).frequencies[1:], expected[1:], rtol=1e-7)


def test_invalid_natural_frequency_requests_are_refused(client, server):
    assert "does not close" in call_service(client, server, at(0.6, 0.0)).message
    assert "platform.position is not finite" in call_service(client, server, at(np.nan, 0.0)).message
    request = at(0.0, 0.0)
    request.platform.orientation.w = 0.0
    assert "platform.orientation has norm 0" in call_service(client, server, request).message
    assert "unknown joint 'nobody'" in call_service(client, server, at(0.0, 0.0, held=["nobody"])).message
    request = NaturalFrequencies.Request(joint_names=["crank_1"], positions=[0.0, 1.0])
    assert not call_service(client, server, request).success
    call_successfully(client, server, at(0.0, 0.0, count=1))
