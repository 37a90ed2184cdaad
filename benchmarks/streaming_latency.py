"""Latency of computed_torque beside a bare relay: states leave this process, efforts come back to it, by its own clock.

    python benchmarks/streaming_latency.py                              0.5, 1, 2 and 4 kHz, and 60 s at 2 kHz
    python benchmarks/streaming_latency.py --seconds 2 --rates 1000     one of them, for a look
    python benchmarks/streaming_latency.py --transports                 computed_torque by UDP beside shared memory

The relay is a node with the same executor, transport and quality of service that copies positions into commands and
does nothing else: what computed_torque takes beyond it is ours. Both are asked in turns of a second, so that whatever
else the machine does disturbs both; what is added is the median of the differences between neighbouring turns. No two
states of a turn are alike, so that each answer tells which state it answers, and a lost one is seen. computed_torque
follows a reference in its full mode, of the Panda.
"""

import argparse
import gc
import os
import subprocess
import sys
import time
from array import array
from contextlib import ExitStack, contextmanager

import numpy as np
import rclpy
from builtin_interfaces.msg import Duration, Time
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from tabulate import tabulate
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.control.control_law import ControlLaw
from robot_dynamics.nodes.processes import running_node, terminate_process
from robot_dynamics.nodes.qos import INPUT_STREAM_QOS, LATEST_ONLY_QOS
from robot_dynamics.nodes.runner import make_events_executor, run_node

DEEP = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)  # what is lost is not lost here
TURN = 1.0  # [s]
LEFT_OVER = 0.3  # [s] to wait for the last answers of a turn
KP, KD = 100.0, 20.0
HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.6])


class Relay(Node):
    """Answers each state with its positions."""

    def __init__(self):
        super().__init__("relay")
        self._message = Float64MultiArray(data=array("d", bytes(56)))
        self._publisher = self.create_publisher(Float64MultiArray, "~/commands", LATEST_ONLY_QOS)
        self._subscription = self.create_subscription(JointState, "joint_states", self._answer, INPUT_STREAM_QOS)

    def _answer(self, message):
        self._message.data = message.position
        self._publisher.publish(self._message)


class NodeUnderTest:
    """One of the two nodes: where its states go, and which answer is expected of each."""

    def __init__(self, node, target, names, answers):
        namespace = target.rpartition("/")[0]
        self.publisher = node.create_publisher(JointState, f"{namespace}/joint_states", LATEST_ONLY_QOS)
        self.message = JointState(name=names)
        self._numbers = {message_key(answer): number for number, answer in enumerate(answers)}
        self.answered = {}
        node.create_subscription(Float64MultiArray, f"{target}/commands", self._take, DEEP)

    def _take(self, message):
        now = time.perf_counter_ns()
        self.answered.setdefault(self._numbers.get(message_key(message.data)), now)


def message_key(numbers):
    return tuple(round(number, 6) for number in numbers[:3])


