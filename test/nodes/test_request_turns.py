"""Long requests are computed in turns: short ones of other clients are answered meanwhile, and results are whole."""

import re
import threading
import time

import numpy as np
import pytest
from nodes.service_requests import PANDA, assert_same, call_service, field, inverse_request, motion
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from robot_dynamics import Dynamics, InvalidInputError, load_robot
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.nodes.dynamics_server.request_turns import PendingRequest, RequestTurns, next_range_size
from robot_dynamics.nodes.runner import make_events_executor
from robot_dynamics_interfaces.srv import InverseDynamicsBatch


class SlowWork:
    """Work whose points take a time [s] each; it records the ranges."""

    def __init__(self, count, seconds_a_point, first_range=1, bad_point=None):
        self.count = count
        self.first_range = first_range
        self.ranges = []
        self.is_finished = False
        self._seconds = seconds_a_point
        self._bad_point = bad_point

    def compute(self, rows):
        if self._bad_point is not None and rows.start <= self._bad_point < rows.stop:
            raise InvalidInputError(f"point {self._bad_point} is invalid")
        self.ranges.append((rows.start, rows.stop))
        time.sleep(self._seconds * (rows.stop - rows.start))

    def finish(self):
        self.is_finished = True


def test_ranges_cover_all_points_once_and_in_order():
    for count in (1, 2, 31, 1000):
        work = SlowWork(count, 1e-5)
        request = PendingRequest(work, str)
        while not request.advance(0.002):
            assert not work.is_finished
        assert work.is_finished
        starts, stops = zip(*work.ranges, strict=True)
        assert starts == (0, *stops[:-1]) and stops[-1] == count


def test_size_of_ranges_follows_the_time_that_they_take():
    assert next_range_size(1, 1e-6, 0.02) == 32  # not more than 32 times as many
    assert next_range_size(100, 0.004, 0.02) == 500
    assert next_range_size(1, 0.015, 0.02) == 2  # a constant part of the time may be most of it
    assert next_range_size(100, 0.022, 0.02) == 100
    assert next_range_size(100, 0.2, 0.02) == 10
    assert next_range_size(1, 10.0, 0.02) == 1


def test_time_of_each_range_that_does_not_depend_on_its_points_does_not_multiply():
    """A range takes 20 ms and 0.1 ms a point, as with loops: 1000 points take 120 ms at once, and 20 s one by one."""

    class Overhead(SlowWork):
        def compute(self, rows):
            time.sleep(0.02)
            super().compute(rows)

    work = Overhead(1000, 1e-4)
    request = PendingRequest(work, str)
    while not request.advance(0.02):
        pass
    assert len(work.ranges) < 25
    assert max(stop - start for start, stop in work.ranges) < 1000


class TurnsNode(Node):
    """A node whose service takes a number of points, 1 ms each, and records the order of the responses."""

    def __init__(self):
        super().__init__("turns")
        self.turns = RequestTurns(self)
        self.completed = []
        self.bad_point = None
        self.service = self.turns.create_service(InverseDynamicsBatch, "~/work", self.respond)
        self.plain = self.create_service(Trigger, "~/plain", lambda request, response: response)

    def respond(self, request, response):
        def complete(reason):
            self.completed.append(request.count)
            response.success = not reason
            response.message = reason
            return response

        return self.turns.start(SlowWork(request.count, 1e-3, bad_point=self.bad_point), complete)


@pytest.fixture(params=[make_events_executor, SingleThreadedExecutor], ids=["events", "single_threaded"])
def turns_node(ros, request):
    node, executor, stop = TurnsNode(), request.param(), threading.Event()
    executor.add_node(node)

    def spin():
        while not stop.is_set():
            executor.spin_once(timeout_sec=0.1)

    thread = threading.Thread(target=spin)
    thread.start()
    yield node
    stop.set()
    thread.join()
    executor.shutdown()
    node.destroy_node()


def call_all(counts):
    """Responses to requests that are sent together; and the order in which they came."""
    client = ServiceClient("turns_client")
    try:
        assert client.call(InverseDynamicsBatch, "/turns/work", InverseDynamicsBatch.Request(count=1)).success
        caller = client.node.create_client(InverseDynamicsBatch, "/turns/work")
        assert caller.wait_for_service(10)
        client.spin(0.5)  # until server and client have discovered each other
        order, futures = [], []
        for count in counts:
            futures.append(caller.call_async(InverseDynamicsBatch.Request(count=count)))
            futures[-1].add_done_callback(lambda _, count=count: order.append(count))
        deadline = time.monotonic() + 60
        while not all(future.done() for future in futures):
            assert time.monotonic() < deadline, f"responses came for {order} only"
            client.spin(0.01)
        return [future.result() for future in futures], order
    finally:
        client.close()


