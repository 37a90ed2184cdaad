"""Real nodes over DDS: dynamics_server with mutated requests, computed_torque with mutated states at 1 kHz.

The nodes run with their default parameters. What is checked comes from outside: messages, their source timestamps, and
the figures of the process.
"""

from __future__ import annotations

import json
import os
import random
import threading
import time
from array import array
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from hashlib import sha256
from pathlib import Path

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from fuzzing.campaign import MEMORY, Summary, cpu_limit
from fuzzing.message_mutations import fill_message, message_content, mutate_tree
from fuzzing.mutations import mutate_bytes
from fuzzing.process_usage import cpu_time, resident_memory
from fuzzing.requests import PandaPeer, RequestTarget, require_finite
from rcl_interfaces.srv import ListParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.nodes.dynamics_server.node import SERVICES
from robot_dynamics.nodes.message_info import MessageInfoCallback
from robot_dynamics.nodes.processes import running_node

PANDA = [f"panda_joint{k}" for k in range(1, 8)]
Q = np.array([0.1, -0.3, 0.2, -1.9, 0.1, 1.8, 0.5])
LIMITS = np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])  # [N m] of the description of the Panda
STATE_TIMEOUT = 0.02  # [s] the default of computed_torque
SLACK = 0.01  # [s] between the last check of the node and the middleware, on a machine that does other things
RATE = 1000.0  # [1/s] of states
BURSTS = (20, 200, 2000)  # states, half of which are mutated, before sound ones again
PATIENCE = 120.0  # [s] on a machine that does other things
SETTLED = 20  # commands that are compared
RAW_PART = 0.2  # of mutated states: their serialized bytes are changed
DEEP = QoSProfile(depth=10_000, reliability=ReliabilityPolicy.RELIABLE)
ROBOTS = ("panda", "four_bar", "free_flying_arm")


class NodeCampaign:
    """The figures and finds of a campaign against nodes."""

    def __init__(self, name: str, folder: Path) -> None:
        self.summary = Summary(name)
        self._finds = folder / "finds"
        self._finds.mkdir(parents=True, exist_ok=True)
        self._began = time.monotonic()
        self._signatures: set[str] = set()

    def start(self) -> None:
        """Count the time from here on."""
        self._began = time.monotonic()

    def find(self, what: str, data: bytes) -> None:
        """Keep an input that something is wrong with."""
        signature = "".join(character for character in what if not character.isdigit())[:100]
        if signature in self._signatures:
            return
        self._signatures.add(signature)
        name = sha256(data).hexdigest()[:16]
        (self._finds / name).write_bytes(data)
        (self._finds / f"{name}.txt").write_text(what)
        self.summary.finds.append(f"{name}: {what[:300]}")

    def is_over(self, inputs: int | None, seconds: float | None) -> bool:
        """Whether the number of inputs or the time is reached."""
        self.summary.seconds = time.monotonic() - self._began
        done = inputs is not None and self.summary.inputs >= inputs
        return done or (seconds is not None and self.summary.seconds >= seconds) or len(self.summary.finds) > 20

    def watch(self, number: int, data: bytes) -> None:
        """Note the memory of a node by the number of its process."""
        memory = resident_memory(number)
        self.summary.largest_memory = max(self.summary.largest_memory, memory)
        if memory > MEMORY:
            self.find(f"the node has {memory / 1e6:.0f} MB", data)


@contextmanager
def started_ros() -> Iterator[None]:
    """A DDS domain of this process."""
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    rclpy.init()
    try:
        yield
    finally:
        rclpy.try_shutdown()


