"""Requests to set parameters that take long: prepared beside the executor, and answered when that is done.

rclpy answers a request when its callback returns, and runs no other callback of the node before that. Here a worker
prepares the change. Until it is made, the executor serves other requests; the client waits as for any other parameter.
"""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from robot_dynamics.nodes.deferred_responses import DeferredResponse, defer_responses
from robot_dynamics.nodes.guarded_callbacks import failure_reason

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.service import Service

MAX_WAITING = 20
"""Requests that may wait for the preparation of another one."""
WORKER_THREAD = "robot-loader"
"""Name of a thread while it prepares a change."""
SWITCH_INTERVAL = 5e-4
"""Time [s] after which the worker lets the thread of the executor go on."""

Prepare = Callable[[Sequence[Parameter]], Callable[[], None] | None]
"""Returns the work that prepares a change of parameters, None if there is none."""


@contextmanager
def yielding_thread() -> Iterator[None]:
    """Let other threads go on often while this one works, and name it WORKER_THREAD."""
    thread = threading.current_thread()
    name = thread.name
    interval = sys.getswitchinterval()
    thread.name = WORKER_THREAD
    sys.setswitchinterval(min(interval, SWITCH_INTERVAL))
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        thread.name = name


def run_in_executor(node: Node, callback: Callable[[], None]) -> None:
    """Run a callback in the thread of the executor of a node; from any thread. Do nothing once the node has ended."""
    executor = node.executor
    if executor is not None and node.context.ok():
        executor.create_task(callback)


@dataclass(eq=False)
class _WaitingRequest(DeferredResponse):
    """A request whose response is not complete.

    Attributes
    ----------
    steps : requests that are made one after the other: one for all parameters, or one for each.
    service : callback of rclpy that makes a step.
    response : response, without the results of the remaining steps.
    """

    steps: deque[Any]
    service: Callable[[Any, Any], Any]
    response: Any

    def make_step(self, logger: Any) -> None:
        """Set the parameters of the next step."""
        request = self.steps.popleft()
        try:
            self._add(self.service(request, type(self.response)()))
        except Exception as error:
            self.refuse(request, failure_reason(logger, error))

    def refuse(self, request: Any, reason: str) -> None:
        """Add the refusal of a step to the response."""
        refusal = SetParametersResult(successful=False, reason=reason)
        if isinstance(request, SetParametersAtomically.Request):
            self.response.result = refusal
        else:
            self.response.results = [*self.response.results, *([refusal] * len(request.parameters))]

    def _add(self, response: Any) -> None:
        if isinstance(response, SetParametersAtomically.Response):
            self.response.result = response.result
        else:
            self.response.results = [*self.response.results, *response.results]


class ParameterRequests:
    """The services set_parameters and set_parameters_atomically of a node, with changes that a worker prepares.

    Changes that need preparation are made in the order of their requests. Others are made at once.

    Parameters
    ----------
    prepare : is called in the thread of the executor with the parameters that will be set together. It returns a
        function without arguments, which runs in the worker and must not raise.
    """

    def __init__(self, node: Node, prepare: Prepare, worker: Executor) -> None:
        self._node = node
        self._prepare = prepare
        self._worker = worker
        self._waiting: deque[_WaitingRequest] = deque()
        for service in list(node.services):
            if service.srv_type in (SetParameters, SetParametersAtomically):
                self._take_over(service)

    def _take_over(self, service: Service) -> None:
        """Replace the callback of a service of rclpy."""
        set_now = service.callback

        def callback(request: Any, response: Any) -> Any:
            return self._respond(set_now, request, response)

        service.callback = callback
        defer_responses(service)

    def _respond(self, set_now: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
        """Return the response, or the _WaitingRequest."""
        steps = deque([request])
        if isinstance(request, SetParameters.Request):
            steps = deque(SetParameters.Request(parameters=[parameter]) for parameter in request.parameters)
        waiting = _WaitingRequest(steps, set_now, response)
        if not any(self._preparation(step) for step in steps):
            while steps:
                waiting.make_step(self._node.get_logger())
            return response
        if len(self._waiting) >= MAX_WAITING:
            waiting.refuse(request, f"{len(self._waiting)} changes of the robot are waiting: try again later")
            return response
        self._waiting.append(waiting)
        if len(self._waiting) == 1:
            self._submit()
        return waiting

    def _preparation(self, step: Any) -> Callable[[], None] | None:
        """Return the work before a step, None if there is none or the step will be refused."""
        try:
            return self._prepare([Parameter.from_parameter_msg(message) for message in step.parameters])
        except Exception:
            return None

    def _submit(self) -> None:
        """Submit the work before the first step of the first request."""
        work = self._preparation(self._waiting[0].steps[0]) or _do_nothing
        future = self._worker.submit(work)
        future.add_done_callback(lambda _: run_in_executor(self._node, self._on_prepared))

    def _on_prepared(self) -> None:
        """Make the first step of the first request, and go on with the next one."""
        first = self._waiting[0]
        first.make_step(self._node.get_logger())
        if not first.steps:
            self._waiting.popleft()
            try:
                if first.send is not None:
                    first.send(first.response)
            except Exception as error:  # the client has gone, for example
                failure_reason(self._node.get_logger(), error)
        if self._waiting:
            self._submit()


def _do_nothing() -> None:
    """Work before a step that needs none."""
