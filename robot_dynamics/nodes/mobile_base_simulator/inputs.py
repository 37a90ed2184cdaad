"""What acts on a simulated robot: commands that were heard, for as long as they count."""

import numpy as np

from robot_dynamics.control.reference import Trajectory
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.codecs.geometry import read_twist
from robot_dynamics.nodes.codecs.joint_order import resolve_name
from robot_dynamics.nodes.codecs.references import read_reference
from robot_dynamics.nodes.codecs.wrenches import read_wrench


class SimulatorInputs:
    """Takes messages over, or refuses them with a QuestionError; times are simulated ones [s].

    simulated: the Simulated; timeout: [s] after which what is not said again is zero. A base that was driven once is
    held by its wheels from then on.
    """

    def __init__(self, setup, namespace, timeout):
        self._simulated, self._namespace, self.timeout = setup, namespace, timeout
        self._simulation = setup.simulation
        self.clear()

    def clear(self):
        """As if nothing had been heard."""
        self.efforts = np.zeros(len(self._simulation.joint_names))
        self._commanded = self._driven = -np.inf
        self._drive, self._wrenches, self._reference = None, {}, None
        self.has_new_efforts = self.has_state_stamp = (
            False  # whether efforts came since await_answer; whether they say to which state
        )
        self._awaited = 0

    def continue_from(self, before):
        """What was heard before, of the same joints, counts on."""
        self._commanded, self._driven, self._drive = before._commanded, before._driven, before._drive
        self._wrenches, self._reference = before._wrenches, before._reference
        self.efforts[:], self.has_new_efforts, self.has_state_stamp = (
            before.efforts,
            before.has_new_efforts,
            before.has_state_stamp,
        )

    def expect_efforts(self, stamp=0):
        """Nothing has come yet of what is wanted: efforts that answer the state of this stamp [ns], as far as they say
        what they answer; 0: any."""
        self.has_new_efforts, self._awaited = False, stamp

    def on_commands(self, now, message):
        """std_msgs/Float64MultiArray, in the order of parameter `joints`."""
        names = self._simulated.joint_names
        if len(message.data) != len(names):
            raise InvalidInputError(
                f"commands has {len(message.data)} values: {len(names)} are needed, one for each of {', '.join(names)}"
            )
        self._push(now, self._simulated.joints, np.asarray(message.data))
        self.has_state_stamp = False

    def on_efforts(self, now, message):
        """sensor_msgs/JointState: efforts of the joints that it names. What answers an earlier state than the one that
        is awaited comes too late, and is left."""
        stamp = to_nanoseconds(message.header.stamp)
        if 0 < stamp < self._awaited:
            return
        if len(message.effort) != len(message.name):
            raise InvalidInputError(f"effort has {len(message.effort)} efforts for {len(message.name)} names")
        names = [resolve_name("joint", name, self._simulated.joint_names, self._namespace) for name in message.name]
        if len(set(names)) < len(names):
            raise InvalidInputError("effort names a joint more than once")
        places = [self._simulation.joint_names.index(name) for name in names]
        self._push(now, places, np.asarray(message.effort))
        self.has_state_stamp = stamp > 0

    def _push(self, now, places, values):
        if not np.isfinite(values).all():
            place = int(np.argmin(np.isfinite(values)))
            raise InvalidInputError(f"effort[{place}] is {values[place]}: a finite number is needed")
        self.efforts[places] = values
        self._commanded, self.has_new_efforts = now, True

    def on_cmd_vel(self, now, message):
        """geometry_msgs/Twist: what the base is driven to."""
        if self._simulation.base != "planar":
            raise InvalidInputError(
                f"cmd_vel drives a planar base or one on wheels, this one is {self._simulation.base}"
            )
        self._drive = read_twist(message, "cmd_vel")
        self._driven = now

    def wrench(self, now, message):
        """geometry_msgs/WrenchStamped: what the environment does to the link that frame_id names, in its frame."""
        link = resolve_name("link", message.header.frame_id, self._simulation.robot.frames_by_name, self._namespace)
        self._wrenches[link] = now, read_wrench(message.wrench, f"external_wrench on {link!r}")

    def reference(self, now, message):
        """trajectory_msgs/JointTrajectory: how the joints move from now on, all of them."""
        names, state = self._simulation.joint_names, self._simulation.state
        times, points = read_reference(message, names, self._namespace)
        if len(times) and times[0] > 0:  # from where they are
            times = np.concatenate([[0.0], times])
            here = np.stack([state.positions, state.velocities, np.zeros(len(names))])
            points = np.concatenate([here[:, None], points], axis=1)
        self._reference = now, Trajectory(times, *points)

    @property
    def has_commands(self):
        """Whether efforts ever came."""
        return np.isfinite(self._commanded)

    def has_timed_out(self, now):
        """Whether efforts were commanded once, and are no longer."""
        return self.has_commands and now - self._commanded > self.timeout

    def step_inputs(self, now):
        """What Simulation.advance takes beside the number of steps."""
        if now - self._commanded > self.timeout:
            self.efforts[:] = 0
        wrenches = {link: wrench for link, (heard, wrench) in self._wrenches.items() if now - heard <= self.timeout}
        drive = self._drive
        if drive is not None and now - self._driven > self.timeout:
            drive = np.zeros(6)
        return {"efforts": self.efforts, "external_wrenches": wrenches, "drive": drive}

    def reference_motion(self, offset):
        """The motion that ~/reference tells, as a function of Simulation's time [s], which is `offset` behind; without
        one the joints stay."""
        state = self._simulation.state
        if self._reference is None:
            rest = np.zeros_like(state.positions)
            return lambda time: (state.positions, rest, rest)
        begun, trajectory = self._reference
        sampled = np.empty((3, len(state.positions)))

        def reference_motion(time):
            trajectory.sample(time + offset - begun, sampled)
            return sampled.copy()

        return reference_motion
