"""Which nodes publish the simulated time. Where two do, time jumps between theirs, and who follows it stops."""

CLOCK_TOPIC = "/clock"
REMEDY = (
    "let one of them publish (publish_clock:=false for the others), or give each its own topic (-r /clock:=clock in "
    "its namespace)"
)


def find_clock_publishers(node):
    """Fully qualified names (a sorted list) of the nodes that publish /clock, as the node has it remapped.

    A node with many publishers is in it as many times.
    """
    endpoints = node.get_publishers_info_by_topic(node.resolve_topic_name(CLOCK_TOPIC))
    return sorted(f"{found.node_namespace.rstrip('/')}/{found.node_name}" for found in endpoints)


class ClockMonitor:
    """Looks for a second clock beside the one that a node publishes, or follows with use_sim_time.

    objection: a sentence with the names of the nodes that publish; empty where there is one clock, or the node has
    nothing to do with any.
    """

    def __init__(self, node):
        self._node = node
        self.conflict = ""

    def check(self):
        """Bring `objection` up to date, and log a new one as a warning."""
        before, self.conflict = self.conflict, self._judged()
        if self.conflict and self.conflict != before:
            self._node.get_logger().warning(self.conflict)

    def _judged(self):
        node, names = self._node, find_clock_publishers(self._node)
        mine, topic = node.get_fully_qualified_name(), node.resolve_topic_name(CLOCK_TOPIC)
        publishes = mine in names
        if len(names) < 2 or not (publishes or node.get_parameter("use_sim_time").value):
            return ""
        if not publishes:
            return f"{topic} is published by {' and '.join(names)}, so that time jumps between theirs: {REMEDY}"
        names.remove(mine)
        others = " and ".join("another node of the same name" if name == mine else name for name in names)
        return f"{topic} is published by {others} as well, so that time jumps between theirs and ours: {REMEDY}"
