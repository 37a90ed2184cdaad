"""Calls of services that end: with a response, or with TimeoutError."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import ListParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.context import Context
from rclpy.parameter import Parameter
from rclpy.task import Future

from robot_dynamics.errors import InvalidInputError, describe_unknown_name
from robot_dynamics.nodes.batch_messages import make_batch_requests, read_batch_responses
from robot_dynamics.nodes.events_executor import make_executor
from robot_dynamics.nodes.qos import SERVICE_QOS

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.node import Node

    from robot_dynamics.array_types import ArrayLike
    from robot_dynamics.nodes.batch_messages import BatchResult

# A server can receive the first request of a client before it has discovered where the client listens. The middleware
# then drops the response, so a first request without a response within this time [s] is sent again.
DISCOVERY_TIME = 2.0
POLLING_INTERVAL = 0.005  # [s] in which a thread that does not spin looks for a response
# Points in a request of `call_batch`, so that messages have some 100 kB, and requests that are sent before a response.
POINTS_PER_REQUEST = 1000
REQUESTS_IN_FLIGHT = 2


def _to_parameter(name: str, value: object) -> Parameter:
    """Return a parameter; a list with integers and floating-point numbers becomes one of floating-point numbers."""
    if isinstance(value, list | tuple) and any(isinstance(item, float) for item in value):
        value = [float(item) if type(item) is int else item for item in value]
    try:
        return Parameter(name, value=value)
    except (TypeError, AttributeError):
        raise InvalidInputError(
            f"parameter {name!r} is {value!r:.80}: a bool, a number, a string or a list of one of these is needed"
        ) from None


class ServiceClient:
    """Calls services from a node of its own, or from one that another thread spins.

    Parameters
    ----------
    name, namespace : of the node.
    context : rclpy context; None: the default one, which `rclpy.init()` initialises.
    node : a node that another thread spins while calls are made in this one; None: a node of its own, which calls spin.

    Attributes
    ----------
    node : rclpy.node.Node
        The node, for subscriptions and publishers beside the calls; `spin` runs its callbacks.
    """

    def __init__(
        self, name: str = "caller", namespace: str = "/", context: Context | None = None, node: Node | None = None
    ) -> None:
        self.node = node or rclpy.create_node(name, namespace=namespace, context=context)
        # Fast DDS passes each response of a service to all its clients: the executor runs for those to others too
        self._executor: Executor | None = None
        if node is None:
            self._executor = make_executor(context)
            self._executor.add_node(self.node)
        self._clients: dict[str, Client] = {}
        self._responsive_services: set[str] = set()

    def call(self, kind: type, service: str, request: object, timeout: float = 30.0) -> Any:
        """Call a service and return its response.

        Parameters
        ----------
        kind : type of the service, for example `robot_dynamics_interfaces.srv.InverseDynamics`.
        service : name of the service.
        request : of type `kind.Request`.
        timeout : for the service to appear, and for its response [s].

        Raises
        ------
        TimeoutError
            There is no such service, or no response came.
        """
        deadline = time.monotonic() + timeout
        client = self._clients.get(service)
        if client is None:
            client = self._clients[service] = self.node.create_client(kind, service, qos_profile=SERVICE_QOS)
        if not client.wait_for_service(timeout):
            raise TimeoutError(f"service {service} did not appear within {timeout} s")
        sent = time.monotonic()
        patience = DISCOVERY_TIME
        futures = [client.call_async(request)]
        try:
            while not any(future.done() for future in futures):
                now = time.monotonic()
                if now > deadline:
                    raise TimeoutError(f"service {service} did not respond within {timeout} s")
                if service not in self._responsive_services and now > sent + patience:
                    sent = now
                    patience *= 2
                    futures.append(client.call_async(request))  # a response to an earlier one may still come
                self._spin_once(0.1)
        finally:
            for future in futures:
                client.remove_pending_request(future)
        self._responsive_services.add(service)
        return next(future.result() for future in futures if future.done())

    def call_batch(
        self,
        kind: type,
        service: str,
        joint_names: Sequence[str],
        *,
        external_wrenches: Mapping[str, ArrayLike] | None = None,
        points_per_request: int = POINTS_PER_REQUEST,
        timeout: float = 30.0,
        **fields: Any,
    ) -> BatchResult:
        """Call a service with flat arrays, and return its response as arrays.

        Many points are sent in several requests: the middleware sends messages of megabytes slowly, and again if parts
        of them are lost.

        Parameters
        ----------
        kind, service
            As for `call`; `kind` is InverseDynamicsBatch, DirectDynamicsBatch or DynamicsTermsBatch.
        joint_names : columns of positions, velocities and so on.
        external_wrenches : {link: (N, 6), or (6,) that acts at every point}.
        points_per_request : largest number of points in a request.
        timeout : for the service to appear, and for each response [s].
        fields : fields of the request: arrays (N, columns), or (columns,) that hold at every point; other fields as the
            service has them, for example ``motion=True``.

        Raises
        ------
        InvalidInputError
            The numbers of points differ, the service has no such field, or it refused a request.
        TimeoutError
            As for `call`.
        """
        requests = make_batch_requests(kind, joint_names, external_wrenches, fields, points_per_request)
        responses = [self.call(kind, service, requests[0], timeout)]
        client = self._clients[service]
        unsent = iter(requests[1:])
        waiting: deque[Future] = deque()
        try:
            while responses[-1].success and len(responses) < len(requests):
                waiting += map(client.call_async, islice(unsent, REQUESTS_IN_FLIGHT - len(waiting)))
                responses.append(self._wait(waiting[0], service, timeout))
                waiting.popleft()
        finally:
            for future in waiting:
                client.remove_pending_request(future)
        if not responses[-1].success:
            first = (len(responses) - 1) * points_per_request
            place = f" from point {first} on, which is point 0 there" if first else ""
            raise InvalidInputError(f"{service} refused the request{place}: {responses[-1].message}")
        return read_batch_responses(responses, [request.count for request in requests])

    def _wait(self, future: Future, service: str, timeout: float) -> Any:
        """Return the response of a request that has been sent to a service. Raises TimeoutError."""
        deadline = time.monotonic() + timeout
        while not future.done():
            if time.monotonic() > deadline:
                raise TimeoutError(f"service {service} did not respond within {timeout} s")
            self._spin_once(0.1)
        return future.result()

    def set_parameters(self, node_name: str, values: dict[str, object], timeout: float = 30.0) -> SetParametersResult:
        """Set parameters {name: value} of a node all at once. The result has the fields `successful` and `reason`.

        Raises
        ------
        InvalidInputError
            A value is of a type that no parameter has.
        TimeoutError
            As for `call`.
        """
        request = SetParametersAtomically.Request()
        request.parameters = [_to_parameter(name, value).to_parameter_msg() for name, value in values.items()]
        result = self.call(SetParametersAtomically, f"{node_name}/set_parameters_atomically", request, timeout).result
        if not result.successful and "undeclared parameter" in result.reason:  # rclpy names none
            known = self.call(ListParameters, f"{node_name}/list_parameters", ListParameters.Request(), timeout)
            unknown = [name for name in values if name not in known.result.names]
            if unknown:
                result.reason = describe_unknown_name("parameter", unknown[0], known.result.names)
        return result

    def spin(self, seconds: float) -> None:
        """Run the callbacks of the node for a time [s]."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self._spin_once(0.05)

    def close(self) -> None:
        """Destroy the node, if it is this object's own."""
        if self._executor is not None:
            self._executor.shutdown()
            self.node.destroy_node()

    def _spin_once(self, seconds: float) -> None:
        """Run a callback of the node, or wait for the thread that does, for a time [s] at most."""
        if self._executor is None:
            time.sleep(min(seconds, POLLING_INTERVAL))
        else:
            self._executor.spin_once(timeout_sec=seconds)
