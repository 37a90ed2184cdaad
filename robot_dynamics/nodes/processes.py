"""Nodes as processes of their own, from inside and from outside, and calls to them that end."""

import argparse
import inspect
import logging
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path

import rclpy
import yaml
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from robot_dynamics.codegen.jit import background
from robot_dynamics.errors import RobotDynamicsError, describe_unknown_name
from robot_dynamics.nodes.middleware import shared_memory, without_shared_memory
from robot_dynamics.version import package_version

# A server can get the first request of a client before it has found where that client listens. The middleware then
# drops the answer, so a first question that is not answered in this time [s] is asked again.
DISCOVERY = 2.0
RCLPY_PARAMETERS = ("use_sim_time", "start_type_description_service")  # parameters that any node has


def make_events_executor():
    """The quickest executor that this rclpy has: EventsExecutor from 7.1.4 on."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        get_logger("robot_dynamics").warning(
            "this rclpy has no EventsExecutor, which is there from 7.1.4 on: SingleThreadedExecutor takes its place, "
            "and each message takes about twice as long"
        )
        return SingleThreadedExecutor()
    return EventsExecutor()


def run_node(make_node, arguments=None, executor=SingleThreadedExecutor, udp_only=False):
    """Be the process of one node: make it, spin it, and end cleanly on SIGINT or SIGTERM.

    make_node: a class, whose docstring is what --help says, or a function. executor: makes what spins it. udp_only:
    whether shared memory, by which another process can block it, is kept out of its middleware.
    Arguments and parameter files that ROS refuses, and values of parameters that the node does, are told in a line and
    end the process with status 1; what is no argument of ROS is refused as well. Signals are not left to rclpy: its
    handler shuts the context down in a thread of its own, and where that meets the shutdown here, the process ends with
    an error.
    """
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    command = sys.argv if arguments is None else [sys.argv[0], *arguments]
    program = Path(command[0])
    name = program.parent.name if program.stem == "__main__" else program.stem
    parser = argparse.ArgumentParser(
        prog=name,
        usage="%(prog)s [--help] [--version] [--ros-args -p NAME:=VALUE ... -r OLD:=NEW ... --params-file FILE]",
        description=inspect.getdoc(make_node),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {package_version()}")
    try:
        with without_shared_memory() if udp_only else nullcontext():
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
            _, others = parser.parse_known_args(remove_ros_args(command)[1:])
            if others:
                text = f"unrecognized arguments: {' '.join(others)}; parameters and remappings go behind --ros-args"
                parser.error(text)
            node = make_node()
    except (RuntimeError, ParameterException, RobotDynamicsError) as error:  # the first two are rclpy's
        sys.exit(f"{name}: {error}")
    _warn_of_parameters_that_nobody_reads(node)
    if udp_only:
        _warn_of_shared_memory(node)
    executor = executor()
    executor.add_node(node)
    try:
        while not stopped.is_set():
            executor.spin_once(timeout_sec=0.2)
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):  # asked once more while it ends, it still ends cleanly
            signal.signal(number, signal.SIG_IGN)
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()
    _leave_compilers_behind()


def _warn_of_parameters_that_nobody_reads(node):
    """rclpy takes any name on a command line and in a file, and says nothing of one that is misspelt."""
    known = [name for name in node.list_parameters([], 0).names if name not in RCLPY_PARAMETERS]
    told = getattr(node, "_parameter_overrides", {})  # rclpy has no public way to them
    for name in told:
        if not node.has_parameter(name) and name not in RCLPY_PARAMETERS and not name.startswith("qos_overrides."):
            node.get_logger().warning(f"{describe_unknown_name('parameter', name, known)} Nothing reads it")


def _warn_of_shared_memory(node):
    segments = shared_memory()
    if segments:
        node.get_logger().warning(
            f"the middleware uses shared memory ({segments[0]}): a process that is stopped or killed while it has "
            "locked it can keep this node from sending for a second. This node uses UDP alone where neither a profile "
            "of Fast DDS nor FASTDDS_BUILTIN_TRANSPORTS is set. In a profile, useBuiltinTransports false and a "
            "transport of type UDPv4 do it, where ROS_AUTOMATIC_DISCOVERY_RANGE is not LOCALHOST"
        )


def _leave_compilers_behind():
    """End this process at once, with success, where a model is being compiled: Python would wait for its thread, some
    seconds for a large robot, and nobody will ask for the model. What programs are kept is written whole or not."""
    if any(thread.name == background.THREAD_NAME for thread in threading.enumerate()):
        logging.shutdown()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


@contextmanager
def running_node(executable, parameters=None, namespace="/", environment=None, log=None, remappings=None):
    """Run a node of this package in a process of its own; it is gone when the block ends, whatever happens in it.

    executable: name of its module in robot_dynamics.nodes. parameters: values by name. environment: variables beside
    those of this process. log: an open file that takes what it prints; None: printed here. remappings: {name: new}.

    Yields the subprocess.Popen.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "parameters.yaml"
        file.write_text(yaml.safe_dump({"/**": {"ros__parameters": parameters or {}}}))
        command = [sys.executable, "-m", f"robot_dynamics.nodes.{executable}", "--ros-args"]
        command += ["-r", f"__ns:={namespace}", "--params-file", str(file)]
        for old, new in (remappings or {}).items():
            command += ["-r", f"{old}:={new}"]
        process = subprocess.Popen(
            command,
            env={**os.environ, **(environment or {})},
            stdout=log,
            stderr=log,
            start_new_session=True,  # Ctrl-C in a terminal reaches this process, which then ends the node
        )
        try:
            yield process
        finally:
            terminate_process(process)


def terminate_process(process, patience=20.0):
    """Terminate a process, and kill it where that does not end it within `patience` seconds."""
    deadline = time.monotonic() + patience
    while process.poll() is None:
        process.send_signal(signal.SIGTERM if time.monotonic() < deadline else signal.SIGKILL)
        with suppress(subprocess.TimeoutExpired):
            process.wait(1.0)


class ServiceClient:
    """Calls services from a node of its own, and waits for each answer for a stated time."""

    def __init__(self, name="caller", namespace="/", context=None):
        self.node = rclpy.create_node(name, namespace=namespace, context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self._clients, self._heard = {}, set()

    def call(self, kind, service, request, timeout=30.0):
        """The response of a service. Raises TimeoutError where none came in `timeout` seconds."""
        deadline = time.monotonic() + timeout
        client = self._clients.get(service)
        if client is None:
            client = self._clients[service] = self.node.create_client(kind, service)
        if not client.wait_for_service(timeout):
            raise TimeoutError(f"service {service} is not there after {timeout} s")
        asked, patience, future = time.monotonic(), DISCOVERY, client.call_async(request)
        while not future.done():
            now = time.monotonic()
            if now > deadline:
                client.remove_pending_request(future)
                raise TimeoutError(f"service {service} did not answer within {timeout} s")
            if service not in self._heard and now > asked + patience:
                client.remove_pending_request(future)
                asked, patience, future = now, 2 * patience, client.call_async(request)
            self._executor.spin_once(timeout_sec=0.1)
        self._heard.add(service)
        return future.result()

    def set_parameters(self, node_name, values, timeout=30.0):
        """Set parameters of a node all at once. Returns what it says: successful, reason."""
        request = SetParametersAtomically.Request()
        request.parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        return self.call(SetParametersAtomically, f"{node_name}/set_parameters_atomically", request, timeout).result

    def spin(self, seconds):
        """Let subscriptions of the node have their messages for that long."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.05)

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()
