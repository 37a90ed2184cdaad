"""Requests in turns: long ones leave room for those of other clients."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.deferred_responses import DeferredResponse, defer_responses
from robot_dynamics.nodes.dynamics_server.point_work import StepWork
from robot_dynamics.nodes.guarded_callbacks import failure_reason
from robot_dynamics.nodes.parameter_requests import run_in_executor, yielding_thread
from robot_dynamics.nodes.qos import SERVICE_QOS

if TYPE_CHECKING:
    from concurrent.futures import Future

    from rclpy.node import Node
    from rclpy.service import Service

    from robot_dynamics.nodes.dynamics_server.point_work import Work


ROUND_TIME = 0.02
"""Time [s] of a round, in which each unfinished request has one turn."""
RANGE_SHARE = 0.8
"""Part of a turn that one range takes at most, unless most of that were overhead."""
MOST_OVERHEAD = 2
"""Time of a range, relative to that of the shortest one, up to which ranges grow. With loops a range of one point takes
nearly as long as one of fifty: in shorter ones a request would take many times as long."""
LARGEST_GROWTH = 32
"""Factor from the number of points in a range to that in the next one, at most."""
OVERRUN = 1.5
"""Factor on the intended time of a range from which on the next one is smaller."""


@dataclass(eq=False)
class PendingRequest(DeferredResponse):
    """A request whose response is not complete.

    Attributes
    ----------
    work : its work.
    complete : makes the response of a reason of refusal, empty if the request succeeded.
    """

    work: Work
    complete: Callable[[str], Any]

    def __post_init__(self) -> None:
        self._start = 0
        self._size = self.work.first_range
        self._began = time.monotonic()
        self._shortest = math.inf  # time of a range [s]: nearly that part which does not depend on the number of points

    def require_time_left(self, limit: float) -> None:
        """Refuse a request that has taken longer than a limit [s]. Raises InvalidInputError."""
        if time.monotonic() - self._began > limit:
            parts = "steps" if isinstance(self.work, StepWork) else "points"
            raise InvalidInputError(
                f"{self._start} of {self.work.count} {parts} are complete after {limit:g} s, the limit for a request. "
                "Send several requests, or raise the parameter request_timeout of this node"
            )

    def advance(self, seconds: float) -> bool:
        """Do about `seconds` of work, one range at least. Return whether the work is done."""
        began = time.perf_counter()
        while True:
            started = time.perf_counter()
            stop = min(self.work.count, self._start + self._size)
            self.work.compute(slice(self._start, stop))
            if stop == self.work.count:
                self.work.finish()
                return True
            now = time.perf_counter()
            if not isinstance(self.work, StepWork):  # steps differ: one range of them says nothing about the next
                self._shortest = min(self._shortest, now - started)
                target = max(RANGE_SHARE * seconds, MOST_OVERHEAD * self._shortest)
                self._size = next_range_size(stop - self._start, now - started, target)
            self._start = stop
            if now - began > seconds / 2:
                return False


def next_range_size(size: int, elapsed: float, target: float) -> int:
    """Return the number of points that take about `target` [s], after `size` points took `elapsed` [s].

    A part of the time does not depend on the number of points: a range that ends early grows to twice its size or more.
    """
    if elapsed < target:
        return min(max(int(size * target / elapsed), 2 * size), LARGEST_GROWTH * size)
    return max(1, int(size * target / elapsed)) if elapsed > OVERRUN * target else size


class RequestTurns:
    """Answers requests: short ones at once, long ones in turns between the callbacks of the node's executor.

    Each new request has its first turn when the executor takes it. Requests that this does not complete follow each
    other in turns of ROUND_TIME, divided among them. The executor runs the callbacks that are due after each turn.
    What a request must prepare is done by a worker before its first turn.

    Parameters
    ----------
    request_timeout : [s] after which a request that is not complete is refused; it may be changed later.
    """

    def __init__(self, node: Node, request_timeout: float = math.inf) -> None:
        self._node = node
        self.request_timeout = request_timeout
        self._pending: deque[PendingRequest] = deque()
        self._preparing = 0
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="preparation")

    def __len__(self) -> int:
        return len(self._pending) + self._preparing

    def create_service(self, kind: type, name: str, callback: Callable[[Any, Any], Any]) -> Service:
        """Create a service whose callback returns the response, or the PendingRequest that `start` has returned."""
        service = self._node.create_service(kind, name, callback, qos_profile=SERVICE_QOS)
        defer_responses(service, self._keep)
        return service

    def start(self, work: Work, complete: Callable[[str], Any]) -> Any:
        """Give a request its first turn. Return its response, or the PendingRequest if it is not complete."""
        request = PendingRequest(work, complete)
        if isinstance(work, StepWork) and work.preparation is not None:
            return request
        return complete("") if request.advance(self._turn_time()) else request

    def _turn_time(self) -> float:
        """Return the time of a turn of one of the pending requests, or of one more [s]."""
        return ROUND_TIME / max(1, len(self._pending) + 1)

    def _keep(self, request: PendingRequest) -> None:
        """Take a request whose response is deferred: for its preparation, else for its turns."""
        if not isinstance(request.work, StepWork) or request.work.preparation is None:
            self._enqueue(request)
            return
        preparation = request.work.preparation
        self._preparing += 1

        def prepare() -> None:
            with yielding_thread():
                preparation()

        future = self._worker.submit(prepare)
        future.add_done_callback(lambda done: run_in_executor(self._node, lambda: self._on_prepared(request, done)))

    def _on_prepared(self, request: PendingRequest, future: Future[None]) -> None:
        """Give a request that is prepared its turns; refuse it where the preparation failed."""
        self._preparing -= 1
        error = future.exception()
        if error is None:
            self._enqueue(request)
        elif isinstance(error, Exception):
            self._send(request, failure_reason(self._node.get_logger(), error))

    def _enqueue(self, request: PendingRequest) -> None:
        self._pending.append(request)
        if len(self._pending) == 1:
            self._schedule()

    def _schedule(self) -> None:
        executor = self._node.executor
        if executor is not None:
            executor.create_task(self._run_turn)

    def _run_turn(self) -> None:
        """Give the first pending request a turn."""
        self._advance(self._pending.popleft())
        if self._pending:
            self._schedule()

    def _advance(self, request: PendingRequest) -> None:
        reason = ""
        try:
            request.require_time_left(self.request_timeout)
            is_done = request.advance(self._turn_time())
        except Exception as error:
            is_done = True
            reason = failure_reason(self._node.get_logger(), error)
        if not is_done:
            self._pending.append(request)
        else:
            self._send(request, reason)

    def _send(self, request: PendingRequest, reason: str) -> None:
        """Send the response of a request, or its refusal for a reason."""
        try:
            if request.send is not None:
                request.send(request.complete(reason))
        except Exception as error:  # the client has gone, for example
            failure_reason(self._node.get_logger(), error)
