"""Round trips of the services of dynamics_server beside those of an empty node with the same types.

    python benchmarks/services.py                 one point, 10 000 and 100 000 points, and small requests beside large
    python benchmarks/services.py --rounds 3      a short run

The empty node has the same executor and quality of service. It takes the same requests, and sends responses of the same
size, made of zeros before the measurement. Both are called in alternation, so that other work on the machine disturbs
both. A ratio is the median of those of neighbouring calls; in the first column it is that of the minima. Times are end
to end: from the request of a client to its response. Processor time is that of the process of the node.

The wait is that of a client with requests of one point, while another client sends requests of 100 000 points to the
same node.
"""

import argparse
import os
import subprocess
import sys
import time
from array import array
from contextlib import contextmanager
from functools import partial

import numpy as np
import rclpy
from rclpy.node import Node
from tabulate import tabulate
from trajectory_msgs.msg import JointTrajectoryPoint

from robot_dynamics import load_robot
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.nodes.middleware import large_messages
from robot_dynamics.nodes.process_memory import keep_free_memory
from robot_dynamics.nodes.processes import running_node, terminate_process
from robot_dynamics.nodes.qos import SERVICE_QOS
from robot_dynamics.nodes.runner import make_events_executor, run_node
from robot_dynamics_interfaces.srv import (
    DirectDynamics,
    DirectDynamicsBatch,
    DynamicsTerms,
    DynamicsTermsBatch,
    InverseDynamics,
    InverseDynamicsBatch,
)

JOINTS = 7
TERM_SIZES = {"inertia_matrix": JOINTS**2, **dict.fromkeys(("coriolis", "gravity", "friction", "elasticity"), JOINTS)}
MOTION = ("positions", "velocities", "accelerations")
MOST_WAIT = 50.0  # [ms] accepted for a small request beside large ones
NAMESPACES = {"dynamics_server": "/model/dynamics_server", "empty": "/bare/dynamics_server"}
FLAT = (InverseDynamicsBatch, "inverse_dynamics_batch")
TRAJECTORY = (InverseDynamics, "inverse_dynamics")
FLAT_DIRECT = (DirectDynamicsBatch, "direct_dynamics_batch")
FLAT_TERMS = (DynamicsTermsBatch, "dynamics_terms_batch")
DIRECT = (DirectDynamics, "direct_dynamics")
TERMS = (DynamicsTerms, "dynamics_terms")
SERVICES = (FLAT, FLAT_DIRECT, FLAT_TERMS, TRAJECTORY, DIRECT, TERMS)
RESULTS = {  # numbers in a row of each array of a response
    FLAT: {"efforts": JOINTS},
    FLAT_DIRECT: {"accelerations": JOINTS},
    FLAT_TERMS: TERM_SIZES,
    TERMS: TERM_SIZES,
}
CASES = [  # service, points, calls, whether in requests of 1000 points
    *((service, 1, 500, False) for service in SERVICES),
    (FLAT, 1000, 100, False),
    (FLAT, 10_000, 50, True),
    (FLAT, 10_000, 50, False),
    (TRAJECTORY, 10_000, 5, False),
]


class EmptyServer(Node):
    """Answers requests with zeros that were made for the first request of the same size."""

    def __init__(self):
        super().__init__("dynamics_server")
        self._responses = {}
        self.services_kept = [
            self.create_service(service[0], f"~/{service[1]}", partial(self._respond, service), qos_profile=SERVICE_QOS)
            for service in SERVICES
        ]

    def _respond(self, service, request, response):
        count = point_count(service, request)
        if (service, count) not in self._responses:
            self._responses[service, count] = zero_response(response, service, count, request)
        return self._responses[service, count]


def point_count(service, request):
    if service is TERMS:
        return 1
    return len(request.trajectory.points) if service in (TRAJECTORY, DIRECT) else request.count


def zero_response(response, service, count, request):
    """A response of the size of that of dynamics_server."""
    response.success = True
    if service in (TRAJECTORY, DIRECT):
        zeros = [0.0] * JOINTS
        response.trajectory.joint_names = request.trajectory.joint_names
        response.trajectory.points = [
            JointTrajectoryPoint(positions=zeros, velocities=zeros, accelerations=zeros, effort=zeros)
            for _ in range(count)
        ]
        return response
    response.joint_names = request.joint_names
    for field, size in RESULTS[service].items():
        setattr(response, field, array("d", bytes(8 * size * count)))
    return response


def make_request(service, count, names):
    """A request with random motion."""
    motion = np.random.default_rng(0).uniform(-1, 1, (3, count, JOINTS))
    if service in (TRAJECTORY, DIRECT):
        last = "effort" if service is DIRECT else "accelerations"
        request = service[0].Request()
        request.trajectory.joint_names = names
        request.trajectory.points = [
            JointTrajectoryPoint(positions=q, velocities=qd, **{last: row}) for q, qd, row in zip(*motion, strict=True)
        ]
        return request
    request = service[0].Request(joint_names=names)
    if service is TERMS:
        request.state = JointTrajectoryPoint(positions=motion[0, 0], velocities=motion[1, 0])
        return request
    request.count = count
    last = "efforts" if service is FLAT_DIRECT else "accelerations"
    for field, values in zip(("positions", "velocities", last), motion, strict=True):
        if hasattr(request, field):
            setattr(request, field, array("d", values.tobytes()))
    return request


def processor_time(process):
    """Time [s] that a process has had on processors."""
    return time.clock_gettime((~process.pid << 3) | 2)  # the clock of another process, as Linux numbers it


