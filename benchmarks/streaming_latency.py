"""Latency of computed_torque beside a bare relay, from the states that this process sends to the efforts it receives.

    python benchmarks/streaming_latency.py                              0.5, 1, 2 and 4 kHz, and 60 s at 2 kHz
    python benchmarks/streaming_latency.py --seconds 2 --rates 1000     a short run at one rate
    python benchmarks/streaming_latency.py --transports                 computed_torque by UDP beside shared memory
    python benchmarks/streaming_latency.py --closed-loop 60             a simulated Gough-Stewart platform at 1 kHz

The relay is a node with the same executor, transport and quality of service that only copies positions into commands:
the latency that computed_torque adds to it is that of robot_dynamics. Both are measured in alternating turns of a
second, so that other work on the machine disturbs both; the added latency is the median of the differences between
neighbouring turns. All states of a turn differ, so that each response identifies its state, and lost responses are
counted. computed_torque follows a reference of the Panda in its full mode.

In the closed loop mobile_base_simulator sends the states, and computed_torque moves the platform. The relay takes the
same states, and sends the same messages. Latency is from the stamp of a state to the time at which the middleware takes
the efforts for it. An answer is late if the next state is due before it. The first seconds, in which models are loaded
or compiled, are counted as well.
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
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.message_info import MessageInfoCallback
from robot_dynamics.nodes.middleware import without_shared_memory
from robot_dynamics.nodes.processes import running_node, terminate_process
from robot_dynamics.nodes.qos import INPUT_STREAM_QOS, LATEST_ONLY_QOS
from robot_dynamics.nodes.runner import make_events_executor, run_node

DEEP = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)  # loses no response in this process
TURN = 1.0  # [s]
FINAL_WAIT = 0.3  # [s] for the last responses of a turn
KP = 100.0
KD = 20.0
PLATFORM = "gough_stewart"
PERIOD = 1e6  # [ns] of its states
START = 5.0  # [s]
NEIGHBOURS = 10  # states before and after a late one
AMPLITUDE = 0.05  # [m]
REFERENCE_STEP = 0.05  # [s]
HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.6])


class Relay(Node):
    """Publishes the positions of each state."""

    def __init__(self):
        super().__init__("relay")
        self._message = Float64MultiArray(data=array("d", bytes(56)))
        self._publisher = self.create_publisher(Float64MultiArray, "~/commands", LATEST_ONLY_QOS)
        self._subscription = self.create_subscription(JointState, "joint_states", self._republish, INPUT_STREAM_QOS)

    def _republish(self, message):
        self._message.data = message.position
        self._publisher.publish(self._message)


class EffortRelay(Node):
    """Publishes the messages of computed_torque for each state: commands, and named efforts with its stamp."""

    def __init__(self):
        super().__init__("relay")
        size = len(Dynamics(load_robot(PLATFORM), compiled=False).joint_names)
        self._commands_message = Float64MultiArray(data=array("d", bytes(8 * size)))
        self._efforts_message = JointState(effort=array("d", bytes(8 * size)))
        self._commands = self.create_publisher(Float64MultiArray, "~/commands", LATEST_ONLY_QOS)
        self._efforts = self.create_publisher(JointState, "~/effort", LATEST_ONLY_QOS)
        self._subscription = self.create_subscription(JointState, "joint_states", self._respond, INPUT_STREAM_QOS)

    def _respond(self, message):
        self._commands.publish(self._commands_message)
        self._efforts_message.name = message.name[: len(self._efforts_message.effort)]
        self._efforts_message.header.stamp = message.header.stamp
        self._efforts.publish(self._efforts_message)


class NodeUnderTest:
    """A node that is measured: publisher of its states, and times of its responses."""

    def __init__(self, node, target, names, responses):
        namespace = target.rpartition("/")[0]
        self.publisher = node.create_publisher(JointState, f"{namespace}/joint_states", LATEST_ONLY_QOS)
        self.message = JointState(name=names)
        self._numbers = {message_key(response): number for number, response in enumerate(responses)}
        self.response_times = {}
        node.create_subscription(Float64MultiArray, f"{target}/commands", self._record_response, DEEP)

    def _record_response(self, message):
        now = time.perf_counter_ns()
        self.response_times.setdefault(self._numbers.get(message_key(message.data)), now)


def message_key(numbers):
    return tuple(round(number, 6) for number in numbers[:3])


def measure_turn(node_under_test, executor, rate, q, qd):
    """Latencies [µs] and number of lost responses of a turn."""
    node_under_test.response_times.clear()
    period, count = 1e9 / rate, int(TURN * rate)
    sent = np.zeros(count, dtype=np.int64)
    start = time.perf_counter_ns() + 1_000_000
    for k in range(count):
        while (remaining := start + k * period - time.perf_counter_ns()) > 0:
            executor.spin_once(timeout_sec=remaining * 1e-9)
        node_under_test.message.position, node_under_test.message.velocity = q[k], qd[k]
        now = time.time_ns()
        node_under_test.message.header.stamp = Time(sec=now // 10**9, nanosec=now % 10**9)
        sent[k] = time.perf_counter_ns()
        node_under_test.publisher.publish(node_under_test.message)
    end = time.perf_counter() + FINAL_WAIT
    while time.perf_counter() < end:
        executor.spin_once(timeout_sec=0.05)
    latencies = [
        (node_under_test.response_times[k] - sent[k]) / 1e3 for k in range(count) if k in node_under_test.response_times
    ]
    return latencies, count - len(latencies)


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


def hold_reference(node, executor, target, node_under_test, q, qd):
    """Send a constant reference at HOME to computed_torque, and wait until it follows."""
    publisher = node.create_publisher(JointTrajectory, f"{target}/reference", 1)
    message = JointTrajectory(joint_names=node_under_test.message.name)
    for seconds in (0, 10**6):
        message.points.append(JointTrajectoryPoint(positions=HOME, time_from_start=Duration(sec=seconds)))
    deadline = time.monotonic() + 60
    node_under_test.message.position = q[0]
    node_under_test.message.velocity = qd[0]
    while 0 not in node_under_test.response_times:
        if time.monotonic() > deadline:
            sys.exit(f"{target} does not send the expected efforts")
        publisher.publish(message)
        for _ in range(20):
            now = time.time_ns()
            node_under_test.message.header.stamp = Time(sec=now // 10**9, nanosec=now % 10**9)
            node_under_test.publisher.publish(node_under_test.message)
            executor.spin_once(timeout_sec=0.01)


def measure(options):
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    dynamics = Dynamics(load_robot("panda"))
    q, qd, efforts = states(int(max(*options.rates, 2000) * TURN), dynamics)
    rclpy.init(args=[])
    node, executor = Node("latency_benchmark"), make_events_executor()
    executor.add_node(node)
    settings = {"robot_file": "panda", "kp": [KP], "kd": [KD], "ramp_time": 0.0, "state_timeout": 1e6, "deadline": 1e3}
    names = list(dynamics.joint_names)
    with ExitStack() as stack:

        def start(name, namespace, environment=None):
            stack.enter_context(running_node("computed_torque", settings, namespace, environment))
            nodes[name] = NodeUnderTest(node, f"{namespace}/computed_torque", names, efforts)
            hold_reference(node, executor, f"{namespace}/computed_torque", nodes[name], q, qd)

        nodes = {}
        if options.transports:
            start("shared memory", "/shared", {"FASTDDS_BUILTIN_TRANSPORTS": "DEFAULT"})
            start("UDP", "/model")
        else:
            stack.enter_context(relay())
            nodes["relay"] = NodeUnderTest(node, "/bare/relay", names, q)
            start("computed_torque", "/model")
        gc.disable()  # pauses of this process do not belong to the nodes
        plans = [(rate, options.seconds) for rate in options.rates] + ([(2000.0, options.long)] if options.long else [])
        rows = [row for plan in plans for row in compare_nodes(nodes, executor, *plan, q, qd)]
    print(
        tabulate(
            rows,
            ["rate [1/s]", "seconds", "node", "p50 [us]", "p99 [us]", "max [us]", "lost", "of"],
            floatfmt=".0f",
            tablefmt="github",
        )
    )
    executor.shutdown()
    rclpy.shutdown()


def compare_nodes(nodes, executor, rate, seconds, q, qd):
    """Rows of the table for a rate."""
    latencies_by_turn = {name: [] for name in nodes}
    lost = dict.fromkeys(nodes, 0)
    turns = max(1, round(seconds / TURN))
    for _ in range(turns):
        for name, node_under_test in nodes.items():
            latencies, missing = measure_turn(node_under_test, executor, rate, q, qd)
            latencies_by_turn[name].append(latencies)
            lost[name] += missing
    latencies_of = {name: np.concatenate(turns_of) for name, turns_of in latencies_by_turn.items()}
    rows = [
        [rate, turns * TURN, name, *np.percentile(latencies_of[name], (50, 99, 100)), lost[name], int(rate * turns)]
        for name in nodes
    ]
    added = [
        np.percentile(ours, (50, 99)) - np.percentile(bare, (50, 99))
        for bare, ours in zip(*latencies_by_turn.values(), strict=True)
        if bare and ours
    ]
    rows.append([rate, turns * TURN, "added", *np.median(added, axis=0)])
    return rows


def measure_closed_loop(seconds):
    """Print latencies of computed_torque and of the relay for the same states of a simulated platform."""
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init(args=[])
    node, executor = Node("closed_loop_benchmark"), make_events_executor()
    executor.add_node(node)
    sent, answers = [], {"relay": {}, "computed_torque": {}}  # stamps; {stamp: latency}, all [ns]

    def record(name):
        def callback(message, info):
            stamp = to_nanoseconds(message.header.stamp)
            answers[name].setdefault(stamp, info["source_timestamp"] - stamp)

        return MessageInfoCallback(callback)

    node.create_subscription(
        JointState, "/loop/joint_states", lambda m: sent.append(to_nanoseconds(m.header.stamp)), DEEP
    )
    for name in answers:
        node.create_subscription(JointState, f"/loop/{name}/effort", record(name), DEEP)
    simulation = {"robot_file": PLATFORM, "publish_clock": False, "wait_for_commands": "first"}
    settings = {"robot_file": PLATFORM, "kp": [KP], "kd": [KD]}
    efforts = {"~/effort": "computed_torque/effort"}
    with (
        relay("--effort-relay", "/loop"),
        running_node("computed_torque", settings, "/loop"),
        running_node("mobile_base_simulator", simulation, "/loop", remappings=efforts),
    ):
        publisher = node.create_publisher(JointTrajectory, "/loop/computed_torque/reference", 1)
        deadline = time.monotonic() + 60
        while not all(answers.values()):
            if time.monotonic() > deadline:
                sys.exit("no efforts came")
            executor.spin_once(timeout_sec=0.1)
        gc.freeze()
        gc.disable()
        publisher.publish(platform_reference(seconds + 10.0))
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.1)
    first = max(min(answered) for answered in answers.values())
    stamps = np.array([stamp for stamp in sent if stamp >= first][:-10])
    latencies = np.array([[answered.get(stamp, np.inf) for answered in answers.values()] for stamp in stamps])
    is_start = stamps < first + START * 1e9
    rows = [
        [label, name, *describe_latencies(latencies[chosen, column])]
        for label, chosen in ((f"first {START:g} s", is_start), ("then", ~is_start))
        for column, name in enumerate(answers)
    ]
    header = ["", "node", "states", "p50 [us]", "p99 [us]", "p99.9 [us]", "max [us]", "late", "over 5 ms", "lost"]
    print(tabulate(rows, header, floatfmt=".0f", tablefmt="github"))
    bare, ours = latencies.T > PERIOD
    near = np.convolve(bare, np.ones(2 * NEIGHBOURS + 1), "same") > 0.5
    print(f"states later than two periods themselves: {(np.diff(stamps) > 2 * PERIOD).sum()}")
    print(f"late answers of computed_torque, and none of the relay within {NEIGHBOURS} ms: {(ours & ~near).sum()}")
    near = np.convolve(ours, np.ones(2 * NEIGHBOURS + 1), "same") > 0.5
    print(f"late answers of the relay, and none of computed_torque within {NEIGHBOURS} ms: {(bare & ~near).sum()}")
    executor.shutdown()
    rclpy.shutdown()


def describe_latencies(latencies):
    """Entries of a row of the table, of latencies [ns]."""
    percentiles = np.percentile(latencies, (50, 99, 99.9, 100), method="higher") / 1e3
    lost = np.isinf(latencies).sum()
    return len(latencies), *percentiles, (latencies > PERIOD).sum(), (latencies > 5 * PERIOD).sum(), lost


def platform_reference(seconds):
    """A trajectory of the legs of the platform: each moves by 5 cm, with a frequency of its own."""
    dynamics = Dynamics(load_robot(PLATFORM), compiled=False)
    numbers = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    home = dynamics.initial_joint_positions[numbers]
    message = JointTrajectory(joint_names=list(dynamics.joint_names))
    rates = 2 * np.pi * np.linspace(0.2, 0.3, len(home))
    count = int(seconds / REFERENCE_STEP)
    for k in range(count + 1):
        angles = rates * k * REFERENCE_STEP
        q = home + AMPLITUDE * (1 - np.cos(angles)) / 2
        qd = AMPLITUDE * rates * np.sin(angles) / 2 * (k < count)  # a trajectory ends at rest
        ns = round(k * REFERENCE_STEP * 1e9)
        duration = Duration(sec=ns // 10**9, nanosec=ns % 10**9)
        message.points.append(JointTrajectoryPoint(positions=q, velocities=qd, time_from_start=duration))
    return message


@contextmanager
def relay(option="--relay", namespace="/bare"):
    """Run the relay in a process of its own."""
    command = [sys.executable, __file__, option, "--ros-args", "-r", f"__ns:={namespace}"]
    process = subprocess.Popen(command)
    try:
        yield
    finally:
        terminate_process(process)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rates", type=float, nargs="+", default=[500, 1000, 2000, 4000])
    parser.add_argument("--seconds", type=float, default=10.0, help="duration at each rate and node (default: 10)")
    parser.add_argument("--long", type=float, default=60.0, help="seconds at 2 kHz at the end; 0: none (default: 60)")
    parser.add_argument("--transports", action="store_true", help="compare UDP with shared memory, not with a relay")
    parser.add_argument("--relay", action="store_true", help=argparse.SUPPRESS)  # the process of the relay
    parser.add_argument("--effort-relay", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument(
        "--closed-loop", type=float, metavar="SECONDS", help="a simulated platform instead of the Panda"
    )
    options, ros_arguments = parser.parse_known_args()
    if options.effort_relay:
        return run_node(EffortRelay, ros_arguments, make_events_executor, without_shared_memory)
    if options.closed_loop:
        return measure_closed_loop(options.closed_loop)
    if options.relay:
        return run_node(Relay, ros_arguments, make_events_executor, without_shared_memory)
    return measure(options)


if __name__ == "__main__":
    main()