def run_node_requests(
    seeds: list[bytes], folder: Path, inputs: int | None, seconds: float | None, seed: int
) -> Summary:
    """Send mutated requests to real servers."""
    campaign = NodeCampaign("node_requests", folder)
    summary = campaign.summary
    rng = random.Random(seed)
    kinds = {name: kind for kind, name, _ in SERVICES}
    target, peer = RequestTarget(), PandaPeer()
    seeds = [data for data in seeds if json.loads(data)["robot"] in ROBOTS]
    namespace = f"/fuzz_{os.getpid()}"
    with ExitStack() as stack:
        stack.enter_context(started_ros())
        log = stack.enter_context(open(folder / "node.log", "w"))
        processes = {
            robot: stack.enter_context(
                running_node("dynamics_server", {"robot_file": robot}, f"{namespace}/{robot}", log=log)
            )
            for robot in ROBOTS
        }
        client = ServiceClient("fuzz")
        try:
            for robot in ROBOTS:
                parameters = f"{namespace}/{robot}/dynamics_server/list_parameters"
                client.call(ListParameters, parameters, ListParameters.Request(), PATIENCE)
            campaign.start()
            while not campaign.is_over(inputs, seconds):
                data = rng.choice(seeds) if rng.random() < 0.1 else target.mutate(rng.choice(seeds), rng, seeds)
                content = json.loads(data)
                kind = kinds[content["service"]]
                try:
                    request = fill_message(kind.Request(), content["request"])
                except ValueError:
                    continue
                process = processes[content["robot"]]
                began = cpu_time(process.pid)
                service = f"{namespace}/{content['robot']}/dynamics_server/{content['service']}"
                summary.inputs += 1
                try:
                    response = client.call(kind, service, request, PATIENCE)
                    if response.success:
                        require_finite(response)
                        count = (
                            peer.compare(content["service"], request, response) if content["robot"] == "panda" else 0
                        )
                        summary.comparisons += count
                        summary.kinds["compared" if count else "accepted"] += 1
                    else:
                        summary.kinds["refused"] += 1
                        if "internal error" in response.message or not response.message:
                            campaign.find(f"the reason is {response.message!r}", data)
                except SystemError:  # rclpy cannot send it
                    summary.kinds["not sent"] += 1
                except (TimeoutError, AssertionError) as error:
                    campaign.find(f"{type(error).__name__}: {error}", data)
                if process.poll() is not None:
                    campaign.find("the node has died", data)
                    break
                elapsed = cpu_time(process.pid) - began  # with that of its other threads
                summary.largest_cpu = max(summary.largest_cpu, elapsed)
                summary.largest_cpu_per_kilobyte = max(
                    summary.largest_cpu_per_kilobyte, elapsed / max(1.0, len(data) / 1024)
                )
                if elapsed > cpu_limit(len(data)) + 1.0:  # compiles models beside
                    campaign.find(f"{elapsed:.1f} s of CPU time", data)
                campaign.watch(process.pid, data)
        finally:
            client.close()
    return summary


class EffortWatcher:
    """The efforts of computed_torque, and what is wrong with them. stamps: {stamp of a state [ns]: input}."""

    def __init__(self, node, target: str) -> None:
        self.commands: deque[np.ndarray] = deque(maxlen=1000)
        self.count = 0
        self.answered = 0
        self.oldest = 0.0  # [s] age of a state when its efforts left
        self.problems: list[str] = []
        self.sent: dict[int, bool] = {}
        node.create_subscription(Float64MultiArray, f"{target}/commands", self._on_commands, DEEP)
        node.create_subscription(JointState, f"{target}/effort", MessageInfoCallback(self._on_effort), DEEP)

    def _on_commands(self, message) -> None:
        efforts = np.array(message.data)
        self._require_sound(efforts)
        self.commands.append(efforts)
        self.count += 1

    def _on_effort(self, message, info) -> None:
        self._require_sound(np.array(message.effort))
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        if stamp not in self.sent:
            return  # efforts of the watchdog have the present time
        age = (info["source_timestamp"] - stamp) * 1e-9
        self.answered += 1
        self.oldest = max(self.oldest, age)
        if not -STATE_TIMEOUT - SLACK <= age <= STATE_TIMEOUT + SLACK:
            self.problems.append(f"efforts answer a state of {age * 1e3:.1f} ms")

    def _require_sound(self, efforts) -> None:
        if len(efforts) != len(PANDA) or not np.isfinite(efforts).all() or (np.abs(efforts) > LIMITS + 1e-9).any():
            self.problems.append(f"efforts {efforts}")


