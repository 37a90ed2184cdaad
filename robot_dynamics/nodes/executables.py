"""The executables of the nodes. They import ROS when they run; without it they end with a line that names a remedy."""

import sys
from importlib import import_module

from robot_dynamics.errors import INTERRUPTED_EXIT_STATUS
from robot_dynamics.optional_packages import missing_package_error

ROS_INSTALLATION_HINT = (
    "install ROS 2 Jazzy and source its setup.bash, or install ROS from PyPI: pip install 'robot_dynamics[ros]'. The "
    "command robot-dynamics and the Python library need no ROS"
)
ROS_MODULES = ("rclpy", "rcl_interfaces", "robot_dynamics_interfaces", "builtin_interfaces", "rosidl_parser")


def run_executable(name: str) -> int | None:
    """Import robot_dynamics.nodes.NAME, run its `main`, and return the result.

    If a module is missing, or the user interrupts the import, the process ends with one line on stderr.
    """
    try:
        main = import_module(f"robot_dynamics.nodes.{name}.__main__").main
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing in ROS_MODULES or missing.endswith("_msgs") or missing.endswith("_srvs"):
            sys.exit(f"{name}: {error.msg} in {sys.executable}: {ROS_INSTALLATION_HINT}")
        sys.exit(f"{missing_package_error(error, name)} (for {sys.executable})")
    except KeyboardInterrupt:
        print(f"{name}: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED_EXIT_STATUS)
    status: int | None = main()
    return status


def computed_torque() -> int | None:
    """Run the node computed_torque."""
    return run_executable("computed_torque")


def dynamics_server() -> int | None:
    """Run the node dynamics_server."""
    return run_executable("dynamics_server")


def demo() -> int | None:
    """Run the demo."""
    return run_executable("demo")


def joint_state_completer() -> int | None:
    """Run the node joint_state_completer."""
    return run_executable("joint_state_completer")


def mobile_base_simulator() -> int | None:
    """Run the node mobile_base_simulator."""
    return run_executable("mobile_base_simulator")


def payload_identifier() -> int | None:
    """Run the node payload_identifier."""
    return run_executable("payload_identifier")


def replay_check() -> int | None:
    """Run the node replay_check."""
    return run_executable("replay_check")


def contact_monitor() -> int | None:
    """Run the node contact_monitor."""
    return run_executable("contact_monitor")