def measure_case(client, processes, service, count, calls, in_parts, names):
    """Rows of the table: times of both nodes, and their ratio."""
    request = make_request(service, count, names)
    kind, name = service
    wall = {node: [] for node in NAMESPACES}
    processor = {node: [] for node in NAMESPACES}
    arrays = np.random.default_rng(0).uniform(-1, 1, (3, count, JOINTS))
    fields = dict(zip(MOTION, arrays, strict=True))
    warm_up = 300 if count == 1 else 3  # calls: they discover the service, and have the model compiled
    for k in range(warm_up + calls):
        for node, namespace in NAMESPACES.items():
            began = processor_time(processes[node])
            started = time.perf_counter()
            if in_parts:
                client.call_batch(kind, f"{namespace}/{name}", names, **fields)
            else:
                assert client.call(kind, f"{namespace}/{name}", request).success
            elapsed = time.perf_counter() - started
            if k >= warm_up:
                wall[node].append(elapsed)
                processor[node].append(processor_time(processes[node]) - began)
        if warm_up - 3 <= k < warm_up:
            time.sleep(1.0)  # for the compiler
    label = f"{name}, call_batch" if in_parts else name
    rows = [
        [label, count, node, *(1e3 * np.percentile(wall[node], (0, 50, 90))), 1e3 * np.median(processor[node])]
        for node in NAMESPACES
    ]
    ours, bare = (np.array(wall[node]) for node in NAMESPACES)
    minimum = ours.min() / bare.min()
    own, other = (np.median(processor[node]) for node in NAMESPACES)
    rows.append([label, count, "ratio", minimum, np.median(ours / bare), None, own / other])
    return rows


def measure_waits(client, node, service, seconds, names):
    """Waits [ms] of another client for one point, while this one sends 100 000 points again and again.

    service: None for call_batch, which sends them in parts.
    """
    request = make_request(service or FLAT, 100_000, names)
    arrays = {name: np.reshape(getattr(request, name), (-1, JOINTS)) for name in MOTION} if service is None else {}
    kind, name = service or FLAT
    command = [sys.executable, __file__, "--small-requests", str(seconds), NAMESPACES[node]]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        process.stdout.readline()  # it has begun
        sent = 0
        while process.poll() is None:
            if service is None:
                client.call_batch(kind, f"{NAMESPACES[node]}/{name}", names, **arrays, timeout=120)
            else:
                assert client.call(kind, f"{NAMESPACES[node]}/{name}", request, timeout=120).success
            sent += 1
        waits = np.fromstring(process.stdout.read(), sep=" ")
    late = int((waits > MOST_WAIT).sum())
    assert len(waits), "the client with small requests ended early"
    return [
        node,
        f"{sent} of {name}" + ("" if service else ", call_batch"),
        len(waits),
        *np.percentile(waits, (50, 99, 100)),
        late,
    ]


def send_small_requests(seconds, namespace):
    """The process of the second client: print the time [ms] of each request."""
    with large_messages():
        rclpy.init(args=[])
        client = ServiceClient("small_requests")
    kind, name = FLAT
    service = f"{namespace}/{name}"
    request = make_request(FLAT, 1, [joint.name for joint in load_robot("panda").joints])
    client.call(kind, service, request)
    print("started", flush=True)
    waits = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        began = time.perf_counter()
        client.call(kind, service, request)
        waits.append(time.perf_counter() - began)
        time.sleep(0.002)
    print(" ".join(f"{1e3 * wait:.3f}" for wait in waits))
    client.close()
    rclpy.shutdown()


@contextmanager
def empty_server():
    """Run the empty node in a process of its own."""
    process = subprocess.Popen([sys.executable, __file__, "--empty", "--ros-args", "-r", "__ns:=/bare"])
    try:
        yield process
    finally:
        terminate_process(process)


def measure(options):
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    names = [joint.name for joint in load_robot("panda").joints]
    with large_messages():
        rclpy.init(args=[])
        client = ServiceClient("services_benchmark")
    with running_node("dynamics_server", {"robot_file": "panda"}, "/model") as server, empty_server() as bare:
        processes = {"dynamics_server": server, "empty": bare}
        rows = []
        cases = [case for case in CASES if case[1] == 1] if options.short else CASES[:1] if options.waits else CASES
        for service, count, calls, in_parts in cases:
            calls = max(3, calls * options.rounds // 10)
            rows += measure_case(client, processes, service, count, calls, in_parts, names)
        header = ["service", "points", "node", "min [ms]", "p50 [ms]", "p90 [ms]", "processor [ms]"]
        print(tabulate(rows, header, floatfmt=".3f", tablefmt="github"))
        if options.short:
            return
        plans = [(node, service) for service in (None, TRAJECTORY) for node in NAMESPACES]
        rows = [measure_waits(client, *plan, 2 * options.rounds, names) for plan in plans]
        header = ["node", "beside", "small requests", "p50 [ms]", "p99 [ms]", "max [ms]", f"over {MOST_WAIT:.0f} ms"]
        print()
        print(tabulate(rows, header, floatfmt=".1f", tablefmt="github"))
    client.close()
    rclpy.shutdown()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=10, help="10: as many calls as in the documentation (default)")
    parser.add_argument("--short", action="store_true", help="only requests of one point")
    parser.add_argument("--waits", action="store_true", help="only the waits beside large requests")
    parser.add_argument("--empty", action="store_true", help=argparse.SUPPRESS)  # the process of the empty node
    parser.add_argument("--small-requests", nargs=2, help=argparse.SUPPRESS)  # the process of the second client
    options, ros_arguments = parser.parse_known_args()
    if options.empty:
        keep_free_memory()
        return run_node(EmptyServer, ros_arguments, make_events_executor, large_messages)
    if options.small_requests:
        return send_small_requests(float(options.small_requests[0]), options.small_requests[1])
    return measure(options)


if __name__ == "__main__":
    main()
