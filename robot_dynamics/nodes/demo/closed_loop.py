"""The second part of the demo: simulated robots under computed_torque, recorded, and a picture of how well they track.

Both nodes are processes of their own and talk over ROS 2. A step of the simulator waits for the efforts that answer it,
so what comes out does not depend on how busy the machine is.
"""

import shutil
from contextlib import contextmanager, nullcontext
from time import monotonic

import numpy as np
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray
from matplotlib import pyplot
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import MissingPackageError, RobotDynamicsError
from robot_dynamics.model.loading import load_robot
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.codecs.geometry import read_twist
from robot_dynamics.nodes.demo.bag_recorder import BagRecorder
from robot_dynamics.nodes.processes import running_node
from robot_dynamics.recordings.bags import import_rosbag2

FREQUENCY = 3.0  # [Hz], critically damped
GAINS = {"kp": [(2 * np.pi * FREQUENCY) ** 2], "kd": [4 * np.pi * FREQUENCY]}
AHEAD, REST = 0.3, 0.3  # [s] before and after a motion
ARRIVED = 0.05  # [rad] from the goal at the end of a motion
AGAIN = 0.05  # [s] after which what was not heard is told again
PATIENCE = 120.0  # [s] of the machine for one motion
REACH = np.array([1.2, -1.4, 1.6, 0.8, 0.6, -1.0])  # [rad] how far the free-flying arm moves, in SPACE_TIME [s]
SPACE_TIME = 2.0
MODES = {"computed_torque": "with the model: A(q)(q̈d + kd ė + kp e) + H", "pd_gravity": "without: PD and gravity"}


def quintic_blend(share):
    """How far along (..., 1) a motion from rest to rest is at a share of its time, (...)."""
    s = np.clip(share, 0, 1)[..., None]
    return 10 * s**3 - 15 * s**4 + 6 * s**5


