"""`ros2 ...` commands of a page, carried out by rclpy: the wheels of ROS have no command `ros2`.

What they print has the form of ros2cli.
"""

import shlex
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
import yaml
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from peers.launch_files import started
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.context import Context
from rclpy.parameter import get_parameter_value
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from page_runner.background import READY, BackgroundNodes, full_name
from page_runner.messages import fill, interface_type, plain
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.recordings.bags import Bag

PATIENCE = 60.0  # [s] for a response, a subscriber, a message
SETTLE_TIME = 0.5  # [s] that a message has to arrive before the next command
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
NAMES_OF_TYPES = {
    ParameterType.PARAMETER_BOOL: ("Boolean value is:", "bool_value"),
    ParameterType.PARAMETER_INTEGER: ("Integer value is:", "integer_value"),
    ParameterType.PARAMETER_DOUBLE: ("Double value is:", "double_value"),
    ParameterType.PARAMETER_STRING: ("String value is:", "string_value"),
    ParameterType.PARAMETER_BOOL_ARRAY: ("Boolean values are:", "bool_array_value"),
    ParameterType.PARAMETER_INTEGER_ARRAY: ("Integer values are:", "integer_array_value"),
    ParameterType.PARAMETER_DOUBLE_ARRAY: ("Double values are:", "double_array_value"),
    ParameterType.PARAMETER_STRING_ARRAY: ("String values are:", "string_array_value"),
}


class UnknownCommandError(AssertionError):
    """The runner cannot carry out a command."""


class RefusalError(AssertionError):
    """A node refused what a command wanted. `output` is what ros2cli prints then."""

    def __init__(self, output: str) -> None:
        super().__init__(output)
        self.output = output


