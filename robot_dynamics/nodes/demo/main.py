"""The demo: a dynamics_server in a process of its own serves the Panda; this process asks it over ROS 2, prints what it
answers and draws a picture of it. Then simulated robots move under computed_torque (demo_closed_loop)."""

import argparse
import os
import signal
import sys
from pathlib import Path

import matplotlib
import numpy as np
import rclpy
from builtin_interfaces.msg import Duration
from rclpy.signals import SignalHandlerOptions
from trajectory_msgs.msg import JointTrajectoryPoint

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.model.loading import load_robot
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.nodes.processes import running_node
from robot_dynamics.version import package_version
from robot_dynamics_interfaces.srv import DirectDynamics, DynamicsTerms, InverseDynamics

matplotlib.use("Agg")  # no screen is needed
from matplotlib import pyplot

from robot_dynamics.nodes.demo import closed_loop

START = np.array([-0.9, -0.6, 0.4, -2.4, 0.5, 1.2, -0.8])
GOAL = np.array([0.9, 0.5, -0.4, -1.2, -0.6, 2.6, 0.8])
DURATION, POINTS = 1.6, 401  # [s]
PAYLOAD_LINK, PAYLOAD_MASS, PAYLOAD_HEIGHT = "panda_link8", 2.0, 0.1  # [kg], [m] beyond the flange


def quintic_motion():
    """Times (N,) [s] and positions, velocities, accelerations (N, 7) of a quintic from START to GOAL, rest to rest."""
    time = np.linspace(0, DURATION, POINTS)
    s = (time / DURATION)[:, None]
    way = GOAL - START
    return (
        time,
        START + way * (10 * s**3 - 15 * s**4 + 6 * s**5),
        way * (30 * s**2 - 60 * s**3 + 30 * s**4) / DURATION,
        way * (60 * s - 180 * s**2 + 120 * s**3) / DURATION**2,
    )


