"""Processes with clients of a service ~/inverse_dynamics_batch, each of which waits for one response after another.

`measure_clients` starts them. Each client has a node, a participant of DDS if wanted, and a motion of its own. It
compares the efforts of each response with those of the recursion, so that it notices a response to another one.

The clients of a process have one executor, which takes responses in the order in which they come: threads would wait
for each other. Clients as in the documentation of rclpy, with an executor and a thread for each, are there to compare.
"""

import json
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.nodes.client import DISCOVERY_TIME
from robot_dynamics.nodes.events_executor import make_executor
from robot_dynamics.nodes.qos import SERVICE_QOS
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


class Load:
    """Requests of a client, and the efforts that belong to them.

    Parameters
    ----------
    index : of the client, the seed of its motion.
    shares : {number of points: part of the requests}.
    """

    def __init__(self, index, shares):
        self._rng = np.random.default_rng(index)
        self._counts, self._shares = list(shares), list(shares.values())
        dynamics = Dynamics(load_robot("panda"), compiled=False)
        self._requests = {}
        for count in self._counts:
            q, qd, qdd = self._rng.uniform(-1, 1, (3, count, len(dynamics.joint_names)))
            request = InverseDynamicsBatch.Request(count=count, joint_names=dynamics.joint_names)
            request.positions, request.velocities, request.accelerations = map(np.ravel, (q, qd, qdd))
            self._requests[count] = request, dynamics.inverse(q, qd, qdd)

    def next_count(self):
        """Draw a number of points."""
        return int(self._rng.choice(self._counts, p=self._shares))

    def request(self, count):
        """Return the request of a number of points."""
        return self._requests[count][0]

    def is_wrong(self, count, response):
        """Return whether the efforts of a response are not those of the request of a number of points."""
        efforts = self._requests[count][1]
        size = min(efforts.size, len(response.efforts))  # an empty response is as wrong as one of zeros
        difference = np.abs(np.asarray(response.efforts)[:size] - efforts.ravel()[:size])
        return bool(size < efforts.size or not difference.max() < 1e-8)


class EventClient:
    """A client that sends the next request when it has the response to the last one, in the executor of its process.

    Attributes
    ----------
    first : time from its start to the first response [s], or None.
    waits : [(number of points, wait [s], or None if there was no response, time of the request [s])], of requests
        between `start_time` and `end_time`.
    wrong : number of responses whose efforts are not those of the request.
    """

    def __init__(self, index, context, service, shares):
        self.node = rclpy.create_node(f"client_{index}", context=context)
        self.first = None
        self.waits = []
        self.wrong = 0
        self.start_time, self.end_time = float("inf"), float("inf")
        self._client = self.node.create_client(InverseDynamicsBatch, service, qos_profile=SERVICE_QOS)
        self._load = Load(index, shares)
        self._began = time.monotonic()
        self._is_going = False
        self._sent = None  # (number of points, time, future) of the request that has no response yet

    @property
    def is_waiting(self):
        """Whether a request has no response yet."""
        return self._sent is not None

    def go(self, start_time, end_time):
        """Send requests until a time, and keep the waits from another one on."""
        self.start_time, self.end_time = start_time, end_time
        self._is_going = True
        self._send(self._load.next_count())

    def check(self):
        """Send the first request again that had no response, and give up later ones."""
        if self._sent is None:
            if self.first is None and self._client.service_is_ready():
                self._send(1)
            return
        count, sent, future = self._sent
        waited = time.monotonic() - sent
        if self.first is None and waited > DISCOVERY_TIME:  # the server had not discovered this client
            self._client.remove_pending_request(future)
            self._send(1)
        elif waited > PATIENCE:
            self._client.remove_pending_request(future)
            self._keep(count, None, sent)
            self._continue()

    def _send(self, count):
        future = self._client.call_async(self._load.request(count))
        self._sent = count, time.monotonic(), future
        future.add_done_callback(self._receive)

    def _receive(self, future):
        now = time.monotonic()
        count, sent, expected = self._sent
        if future is not expected:
            return
        self.wrong += self._load.is_wrong(count, future.result())
        if self.first is None:
            self.first = now - self._began
        else:
            self._keep(count, now - sent, sent)
        self._continue()

    def _keep(self, count, wait, sent):
        if self.start_time < sent < self.end_time:
            self.waits.append((count, wait, sent))

    def _continue(self):
        self._sent = None
        if self._is_going and time.monotonic() < self.end_time:
            self._send(self._load.next_count())

    def close(self):
        """Destroy the node."""
        self.node.destroy_node()


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
    """A thread with a PlainClient, which calls the service again and again after `go`, until a time.

    Attributes
    ----------
    first, waits, wrong : as of EventClient.
    """

    def __init__(self, index, context, service, shares, depth):
        super().__init__(daemon=True)
        self.first = None
        self.waits = []
        self.wrong = 0
        self.is_ready = threading.Event()
        self._may_go = threading.Event()
        self._times = None
        self._service = service
        self._client = PlainClient(f"client_{index}", context, depth)
        self._load = Load(index, shares)

    def go(self, start_time, end_time):
        """Send requests until a time, and keep the waits from another one on."""
        self._times = start_time, end_time
        self._may_go.set()

    def run(self):
        try:
            began = time.monotonic()
            self._call(1, START_PATIENCE)
            self.first = time.monotonic() - began
            self.is_ready.set()
            self._may_go.wait()
            start_time, end_time = self._times
            while (sent := time.monotonic()) < end_time:
                count = self._load.next_count()
                try:
                    self._call(count, PATIENCE)
                except TimeoutError:
                    self.waits.append((count, None, sent))
                else:
                    if sent > start_time:
                        self.waits.append((count, time.monotonic() - sent, sent))
        finally:
            self.is_ready.set()

    def _call(self, count, timeout):
        response = self._client.call(InverseDynamicsBatch, self._service, self._load.request(count), timeout)
        self.wrong += self._load.is_wrong(count, response)

    def close(self):
        """Destroy the node."""
        self._client.close()


