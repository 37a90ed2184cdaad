"""Waits of many clients of dynamics_server, beside those of as many clients of an empty node with the same services.

    python benchmarks/many_clients.py                  1 and 50 clients, 20 s with each node
    python benchmarks/many_clients.py --mixed          requests of 1, 100 and 5000 points
    python benchmarks/many_clients.py --depth 10       clients as in the documentation of rclpy, with its default depth
    python benchmarks/many_clients.py --clients 50 --seconds 600 --without-empty --per-client

Each client sends its next request when it has the response to the last one. It has a DDS participant and a node of its
own; several share a process of Python and its executor (--processes), since 50 processes or threads of Python would
measure how two cores divide their time among them. The empty node is that of benchmarks/services.py.

The column "first" has the longest time from the start of a client, while all are being discovered, to its first
response. The waits are those of later requests. The column "others" has the largest number of responses that all
clients received during a wait. Lost are requests without a response within 10 s.
"""

import argparse
import os
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from services import FLAT, NAMESPACES, empty_server
from tabulate import tabulate

from robot_dynamics.nodes.processes import running_node

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "test"))
from peers.service_load import measure_clients, responses_meanwhile

HEADER = ["node", "clients", "points", "calls/s", "p50 [ms]", "p99 [ms]", "max [ms]", "max / p50", "others"]
HEADER += ["lost", "calls of a client", "first [s]"]
CLIENT_HEADER = ["client", "calls", "p50 [ms]", "max [ms]", "lost", "first [s]"]


def summary_rows(label, clients, seconds):
    """Rows of the table, one for each number of points in a request. clients: from `measure_clients`."""
    firsts = [first for first, _, _ in clients]
    silent = sum(first is None for first in firsts)
    first = f"{silent} without" if silent else f"{max(firsts):.2f}"
    assert sum(wrong for _, _, wrong in clients) == 0 or label == "empty", "responses with wrong efforts"
    most = int(responses_meanwhile(clients).max())
    rows = []
    for count in sorted({count for _, waits, _ in clients for count, _, _ in waits}):
        of_clients = [[wait for points, wait, _ in waits if points == count] for _, waits, _ in clients]
        responses = np.array([wait for waits in of_clients for wait in waits if wait is not None])
        sent = sum(map(len, of_clients))
        lost = f"{sent - len(responses)} of {sent}"
        calls = f"{min(map(len, of_clients))} to {max(map(len, of_clients))}"
        median, late, largest = 1e3 * np.percentile(responses, (50, 99, 100))
        row = [label, len(clients), count, len(responses) / seconds, median, late, largest, largest / median, most]
        rows.append([*row, lost, calls, first])
    return rows


def client_rows(clients):
    """Rows of a table with each client."""
    rows = []
    for index, (first, waits, _) in enumerate(clients):
        responses = [1e3 * wait for _, wait, _ in waits if wait is not None] or [float("nan")]
        lost = sum(wait is None for _, wait, _ in waits)
        rows.append([index, len(waits), np.median(responses), max(responses), lost, first])
    return rows


def measure(options):
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rows, tables = [], {}
    with ExitStack() as stack:
        stack.enter_context(running_node("dynamics_server", {"robot_file": "panda"}, "/model"))
        nodes = dict(NAMESPACES)
        if options.without_empty:
            nodes.pop("empty")
        else:
            stack.enter_context(empty_server())
        for count in options.clients:
            for label, node in nodes.items():
                clients = measure_clients(
                    f"{node}/{FLAT[1]}", count, options.processes, options.seconds, options.mixed, options.depth
                )
                rows += summary_rows(label, clients, options.seconds)
                tables[f"{label}, {count} clients"] = client_rows(clients)
    print(f"load average at the end: {os.getloadavg()[0]:.1f}")
    print(tabulate(rows, HEADER, floatfmt=".1f", tablefmt="github"))
    if options.per_client:
        for title, table in tables.items():
            print(f"\n{title}")
            print(tabulate(table, CLIENT_HEADER, floatfmt=".1f", tablefmt="github"))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clients", type=int, nargs="+", default=[1, 50], help="numbers of clients (default: 1 50)")
    parser.add_argument("--processes", type=int, default=1, help="processes that they are divided among (default: 1)")
    parser.add_argument("--seconds", type=float, default=20.0, help="time with each node (default: 20)")
    parser.add_argument("--mixed", action="store_true", help="requests of 1, 100 and 5000 points, else of one point")
    parser.add_argument("--depth", type=int, help="clients in threads, with this depth")
    parser.add_argument("--without-empty", action="store_true", help="only dynamics_server")
    parser.add_argument("--per-client", action="store_true", help="print a table of all clients too")
    measure(parser.parse_args())


if __name__ == "__main__":
    main()