def measure_turn(asked, executor, rate, q, qd):
    """(latencies [µs], states that were not answered) of a turn."""
    asked.answered.clear()
    period, count = 1e9 / rate, int(TURN * rate)
    sent, began = np.zeros(count, dtype=np.int64), time.perf_counter_ns() + 1_000_000
    for k in range(count):
        while (left := began + k * period - time.perf_counter_ns()) > 0:
            executor.spin_once(timeout_sec=left * 1e-9)
        asked.message.position, asked.message.velocity = q[k], qd[k]
        now = time.time_ns()
        asked.message.header.stamp = Time(sec=now // 10**9, nanosec=now % 10**9)
        sent[k] = time.perf_counter_ns()
        asked.publisher.publish(asked.message)
    end = time.perf_counter() + LEFT_OVER
    while time.perf_counter() < end:
        executor.spin_once(timeout_sec=0.05)
    took = [(asked.answered[k] - sent[k]) / 1e3 for k in range(count) if k in asked.answered]
    return took, count - len(took)


def states(count, dynamics):
    """Positions, velocities, and the efforts that computed_torque sends for them while its reference is HOME."""
    rng = np.random.default_rng(0)
    q, qd = HOME + rng.uniform(-0.05, 0.05, (count, 7)), rng.uniform(-0.05, 0.05, (count, 7))
    law, reference, efforts = ControlLaw(dynamics, dynamics.joint_names), np.zeros((3, 7)), np.zeros((count, 7))
    reference[0] = HOME
    limits = np.array([joint.limits.effort for joint in dynamics.robot.joints])
    for k in range(count):
        law.q[:], law.qd[:] = q[k], qd[k]
        law.computed_torque(reference, KP, KD, efforts[k])
    return [array("d", row) for row in q], [array("d", row) for row in qd], np.clip(efforts, -limits, limits)


def hold_reference(node, executor, target, asked, q, qd):
    """Have computed_torque follow a reference that stands at HOME, and wait until it does."""
    publisher = node.create_publisher(JointTrajectory, f"{target}/reference", 1)
    message = JointTrajectory(joint_names=asked.message.name)
    for seconds in (0, 10**6):
        message.points.append(JointTrajectoryPoint(positions=HOME, time_from_start=Duration(sec=seconds)))
    patience, asked.message.position, asked.message.velocity = time.monotonic() + 60, q[0], qd[0]
    while 0 not in asked.answered:
        if time.monotonic() > patience:
            sys.exit(f"{target} does not answer as it should")
        publisher.publish(message)
        for _ in range(20):
            now = time.time_ns()
            asked.message.header.stamp = Time(sec=now // 10**9, nanosec=now % 10**9)
            asked.publisher.publish(asked.message)
            executor.spin_once(timeout_sec=0.01)


def measure(told):
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    dynamics = Dynamics(load_robot("panda"))
    q, qd, efforts = states(int(max(*told.rates, 2000) * TURN), dynamics)
    rclpy.init(args=[])
    node, executor = Node("asker"), make_events_executor()
    executor.add_node(node)
    settings = {"robot_file": "panda", "kp": [KP], "kd": [KD], "ramp_time": 0.0, "state_timeout": 1e6, "deadline": 1e3}
    names = list(dynamics.joint_names)
    with ExitStack() as stack:

        def start(name, namespace, environment=None):
            stack.enter_context(running_node("computed_torque", settings, namespace, environment))
            asked[name] = NodeUnderTest(node, f"{namespace}/computed_torque", names, efforts)
            hold_reference(node, executor, f"{namespace}/computed_torque", asked[name], q, qd)

        asked = {}
        if told.transports:
            start("shared memory", "/shared", {"FASTDDS_BUILTIN_TRANSPORTS": "DEFAULT"})
            start("UDP", "/model")
        else:
            stack.enter_context(relay())
            asked["relay"] = NodeUnderTest(node, "/bare/relay", names, q)
            start("computed_torque", "/model")
        gc.disable()  # pauses of the one that asks are none of the nodes'
        plans = [(rate, told.seconds) for rate in told.rates] + ([(2000.0, told.long)] if told.long else [])
        rows = [row for plan in plans for row in compare_nodes(asked, executor, *plan, q, qd)]
    print(tabulate(rows, ["rate [1/s]", "seconds", "node", "p50 [us]", "p99 [us]", "max [us]", "lost", "of"],
                   floatfmt=".0f", tablefmt="github"))  # fmt: skip
    executor.shutdown()
    rclpy.shutdown()


def compare_nodes(asked, executor, rate, seconds, q, qd):
    """Rows of the table for a rate."""
    turned, lost = {name: [] for name in asked}, dict.fromkeys(asked, 0)
    turns = max(1, round(seconds / TURN))
    for _ in range(turns):
        for name, one in asked.items():
            latencies, missing = measure_turn(one, executor, rate, q, qd)
            turned[name].append(latencies)
            lost[name] += missing
    took = {name: np.concatenate(latencies) for name, latencies in turned.items()}
    rows = [
        [rate, turns * TURN, name, *np.percentile(took[name], (50, 99, 100)), lost[name], int(rate * turns)]
        for name in asked
    ]
    added = [
        np.percentile(ours, (50, 99)) - np.percentile(bare, (50, 99))
        for bare, ours in zip(*turned.values(), strict=True)
        if bare and ours
    ]
    rows.append([rate, turns * TURN, "added", *np.median(added, axis=0)])
    return rows


@contextmanager
def relay():
    """The relay in a process of its own."""
    command = [sys.executable, __file__, "--relay", "--ros-args", "-r", "__ns:=/bare"]
    process = subprocess.Popen(command)
    try:
        yield
    finally:
        terminate_process(process)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rates", type=float, nargs="+", default=[500, 1000, 2000, 4000])
    parser.add_argument("--seconds", type=float, default=10.0, help="of each rate and node (default: 10)")
    parser.add_argument("--long", type=float, default=60.0, help="seconds at 2 kHz at the end; 0: none (default: 60)")
    parser.add_argument("--transports", action="store_true", help="compare UDP with shared memory, not with a relay")
    parser.add_argument("--relay", action="store_true", help=argparse.SUPPRESS)  # the other process
    told, others = parser.parse_known_args()
    if told.relay:
        return run_node(Relay, others, make_events_executor, udp_only=True)
    return measure(told)


if __name__ == "__main__":
    main()