def test_short_requests_overtake_long_ones(turns_node):
    responses, order = call_all([600, 2, 500, 3, 40])
    assert all(response.success for response in responses)
    assert set(order[:2]) == {2, 3} and order[-1] in (500, 600)
    assert order.index(40) < order.index(500)
    assert len(turns_node.turns) == 0


def test_an_error_after_the_first_turn_is_a_refusal_of_that_request_alone(turns_node):
    turns_node.bad_point = 100
    responses, _ = call_all([300, 90])
    assert [response.success for response in responses] == [False, True]
    assert responses[0].message == "point 100 is invalid"


def test_request_that_takes_too_long_is_refused_and_others_go_on(turns_node):
    turns_node.turns.request_timeout = 0.3
    responses, _ = call_all([3000, 20])
    assert [response.success for response in responses] == [False, True]
    assert re.match(r"\d+ of 3000 points are complete after 0.3 s", responses[0].message)
    assert len(turns_node.turns) == 0


def test_client_with_small_requests_is_served_beside_a_long_one(client, start_server):
    """The long one takes seconds, and its messages are small: it has one row for all points of a robot with loops."""
    server = start_server({"robot_file": "gough_stewart"})
    service = f"{server}/inverse_dynamics_batch"
    dynamics = Dynamics(load_robot("gough_stewart"), compiled=False)
    columns = [dynamics.all_joint_names.index(name) for name in dynamics.joint_names]
    q = dynamics.initial_joint_positions[columns]
    rest = np.zeros_like(q)
    state = {"positions": q, "velocities": rest, "accelerations": rest}
    results, small_ends = [], []

    def send_long():
        long_client = ServiceClient("long_requests")
        try:
            request = InverseDynamicsBatch.Request(count=150, joint_names=dynamics.joint_names, motion=True)
            request.positions, request.velocities, request.accelerations = q.tolist(), rest.tolist(), rest.tolist()
            results.append(long_client.call(InverseDynamicsBatch, service, request, timeout=60))
            results.append(time.monotonic())
        finally:
            long_client.close()

    client.call_batch(InverseDynamicsBatch, service, dynamics.joint_names, **state)
    thread = threading.Thread(target=send_long)
    thread.start()
    while thread.is_alive():
        small = client.call_batch(InverseDynamicsBatch, service, dynamics.joint_names, **state)
        small_ends.append(time.monotonic())
    thread.join()
    efforts = dynamics.inverse(q, rest, rest)
    np.testing.assert_allclose(small["efforts"][0, : len(q)], efforts, rtol=1e-8)
    response, end = results
    result = np.reshape(response.efforts, (150, -1))
    np.testing.assert_allclose(result[:, : len(q)], np.tile(efforts, (150, 1)), rtol=1e-8)
    assert sum(small_end < end for small_end in small_ends) >= 3


def test_requests_of_thirty_clients_at_once_are_all_answered(client, start_server, panda_dynamics):
    """More than the usual depth of the history of a service."""
    server = start_server({"robot_file": "panda"})
    q, qd, qdd = motion(30, 7)
    call_service(client, server, inverse_request(PANDA, q[:1], qd[:1], qdd[:1]))
    service = f"{server}/inverse_dynamics_batch"
    caller = client.node.create_client(InverseDynamicsBatch, service)
    assert caller.wait_for_service(10)
    client.spin(1.0)
    futures = []
    for k in range(30):
        request = InverseDynamicsBatch.Request(count=1, joint_names=PANDA)
        request.positions, request.velocities, request.accelerations = q[k].tolist(), qd[k].tolist(), qdd[k].tolist()
        futures.append(caller.call_async(request))
    deadline = time.monotonic() + 20
    while not all(future.done() for future in futures):
        assert time.monotonic() < deadline, f"{sum(future.done() for future in futures)} responses came"
        client.spin(0.01)
    efforts = np.array([future.result().efforts for future in futures])
    assert_same(efforts, panda_dynamics.inverse(q, qd, qdd))
    trajectory = call_service(client, server, inverse_request(PANDA, q, qd, qdd)).trajectory
    assert_same(field(trajectory, "effort"), efforts)
