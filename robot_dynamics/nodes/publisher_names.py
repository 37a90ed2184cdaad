"""The names of the nodes that publish a topic."""

from collections.abc import Sequence

from rclpy.node import Node


def find_publishers(node: Node, topic: str) -> list[str]:
    """Return the fully qualified names, sorted, of the nodes that publish a topic, as the node has it remapped.

    A node with many publishers is in it as many times.
    """
    endpoints = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    return sorted(f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}" for endpoint in endpoints)


def join_other_names(names: Sequence[str], own_name: str) -> str:
    """Return the names of the publishers beside a node that is one of them, as words of a sentence."""
    others = list(names)
    others.remove(own_name)
    return " and ".join("another node of the same name" if name == own_name else name for name in others)
