"""Launch files with arguments as users type them, and the nodes that they start as real processes."""

import os
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from nodes.controller_probe import trajectory_message
from nodes.service_requests import call_service, inverse_request
from peers.launch_files import ROOT, DeclareLaunchArgument, description, performed, started
from peers.real_robots import real_urdf
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics.nodes.processes import terminate_process

FILES = sorted(path.name for path in (ROOT / "launch").glob("*.launch.py"))
# simulated time waits for each effort, so that a busy machine loses none
PATIENT = {
    "/**/mobile_base_simulator": {"wait_for_commands": "each", "real_time_factor": 0.5},
    "/**/computed_torque": {"kp": [2500.0], "kd": [100.0], "deadline": 1.0, "state_timeout": 1.0, "ramp_time": 0.0},
}
PAUSED = {"/**/mobile_base_simulator": {"start_paused": True}}  # it tells the same time again and again
UR5 = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"]


@contextmanager
def launched(folder, file, *arguments):
    """Start the nodes of a launch file until the block ends. Yields {executable: Path of its log}."""
    logs = {}
    with ExitStack() as stack:
        for executable, node_arguments in started(file, arguments, folder):
            logs[executable] = folder / f"{executable}_{len(list(folder.iterdir()))}.log"
            log = stack.enter_context(logs[executable].open("w"))
            command = [sys.executable, "-m", f"robot_dynamics.nodes.{executable}", "--ros-args", *node_arguments]
            stack.callback(terminate_process, subprocess.Popen(command, stdout=log, stderr=log))
        yield logs


def with_parameters(folder, values_of):
    """The launch argument of a parameter file {node: {name: value}}."""
    path = folder / "parameters.yaml"
    path.write_text(yaml.safe_dump({node: {"ros__parameters": values} for node, values in values_of.items()}))
    return f"parameters:={path}"


def eventually(client, condition, logs, patience=60.0):
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline, "\n".join(path.read_text() for each in logs for path in each.values())
        client.spin(0.1)


@pytest.mark.parametrize("file", FILES)
def test_launch_defaults_can_be_typed_and_change_nothing(file, tmp_path):
    arguments = [item for item in description(ROOT / "launch" / file) if isinstance(item, DeclareLaunchArgument)]
    typed = [f"{item.name}:={performed(item.default_value, {})}" for item in arguments]
    assert {"robot", "namespace"} < {item.name for item in arguments} or file == "dynamics_server.launch.py"

    def contents(node_arguments):
        return [(executable, [open(word).read() if os.path.isfile(word) else word for word in words])
                for executable, words in started(file, node_arguments, tmp_path)]  # fmt: skip

    assert contents(typed) == contents([])
    for node_arguments in contents(["robot:=none"]):
        assert any("robot_file: ''" in word for word in node_arguments[1])
    with pytest.raises(ValueError, match="malformed launch argument 'robot:='"):
        started(file, ["robot:="], tmp_path)


@pytest.mark.parametrize(
    ("file", "arguments", "of_user", "expected"),
    [
        ("closed_loop", [], {}, (True, True)),
        ("closed_loop", ["clock:=/clock"], {}, (True, True)),
        ("closed_loop", ["clock:=none"], {}, (False, False)),
        ("closed_loop", [], {"/**/mobile_base_simulator": {"publish_clock": False}}, (False, True)),
        ("closed_loop", [], {"/**": {"publish_clock": False, "use_sim_time": False}}, (False, False)),
        ("closed_loop", ["clock:=none"], {"/left/computed_torque": {"use_sim_time": True}}, (False, True)),
        ("mobile_base_simulator", [], {}, (True, None)),
        ("mobile_base_simulator", ["clock:=none"], {}, (False, None)),
        ("mobile_base_simulator", [], {"/**/mobile_base_simulator": {"publish_clock": False}}, (False, None)),
        ("computed_torque", [], {}, (None, False)),
        ("computed_torque", ["use_sim_time:=true"], {}, (None, True)),
        ("computed_torque", [], {"/**/computed_torque": {"use_sim_time": True}}, (None, True)),
    ],
)
def test_parameter_file_has_priority_over_the_time_of_the_arguments(file, arguments, of_user, expected, ros, tmp_path):
    """And the robot is that of the arguments: rcl merges all parameters that are loaded."""
    typed = ["namespace:=left", "robot:=ur5e", *arguments]
    if of_user:
        of_user = {node: {**values, "robot_file": "rx90"} for node, values in of_user.items()}
        typed.append(with_parameters(tmp_path, of_user))
    values = {"mobile_base_simulator": None, "computed_torque": None}
    for executable, node_arguments in started(f"{file}.launch.py", typed, tmp_path):
        node = rclpy.create_node(
            executable, cli_args=["--ros-args", *node_arguments], use_global_arguments=False,
            automatically_declare_parameters_from_overrides=True,
        )  # fmt: skip
        name = "publish_clock" if executable == "mobile_base_simulator" else "use_sim_time"
        values[executable] = node.get_parameter(name).value
        assert node.get_parameter("robot_file").value == "ur5e"
        node.destroy_node()
    assert tuple(values.values()) == expected


