"""The simulation of the present robot in time: steps when they are due, the state after each."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.node import Node

from robot_dynamics.errors import SimulationError
from robot_dynamics.nodes.codecs.fields import to_nanoseconds, to_time_message
from robot_dynamics.nodes.diagnostics import DurationStatistics
from robot_dynamics.nodes.guarded_callbacks import failure_reason
from robot_dynamics.nodes.mobile_base_simulator.inputs import SimulatorInputs
from robot_dynamics.nodes.mobile_base_simulator.pacing import MAX_LAG, Pacer
from robot_dynamics.nodes.mobile_base_simulator.publishers import SimulatorPublishers

if TYPE_CHECKING:
    from robot_dynamics.nodes.mobile_base_simulator.inputs import StepInputs
    from robot_dynamics.nodes.mobile_base_simulator.simulation_setup import SimulationSetup
    from robot_dynamics.nodes.parameters import ParameterValues
    from robot_dynamics.simulation import Simulation

MAX_TICK_DURATION = 0.02  # [s] of the machine for the steps of one check: then messages are received again
MAX_SPEED = 1e9  # [rad/s or m/s] faster than anything: the simulation has diverged
REPEAT_INTERVAL = 0.05  # [s] of the machine after which the state is published again while time stands still
LATE_RESPONSE = 0.25  # [s] of the machine: later efforts are no response to a state that was published


@dataclass(frozen=True, eq=False)
class ActiveSimulation:
    """The simulation of the present robot, and its inputs."""

    setup: SimulationSetup
    inputs: SimulatorInputs

    @property
    def simulation(self) -> Simulation:
        """The simulation."""
        return self.setup.simulation


class SimulationLoop:
    """Advances simulated time beside that of the machine, and publishes the state after each step.

    Parameters
    ----------
    values : parameters of the node, which may change later.

    Attributes
    ----------
    active : the present simulation; None if there is no robot, or none that can be simulated.
    failure : why nothing is simulated, or why the simulation stopped; empty otherwise.
    is_paused : whether time stands still by request.
    efforts_received_at : time of the machine [s] of the last input.
    commands_timed_out : whether efforts were received, and are no longer valid.
    step_count, skipped_time : numbers of steps, and of delays of simulated time, since the last report.
    """

    def __init__(self, node: Node, values: ParameterValues) -> None:
        self._node = node
        self._values = values
        self.active: ActiveSimulation | None = None
        self.failure = ""
        self.is_paused: bool = values["start_paused"]
        self.efforts_received_at = -np.inf
        self.commands_timed_out = False
        self.step_count = 0
        self.skipped_time = 0
        self.step_durations = DurationStatistics()
        self._offset_ns = 0  # simulated time before the last reset or change of the robot
        self._pacer = Pacer()
        self.outputs = SimulatorPublishers(node, values, self._stamp)

    def start(self, setup: SimulationSetup, restarts: bool) -> None:
        """Simulate a setup, from the present state if it can have that and does not restart.

        Raises RobotDynamicsError.
        """
        simulation = setup.simulation
        previous = self.active
        continues = (
            previous is not None
            and not restarts
            and not self.failure
            and simulation.is_compatible_with(previous.simulation)
        )
        self._offset_ns = self._now_ns()
        inputs = SimulatorInputs(setup, self._node.get_namespace(), self._values["command_timeout"])
        self.active = ActiveSimulation(setup, inputs)
        if previous is not None and continues:
            simulation.continue_from(previous.simulation)
            inputs.continue_from(previous.inputs)
        self._begin(self.active)

    def stop(self, reason: str) -> None:
        """Simulate nothing, for a reason."""
        self.active = None
        self.failure = reason

    def reset(self, active: ActiveSimulation) -> None:
        """Return to the initial state; simulated time goes on."""
        self._offset_ns = self._now_ns()
        active.simulation.reset()
        active.inputs.clear()
        self._begin(active)

    def _begin(self, active: ActiveSimulation) -> None:
        self.failure = ""
        self.outputs.restart()
        self.restart_pacer()
        self._publish(active)

    def _now_ns(self) -> int:
        if self.active is None:
            return self._offset_ns
        return self._offset_ns + round(self.active.simulation.state.time * 1e9)

    def now(self) -> float:
        """Return the simulated time [s], which goes on after a reset and with another robot."""
        return self._now_ns() * 1e-9

    def _stamp(self) -> Time:
        is_simulated = self._values["publish_clock"]
        return to_time_message(self._now_ns() if is_simulated else self._node.get_clock().now().nanoseconds)

    def restart_pacer(self) -> None:
        """Let simulated time and that of the machine run together from now on."""
        self._pacer.restart(self._now_ns())

    def tick(self) -> None:
        """Make the steps that are due, or publish the state again while time stands still."""
        active = self.active
        if active is None:
            return
        if self.is_paused or self.failure or self._is_waiting(active.inputs):
            self.restart_pacer()
            has_input = active.inputs.has_new_efforts and self._values["wait_for_commands"] == "each"
            if (not has_input or self.is_paused) and time.monotonic() - self.outputs.published_at > REPEAT_INTERVAL:
                self.outputs.publish_joint_states_again()
            return
        factor = self._values["real_time_factor"]
        step = active.simulation.step
        deadline = time.monotonic() + MAX_TICK_DURATION
        while time.monotonic() < deadline:
            if factor:
                lag = self._pacer.lag(self._now_ns(), factor)
                if lag < step:
                    return
                if lag > max(MAX_LAG * factor, 2 * step):
                    self.skipped_time += 1
                    self.restart_pacer()
            if not self.advance(active) or self._is_waiting(active.inputs):
                return

    def _is_waiting(self, inputs: SimulatorInputs) -> bool:
        """Return whether time stands still until efforts come.

        There may be two responses to a state that was published twice. If efforts have no stamp of the state, a late
        one would be taken for that of the next state: time goes on after a pause without efforts, or where there is
        none, as with a controller that sends at a rate of its own, long after the state was published.
        """
        wait = self._values["wait_for_commands"]
        if wait == "first":
            return not inputs.has_commands
        if wait != "each":
            return False
        if inputs.has_new_efforts and not inputs.has_state_stamp and self.outputs.publication_count > 1:
            now = time.monotonic()
            is_paused = now - self.efforts_received_at >= REPEAT_INTERVAL
            return not is_paused and now - self.outputs.published_at < LATE_RESPONSE
        return not inputs.has_new_efforts

    def standstill(self) -> float:
        """Return for how long time has stood still because efforts are missing [s of the machine].

        inf before the first efforts; 0 where time does not wait for efforts, or is paused.
        """
        active = self.active
        if active is None or self.is_paused or not self._is_waiting(active.inputs):
            return 0.0
        return time.monotonic() - self.efforts_received_at if active.inputs.has_commands else np.inf

    def advance(self, active: ActiveSimulation) -> bool:
        """Make one step, publish the state, and return whether the step was possible."""
        began = time.perf_counter()
        self.outputs.publication_count = 0
        active.inputs.expect_efforts()
        try:
            active.simulation.advance(**self._step_inputs(active))
            _check_speed(active.simulation)
        except Exception as error:
            reason = failure_reason(self._node.get_logger(), error)
            self.failure = f"stopped at {self.now():.6g} s, call ~/reset to restart: {reason}"
            self._node.get_logger().error(self.failure)
            return False
        self.step_count += 1
        self._publish(active)
        self.step_durations.add(time.perf_counter() - began)
        self.commands_timed_out = active.inputs.has_timed_out(self.now())
        return True

    def _step_inputs(self, active: ActiveSimulation) -> StepInputs:
        if self._values["moved_by"] == "reference":
            return {"motion": active.inputs.reference_motion(self._offset_ns * 1e-9)}
        return active.inputs.step_inputs(self.now())

    def _publish(self, active: ActiveSimulation) -> None:
        stamp = self._stamp()
        if self._values["wait_for_commands"] == "each":
            active.inputs.expect_efforts(to_nanoseconds(stamp))
        self.outputs.publish_state(active.simulation, active.inputs, stamp, lambda: self._step_inputs(active))


def _check_speed(simulation: Simulation) -> None:
    """Raise SimulationError if something moves faster than MAX_SPEED: then its state is not published."""
    state = simulation.state
    speeds = np.abs(np.concatenate([state.twist, state.joint_velocities]))
    fastest = int(np.argmax(speeds))
    if not speeds[fastest] <= MAX_SPEED:
        name = "the base" if fastest < 6 else f"joint {simulation.robot.joints[fastest - 6].name!r}"
        raise SimulationError(
            f"{name} moves at {speeds[fastest]:.3g} rad/s or m/s, faster than anything real: efforts, masses or "
            "the step are wrong"
        )
