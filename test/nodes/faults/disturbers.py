"""Processes that disturb computed_torque by messages, participants and requests, from "go" to "rest" on standard input.

python disturbers.py states /robot

A disturber prints a line when it is ready, and after each "rest" one with what it has done since "go".
"""

import json
import sys
import threading
import time
from functools import partial

import numpy as np
import rclpy
from nodes.controller_probe import PANDA, Q, trajectory_message
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.qos import HistoryPolicy, QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics.nodes.qos import SERVICE_QOS
from robot_dynamics.nodes.runner import make_events_executor

RATE = 10_000  # [1/s] messages of a talker
CLIENTS = 50
STAMP = slice(4, 12)  # of a serialized message with a header
PARTICIPANTS = 4  # at a time in a discovery storm
KEEP_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)


def talk(publish, is_on):
    """Call publish RATE times a second while is_on; the number of calls."""
    count, began = 0, time.monotonic()
    previous = began
    while is_on():
        now = time.monotonic()
        for _ in range(round(min(now - previous, 0.01) * RATE)):
            publish()
            count += 1
        previous = now
        time.sleep(5e-4)
    return {"messages": count, "rate [1/s]": round(count / (time.monotonic() - began))}


def states(node, namespace, position=Q[0]):
    """Publishes states of the same joints."""
    publisher = node.create_publisher(JointState, f"{namespace}/joint_states", 1)
    message = JointState(name=PANDA, position=[position, *Q[1:]], velocity=np.zeros(7))

    serialized = bytearray(serialize_message(message))

    def publish():
        serialized[STAMP] = np.array(divmod(time.time_ns(), 10**9), dtype="u4").tobytes()
        publisher.publish(bytes(serialized))

    return partial(talk, publish)


def points(node, namespace):
    """Publishes points of a reference."""
    publisher = node.create_publisher(JointTrajectory, f"{namespace}/computed_torque/reference_point", 1)
    message = serialize_message(trajectory_message(PANDA, [0.0], [Q], [np.zeros(7)], [np.zeros(7)]))
    return partial(talk, lambda: publisher.publish(message))


def storm(node, namespace):
    """Makes participants with endpoints on all topics, and destroys them."""

    def participant():
        context = Context()
        rclpy.init(context=context)
        passing = rclpy.create_node("passing", namespace=namespace, context=context, enable_rosout=False)
        passing.create_subscription(Float64MultiArray, "computed_torque/commands", print, 1)
        passing.create_subscription(JointState, "computed_torque/effort", print, KEEP_ALL)
        passing.create_publisher(JointState, "joint_states", 1)
        passing.create_publisher(JointTrajectory, "computed_torque/reference", 1)
        return passing

    def end(passing):
        passing.destroy_node()
        passing.context.try_shutdown()

    def run(is_on):
        count, present = 0, []
        while is_on():
            present.append(participant())
            count += 1
            if len(present) > PARTICIPANTS:
                end(present.pop(0))
        for passing in present:
            end(passing)
        return {"participants": count}

    return run


def unread(node, namespace):
    """Subscribes reliably, with an unlimited queue, and never takes a message."""

    def run(is_on):
        subscriptions = [
            node.create_subscription(kind, f"{namespace}/computed_torque/{topic}", print, KEEP_ALL)
            for kind, topic in ((Float64MultiArray, "commands"), (JointState, "effort"), (JointTrajectory, "state"))
        ]
        while is_on():
            time.sleep(0.01)
        for subscription in subscriptions:
            node.destroy_subscription(subscription)
        return {"subscriptions": len(subscriptions)}

    return run


class Caller:
    """A client with a node of its own, which requests parameters of computed_torque, again after each response."""

    def __init__(self, executor, number, namespace):
        node = rclpy.create_node(f"caller_{number}", start_parameter_services=False, enable_rosout=False)
        executor.add_node(node)
        service = f"{namespace}/computed_torque/get_parameters"
        self._client = node.create_client(GetParameters, service, qos_profile=SERVICE_QOS)
        self.is_connected = self._client.service_is_ready
        self._is_on = None
        self.waits = []  # [s]
        self.is_waiting = False

    def begin(self, is_on):
        """Send a request, and others after it while is_on."""
        self._is_on, self.waits = is_on, []
        self._call()

    def _call(self):
        sent = time.monotonic()
        self.is_waiting = True

        def receive(_):
            self.waits.append(time.monotonic() - sent)
            self.is_waiting = False
            if self._is_on():
                self._call()

        self._client.call_async(GetParameters.Request(names=["mode", "kp"])).add_done_callback(receive)


def clients(node, namespace):
    """CLIENTS clients of a service of the node."""
    executor = make_events_executor()
    callers = [Caller(executor, number, namespace) for number in range(CLIENTS)]
    while not all(caller.is_connected() for caller in callers):
        time.sleep(0.05)

    def run(is_on):
        for caller in callers:
            caller.begin(is_on)
        end = None
        while end is None or (any(caller.is_waiting for caller in callers) and time.monotonic() < end):
            executor.spin_once(timeout_sec=0.01)
            if end is None and not is_on():
                end = time.monotonic() + 5.0
        return {
            "responses": sum(len(caller.waits) for caller in callers),
            "fewest": min(len(caller.waits) for caller in callers),
            "longest wait": max(max(caller.waits, default=np.inf) for caller in callers),
            "without response": sum(caller.is_waiting for caller in callers),
        }

    return run


DISTURBERS = {
    "states": states,
    "invalid_states": partial(states, position=np.nan),
    "points": points,
    "storm": storm,
    "unread": unread,
    "clients": clients,
}


def main():
    kind, namespace = sys.argv[1:]
    rclpy.init(args=[])
    node = rclpy.create_node("disturber")
    run = DISTURBERS[kind](node, namespace)
    print("ready", flush=True)
    for line in sys.stdin:
        if line.strip() != "go":
            continue
        resting = threading.Event()
        watch = threading.Thread(target=lambda event=resting: (sys.stdin.readline(), event.set()))
        watch.start()
        done = run(lambda event=resting: not event.is_set())
        watch.join()
        print(json.dumps(done), flush=True)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
