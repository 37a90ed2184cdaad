"""A controller manager with a Panda, for the trial of the controller: processes, services, topics and recordings."""

from __future__ import annotations

import importlib.util
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTrajectoryControllerState
from controller_manager_msgs.srv import ListControllers, SwitchController
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

JOINTS = [f"panda_joint{number}" for number in range(1, 8)]
CONTROLLER = "computed_torque_controller"
TRAJECTORY = "joint_trajectory_controller"
EFFORT = "effort_controller"
PAYLOAD = {
    "payload.mass": 1.0,
    "payload.first_moments": [0.0, 0.0, 0.1],
    "payload.inertia": [0.011, 0.0, 0.0, 0.011, 0.0, 0.001],
}  # of panda_simulated.ros2_control.xml
NO_PAYLOAD = {"payload.mass": 0.0, "payload.first_moments": [0.0] * 3, "payload.inertia": [0.0] * 6}


def shipped(name: str) -> Path:
    """Return the path of a file of the example."""
    return Path(get_package_share_directory("robot_dynamics_control"), "bringup", name)


def describe_robot(hardware: str) -> str:
    """Return the URDF with the tags of the hardware, as the launch file of the example makes it."""
    name = "panda_ros2_control.launch"
    spec = importlib.util.spec_from_file_location(name, shipped(f"{name}.py"))
    assert spec is not None and spec.loader is not None
    launch_file = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(launch_file)
    return str(launch_file.describe_robot(hardware, headless="true"))


class Bench:
    """A controller manager in a process of its own, and a node that talks to it.

    Parameters
    ----------
    hardware : "simulated", "mujoco" or "mock".
    """

    def __init__(self, hardware: str) -> None:
        self.hardware = hardware
        self.controllers = shipped("panda_controllers.yaml")
        self.node = rclpy.create_node("acceptance")
        self.samples: list[tuple[float, list[float], list[float], list[float]]] = []
        self.tracking: list[JointTrajectoryControllerState] = []
        self.diagnostics: dict[str, dict[str, str]] = {}
        self._clock_offset = 0.0  # [s]
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._description = self.node.create_publisher(String, "robot_description", latched)
        self._description.publish(String(data=describe_robot(hardware)))
        self.node.create_subscription(JointState, "joint_states", self._on_joint_states, 1000)
        self.node.create_subscription(
            JointTrajectoryControllerState, f"{TRAJECTORY}/controller_state", self.tracking.append, 100
        )
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self.reference_points = self.node.create_publisher(JointTrajectory, f"{CONTROLLER}/reference_point", 1)
        self.effort_commands = self.node.create_publisher(Float64MultiArray, f"{EFFORT}/commands", 1)
        self._faults = self.node.create_publisher(Float64MultiArray, "fault_controller/commands", 1)
        self._trajectories = ActionClient(self.node, FollowJointTrajectory, f"{TRAJECTORY}/follow_joint_trajectory")
        self._clients: dict[str, Any] = {}
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._is_running = True
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()
        self.log = Path(tempfile.mkdtemp(prefix="ros2_control_"), "controller_manager.log")
        self.process = self._start_manager()

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop(signal.SIGINT)
        self._is_running = False
        self._thread.join()
        self._executor.shutdown()
        self._trajectories.destroy()
        self.node.destroy_node()

    def _spin(self) -> None:
        while self._is_running:
            self._executor.spin_once(timeout_sec=0.1)

    def _start_manager(self) -> subprocess.Popen[bytes]:
        package = "mujoco_ros2_control" if self.hardware == "mujoco" else "controller_manager"
        program = Path(get_package_prefix(package), "lib", package, "ros2_control_node")
        clock = f"use_sim_time:={str(self.hardware == 'mujoco').lower()}"
        with self.log.open("ab") as log:
            return subprocess.Popen(
                [program, "--ros-args", "--params-file", self.controllers, "-p", clock],
                stdout=log,
                stderr=log,
                env={**os.environ, "RCUTILS_COLORIZED_OUTPUT": "0"},
            )

    def stop(self, number: signal.Signals) -> None:
        """End the controller manager by a signal."""
        if self.process.poll() is None:
            self.process.send_signal(number)
            try:
                self.process.wait(20)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()

    def restart(self) -> None:
        """Start another controller manager."""
        self.process = self._start_manager()

    # --- Recordings ---

    def _on_joint_states(self, message: JointState) -> None:
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        if self.hardware == "mujoco":  # stamps of the simulation, which begins at zero
            self._clock_offset = self._clock_offset or time.time() - stamp
            stamp += self._clock_offset
        order = [message.name.index(name) for name in JOINTS]
        rows = ([values[index] for index in order] for values in (message.position, message.velocity, message.effort))
        self.samples.append((stamp, *rows))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.diagnostics[status.name] = {pair.key: pair.value for pair in status.values}

    def record(self, duration: float, during: Callable[[], Any] = lambda: None) -> dict[str, np.ndarray]:
        """Record joint_states for a time [s], and do something at its beginning.

        Returns
        -------
        dict
            Arrays: time (N,) [s], position, velocity and effort (N, joints).
        """
        begin = time.time()
        self.samples.clear()
        time.sleep(0.1)
        during()
        end = time.time() + duration
        # this process may lag behind the update loop
        while not self.samples or (self.samples[-1][0] < end and time.time() < end + 5.0):
            time.sleep(0.02)
        rows = [row for row in self.samples if begin <= row[0] <= end]
        expect(len(rows) > 10, f"joint_states came {len(rows)} times")
        names = ("time", "position", "velocity", "effort")
        return {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}

    def read_log(self) -> str:
        """Return what the controller manager logged."""
        return self.log.read_text(errors="replace")

    # --- Requests ---

    def spawn(self, *names: str) -> None:
        """Run the spawner for controllers."""
        self._run("spawner", *names, "--param-file", str(self.controllers), "--controller-manager-timeout", "30")

    def spawn_inactive(self, *names: str) -> None:
        """Run the spawner for controllers that are not activated."""
        arguments = ("--param-file", str(self.controllers), "--inactive")
        self._run("spawner", *names, *arguments)

    def unspawn(self, *names: str) -> None:
        """Run the unspawner for controllers."""
        self._run("unspawner", *names)

    def _run(self, program: str, *arguments: str) -> None:
        path = Path(get_package_prefix("controller_manager"), "lib", "controller_manager", program)
        result = subprocess.run([path, *arguments], capture_output=True, text=True, timeout=120)
        expect(result.returncode == 0, f"{program} {' '.join(arguments)}: {result.stdout}{result.stderr}")

    def call(self, kind: type, name: str, request: Any) -> Any:
        """Call a service, and return its response."""
        self._require_manager()
        # clients live as long as the node: to destroy one while the other thread waits for it ends that thread
        client = self._clients.get(name) or self.node.create_client(kind, name)
        self._clients[name] = client
        expect(client.wait_for_service(30), f"there is no service {name}")
        future = client.call_async(request)
        end = time.monotonic() + 30
        while not future.done() and time.monotonic() < end:
            time.sleep(0.002)
        expect(future.done(), f"{name} does not answer")
        return future.result()

    def _require_manager(self) -> None:
        if self.process.poll() is not None:
            raise Failed(f"the controller manager has ended with {self.process.returncode}: see {self.log}")

    def states(self) -> dict[str, str]:
        """Return the states of the controllers by name."""
        response = self.call(ListControllers, "controller_manager/list_controllers", ListControllers.Request())
        return {controller.name: controller.state for controller in response.controller}

    def switch(self, activate: Sequence[str] = (), deactivate: Sequence[str] = (), at_once: bool = True) -> None:
        """Switch controllers; at_once: in one update."""
        request = SwitchController.Request(
            activate_controllers=list(activate),
            deactivate_controllers=list(deactivate),
            strictness=SwitchController.Request.STRICT,
            activate_asap=at_once,
            timeout=Duration(seconds=5).to_msg(),
        )
        response = self.call(SwitchController, "controller_manager/switch_controller", request)
        expect(response.ok, f"switching {activate}, {deactivate}: {response.message}")

    def set_parameters(self, **values: Any) -> list[str]:
        """Set parameters of the controller, and return the reasons of those that it refuses."""
        return self.set_named({name.replace("__", "."): value for name, value in values.items()})

    def set_named(self, values: dict[str, Any]) -> list[str]:
        """Set parameters by their names."""
        parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        response = self.call(
            SetParameters, f"{CONTROLLER}/set_parameters", SetParameters.Request(parameters=parameters)
        )
        return [result.reason for result in response.results if not result.successful]

    def break_sensors(self, is_broken: bool) -> None:
        """Let the simulated robot give nan, or positions again."""
        self._faults.publish(Float64MultiArray(data=[1.0 if is_broken else 0.0]))

    def move(self, goal: Sequence[float], duration: float) -> int:
        """Send a goal to the trajectory controller, and return the error code of its result."""
        self._require_manager()
        client = self._trajectories
        rest = [0.0] * len(JOINTS)
        point = JointTrajectoryPoint(
            positions=[float(position) for position in goal],
            velocities=rest,
            accelerations=rest,
            time_from_start=Duration(seconds=duration).to_msg(),
        )
        expect(client.wait_for_server(30), "there is no action server")
        goal_message = FollowJointTrajectory.Goal()
        goal_message.trajectory = JointTrajectory(joint_names=JOINTS, points=[point])
        handle = _wait_for(client.send_goal_async(goal_message), 30)
        expect(handle.accepted, "the goal is refused")
        return int(_wait_for(handle.get_result_async(), duration + 30).result.error_code)


