"""The process of one node: command line, executor, signals, end."""

import argparse
import inspect
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from robot_dynamics.codegen.jit import background
from robot_dynamics.errors import RobotDynamicsError, describe_unknown_name
from robot_dynamics.nodes.events_executor import make_executor
from robot_dynamics.nodes.log_folder import ensure_log_folder
from robot_dynamics.nodes.middleware import shared_memory, without_shared_memory
from robot_dynamics.nodes.parameter_requests import WORKER_THREAD
from robot_dynamics.nodes.processes import is_orphaned
from robot_dynamics.nodes.security import check_security_strategy, security_hint
from robot_dynamics.version import package_version

RCLPY_PARAMETERS = ("use_sim_time", "start_type_description_service")  # that every node has
LATER_PARAMETERS = ("qos_overrides.", "constraints.")  # beginnings of names that are declared later, or by rclpy
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def make_events_executor() -> Executor:
    """Return an EventsExecutor, which rclpy has from 7.1.4 on, else a SingleThreadedExecutor with a warning."""
    executor = make_executor()
    if isinstance(executor, SingleThreadedExecutor):
        get_logger("robot_dynamics").warning(
            "this rclpy has no EventsExecutor (added in 7.1.4): SingleThreadedExecutor is used instead, and each "
            "message takes about twice as long"
        )
    return executor


def run_node(
    make_node: Callable[[], Node],
    arguments: list[str] | None = None,
    executor: Callable[[], Executor] = SingleThreadedExecutor,
    transports: Callable[[], AbstractContextManager[None]] = nullcontext,
) -> None:
    """Create a node, spin it, and end cleanly on SIGINT or SIGTERM.

    Invalid ROS arguments, parameter files and parameter values end the process with one line and status 1; arguments
    that are not of ROS are refused as well. rclpy installs no signal handlers: its handler shuts the context down in
    another thread, and if that coincides with the shutdown here, the process ends with an error.

    Parameters
    ----------
    make_node : class, whose docstring is the text of --help, or function.
    arguments : of the command line; None: those of this process.
    executor : class or function that makes the executor.
    transports : context manager of `middleware` that chooses the transports of the middleware.
    """
    stopped = threading.Event()
    for number in STOP_SIGNALS:
        signal.signal(number, lambda *_: stopped.set())
    command = sys.argv if arguments is None else [sys.argv[0], *arguments]
    parser = _argument_parser(command[0], make_node)
    try:
        check_security_strategy(os.environ)
        ensure_log_folder()
        with transports():
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
            _, unknown = parser.parse_known_args(remove_ros_args(command)[1:])
            if unknown:
                parser.error(
                    f"unrecognized arguments: {' '.join(unknown)}; put parameters and remappings after --ros-args"
                )
            node = make_node()
    except (RuntimeError, ParameterException, RobotDynamicsError) as error:  # the first two come from rclpy
        sys.exit(f"{parser.prog}: {error}{security_hint(str(error))}")
    _warn_of_unknown_parameters(node)
    if transports is without_shared_memory:
        _warn_of_shared_memory(node)
    _spin(node, executor(), stopped)
    _exit_without_compilers()


def _argument_parser(path: str, make_node: Callable[[], Node]) -> argparse.ArgumentParser:
    program = Path(path)
    parser = argparse.ArgumentParser(
        prog=program.parent.name if program.stem == "__main__" else program.stem,
        usage="%(prog)s [--help] [--version] [--ros-args -p NAME:=VALUE ... -r OLD:=NEW ... --params-file FILE]",
        description=inspect.getdoc(make_node),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {package_version()}")
    return parser


def _spin(node: Node, executor: Executor, stopped: threading.Event) -> None:
    executor.add_node(node)
    try:
        while not stopped.is_set() and not is_orphaned():
            executor.spin_once(timeout_sec=0.2)
    finally:
        for number in STOP_SIGNALS:  # a second signal does not interrupt the clean end
            signal.signal(number, signal.SIG_IGN)
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()


def _warn_of_unknown_parameters(node: Node) -> None:
    """Warn of parameters that the node has not declared: rclpy accepts misspelt names without a message."""
    known = [name for name in node.list_parameters([], 0).names if name not in RCLPY_PARAMETERS]
    overrides = getattr(node, "_parameter_overrides", {})  # rclpy has no public access to them
    for name in overrides:
        if not node.has_parameter(name) and name not in RCLPY_PARAMETERS and not name.startswith(LATER_PARAMETERS):
            node.get_logger().warning(f"{describe_unknown_name('parameter', name, known)} Nothing reads it")


def _warn_of_shared_memory(node: Node) -> None:
    segments = shared_memory()
    if segments:
        node.get_logger().warning(
            f"the middleware uses shared memory ({segments[0]}): a process that is stopped or killed while it has "
            "locked it can keep this node from sending for a second. This node uses UDP alone where neither a profile "
            "of Fast DDS nor FASTDDS_BUILTIN_TRANSPORTS is set. In a profile, useBuiltinTransports false and a "
            "transport of type UDPv4 do it, where ROS_AUTOMATIC_DISCOVERY_RANGE is not LOCALHOST"
        )


def _exit_without_compilers() -> None:
    """End this process at once, with success, if a model is being compiled or a robot loaded.

    Python would wait for the thread of the compiler or the worker, some seconds for a large robot, for nothing.
    Files of the program cache are written whole or not at all.
    """
    if any(thread.name in (background.THREAD_NAME, WORKER_THREAD) for thread in threading.enumerate()):
        logging.shutdown()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)
