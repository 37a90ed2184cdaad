"""Publishers of the simulated time. With two of them time jumps back and forth, and nodes that follow it stop."""

from rclpy.node import Node

from robot_dynamics.nodes.publisher_names import find_publishers, join_other_names

CLOCK_TOPIC = "/clock"
REMEDY = (
    "let one of them publish (publish_clock:=false for the others), or give each its own topic (-r /clock:=clock in "
    "its namespace)"
)


class ClockMonitor:
    """Detects a second publisher of the clock that a node publishes, or follows with use_sim_time.

    conflict: a sentence with the names of the nodes that publish; empty if there is one publisher, or if the node
    neither publishes nor follows the clock.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.conflict = ""

    def check(self) -> None:
        """Update `conflict`, and log a new one as a warning."""
        previous = self.conflict
        self.conflict = self._find_conflict()
        if self.conflict and self.conflict != previous:
            self._node.get_logger().warning(self.conflict)

    def _find_conflict(self) -> str:
        node = self._node
        names = find_publishers(node, CLOCK_TOPIC)
        own_name = node.get_fully_qualified_name()
        topic = node.resolve_topic_name(CLOCK_TOPIC)
        publishes = own_name in names
        if len(names) < 2 or not (publishes or node.get_parameter("use_sim_time").value):
            return ""
        if not publishes:
            return f"{topic} is published by {' and '.join(names)}, so that time jumps between theirs: {REMEDY}"
        others = join_other_names(names, own_name)
        return f"{topic} is published by {others} as well, so that time jumps between theirs and ours: {REMEDY}"