class RosCommands:
    """Carries out commands; publications with `--rate` go on until the page ends or the topic gets another one."""

    def __init__(self, nodes: BackgroundNodes) -> None:
        self._nodes = nodes
        self._context = Context()
        rclpy.init(context=self._context)
        self._client = ServiceClient("page_reader", context=self._context)
        self._repeated: dict[str, threading.Event] = {}
        self._publishers: dict[tuple[str, str], Any] = {}
        self._folder = tempfile.TemporaryDirectory(prefix="page_launch_")
        self._commands: dict[str, Callable[[list[str]], str]] = {
            "run": self._run,
            "launch": self._launch,
            "service call": self._service_call,
            "service list": lambda _: self._names(self._client.node.get_service_names_and_types()),
            "topic list": lambda _: self._names(self._client.node.get_topic_names_and_types()),
            "bag play": self._bag_play,
            "topic pub": self._topic_pub,
            "topic echo": self._topic_echo,
            "topic info": self._topic_exists,
            "topic hz": self._topic_exists,
            "param set": self._param_set,
            "param get": self._param_get,
            "lifecycle set": self._lifecycle_set,
            "lifecycle get": self._lifecycle_get,
        }

    def carry_out(self, words: list[str]) -> str:
        """Carry out a command, given by its words after `ros2`, and return what it prints."""
        for length in (1, 2):
            command = self._commands.get(" ".join(words[:length]))
            if command is not None:
                return command(words[length:])
        raise UnknownCommandError(f"the runner knows no command ros2 {' '.join(words[:2])}")

    def close(self) -> None:
        """Stop all publications."""
        for stop in self._repeated.values():
            stop.set()
        time.sleep(0.05 if self._repeated else 0.0)
        self._client.close()
        rclpy.shutdown(context=self._context)
        self._folder.cleanup()

    # run, launch

    def _run(self, words: list[str]) -> str:
        package, executable, *arguments = words
        if (package, executable) == ("robot_state_publisher", "robot_state_publisher"):
            return self._publish_description(arguments)
        if package != "robot_dynamics" or executable not in READY:
            raise UnknownCommandError(f"the runner cannot run the executable {executable} of {package}")
        return self._nodes.start(shlex.join([executable, *arguments]))

    def _publish_description(self, arguments: list[str]) -> str:
        """What robot_state_publisher does with the file of a URDF."""
        (file,) = [word for word in arguments if word.endswith(".urdf")]
        publisher = self._publisher("robot_description", String, LATCHED)
        publisher.publish(String(data=Path(file).read_text(encoding="utf-8")))
        self._client.spin(SETTLE_TIME)
        return ""

    def _launch(self, words: list[str]) -> str:
        package, file, *arguments = words
        if package != "robot_dynamics":
            raise UnknownCommandError(f"the runner has no launch files of {package}")
        folder = tempfile.mkdtemp(dir=self._folder.name)
        starts = started(file, arguments, folder)
        output = "".join(self._nodes.start(shlex.join([name, "--ros-args", *rest])) for name, rest in starts)
        names = {name: full_name([name, *rest]) for name, rest in starts}
        if {"computed_torque", "mobile_base_simulator"} <= set(names):  # a reader would see them run before going on
            self._topic_echo([f"{names['computed_torque']}/state", "--once"])
        return output

    # services and parameters

    def _service_call(self, words: list[str]) -> str:
        service, kind, *values = words
        service_type = interface_type(kind)
        request = fill(service_type.Request(), yaml.safe_load(values[0]) if values else {})
        response = self._client.call(service_type, service, request, PATIENCE)
        output = f"requester: making request: {request!r}\n\nresponse:\n{response!r}\n"
        if not getattr(response, "success", True):
            raise RefusalError(output)
        return output

    def _param_set(self, words: list[str]) -> str:
        node, name, text = words
        parameter = ParameterMessage(name=name, value=get_parameter_value(text))
        request = SetParameters.Request(parameters=[parameter])
        (result,) = self._client.call(SetParameters, f"{node}/set_parameters", request, PATIENCE).results
        if not result.successful:
            raise RefusalError(f"Setting parameter failed: {result.reason}\n")
        return "Set parameter successful\n"

    def _param_get(self, words: list[str]) -> str:
        node, name = words
        request = GetParameters.Request(names=[name])
        (value,) = self._client.call(GetParameters, f"{node}/get_parameters", request, PATIENCE).values
        return f"{_parameter_text(value)}\n"

    def _lifecycle_set(self, words: list[str]) -> str:
        node, label = words
        available = self._client.call(
            GetAvailableTransitions, f"{node}/get_available_transitions", GetAvailableTransitions.Request(), PATIENCE
        ).available_transitions
        transitions = {each.transition.label: each.transition for each in available}
        assert label in transitions, f"{node} has no transition {label} now, but {', '.join(transitions)}"
        request = ChangeState.Request(transition=transitions[label])
        if not self._client.call(ChangeState, f"{node}/change_state", request, PATIENCE).success:
            raise RefusalError("Transitioning failed\n")
        return "Transitioning successful\n"

    def _lifecycle_get(self, words: list[str]) -> str:
        (node,) = words
        state = self._client.call(GetState, f"{node}/get_state", GetState.Request(), PATIENCE).current_state
        return f"{state.label} [{state.id}]\n"

    # topics

    def _topic_pub(self, words: list[str]) -> str:
        rate, times = 1.0, 0
        while words[0].startswith("-"):
            option, words = words[0], words[1:]
            if option in ("--once", "-1"):
                times = 1
            elif option in ("--rate", "-r"):
                rate, words = float(words[0]), words[1:]
            elif option in ("--times", "-t"):
                times, words = int(words[0]), words[1:]
            else:
                raise UnknownCommandError(f"the runner knows no option {option} of ros2 topic pub")
        topic, kind, *values = words
        message = fill(interface_type(kind)(), yaml.safe_load(values[0]) if values else {})
        publisher = self._publisher(topic, type(message), 1)
        self._wait(publisher.get_subscription_count, f"no node subscribes to {topic}")
        self._client.spin(0.1)  # until the subscriber has discovered this publisher as well
        if times:
            for number in range(times):
                self._client.spin(1 / rate if number else 0.0)
                publisher.publish(message)
        else:
            self._publish_repeatedly(publisher, message, rate)
        self._client.spin(SETTLE_TIME)
        return f"publisher: beginning loop\npublishing #1: {message!r}\n"

    def _publish_repeatedly(self, publisher: Any, message: Any, rate: float) -> None:
        topic = publisher.topic_name
        if topic in self._repeated:
            self._repeated[topic].set()
        stop = self._repeated[topic] = threading.Event()

        def publish() -> None:
            while not stop.wait(1 / rate):
                publisher.publish(message)

        publisher.publish(message)
        threading.Thread(target=publish, daemon=True).start()

    def _bag_play(self, words: list[str]) -> str:
        """Publish the joint states of a bag in the background, with the stamps that they have."""
        loops = "--loop" in words
        (path,) = [word for word in words if word != "--loop"]
        bag = Bag(Path(path))
        samples = list(bag.samples(bag.joint_topics()))
        publishers = {each: self._publisher(each, JointState, 1000) for each in {sample.source for sample in samples}}
        stop = self._repeated[path] = threading.Event()

        def play() -> None:
            is_first = True
            while (loops or is_first) and not stop.is_set():
                started = time.monotonic()
                for sample in samples:
                    due = started + (sample.receive_time - samples[0].receive_time) / 1e9
                    if stop.wait(max(0.0, due - time.monotonic())):
                        return
                    message = JointState(name=list(sample.names))
                    message.header.stamp.sec, message.header.stamp.nanosec = divmod(sample.stamp, 10**9)
                    for field in ("position", "velocity", "effort"):
                        setattr(message, field, getattr(sample, field).tolist())
                    publishers[sample.source].publish(message)
                is_first = False

        threading.Thread(target=play, daemon=True).start()
        return ""

    def _topic_echo(self, words: list[str]) -> str:
        assert "--once" in words, "in a page `ros2 topic echo` needs --once, or it does not end"
        words = [word for word in words if word not in ("--once", "--no-arr", "--full-length", "-f")]
        field = words.pop(words.index("--field") + 1).split(".") if "--field" in words else []
        topic = next(word for word in words if not word.startswith("-"))
        kinds = self._wait(lambda: self._kinds().get(_absolute(topic)), f"there is no topic {topic}")
        infos = self._wait(lambda: self._client.node.get_publishers_info_by_topic(topic), f"no node publishes {topic}")
        latched = all(info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for info in infos)
        qos = LATCHED if latched else QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        messages: list[Any] = []
        subscription = self._client.node.create_subscription(interface_type(kinds[0]), topic, messages.append, qos)
        self._wait(lambda: messages, f"no message came on {topic}")
        self._client.node.destroy_subscription(subscription)
        value = messages[0]
        for name in field:
            value = getattr(value, name)
        return f"{yaml.safe_dump(plain(value), sort_keys=False)}---\n"

    def _topic_exists(self, words: list[str]) -> str:
        topic = next(word for word in words if not word.startswith("-"))
        self._wait(lambda: _absolute(topic) in self._kinds(), f"there is no topic {topic}")
        return ""

    def _kinds(self) -> dict[str, list[str]]:
        return dict(self._client.node.get_topic_names_and_types())

    def _publisher(self, topic: str, kind: type, qos: QoSProfile | int) -> Any:
        key = (topic, kind.__name__)
        if key not in self._publishers:
            self._publishers[key] = self._client.node.create_publisher(kind, topic, qos)
        return self._publishers[key]

    def _wait(self, condition: Callable[[], Any], failure: str) -> Any:
        deadline = time.monotonic() + PATIENCE
        while not (value := condition()):
            assert time.monotonic() < deadline, f"{failure} ({PATIENCE:g} s)"
            self._client.spin(0.05)
        return value

    @staticmethod
    def _names(names_and_types: list[tuple[str, list[str]]]) -> str:
        return "".join(f"{name}\n" for name, _ in sorted(names_and_types) if not name.startswith("/page_reader/"))


def _absolute(topic: str) -> str:
    return topic if topic.startswith("/") else f"/{topic}"


def _parameter_text(value: ParameterValue) -> str:
    if value.type == ParameterType.PARAMETER_NOT_SET:
        return "Parameter not set."
    words, field = NAMES_OF_TYPES[value.type]
    content = getattr(value, field)
    return f"{words} {content}" if isinstance(content, bool | int | float | str) else f"{words} {list(content)}"
