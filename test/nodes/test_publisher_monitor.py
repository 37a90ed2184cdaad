"""Second publishers on the topics of computed_torque: those that disturb are named in its diagnostics."""

import time

import numpy as np
import pytest
import rclpy
from nodes.controller_probe import PANDA, ControllerProbe, Q, to_time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from robot_dynamics.nodes.computed_torque.publisher_monitor import SequenceSteps
from robot_dynamics.nodes.diagnostics import OK, WARN

PARAMETERS = {"robot_file": "panda", "mode": "gravity_compensation", "deadline": 1.0, "state_timeout": 0.5}


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


def test_second_publisher_of_controlled_joints_is_named_and_one_of_other_joints_is_not(controller, second_node):
    publisher = second_node.create_publisher(JointState, "joint_states", 10)

    def publish(names, positions):
        message = JointState(name=names, position=positions, velocity=np.zeros(len(names)))
        message.header.stamp = to_time(time.time_ns())
        publisher.publish(message)

    controller.stream_until_steady()
    wait_for_reports(controller, 3, lambda: publish(["gripper"], np.zeros(1)))
    assert level_of(controller) == OK, controller.diagnostics[-1]
    names = " and ".join(sorted([controller.node.get_fully_qualified_name(), second_node.get_fully_qualified_name()]))
    sentence = f"/joint_states is published by {names}, and more than one of them has the controlled joints"

    def is_named():
        publish(PANDA, Q + 0.2)
        return controller.has_diagnostic(sentence)

    controller.stream_until(is_named, sentence)
    assert level_of(controller) == WARN
    controller.stream_until(lambda: level_of(controller) == OK, "the end of the warning")