def test_robot_none_serves_the_robot_on_the_topic(client, tmp_path):
    latched = client.node.create_publisher(
        String, "/launched/robot_description", QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    )
    latched.publish(String(data=real_urdf("ur5")))
    zero = np.zeros((1, 6))
    with launched(tmp_path, "dynamics_server.launch.py", "robot:=none", "namespace:=launched") as logs:
        request = inverse_request(UR5, zero, zero, zero)
        eventually(client, lambda: call_service(client, "/launched/dynamics_server", request).success, [logs])
    client.node.destroy_publisher(latched)


def test_two_closed_loops_run_side_by_side_under_two_namespaces(client, tmp_path):
    """Each robot follows its own reference, in a simulated time of its own."""
    node, names = client.node, [f"panda_joint{k}" for k in range(1, 8)]
    moves = {"left": np.array([0.1, -0.1, 0, -0.2, 0, 0.1, 0]), "right": np.array([-0.1, 0, 0.1, -0.1, 0.1, 0, 0.1])}
    states, subscriptions = {}, []
    for side in moves:
        keep = lambda message, side=side: states.update({side: message})  # noqa: E731
        subscriptions.append(node.create_subscription(JointState, f"/{side}/joint_states", keep, 1))
    out = {side: node.create_publisher(JointTrajectory, f"/{side}/computed_torque/reference", 1) for side in moves}

    def moving():
        times = [state.header.stamp.sec + state.header.stamp.nanosec * 1e-9 for state in states.values()]
        return len(times) == 2 and min(times) > 0.01 and all(p.get_subscription_count() for p in out.values())

    with ExitStack() as stack:
        logs = [
            stack.enter_context(
                launched(tmp_path, "closed_loop.launch.py", f"namespace:={side}", with_parameters(tmp_path, PATIENT))
            )
            for side in moves
        ]
        eventually(client, moving, logs)
        goals = {side: np.array(states[side].position) + move for side, move in moves.items()}
        for side, goal in goals.items():
            out[side].publish(trajectory_message(names, [0.2], [goal], [np.zeros(7)]))

        def arrived():
            return all(np.abs(np.array(states[side].position) - goal).max() < 2e-3 for side, goal in goals.items())

        eventually(client, arrived, logs, patience=120.0)
        topics = dict(node.get_topic_names_and_types())
        assert {"/left/clock", "/right/clock"} <= set(topics) and not node.get_publishers_info_by_topic("/clock")
    for each in logs:
        assert "clock" not in text(each), text(each)
    for subscription in subscriptions:
        node.destroy_subscription(subscription)


def text(logs):
    return "\n".join(path.read_text() for path in logs.values())


def test_second_clock_is_reported_by_all_nodes_that_it_concerns(client, tmp_path):
    diagnostics = []
    diagnostics_subscription = client.node.create_subscription(DiagnosticArray, "/diagnostics", diagnostics.append, 100)
    paused, second = with_parameters(tmp_path, PAUSED), tmp_path / "second"
    second.mkdir()
    with launched(tmp_path, "closed_loop.launch.py", "namespace:=left", "clock:=/clock", paused) as first:
        eventually(client, lambda: "controls" in text(first) and "simulates" in text(first), [first])
        with launched(second, "mobile_base_simulator.launch.py", "namespace:=right", paused) as other_log:
            both = "/clock is published by /left/mobile_base_simulator and /right/mobile_base_simulator"
            eventually(client, lambda: both in first["computed_torque"].read_text(), [first, other_log])
            statuses = lambda: [status for message in diagnostics for status in message.status]  # noqa: E731
            eventually(
                client, lambda: any("computed_torque" in s.name and both in s.message for s in statuses()), [first]
            )
            says = "/clock is published by {} as well"
            named = says.format("/left/mobile_base_simulator")
            eventually(client, lambda: named in other_log["mobile_base_simulator"].read_text(), [first, other_log])
            named = says.format("/right/mobile_base_simulator")
            eventually(client, lambda: named in first["mobile_base_simulator"].read_text(), [first, other_log])
            for name in ("left/mobile_base_simulator", "right/mobile_base_simulator"):
                assert client.set_parameters(f"/{name}", {"publish_clock": False}).successful
            eventually(client, lambda: not client.node.get_publishers_info_by_topic("/clock"), [first, other_log])
        assert text(other_log).count("as well") == 1 and text(first).count(both) == 1
    client.node.destroy_subscription(diagnostics_subscription)


def test_one_clock_causes_no_warning_and_one_of_the_same_name_does(client, tmp_path):
    simulator, paused = "mobile_base_simulator.launch.py", with_parameters(tmp_path, PAUSED)
    with launched(tmp_path, simulator, "namespace:=alone", paused) as first:
        (tmp_path / "own").mkdir()
        with launched(tmp_path / "own", simulator, "namespace:=own", "clock:=none", paused) as other_log:
            eventually(
                client, lambda: "simulates" in text(first) and "simulates" in text(other_log), [first, other_log]
            )
            client.spin(2.5)
            assert "published by" not in text(first) + text(other_log)
        (tmp_path / "same").mkdir()
        with launched(tmp_path / "same", simulator, "namespace:=alone", paused) as other_log:
            named = "/clock is published by another node of the same name as well"
            eventually(client, lambda: named in text(first) and named in text(other_log), [first, other_log])
