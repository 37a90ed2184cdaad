"""Changes of nodes that run, for commands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import rclpy

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.nodes.client import ServiceClient

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

TIME_LIMIT = 10.0
"""Time [s] in which a node must respond."""


def set_node_parameters(names: Sequence[str], values: dict[str, object]) -> Iterator[str]:
    """Set parameters of running nodes from a process without a node: `set_parameters_of_nodes`."""
    rclpy.init()
    client = ServiceClient("robot_dynamics_command")
    try:
        yield from set_parameters_of_nodes(client, names, values)
    finally:
        client.close()
        rclpy.shutdown()


def set_parameters_of_nodes(client: ServiceClient, names: Sequence[str], values: dict[str, object]) -> Iterator[str]:
    """Set parameters of running nodes, all at once in each, and yield the name of each node that has them.

    Parameters
    ----------
    client : makes the calls.
    names : sequence of str
        Names of the nodes with their namespaces, such as ``"/dynamics_server"``.
    values : dict
        Values of the parameters by name.

    Raises
    ------
    RobotDynamicsError
        If a node is absent or refuses a value; nodes before it have the values.
    """
    for name in names:
        try:
            result = client.set_parameters(name, values, timeout=TIME_LIMIT)
        except TimeoutError as error:
            raise RobotDynamicsError(f"{name}: {error}. Is the node running?") from None
        if not result.successful:
            raise RobotDynamicsError(f"{name}: the node refuses the parameters: {result.reason}")
        yield name
