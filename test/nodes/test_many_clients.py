"""Fifty clients at once: each has a response to each of its requests, and none waits far longer than others.

`make soak` runs it with CLIENT_SECONDS=600; the default is short.
"""

import os

import numpy as np
from nodes.service_requests import PANDA
from peers.service_load import measure_clients, responses_meanwhile

from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.nodes.qos import SERVICE_QOS
from robot_dynamics_interfaces.srv import InverseDynamicsBatch

SECONDS = float(os.environ.get("CLIENT_SECONDS", "3"))
LONG = 60.0
"""Time [s] from which on single disturbances by other work on the machine no longer decide about the median."""
MOST_WAIT = 10.0
"""Accepted largest wait, relative to the median."""
CLIENTS = 50


def test_each_of_fifty_clients_has_a_response_to_each_request(start_server):
    """They share a participant, unless time is long: discovery would take most of the processor time.

    One process has all clients and takes responses in their order: of several, the system decides which one goes on.
    """
    service = f"{start_server({'robot_file': 'panda'})}/inverse_dynamics_batch"
    clients = measure_clients(service, CLIENTS, 1, SECONDS, participants=SECONDS > LONG)
    assert len(clients) == CLIENTS
    waits = [[wait for _, wait, _ in of_client] for _, of_client, _ in clients]
    lost = sum(wait is None for of_client in waits for wait in of_client)
    calls = sorted(map(len, waits))
    responses = np.array([wait for of_client in waits for wait in of_client if wait is not None])
    median, largest = np.median(responses), responses.max()
    meanwhile = responses_meanwhile(clients)
    print(f"\n{SECONDS:g} s: {len(responses) / SECONDS:.0f} responses/s, {calls[0]} to {calls[-1]} for a client")
    print(f"waits: median {1e3 * median:.1f} ms, largest {1e3 * largest:.1f} ms, {lost} requests without a response")
    print(f"responses to others during a wait: median {np.median(meanwhile):.0f}, largest {meanwhile.max()}")
    assert all(first is not None for first, _, _ in clients)
    assert lost == 0
    assert sum(wrong for _, _, wrong in clients) == 0
    assert calls[0] > calls[CLIENTS // 2] / (3 if SECONDS > LONG else 10)
    assert meanwhile.max() < MOST_WAIT * np.median(meanwhile)  # whatever else the machine does
    if SECONDS > LONG:
        assert largest < MOST_WAIT * median


def test_client_takes_responses_to_others_and_keeps_its_own(ros, client, start_server):
    """Each client of a service receives the responses to all. A client that is busy meanwhile must not lose its own."""
    service = f"{start_server({'robot_file': 'panda'})}/inverse_dynamics_batch"
    busy = ServiceClient("busy_client")
    try:
        rows = {"velocities": [0.0] * 7, "accelerations": [0.0] * 7}
        request = InverseDynamicsBatch.Request(count=1, joint_names=PANDA, positions=[0.1] * 7, **rows)
        expected = busy.call(InverseDynamicsBatch, service, request).efforts
        sender = busy.node.create_client(InverseDynamicsBatch, service, qos_profile=SERVICE_QOS)
        assert sender.wait_for_service(10)
        busy.spin(0.5)
        future = sender.call_async(request)
        refused = InverseDynamicsBatch.Request(count=1)
        for _ in range(100):
            assert not client.call(InverseDynamicsBatch, service, refused).success
        assert not future.done()
        busy.spin(1.0)
        np.testing.assert_allclose(future.result().efforts, expected, rtol=1e-9)
    finally:
        busy.close()
