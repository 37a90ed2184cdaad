"""Other nodes that publish on the topics of a simulator: a second simulator, or publishers of other joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node, NodeNameNonExistentError

from robot_dynamics.nodes.publisher_names import describe_publishers

RCLError = rclpy_implementation.RCLError
SERVICES = ("pause", "reset", "step")  # that every simulator has
REMEDY = "give one of them another namespace, or remap its topics"


class OtherPublishers:
    """Finds other publishers of the states that a simulator publishes.

    Parameters
    ----------
    topics : returns the names of the topics that the node publishes at present.

    Attributes
    ----------
    conflicts : sentences on topics that another simulator publishes as well.
    notes : sentences on topics that other nodes publish, which may have other joints.
    """

    def __init__(self, node: Node, topics: Callable[[], Sequence[str]]) -> None:
        self._node = node
        self._topics = topics
        self.conflicts: list[str] = []
        self.notes: list[str] = []

    def check(self) -> None:
        """Update `conflicts` and `notes`, and log new ones."""
        previous = {*self.conflicts, *self.notes}
        self.conflicts = []
        self.notes = []
        for topic in self._topics():
            self._check(topic)
        logger = self._node.get_logger()
        for conflict in self.conflicts:
            if conflict not in previous:
                logger.warning(conflict)
        for note in self.notes:
            if note not in previous:
                logger.info(note)

    def _check(self, topic: str) -> None:
        node = self._node
        full_topic = node.resolve_topic_name(topic)
        if node.count_publishers(full_topic) < 2:
            return
        endpoints = node.get_publishers_info_by_topic(full_topic)
        names = [(endpoint.node_name, endpoint.node_namespace) for endpoint in endpoints]
        own_name = node.get_name(), node.get_namespace()
        if len(names) < 2 or own_name not in names:
            return
        names.remove(own_name)
        text = f"{full_topic} is published by {describe_publishers(node, topic)}"
        if own_name in names or any(self._is_simulator(*name) for name in names):
            self.conflicts.append(f"{text}, so that states of two simulations alternate: {REMEDY}")
        else:
            self.notes.append(f"{text}: if they have the same joints or base, {REMEDY}")

    def _is_simulator(self, name: str, namespace: str) -> bool:
        """Return whether a node has the services of a simulator."""
        try:
            services = {service for service, _ in self._node.get_service_names_and_types_by_node(name, namespace)}
        except (NodeNameNonExistentError, RCLError):  # a node that has ended, or whose name is not known yet
            return False
        full_name = f"{namespace.rstrip('/')}/{name}"
        return services.issuperset(f"{full_name}/{service}" for service in SERVICES)
