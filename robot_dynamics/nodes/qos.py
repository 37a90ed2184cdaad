"""Quality-of-service profiles that the nodes share."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

INPUT_STREAM_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Of streamed inputs: a lost message is not sent again; 50 ms of 2 kHz are kept while the processor is busy."""

LATEST_ONLY_QOS = QoSProfile(depth=1)
"""Of streamed outputs: only the latest message matters."""

LATCHED_QOS = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of descriptions: later subscribers receive the last message."""
