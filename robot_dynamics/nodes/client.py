"""Calls of services that end: with a response, or with TimeoutError."""

import time
from typing import Any

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import ListParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from robot_dynamics.errors import InvalidInputError, describe_unknown_name

# A server can receive the first request of a client before it has discovered where the client listens. The middleware
# then drops the response, so a first request without a response within this time [s] is sent again.
DISCOVERY_TIME = 2.0


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
    """Calls services from a node of its own.

    Parameters
    ----------
    name, namespace : of the node.
    context : rclpy context; None: the default one, which `rclpy.init()` initialises.

    Attributes
    ----------
    node : rclpy.node.Node
        The node, for subscriptions and publishers beside the calls; `spin` runs its callbacks.
    """

    def __init__(self, name: str = "caller", namespace: str = "/", context: Context | None = None) -> None:
        self.node = rclpy.create_node(name, namespace=namespace, context=context)
        self._executor = SingleThreadedExecutor(context=context)
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
            client = self._clients[service] = self.node.create_client(kind, service)
        if not client.wait_for_service(timeout):
            raise TimeoutError(f"service {service} did not appear within {timeout} s")
        sent = time.monotonic()
        patience = DISCOVERY_TIME
        future = client.call_async(request)
        while not future.done():
            now = time.monotonic()
            if now > deadline:
                client.remove_pending_request(future)
                raise TimeoutError(f"service {service} did not respond within {timeout} s")
            if service not in self._responsive_services and now > sent + patience:
                client.remove_pending_request(future)
                sent = now
                patience *= 2
                future = client.call_async(request)
            self._executor.spin_once(timeout_sec=0.1)
        self._responsive_services.add(service)
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
            self._executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        """Destroy the node."""
        self._executor.shutdown()
        self.node.destroy_node()