class ClosedLoopClient:
    """A simulator and computed_torque in a namespace, as a Caller hears them.

    states: {time [ns]: (positions, velocities) (n,)}; base: {time [ns]: (position (3,), Rotation, twist (6,))}.
    """

    def __init__(self, client, namespace, names):
        self._caller, self._namespace, self._names = client, namespace, list(names)
        self.now_ns, self.states, self.base, self._said = 0, {}, {}, []
        node = client.node
        self._held = [
            node.create_subscription(Clock, f"{namespace}/clock", self._on_clock, 2000),
            node.create_subscription(JointState, f"{namespace}/joint_states", self._on_state, 2000),
            node.create_subscription(Odometry, f"{namespace}/odom", self._on_odom, 2000),
            node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100),
        ]
        self._reference = node.create_publisher(JointTrajectory, f"{namespace}/computed_torque/reference", 1)

    def close(self):
        for subscription in self._held:
            self._caller.node.destroy_subscription(subscription)
        self._caller.node.destroy_publisher(self._reference)

    def _on_clock(self, message):
        self.now_ns = message.clock.sec * 10**9 + message.clock.nanosec

    def _on_diagnostics(self, message):
        told = [status for status in message.status if status.name.startswith(self._namespace)]
        self._said += [f"{status.name}: {status.message}" for status in told]

    def _on_state(self, message):
        order = [list(message.name).index(name) for name in self._names]
        told = np.array(message.position)[order], np.array(message.velocity)[order]
        self.states[to_nanoseconds(message.header.stamp)] = told

    def _on_odom(self, message):
        pose, twist = message.pose.pose, message.twist.twist
        p, r = pose.position, pose.orientation
        told = np.array([p.x, p.y, p.z]), Rotation.from_quat([r.x, r.y, r.z, r.w]), read_twist(twist, "odom")
        self.base[to_nanoseconds(message.header.stamp)] = told

    def execute_motion(self, start, goal, seconds):
        """Follow a motion from rest to rest, and give the time [s] at which it began."""
        self.wait_until(self.now_ns * 1e-9 + 1e-3)
        with self._standing_still():
            begin = self.now_ns + round(AHEAD * 1e9)
            message = self._motion(begin, start, goal, seconds)
            deadline = monotonic() + PATIENCE
            self._reference.publish(message)
            while not self._led():  # the first may find no listener that knows of it
                if monotonic() > deadline:
                    raise TimeoutError(f"computed_torque takes no reference; the nodes say: {self._said}")
                self._caller.spin(AGAIN)
                self._reference.publish(message)
        self.wait_until(begin * 1e-9 + seconds + REST)
        if not np.abs(self.states[max(self.states)][0] - goal).max() < ARRIVED:
            raise RobotDynamicsError(f"the robot did not come to its goal; the nodes say: {self._said}")
        return begin * 1e-9

    def _led(self):
        """Whether computed_torque says that it follows a reference."""
        said = [text for text in self._said if "computed_torque: " in text]
        return said and "no reference" not in said[-1]

    def _motion(self, begin, start, goal, seconds):
        message = JointTrajectory(joint_names=self._names)
        message.header.stamp = Time(sec=begin // 10**9, nanosec=begin % 10**9)
        for time, positions in ((0.0, start), (seconds, goal)):
            rest = np.zeros(len(positions)).tolist()
            ns = round(time * 1e9)
            point = JointTrajectoryPoint(positions=positions.tolist(), velocities=rest, accelerations=rest)
            point.time_from_start = Duration(sec=ns // 10**9, nanosec=ns % 10**9)
            message.points.append(point)
        return message

    @contextmanager
    def _standing_still(self):
        """Simulated time stands still in the block, and this process has heard all that was told of the time before:
        it may be seconds behind where the simulation is faster than it reads."""
        pause = f"{self._namespace}/mobile_base_simulator/pause"
        self._caller.call(SetBool, pause, SetBool.Request(data=True))
        heard = None
        while heard != self.now_ns:  # a simulator that is paused tells its time again and again
            heard = self.now_ns
            self._caller.spin(4 * AGAIN)
        yield
        self._caller.call(SetBool, pause, SetBool.Request(data=False))

    def wait_until(self, time):
        """Until the simulation has come to a time [s]. Raises TimeoutError."""
        for _ in range(round(PATIENCE / 0.05)):
            if self.now_ns * 1e-9 >= time and self._reference.get_subscription_count():
                return
            self._caller.spin(0.05)
        raise TimeoutError(f"the simulation came to {self.now_ns * 1e-9:.3f} s only, in {PATIENCE:g} s")

    def errors(self, begin, start, goal, seconds):
        """(times (N,) [s] from the beginning of a motion, errors (N, n) [rad]) of the states during it and after."""
        since = {1e-9 * ns - begin: q for ns, (q, _) in sorted(self.states.items())}
        chosen = {time: q for time, q in since.items() if 0 <= time <= seconds + REST}
        times, q = np.array(list(chosen)), np.array(list(chosen.values()))
        return times, start + (goal - start) * quintic_blend(times / seconds) - q


@contextmanager
def running_closed_loop(client, robot, namespace, simulator):
    """A Loop of a robot that ships. simulator: parameters of the simulator beside the usual ones."""
    common = {"robot_file": robot, **{name: value for name, value in simulator.items() if name == "gravity"}}
    controller = {**common, **GAINS, "use_sim_time": True, "ramp_time": 0.0, "deadline": 1.0}
    # time stands still while a motion is awaited on a busy machine, and no answer is late
    simulator = {**common, **simulator, "wait_for_commands": "each", "real_time_factor": 0.0, "odom_rate": 100.0}
    clock = {"/clock": "clock"}  # in the namespace, so that two demos do not meet
    connected = {"~/effort": "computed_torque/effort", **clock}  # whose stamps say which state they answer
    loop = ClosedLoopClient(client, namespace, Dynamics(load_robot(robot), compiled=False).joint_names)
    try:
        with (
            running_node("mobile_base_simulator", simulator, namespace, remappings=connected),
            running_node("computed_torque", controller, namespace, remappings=clock),
        ):
            yield loop
    finally:
        loop.close()


def open_bag_recorder(client, loop, namespace, path):
    """The Recorder of a Loop, into a bag that may be there already; None where nothing can write one."""
    try:
        import_rosbag2()
    except MissingPackageError as error:
        print(f"no bag is written: {error}")
        return nullcontext()
    if path.exists():
        if {file.suffix for file in path.iterdir()} - {".mcap", ".yaml"}:
            raise RobotDynamicsError(f"{path} is no bag of the demo, which would write it anew: name another by --bag")
        shutil.rmtree(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    topics = {
        f"{namespace}/joint_states": JointState,
        f"{namespace}/odom": Odometry,
        f"{namespace}/computed_torque/commands": Float64MultiArray,
        f"{namespace}/computed_torque/reference": JointTrajectory,
        f"{namespace}/computed_torque/state": JointTrajectory,
    }
    return BagRecorder(client.node, path, topics, lambda: loop.now_ns)


def measure_tracking(client, namespace, start, goal, seconds, bag):
    """{mode: (times, errors)} of the Panda in the same motion with the whole model and without most of it."""
    names = [joint.name for joint in load_robot("panda").joints]
    beginning = {"initial.joints": names, "initial.positions": start.tolist()}
    found = {}
    with (
        running_closed_loop(client, "panda", namespace, beginning) as loop,
        open_bag_recorder(client, loop, namespace, bag) as recorder,
    ):
        for mode in MODES:
            if found:  # back to where it began
                loop.execute_motion(goal, start, seconds)
            client.set_parameters(f"{namespace}/computed_torque", {"mode": mode})
            begin = loop.execute_motion(start, goal, seconds)
            found[mode] = loop.errors(begin, start, goal, seconds)
            client.set_parameters(f"{namespace}/computed_torque", {"mode": "computed_torque"})
        if recorder is not None:
            print(f"bag: {bag}, {recorder.message_count} messages")
    return found


def measure_base_motion(client, namespace, bag):
    """(times (N,), positions (N, 3) [m], angles (N,) [rad], momenta (N, 6)) of the base of the free-flying arm, while
    its arm moves; momenta in the world, at its origin."""
    dynamics = Dynamics(load_robot("free_flying_arm"), compiled=False)
    weightless = {"gravity": [0.0, 0.0, 0.0]}
    with (
        running_closed_loop(client, "free_flying_arm", namespace, weightless) as loop,
        open_bag_recorder(client, loop, namespace, bag),
    ):
        begin = loop.execute_motion(np.zeros(6), REACH, SPACE_TIME)
    stamps = sorted(ns for ns in loop.base if 1e-9 * ns >= begin and ns in loop.states)
    momenta = []
    for ns in stamps:
        (position, turned, twist), (q, qd) = loop.base[ns], loop.states[ns]
        linear, angular = np.split(dynamics.inertia_matrix(q)[:6] @ np.concatenate([twist, qd]), 2)
        linear = turned.apply(linear)
        momenta.append(np.concatenate([linear, turned.apply(angular) + np.cross(position, linear)]))
    positions, angles = zip(*((loop.base[ns][0], loop.base[ns][1].magnitude()) for ns in stamps), strict=True)
    return 1e-9 * np.array(stamps) - begin, np.array(positions), np.array(angles), np.array(momenta)


def draw(picture, tracked, flown):
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    for (mode, (times, errors)), style in zip(tracked.items(), ("-", "--"), strict=True):
        left.semilogy(times, 1e3 * np.linalg.norm(errors, axis=1), style, label=MODES[mode])
    left.set(title="Franka Panda: tracking error, same gains", xlabel="time [s]", ylabel="|q_d − q| [mrad]")
    times, positions, angles, _ = flown
    for k, axis in enumerate("xyz"):
        right.plot(times, 1e3 * positions[:, k], label=f"{axis} [mm]")
    right.plot(times, np.degrees(angles) * 10, "k--", label="turned by [0.1°]")
    right.set(title="free-flying arm: its base moves by reaction", xlabel="time [s]")
    for axis in (left, right):
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    figure.savefig(picture, dpi=110)
    pyplot.close(figure)


def show_closed_loops(client, namespace, motion, picture, bag):
    """Print and draw how the Panda tracks and how the free-flying arm moves its base; record both.

    motion: (start (7,), goal (7,), seconds). Returns the status of the process: 0 where the model made the difference
    that it should.
    """
    start, goal, seconds = motion
    tracked = measure_tracking(client, f"{namespace}/arm", start, goal, seconds, bag / "panda")
    print(f"\nclosed loop at 1 kHz of simulated time, {FREQUENCY:g} Hz critically damped, a motion of {seconds} s\n")
    most = {mode: 1e3 * np.abs(errors).max(axis=0) for mode, (_, errors) in tracked.items()}
    print("largest tracking error [mrad], joint by joint")
    for mode, values in most.items():
        print(f"  {MODES[mode]:<45}", " ".join(f"{value:8.2f}" for value in values))
    flown = measure_base_motion(client, f"{namespace}/space", bag / "free_flying_arm")
    _, positions, angles, momenta = flown
    print(f"\nfree-flying arm: {np.degrees(np.abs(REACH)).max():.0f}° of its arm move the base by "
          f"{1e3 * np.linalg.norm(positions[-1]):.1f} mm and {np.degrees(angles[-1]):.2f}°; "
          f"momentum stays below {np.abs(momenta).max():.1e} kg m/s, kg m²/s")  # fmt: skip
    draw(picture, tracked, flown)
    print(f"picture: {picture}")
    better = np.linalg.norm(most["pd_gravity"]) / np.linalg.norm(most["computed_torque"])
    moved = np.linalg.norm(positions[-1])
    return 0 if better > 10 and moved > 1e-4 and np.abs(momenta).max() < 1e-6 else 1
