"""Quality-of-service profiles that the nodes share."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

INPUT_STREAM_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Of streamed inputs: a lost message is not sent again; 50 ms of 2 kHz are kept while the processor is busy."""

LATEST_ONLY_QOS = QoSProfile(depth=1)
"""Of streamed outputs: only the latest message matters."""

LATCHED_QOS = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of descriptions: later subscribers receive the last message."""

SERVICE_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""Of services with many clients, which share the history of requests and that of responses. With the default depth of
10, ten short responses replace a long one that is still being sent, and requests of 11 clients replace each other."""

BUFFERED_INPUT_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Inputs of which no message should be lost while the model computes: they wait in the queue."""
