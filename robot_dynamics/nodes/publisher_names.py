"""The names and endpoints of the nodes that publish a topic."""

from collections.abc import Sequence

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo


def find_publishers(node: Node, topic: str) -> list[str]:
    """Return the fully qualified names, sorted, of the nodes that publish a topic, as the node has it remapped.

    A node with many publishers is in it as many times.
    """
    return sorted(_node_name(endpoint) for endpoint in _publisher_endpoints(node, topic))


def describe_publishers(node: Node, topic: str) -> str:
    """Return the names of all publishers of a topic with their endpoints, as words of a sentence.

    The endpoint is the GID in the form of `ros2 topic info --verbose`.
    """
    return " and ".join(sorted(map(_describe_endpoint, _publisher_endpoints(node, topic))))


def join_other_names(names: Sequence[str], own_name: str) -> str:
    """Return the names of the publishers beside a node that is one of them, as words of a sentence."""
    others = list(names)
    others.remove(own_name)
    return " and ".join("another node of the same name" if name == own_name else name for name in others)


def _publisher_endpoints(node: Node, topic: str) -> list[TopicEndpointInfo]:
    return list(node.get_publishers_info_by_topic(node.resolve_topic_name(topic)))


def _node_name(endpoint: TopicEndpointInfo) -> str:
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


def _describe_endpoint(endpoint: TopicEndpointInfo) -> str:
    return f"{_node_name(endpoint)} (endpoint {'.'.join(f'{byte:02x}' for byte in endpoint.endpoint_gid)})"
