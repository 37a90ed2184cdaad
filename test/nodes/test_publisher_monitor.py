"""Second publishers on the topics of computed_torque: those that disturb are named in its diagnostics."""

import time

import numpy as np
import pytest
import rclpy
from nodes.controller_probe import PANDA, ControllerProbe, Q, to_time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.nodes.computed_torque.publisher_monitor import SequenceSteps
from robot_dynamics.nodes.diagnostics import ERROR, OK, WARN

PARAMETERS = {"robot_file": "panda", "mode": "gravity_compensation", "deadline": 1.0, "state_timeout": 0.5}
GRAVITY = Dynamics(load_robot("panda"), compiled=False).gravity(Q)


@pytest.fixture
def controller(start_server, client):
    probe = ControllerProbe(start_server(PARAMETERS, executable="computed_torque"), client)
    yield probe
    probe.close()


@pytest.fixture
def second_node(ros, controller):
    node = rclpy.create_node("second", namespace=controller.target.rpartition("/")[0])
    yield node
    node.destroy_node()


def level_of(controller):
    return controller.diagnostics[-1][0]


def wait_for_reports(controller, count, step=lambda: None):
    """Stream states until some more diagnostics have come."""
    since = len(controller.diagnostics)

    def has_come():
        step()
        return len(controller.diagnostics) >= since + count

    controller.stream_until(has_come, "diagnostics")


def test_steps_back_of_sequence_numbers_are_counted():
    steps = SequenceSteps()
    for number in (1, 2, 5, 6):  # a single publisher, of which messages were lost
        steps.add({"publication_sequence_number": number})
    assert steps.take() == 0
    for number in (7, 7, 8, 8, 9):  # two publishers that began together
        steps.add({"publication_sequence_number": number})
    assert steps.take() == 2
    assert steps.take() == 0
    for number in (None, None):  # a middleware without such numbers
        steps.add({"publication_sequence_number": number})
    steps.add({})
    assert steps.take() == 0


def test_second_publisher_of_efforts_is_named(controller, second_node):
    controller.stream_until_steady()
    wait_for_reports(controller, 2)
    assert level_of(controller) == OK, controller.diagnostics[-1]
    publisher = second_node.create_publisher(Float64MultiArray, f"{controller.target}/commands", 1)
    sentence = f"{controller.target}/commands is published by {second_node.get_fully_qualified_name()} as well"
    controller.stream_until(lambda: controller.has_diagnostic(sentence), sentence)
    assert level_of(controller) == WARN
    second_node.destroy_publisher(publisher)
    controller.stream_until(lambda: level_of(controller) == OK, "the end of the warning")


def state_message(names, positions, velocities=None):
    message = JointState(name=list(names), position=positions)
    message.velocity = np.zeros(len(names)) if velocities is None else velocities
    message.header.stamp = to_time(time.time_ns())
    return message


def endpoints(controller, *nodes):
    """Words that name the publishers of joint_states of some nodes, from the graph as the probe has it."""
    infos = controller.node.get_publishers_info_by_topic(controller.node.resolve_topic_name("joint_states"))
    names = {node.get_name() for node in nodes}
    return [
        f"{info.node_namespace}/{info.node_name} (endpoint {'.'.join(f'{byte:02x}' for byte in info.endpoint_gid)})"
        for info in infos
        if info.node_name in names
    ]


def test_publishers_of_other_joints_and_of_equal_states_do_not_stop_the_efforts(controller, second_node):
    publisher = second_node.create_publisher(JointState, "joint_states", 10)
    controller.stream_until_steady()
    wait_for_reports(controller, 3, lambda: publisher.publish(state_message(["gripper"], np.zeros(1))))
    assert level_of(controller) == OK, controller.diagnostics[-1]
    sent = len(controller.commands)
    sentence = "and more than one of them has the controlled joints"

    def is_named():
        publisher.publish(state_message(PANDA[::-1], Q[::-1]))
        publisher.publish(state_message(PANDA, Q))
        return controller.has_diagnostic(sentence)

    controller.stream_until(is_named, sentence)
    assert level_of(controller) == WARN
    assert all(controller.has_diagnostic(endpoint) for endpoint in endpoints(controller, controller.node, second_node))
    efforts = np.array([efforts for _, efforts in controller.commands[sent:]])
    assert np.abs(efforts - GRAVITY).max() < 1e-6
    controller.stream_until(lambda: level_of(controller) == OK, "the end of the warning")


@pytest.mark.parametrize("difference", ["positions", "velocities"])
def test_states_that_contradict_each_other_lead_to_zero_efforts(difference, controller, second_node):
    publisher = second_node.create_publisher(JointState, "joint_states", 10)
    controller.stream_until_steady()
    other = {"positions": (Q + 0.2, np.zeros(7)), "velocities": (Q, np.full(7, 0.5))}[difference]

    def publish():
        publisher.publish(state_message(PANDA, *other))

    def is_zero():
        publish()
        sent = [efforts for _, efforts in controller.commands[-10:]]
        return len(sent) == 10 and not np.any(sent)

    sent = len(controller.commands)
    controller.stream_until(is_zero, "zeros")
    efforts = np.array([efforts for _, efforts in controller.commands[sent:]])
    # efforts for the other position were never sent: they only decay
    fractions = (efforts @ GRAVITY) / (GRAVITY @ GRAVITY)
    assert (np.diff(fractions) < 1e-9).all()
    assert np.abs(efforts - fractions[:, None] * GRAVITY).max() < 1e-6
    assert level_of(controller) == ERROR
    names = endpoints(controller, controller.node, second_node)
    assert len(names) == 2
    since = len(controller.diagnostics)

    def are_named():
        publish()
        return all(controller.has_diagnostic(name, since) for name in names)

    controller.stream_until(are_named, f"{names}")
    wait_for_reports(controller, 2, publish)
    assert "contradict each other" in controller.diagnostics[-1][1]
    sent = len(controller.commands)
    wait_for_reports(controller, 1, publish)
    assert not np.any([efforts for _, efforts in controller.commands[sent:]])
    controller.stream_until(lambda: level_of(controller) == OK, "the end of the fault")
    controller.stream_until_steady()
    assert np.abs(controller.commands[-1][1] - GRAVITY).max() < 1e-6