def _wait_for(future: Any, timeout: float) -> Any:
    end = time.monotonic() + timeout
    while not future.done() and time.monotonic() < end:
        time.sleep(0.002)
    expect(future.done(), "an action does not answer")
    return future.result()


class Failed(Exception):
    """What should be, and is not."""


def expect(condition: bool, text: str) -> None:
    """Raise Failed unless something holds."""
    if not condition:
        raise Failed(text)


def largest_jump(recorded: dict[str, np.ndarray]) -> float:
    """Largest change of an effort in one period of 1 ms [N m]; the mean of several periods where samples are lost."""
    periods = np.maximum(np.rint(1e3 * np.diff(recorded["time"])), 1.0)
    return float((np.abs(np.diff(recorded["effort"], axis=0)).max(axis=1) / periods).max())


def percentiles(values: np.ndarray) -> str:
    """Median, 99th percentile and maximum as text."""
    return f"p50 {np.percentile(values, 50):.4g}, p99 {np.percentile(values, 99):.4g}, max {values.max():.4g}"


def write_report(path: Path, rows: Sequence[tuple[str, str, str]]) -> None:
    """Write the results as JSON."""
    names = ("check", "result", "figures")
    path.write_text(json.dumps([dict(zip(names, row, strict=True)) for row in rows], indent=2) + "\n")


def is_finite(values: np.ndarray) -> bool:
    """Whether all numbers are finite."""
    return bool(math.isfinite(float(values.sum())))


def initialise() -> None:
    """Start ROS in this process."""
    rclpy.init(args=sys.argv)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended by SIGTERM"))  # so that the manager is ended too