def points(time, **fields):
    """JointTrajectoryPoints from arrays (N, n) by field."""
    made = []
    for k, seconds in enumerate(time):
        ns = round(seconds * 1e9)
        point = JointTrajectoryPoint(time_from_start=Duration(sec=ns // 10**9, nanosec=ns % 10**9))
        for field, values in fields.items():
            setattr(point, field, values[k].tolist())
        made.append(point)
    return made


class DemoClient:
    """Asks the server of the demo, and stops where an answer is no success."""

    def __init__(self, client, server, joint_names):
        self._caller, self._server, self.joint_names = client, server, joint_names

    def _ask(self, kind, service, request):
        response = self._caller.call(kind, f"{self._server}/{service}", request)
        if not response.success:
            raise RobotDynamicsError(f"{service}: {response.message}")
        return response

    def efforts(self, time, q, qd, qdd):
        fields = {"positions": q, "velocities": qd, "accelerations": qdd}
        return self._complete(InverseDynamics, "inverse_dynamics", "effort", time, fields)

    def accelerations(self, time, q, qd, efforts):
        fields = {"positions": q, "velocities": qd, "effort": efforts}
        return self._complete(DirectDynamics, "direct_dynamics", "accelerations", time, fields)

    def _complete(self, kind, service, asked, time, fields):
        """What is asked for, (N, n), at points with these fields."""
        request = kind.Request()
        request.trajectory.joint_names = self.joint_names
        request.trajectory.points = points(time, **fields)
        answer = self._ask(kind, service, request)
        return np.array([getattr(point, asked) for point in answer.trajectory.points])

    def terms(self, q, qd):
        request = DynamicsTerms.Request(joint_names=self.joint_names)
        request.state = JointTrajectoryPoint(positions=q.tolist(), velocities=qd.tolist())
        return self._ask(DynamicsTerms, "dynamics_terms", request)

    def set_payload(self, link, mass, height):
        payload = {"payload.link": link, "payload.mass": mass, "payload.first_moments": [0.0, 0.0, mass * height]}
        payload["payload.inertia"] = [mass * height**2, 0.0, 0.0, mass * height**2, 0.0, 0.0]
        result = self._caller.set_parameters(self._server, payload)
        if not result.successful:
            raise RobotDynamicsError(result.reason)


def run(client, server, picture):
    robot = load_robot("panda")
    asker = DemoClient(client, server, [joint.name for joint in robot.joints])
    limits = np.array([joint.limits.effort for joint in robot.joints])
    time, q, qd, qdd = quintic_motion()

    empty = asker.efforts(time, q, qd, qdd)
    back = asker.accelerations(time, q, qd, empty)
    middle = POINTS // 2
    terms = asker.terms(q[middle], qd[middle])
    asker.set_payload(PAYLOAD_LINK, PAYLOAD_MASS, PAYLOAD_HEIGHT)
    loaded = asker.efforts(time, q, qd, qdd)

    print(f"\n{POINTS} points of a motion of {DURATION} s, asked of {server}/inverse_dynamics [N m]\n")
    print("joint          peak torque   gravity, half way   Coriolis, half way   peak with 2 kg   limit")
    for k, name in enumerate(asker.joint_names):
        print(
            f"{name:<14} {np.abs(empty[:, k]).max():11.2f} {terms.gravity[k]:19.2f} {terms.coriolis[k]:20.2f} "
            f"{np.abs(loaded[:, k]).max():16.2f} {limits[k]:7.0f}"
        )
    error = np.abs(back - qdd).max()
    print(f"\ndirect_dynamics gives the accelerations back to {error:.1e} rad/s²")
    draw(picture, time, empty, loaded, asker.joint_names)
    print(f"picture: {picture}")
    return 0 if error < 1e-6 else 1


def draw(picture, time, empty, loaded, joint_names):
    figure, axes = pyplot.subplots(2, 4, figsize=(11, 5), sharex=True, layout="constrained")
    for k, (axis, name) in enumerate(zip(axes.flat, joint_names, strict=False)):
        axis.plot(time, empty[:, k], label="empty")
        axis.plot(time, loaded[:, k], "--", label=f"with {PAYLOAD_MASS:g} kg at the flange")
        axis.set_title(name, fontsize=9)
        axis.grid(alpha=0.3)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    axes.flat[-1].axis("off")
    axes.flat[-1].legend(handles, labels, loc="center")
    figure.supxlabel("time [s]")
    figure.supylabel("torque [N m]")
    figure.suptitle("Franka Panda: joint torques of one motion, answered by dynamics_server")
    figure.savefig(picture, dpi=110)
    pyplot.close(figure)


def main(arguments=None):
    parser = argparse.ArgumentParser(prog="demo", description=__doc__)
    parser.add_argument("--version", action="version", version=f"%(prog)s {package_version()}")
    parser.add_argument("--picture", default="demo.png", help="where to write the picture (default: %(default)s)")
    parser.add_argument("--tracking", default="demo_tracking.png", help="and that of tracking (default: %(default)s)")
    parser.add_argument("--bag", default="demo_bag", help="folder of the bags, written anew (default: %(default)s)")
    options = parser.parse_args(arguments)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    signals = []

    def interrupt(number, _):
        signals.append(number)
        raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:  # as of nohup
            signal.signal(number, interrupt)
    try:
        return run_demo(options)
    except (RobotDynamicsError, TimeoutError) as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1
    except (KeyboardInterrupt, SystemError):  # where it interrupts compiled code of rclpy, this raises a SystemError
        if not signals:
            raise
        print("demo: interrupted", file=sys.stderr)
        return 128 + signals[0]  # as shells have it


def run_demo(options):
    """Run both parts of the demo. Returns the exit status of the process; no process is left behind."""
    namespace = f"/demo_{os.getpid()}"  # so that two demos do not meet
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    client = ServiceClient("demo", namespace)
    try:
        with running_node("dynamics_server", {"robot_file": "panda"}, namespace):
            asked = run(client, f"{namespace}/dynamics_server", options.picture)
        return asked or closed_loop.run(client, namespace, (START, GOAL, DURATION), options.tracking, Path(options.bag))
    finally:
        client.close()
        rclpy.try_shutdown()