def clean_state() -> JointState:
    """A state at rest with the present time."""
    now = time.time_ns()
    message = JointState(name=PANDA, position=array("d", Q), velocity=array("d", bytes(56)))
    message.header.stamp = Time(sec=now // 10**9, nanosec=now % 10**9)
    return message


def mutated_state(rng: random.Random, corpus: list[bytes]) -> JointState | bytes:
    """A state with changed fields, or the serialized bytes of one, changed."""
    message = clean_state()
    if rng.random() < RAW_PART:
        return mutate_bytes(serialize_message(message), rng, [serialize_message(message)])
    content = json.loads(rng.choice(corpus)) if corpus and rng.random() < 0.3 else message_content(message)
    stamp = content["header"]["stamp"] = message_content(message.header.stamp)
    if rng.random() < 0.2:
        shift = rng.choice([-1, 1]) * rng.choice([1e3, 1e6, 5e6, 15e6, 25e6, 1e9, 1e12])
        now = stamp["sec"] * 10**9 + stamp["nanosec"] + int(shift)
        content["header"]["stamp"] = {"sec": now // 10**9, "nanosec": now % 10**9}
        return fill_message(JointState(), content)
    while True:
        try:
            return fill_message(JointState(), mutate_tree(content, rng))
        except ValueError:  # no message of this type
            continue


def run_node_states(seeds: list[bytes], folder: Path, inputs: int | None, seconds: float | None, seed: int) -> Summary:
    """Publish states at 1 kHz, half of them mutated, to computed_torque with its defaults."""
    campaign = NodeCampaign("node_states", folder)
    summary = campaign.summary
    rng = random.Random(seed)
    peer = PandaPeer()
    expected = _gravity(peer)
    namespace = f"/fuzz_{os.getpid()}"
    target = f"{namespace}/computed_torque"
    log = open(folder / "node.log", "w")
    with started_ros(), log, running_node("computed_torque", {"robot_file": "panda"}, namespace, log=log) as child:
        node = rclpy.create_node("robot", namespace=namespace)
        publisher = node.create_publisher(JointState, "joint_states", 10)
        watcher = EffortWatcher(node, target)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        stopped = threading.Event()

        def spin() -> None:
            while not stopped.is_set():
                executor.spin_once(timeout_sec=0.05)

        thread = threading.Thread(target=spin)
        thread.start()
        recent: list[bytes] = []
        try:
            _settle(publisher, watcher, expected, child)
            campaign.start()
            while not campaign.is_over(inputs, seconds):
                if not _settle(publisher, watcher, expected, child):
                    state = "has died" if child.poll() is not None else f"sends {list(watcher.commands)[-1:]}"
                    campaign.find(
                        f"no right efforts within {PATIENCE} s of sound states: the node {state}", b"".join(recent)
                    )
                    break
                summary.comparisons += SETTLED
                began = cpu_time(child.pid)
                recent.clear()
                next_time = time.monotonic()
                size = rng.choice(BURSTS)
                for _ in range(size):
                    is_mutated = rng.random() < 0.5
                    message = mutated_state(rng, seeds) if is_mutated else clean_state()
                    if isinstance(message, JointState):
                        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
                        watcher.sent[stamp] = True
                    try:
                        publisher.publish(message)
                    except SystemError:  # rclpy cannot send it
                        continue
                    recent.append(message if isinstance(message, bytes) else serialize_message(message))
                    summary.inputs += 1
                    summary.kinds["mutated"] += is_mutated
                    next_time += 1 / RATE
                    time.sleep(max(0.0, next_time - time.monotonic()))
                elapsed = (cpu_time(child.pid) - began) / size
                summary.largest_cpu = max(summary.largest_cpu, elapsed)
                summary.largest_cpu_per_kilobyte = max(summary.largest_cpu_per_kilobyte, elapsed)
                campaign.watch(child.pid, b"".join(recent))
                for problem in watcher.problems:
                    campaign.find(problem, b"".join(recent))
                watcher.problems.clear()
            summary.kinds.update({"answered": watcher.answered, "efforts": watcher.count})
            summary.kinds["oldest state [us]"] = round(watcher.oldest * 1e6)
        finally:
            stopped.set()
            thread.join()
            executor.shutdown()
            node.destroy_node()
    return summary


def _gravity(peer: PandaPeer) -> np.ndarray:
    import pinocchio as pin

    rows = peer.rows(PANDA)
    return pin.computeGeneralizedGravity(peer.model, peer.data, peer.vector(rows, Q))[rows]


def _settle(publisher, watcher: EffortWatcher, expected: np.ndarray, child) -> bool:
    """Publish sound states until the efforts are those of Pinocchio at rest; returns whether they are in time."""
    until = time.monotonic() + PATIENCE
    watcher.commands.clear()
    while time.monotonic() < until and child.poll() is None:
        message = clean_state()
        watcher.sent[message.header.stamp.sec * 10**9 + message.header.stamp.nanosec] = True
        publisher.publish(message)
        time.sleep(1 / RATE)
        last = list(watcher.commands)[-SETTLED:]
        if len(last) == SETTLED and np.abs(np.array(last) - expected).max() < 1e-6:
            return True
    return False
