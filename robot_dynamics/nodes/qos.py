"""Qualities of service that the nodes share."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# what streams in: a lost message is not asked for again, and 50 ms of 2 kHz wait where the processor is elsewhere
INPUT_STREAM_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
LATEST_ONLY_QOS = QoSProfile(depth=1)  # what streams out: the latest counts
LATCHED_QOS = QoSProfile(
    depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL
)  # the last one is there for who comes later