def run_events(clients, executor, is_over):
    """Run the clients of a process until a condition is true."""
    while not is_over():
        next_check = time.monotonic() + 0.1
        for client in clients:
            client.check()
        while (remaining := next_check - time.monotonic()) > 0:
            executor.spin_once(timeout_sec=remaining)


def run_clients(plan):
    """The process of some clients: print "ready", go at a line on stdin, print their waits, and end when stdin does."""
    shares = MIXED_SIZES if plan["mixed"] else ONE_SIZE
    contexts = [rclpy.Context() for _ in range(len(plan["indices"]) if plan["participants"] else 1)]
    for context in contexts:
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
    arguments = [
        (index, contexts[k % len(contexts)], plan["service"], shares) for k, index in enumerate(plan["indices"])
    ]
    if plan["depth"]:
        clients = [ClientThread(*values, plan["depth"]) for values in arguments]
        for client in clients:
            client.start()
        for client in clients:
            client.is_ready.wait()
    else:
        clients = [EventClient(*values) for values in arguments]
        executor = make_executor(contexts[0])
        for client in clients:
            executor.add_node(client.node)
        patience = time.monotonic() + START_PATIENCE
        run_events(clients, executor, lambda: all(client.first for client in clients) or time.monotonic() > patience)
    print("ready", flush=True)
    start_time, end_time = json.loads(sys.stdin.readline())
    for client in clients:
        client.go(start_time, end_time)
    if plan["depth"]:
        for client in clients:
            client.join()
    else:
        is_over = lambda: time.monotonic() > end_time and not any(client.is_waiting for client in clients)  # noqa: E731
        run_events(clients, executor, is_over)
    print(json.dumps([[client.first, client.waits, client.wrong] for client in clients]), flush=True)
    sys.stdin.read()  # the end of a client, which the middleware announces to all, disturbs those that wait
    for client in clients:
        client.close()
    for context in contexts:
        rclpy.shutdown(context=context)


def measure_clients(service, count, processes, seconds, mixed=False, depth=None, participants=True):
    """Let clients call a service for a time.

    Parameters
    ----------
    processes : that the clients are divided among.
    mixed : whether requests have 1, 100 or 5000 points; else all have one.
    depth : of plain clients of rclpy, each in a thread; None: the clients of a process have one EventsExecutor.
    participants : whether each client has a participant of DDS; else those of a process share one.

    Returns
    -------
    list
        For each client (time to the first response, waits, wrong responses) as in `EventClient`.
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
        start_time = time.monotonic() + WARM_UP  # a clock that all processes share
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


def responses_meanwhile(clients):
    """Return for each wait the number of responses that all clients received during it: it tells who is preferred.

    Parameters
    ----------
    clients : from `measure_clients`.
    """
    waits = [(sent, sent + wait) for _, waits, _ in clients for _, wait, sent in waits if wait is not None]
    sent, received = np.array(waits).T
    ends = np.sort(received)
    return np.searchsorted(ends, received) - np.searchsorted(ends, sent)


if __name__ == "__main__":
    run_clients(json.loads(sys.argv[1]))
