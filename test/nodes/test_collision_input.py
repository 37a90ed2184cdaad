"""computed_torque reacts to a message on collision, and refuses references until the collision is over."""

import numpy as np
import pytest
from lifecycle_msgs.msg import Transition
from nodes.controller_probe import PANDA, ControllerProbe, Q, trajectory_message
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool

from robot_dynamics import Dynamics, load_robot

QUIET = {"robot_file": "panda", "deadline": 1.0, "state_timeout": 0.2, "without_reference": "damp"}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
REST = np.zeros((1, 7))


@pytest.fixture
def start_controller(start_server, client):
    probes = []

    def start(parameters):
        probes.append(ControllerProbe(start_server({**QUIET, **parameters}, executable="computed_torque"), client))
        return probes[-1]

    yield start
    for probe in probes:
        probe.close()


def collision_publisher(probe):
    return probe.node.create_publisher(Bool, f"{probe.target.rpartition('/')[0]}/collision", LATCHED)


def test_robot_yields_until_the_collision_is_over(start_controller):
    controller = start_controller({"collision_reaction": "gravity_compensation"})
    controller.stream_until_steady()
    controller.reference.publish(trajectory_message(PANDA, [0.0], [Q + 0.1], REST, REST))
    weight = Dynamics(load_robot("panda"), compiled=False).gravity(Q)
    is_away = lambda: np.abs(controller.commands[-1][1] - weight).max() > 1.0  # noqa: E731
    controller.stream_until(is_away, "the reference")
    publisher = collision_publisher(controller)
    publisher.publish(Bool(data=True))
    holds = lambda: np.abs(controller.commands[-1][1] - weight).max() < 1e-9  # noqa: E731
    controller.stream_until(holds, "gravity compensation")
    controller.stream_until(lambda: controller.has_diagnostic("collision: gravity_compensation"), "diagnostics")
    controller.reference.publish(trajectory_message(PANDA, [0.0], [Q + 0.1], REST, REST))
    controller.stream_until(lambda: controller.has_diagnostic("a collision was reported"), "refusal")
    assert holds()
    publisher.publish(Bool(data=False))
    since = len(controller.diagnostics)
    controller.stream_until(lambda: not controller.has_diagnostic("collision: ", since), "end")
    controller.stream_until(lambda: len(controller.diagnostics) > since, "diagnostics after the end")
    controller.reference.publish(trajectory_message(PANDA, [0.0], [Q + 0.1], REST, REST))
    controller.stream_until(is_away, "the reference again")


def test_collision_before_the_activation_counts_and_none_ignores_it(start_controller, client):
    controller = start_controller({"autostart": False, "collision_reaction": "hold"})
    publisher = collision_publisher(controller)
    publisher.publish(Bool(data=True))
    controller.wait_until(publisher.get_subscription_count, "subscription")
    controller.change_state(Transition.TRANSITION_CONFIGURE)
    controller.change_state(Transition.TRANSITION_ACTIVATE)
    controller.stream_until(lambda: controller.has_diagnostic("collision: hold"), "reaction")
    assert client.set_parameters(controller.target, {"collision_reaction": "none"}).successful
    since = len(controller.diagnostics)
    controller.stream_until(
        lambda: any("collision: " not in message for _, message, _ in controller.diagnostics[since:]), "no reaction"
    )
