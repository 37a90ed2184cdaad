"""The second part of the demo: simulated robots under computed_torque, recorded, with a picture of the results.

Both nodes run in processes of their own. A step of the simulator waits for the efforts for its state, so the results do
not depend on the load of the machine.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import MissingPackageError, RobotDynamicsError
from robot_dynamics.model.loading import load_robot
from robot_dynamics.nodes.demo.bag_recorder import BagRecorder
from robot_dynamics.nodes.demo.closed_loop_client import ClosedLoopClient
from robot_dynamics.nodes.demo.motion import Motion
from robot_dynamics.nodes.processes import running_node
from robot_dynamics.plots.plot_style import PAGE_WIDTH, new_figure, plot_style, save_figure
from robot_dynamics.recordings.bags import import_rosbag2

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.nodes.client import ServiceClient

FREQUENCY = 3.0  # [Hz], critically damped
GAINS = {"kp": [float((2 * np.pi * FREQUENCY) ** 2)], "kd": [float(4 * np.pi * FREQUENCY)]}
FLYING_ARM_MOTION = Motion(np.zeros(6), np.array([1.2, -1.4, 1.6, 0.8, 0.6, -1.0]), 2.0)
MODES = {"computed_torque": "with the model: A(q)(q̈d + kd ė + kp e) + H", "pd_gravity": "without: PD and gravity"}


@dataclass(frozen=True, eq=False)
class BaseMotion:
    """The motion of the base of the free-flying arm.

    Attributes
    ----------
    times : (N,) [s].
    positions : (N, 3) [m].
    angles : (N,) of its rotation [rad].
    momenta : (N, 6) of the robot, linear and angular, in the world and about its origin.
    """

    times: Array
    positions: Array
    angles: Array
    momenta: Array


@contextmanager
def running_closed_loop(
    client: ServiceClient, robot: str, namespace: str, simulator: Mapping[str, object]
) -> Iterator[ClosedLoopClient]:
    """Run the simulator, with further parameters, and computed_torque for a robot."""
    common = {"robot_file": robot, **{name: value for name, value in simulator.items() if name == "gravity"}}
    controller = {**common, **GAINS, "use_sim_time": True, "ramp_time": 0.0, "deadline": 1.0}
    # time stands still until the efforts for a state come, so none are late
    simulation = {**common, **simulator, "wait_for_commands": "each", "real_time_factor": 0.0, "odom_rate": 100.0}
    clock = {"/clock": "clock"}  # in the namespace, apart from that of another demo
    efforts = {"~/effort": "computed_torque/effort", **clock}  # with the stamps of the states that they are for
    loop = ClosedLoopClient(client, namespace, Dynamics(load_robot(robot), compiled=False).joint_names)
    try:
        with (
            running_node("mobile_base_simulator", simulation, namespace, remappings=efforts),
            running_node("computed_torque", controller, namespace, remappings=clock),
        ):
            yield loop
    finally:
        loop.close()


def open_bag_recorder(
    client: ServiceClient, loop: ClosedLoopClient, namespace: str, path: Path
) -> AbstractContextManager[BagRecorder | None]:
    """Return a recorder into a bag, which is replaced if it exists; of None if the package for bags is missing."""
    try:
        import_rosbag2()
    except MissingPackageError as error:
        print(f"no bag is written: {error}")
        return nullcontext()
    if path.exists():
        if {file.suffix for file in path.iterdir()} - {".mcap", ".yaml"}:
            raise RobotDynamicsError(f"{path} is no bag of the demo, which would replace it: name another by --bag")
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


def measure_tracking(
    client: ServiceClient, namespace: str, motion: Motion, bag: Path
) -> dict[str, tuple[Array, Array]]:
    """Return {mode: (times (N,), errors (N, n))} of the Panda in one motion, with the whole model and without."""
    names = [joint.name for joint in load_robot("panda").joints]
    initial = {"initial.joints": names, "initial.positions": motion.start.tolist()}
    errors: dict[str, tuple[Array, Array]] = {}
    with (
        running_closed_loop(client, "panda", namespace, initial) as loop,
        open_bag_recorder(client, loop, namespace, bag) as recorder,
    ):
        for mode in MODES:
            if errors:
                loop.execute_motion(motion.reversed())
            client.set_parameters(f"{namespace}/computed_torque", {"mode": mode})
            start = loop.execute_motion(motion)
            errors[mode] = loop.tracking_errors(motion, start)
            client.set_parameters(f"{namespace}/computed_torque", {"mode": "computed_torque"})
        if recorder is not None:
            print(f"bag: {bag}, {recorder.message_count} messages")
    return errors


def measure_base_motion(client: ServiceClient, namespace: str, bag: Path) -> BaseMotion:
    """Return the motion of the base of the free-flying arm while its arm moves."""
    dynamics = Dynamics(load_robot("free_flying_arm"), compiled=False)
    with (
        running_closed_loop(client, "free_flying_arm", namespace, {"gravity": [0.0, 0.0, 0.0]}) as loop,
        open_bag_recorder(client, loop, namespace, bag),
    ):
        start = loop.execute_motion(FLYING_ARM_MOTION)
    stamps = sorted(ns for ns in loop.base if 1e-9 * ns >= start and ns in loop.states)
    momenta = []
    for ns in stamps:
        position, rotation, twist = loop.base[ns]
        q, qd = loop.states[ns]
        linear, angular = np.split(dynamics.inertia_matrix(q)[:6] @ np.concatenate([twist, qd]), 2)
        linear = rotation.apply(linear)
        momenta.append(np.concatenate([linear, rotation.apply(angular) + np.cross(position, linear)]))
    return BaseMotion(
        times=1e-9 * np.array(stamps) - start,
        positions=np.array([loop.base[ns][0] for ns in stamps]),
        angles=np.array([loop.base[ns][1].magnitude() for ns in stamps]),
        momenta=np.array(momenta),
    )


@plot_style()
def draw(picture: str, errors: Mapping[str, tuple[Array, Array]], base: BaseMotion) -> None:
    """Draw the tracking errors of each mode and the motion of the base into a file."""
    figure = new_figure(PAGE_WIDTH, 3.2)
    left, right = figure.subplots(1, 2)
    for mode, (times, values) in errors.items():
        left.semilogy(times, 1e3 * np.linalg.norm(values, axis=1), label=MODES[mode])
    left.set(title="Franka Panda: tracking error, same gains", xlabel="time [s]", ylabel="|q_d − q| [mrad]")
    for k, axis in enumerate("xyz"):
        right.plot(base.times, 1e3 * base.positions[:, k], label=f"position {axis}")
    angle = right.twinx()
    angle.grid(False)
    angle.spines["right"].set_visible(True)
    angle.plot(base.times, np.degrees(base.angles), color="0.35", linestyle=(0, (1, 1)), label="angle, right axis")
    right.set(title="free-flying arm: its base moves by reaction", xlabel="time [s]", ylabel="position [mm]")
    angle.set_ylabel("angle of rotation [°]")
    below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.2), "ncols": 2}
    left.legend(**{**below, "ncols": 1})
    handles = [*right.get_legend_handles_labels()[0], *angle.get_legend_handles_labels()[0]]
    angle.legend(handles=handles, **below)
    save_figure(figure, picture)


def show_closed_loops(client: ServiceClient, namespace: str, motion: Motion, picture: str, bag: Path) -> int:
    """Print and draw how the Panda tracks and how the free-flying arm moves its base, and record both.

    Returns the exit status: 0 if the model reduces the errors, and momentum is conserved.
    """
    errors = measure_tracking(client, f"{namespace}/arm", motion, bag / "panda")
    print(
        f"\nclosed loop at 1 kHz of simulated time, {FREQUENCY:g} Hz critically damped, "
        f"a motion of {motion.duration} s\n"
    )
    print("largest tracking error [mrad], joint by joint")
    largest = {mode: 1e3 * np.abs(values).max(axis=0) for mode, (_, values) in errors.items()}
    for mode, values in largest.items():
        print(f"  {MODES[mode]:<45}", " ".join(f"{value:8.2f}" for value in values))
    base = measure_base_motion(client, f"{namespace}/space", bag / "free_flying_arm")
    distance = np.linalg.norm(base.positions[-1])
    momentum = np.abs(base.momenta).max()
    print(
        f"\nfree-flying arm: {np.degrees(np.abs(FLYING_ARM_MOTION.goal)).max():.0f}° of its arm move the base by "
        f"{1e3 * distance:.1f} mm and {np.degrees(base.angles[-1]):.2f}°; "
        f"momentum stays below {momentum:.1e} kg m/s, kg m²/s"
    )
    draw(picture, errors, base)
    print(f"picture: {picture}")
    improvement = np.linalg.norm(largest["pd_gravity"]) / np.linalg.norm(largest["computed_torque"])
    return 0 if improvement > 10 and distance > 1e-4 and momentum < 1e-6 else 1
