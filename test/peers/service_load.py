"""Processes with clients of a service ~/inverse_dynamics_batch, each of which waits for one response after another.

`measure_clients` starts them. Each client has a node, an executor and a motion of its own, in a thread. It compares the
efforts of each response with those of the recursion, so that it notices a response to another one.
"""

import json
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics_interfaces.srv import InverseDynamicsBatch

PATIENCE = 10.0
"""Time [s] after which a request is lost."""
START_PATIENCE = 120.0
"""Time [s] in which the first request must have a response."""
WARM_UP = 2.0
"""Time [s] before the measurement, in which the server compiles the model."""
ONE_SIZE = {1: 1.0}
MIXED_SIZES = {1: 0.8, 100: 0.17, 5000: 0.03}
"""Shares of the requests by their numbers of points."""


class PlainClient:
    """A client as in the documentation of rclpy. It sends the first request again until a response comes."""

    def __init__(self, name, context, depth):
        self.node = rclpy.create_node(name, context=context)
        self._quality_of_service = QoSProfile(depth=depth)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self._client = None

    def call(self, kind, service, request, timeout):
        is_first = self._client is None
        if is_first:
            self._client = self.node.create_client(kind, service, qos_profile=self._quality_of_service)
            self._client.wait_for_service(timeout)
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            future = self._client.call_async(request)
            attempt_end = min(deadline, time.monotonic() + 2.0) if is_first else deadline
            while time.monotonic() < attempt_end:
                self._executor.spin_once(timeout_sec=0.1)
                if future.done():
                    return future.result()
            self._client.remove_pending_request(future)
        raise TimeoutError(service)

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()


class ClientThread(threading.Thread):
    """A client, which calls the service again and again after `go` is set, until `end`.

    Attributes
    ----------
    first : time from its start to the first response [s], or None.
    waits : [(number of points, wait [s], or None if there was no response)] between `start` and `end`.
    wrong : number of responses whose efforts are not those of the request.
    """

    def __init__(self, index, make_client, service, shares):
        super().__init__(daemon=True)
        self.first = None
        self.waits = []
        self.wrong = 0
        self.is_ready = threading.Event()
        self.go = threading.Event()
        self.start_time = self.end_time = 0.0
        self._service = service
        self._make_client = partial(make_client, f"client_{index}")
        self._client = None
        self._rng = np.random.default_rng(index)
        self._counts, self._shares = list(shares), list(shares.values())
        dynamics = Dynamics(load_robot("panda"), compiled=False)
        self._requests = {}
        for count in self._counts:
            q, qd, qdd = self._rng.uniform(-1, 1, (3, count, len(dynamics.joint_names)))
            request = InverseDynamicsBatch.Request(count=count, joint_names=dynamics.joint_names)
            request.positions, request.velocities, request.accelerations = map(np.ravel, (q, qd, qdd))
            self._requests[count] = request, dynamics.inverse(q, qd, qdd)

    def run(self):
        try:
            began = time.monotonic()
            self._client = self._make_client()
            self._call(1, START_PATIENCE)
            self.first = time.monotonic() - began
            self.is_ready.set()
            self.go.wait()
            while (began := time.monotonic()) < self.end_time:
                count = int(self._rng.choice(self._counts, p=self._shares))
                try:
                    self._call(count, PATIENCE)
                except TimeoutError:
                    self.waits.append((count, None))
                else:
                    if began > self.start_time:
                        self.waits.append((count, time.monotonic() - began))
        finally:
            self.is_ready.set()

    def _call(self, count, timeout):
        request, efforts = self._requests[count]
        response = self._client.call(InverseDynamicsBatch, self._service, request, timeout)
        size = min(efforts.size, len(response.efforts))  # an empty response is as wrong as one of zeros
        difference = np.abs(np.asarray(response.efforts)[:size] - efforts.ravel()[:size])
        self.wrong += size < efforts.size or not difference.max() < 1e-8

    def close(self):
        if self._client is not None:
            self._client.close()


def run_clients(plan):
    """The process of some clients: print "ready", go at a line on stdin, print their waits, and end when stdin does."""
    make_client = partial(PlainClient, depth=plan["depth"]) if plan["depth"] else ServiceClient
    shares = MIXED_SIZES if plan["mixed"] else ONE_SIZE
    contexts = [rclpy.Context() for _ in range(len(plan["indices"]) if plan["participants"] else 1)]
    for context in contexts:
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
    threads = [
        ClientThread(index, partial(make_client, context=contexts[k % len(contexts)]), plan["service"], shares)
        for k, index in enumerate(plan["indices"])
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.is_ready.wait()
    print("ready", flush=True)
    start_time, end_time = json.loads(sys.stdin.readline())
    for thread in threads:
        thread.start_time, thread.end_time = start_time, end_time
        thread.go.set()
    for thread in threads:
        thread.join()
    print(json.dumps([[thread.first, thread.waits, thread.wrong] for thread in threads]), flush=True)
    sys.stdin.read()  # the end of a client, which the middleware announces to all, disturbs those that wait
    for thread in threads:
        thread.close()
    for context in contexts:
        rclpy.shutdown(context=context)


def measure_clients(service, count, processes, seconds, mixed=False, depth=None, participants=True):
    """Let clients call a service for a time.

    Parameters
    ----------
    processes : that the clients are divided among.
    mixed : whether requests have 1, 100 or 5000 points; else all have one.
    depth : of plain clients of rclpy; None: clients are ServiceClient.
    participants : whether each client has a participant of DDS; else those of a process share one.

    Returns
    -------
    list
        For each client (time to the first response, waits, wrong responses) as in `ClientThread`.
    """
    with ExitStack() as stack:
        children = []
        for part in np.array_split(np.arange(count), min(processes, count)):
            plan = {"service": service, "indices": part.tolist(), "mixed": mixed}
            plan |= {"depth": depth, "participants": participants}
            command = [sys.executable, str(Path(__file__).resolve()), json.dumps(plan)]
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
            child = stack.enter_context(subprocess.Popen(command, **pipes, text=True))
            stack.callback(child.kill)
            children.append(child)
        for child in children:
            assert child.stdout.readline() == "ready\n", "a process of clients ended"
        start_time = time.monotonic() + WARM_UP
        outputs = []
        for child in children:
            child.stdin.write(json.dumps([start_time, start_time + seconds]) + "\n")
            child.stdin.flush()
        for child in children:
            outputs += json.loads(child.stdout.readline())
        for child in children:
            child.stdin.close()
        for child in children:
            child.wait(60)
    return outputs


if __name__ == "__main__":
    run_clients(json.loads(sys.argv[1]))
