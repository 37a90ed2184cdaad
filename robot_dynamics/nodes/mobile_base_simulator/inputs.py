"""The inputs of a simulated robot: commands that were received, for as long as they are valid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias, TypedDict

import numpy as np
from geometry_msgs.msg import Twist, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics.array_types import Array
from robot_dynamics.control.reference import Trajectory
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.codecs.geometry import read_twist
from robot_dynamics.nodes.codecs.joint_order import resolve_name
from robot_dynamics.nodes.codecs.references import read_reference
from robot_dynamics.nodes.codecs.wrenches import read_wrench

if TYPE_CHECKING:
    from robot_dynamics.array_types import IntArray
    from robot_dynamics.nodes.mobile_base_simulator.simulation_setup import SimulationSetup

Motion: TypeAlias = Callable[[float], tuple[Array, Array, Array]]
"""Positions, velocities and accelerations (n,) of all joints at a time [s]."""


class StepInputs(TypedDict, total=False):
    """Arguments of Simulation.advance beside the number of steps."""

    efforts: Array
    external_wrenches: dict[str, Array]
    drive: Array | None
    motion: Motion


class SimulatorInputs:
    """Reads messages, and returns the inputs of a step. Times are simulated [s].

    Callbacks raise InvalidInputError for messages that do not fit. A base that was driven once is held by its wheels
    from then on.

    Parameters
    ----------
    setup : the simulation.
    namespace : of the node, which may precede names.
    timeout : [s] after which commands and wrenches that are not repeated are zero.
    """

    def __init__(self, setup: SimulationSetup, namespace: str, timeout: float) -> None:
        self._setup = setup
        self._simulation = setup.simulation
        self._namespace = namespace
        self.timeout = timeout
        self.clear()

    def clear(self) -> None:
        """Forget all messages."""
        self.efforts: Array = np.zeros(len(self._simulation.joint_names))
        self.has_new_efforts = False  # since `expect_efforts`
        self.has_state_stamp = False  # whether the last efforts have the stamp of the state that they belong to
        self._expected_stamp = 0
        self._efforts_received_at = -np.inf
        self._drive: Array | None = None
        self._drive_received_at = -np.inf
        self._wrenches: dict[str, tuple[float, Array]] = {}  # with the time at which they were received
        self._reference: tuple[float, Trajectory] | None = None  # likewise

    def continue_from(self, predecessor: SimulatorInputs) -> None:
        """Take over the messages that another simulation of the same joints has received."""
        self.efforts[:] = predecessor.efforts
        self.has_new_efforts = predecessor.has_new_efforts
        self.has_state_stamp = predecessor.has_state_stamp
        self._efforts_received_at = predecessor._efforts_received_at
        self._drive = predecessor._drive
        self._drive_received_at = predecessor._drive_received_at
        self._wrenches = predecessor._wrenches
        self._reference = predecessor._reference

    def expect_efforts(self, stamp: int = 0) -> None:
        """Wait for efforts of the state with this stamp [ns], or without a stamp; 0: any efforts."""
        self.has_new_efforts = False
        self._expected_stamp = stamp

    def on_commands(self, now: float, message: Float64MultiArray) -> None:
        """Read efforts in the order of parameter `joints`."""
        names = self._setup.joint_names
        if len(message.data) != len(names):
            raise InvalidInputError(
                f"commands has {len(message.data)} values: {len(names)} are needed, one for each of {', '.join(names)}"
            )
        self._set_efforts(now, self._setup.joints, np.asarray(message.data))
        self.has_state_stamp = False

    def on_efforts(self, now: float, message: JointState) -> None:
        """Read the efforts of the named joints. Those of a state before the expected one are too late, and ignored."""
        stamp = to_nanoseconds(message.header.stamp)
        if 0 < stamp < self._expected_stamp:
            return
        if len(message.effort) != len(message.name):
            raise InvalidInputError(f"effort has {len(message.effort)} efforts for {len(message.name)} names")
        names = [resolve_name("joint", name, self._setup.joint_names, self._namespace) for name in message.name]
        if len(set(names)) < len(names):
            raise InvalidInputError("effort names a joint more than once")
        indices = [self._simulation.joint_names.index(name) for name in names]
        self._set_efforts(now, indices, np.asarray(message.effort))
        self.has_state_stamp = stamp > 0

    def on_cmd_vel(self, now: float, message: Twist) -> None:
        """Read the commanded twist of the base."""
        if self._simulation.base != "planar":
            raise InvalidInputError(
                f"cmd_vel drives a planar base or one on wheels, this one is {self._simulation.base}"
            )
        self._drive = read_twist(message, "cmd_vel")
        self._drive_received_at = now

    def on_wrench(self, now: float, message: WrenchStamped) -> None:
        """Read the wrench of the environment on the link that frame_id names, in the frame of that link."""
        link = resolve_name("link", message.header.frame_id, self._simulation.robot.frames_by_name, self._namespace)
        self._wrenches[link] = now, read_wrench(message.wrench, f"external_wrench on {link!r}")

    def on_reference(self, now: float, message: JointTrajectory) -> None:
        """Read the motion of all joints from now on."""
        names = self._simulation.joint_names
        state = self._simulation.state
        times, points = read_reference(message, names, self._namespace)
        if len(times) and times[0] > 0:  # starts from the present state
            times = np.concatenate([[0.0], times])
            present = np.stack([state.positions, state.velocities, np.zeros(len(names))])
            points = np.concatenate([present[:, None], points], axis=1)
        self._reference = now, Trajectory(times, *points)

    @property
    def has_commands(self) -> bool:
        """Whether efforts were received at all."""
        return bool(np.isfinite(self._efforts_received_at))

    def has_timed_out(self, now: float) -> bool:
        """Return whether efforts were received, and are no longer valid."""
        return self.has_commands and now - self._efforts_received_at > self.timeout

    def step_inputs(self, now: float) -> StepInputs:
        """Return the inputs of a step; efforts, wrenches and drives that are no longer valid are zero."""
        if now - self._efforts_received_at > self.timeout:
            self.efforts[:] = 0
        wrenches = {
            link: wrench for link, (received_at, wrench) in self._wrenches.items() if now - received_at <= self.timeout
        }
        drive = self._drive
        if drive is not None and now - self._drive_received_at > self.timeout:
            drive = np.zeros(6)
        return {"efforts": self.efforts, "external_wrenches": wrenches, "drive": drive}

    def reference_motion(self, offset: float) -> Motion:
        """Return the motion of the reference as a function of the time of the Simulation [s].

        offset: simulated time less the time of the Simulation. Without a reference the joints are at rest.
        """
        state = self._simulation.state
        if self._reference is None:
            rest = np.zeros_like(state.positions)
            return lambda time: (state.positions, rest, rest)
        start, trajectory = self._reference
        sample = np.empty((3, len(state.positions)))

        def reference_motion(time: float) -> tuple[Array, Array, Array]:
            trajectory.sample(time + offset - start, sample)
            positions, velocities, accelerations = sample.copy()
            return positions, velocities, accelerations

        return reference_motion

    def _set_efforts(self, now: float, indices: IntArray | Sequence[int], values: Array) -> None:
        """Set the efforts of joints, by their indices in the simulation."""
        if not np.isfinite(values).all():
            index = int(np.argmin(np.isfinite(values)))
            raise InvalidInputError(f"effort[{index}] is {values[index]}: a finite number is needed")
        self.efforts[indices] = values
        self._efforts_received_at = now
        self.has_new_efforts = True
