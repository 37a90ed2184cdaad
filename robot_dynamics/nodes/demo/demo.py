"""The demo: nodes in processes of their own, called over ROS 2, with tables and pictures of the results.

First dynamics_server computes joint torques of a motion of the Panda; then simulated robots move under computed_torque.
"""

import argparse
import os
import signal
import sys
from pathlib import Path
from types import FrameType

import numpy as np
import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.nodes.demo.closed_loop import show_closed_loops
from robot_dynamics.nodes.demo.motion import Motion
from robot_dynamics.nodes.demo.service_demo import show_services
from robot_dynamics.nodes.log_folder import ensure_log_folder
from robot_dynamics.nodes.processes import running_node
from robot_dynamics.version import package_version

PANDA_MOTION = Motion(
    start=np.array([-0.9, -0.6, 0.4, -2.4, 0.5, 1.2, -0.8]),
    goal=np.array([0.9, 0.5, -0.4, -1.2, -0.6, 2.6, 0.8]),
    duration=1.6,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the demo, and return the exit status."""
    parser = argparse.ArgumentParser(prog="demo", description=__doc__)
    parser.add_argument("--version", action="version", version=f"%(prog)s {package_version()}")
    parser.add_argument("--picture", default="demo.png", help="file of the picture of torques (default: %(default)s)")
    parser.add_argument(
        "--tracking", default="demo_tracking.png", help="file of the picture of tracking (default: %(default)s)"
    )
    parser.add_argument("--bag", default="demo_bag", help="folder of the bags, replaced (default: %(default)s)")
    options = parser.parse_args(arguments)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    received_signals: list[int] = []

    def interrupt(number: int, _: FrameType | None) -> None:
        received_signals.append(number)
        raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:  # nohup ignores SIGHUP
            signal.signal(number, interrupt)
    try:
        return run_demo(options.picture, options.tracking, Path(options.bag))
    except (RobotDynamicsError, TimeoutError) as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1
    except (KeyboardInterrupt, SystemError):  # an interrupt of compiled code of rclpy becomes a SystemError
        if not received_signals:
            raise
        print("demo: interrupted", file=sys.stderr)
        return 128 + received_signals[0]  # the convention of shells


def run_demo(picture: str, tracking_picture: str, bag: Path) -> int:
    """Run both parts, and return the exit status. All child processes have ended afterwards."""
    namespace = f"/demo_{os.getpid()}"  # two demos do not interfere
    ensure_log_folder()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    client = ServiceClient("demo", namespace)
    try:
        with running_node("dynamics_server", {"robot_file": "panda"}, namespace):
            status = show_services(client, f"{namespace}/dynamics_server", PANDA_MOTION, picture)
        return status or show_closed_loops(client, namespace, PANDA_MOTION, tracking_picture, bag)
    finally:
        client.close()
        try_shutdown()
