"""Callbacks of subscriptions that get what the middleware knows of a message: when it was published and received."""

import inspect


class MessageInfoCallback:
    """A callback(message, info) for `create_subscription` that works with every executor of rclpy.

    EventsExecutor of rclpy 7.1 passes the pair as a single argument where other executors pass two. `info` is a dict:
    source_timestamp and received_timestamp [ns since the epoch], by the clocks of the publisher's and of this machine;
    zero where the middleware does not know them.
    """

    __signature__ = inspect.signature(lambda message, info: None)  # by which rclpy decides what it passes

    def __init__(self, callback):
        self._callback = callback

    def __call__(self, *received):
        message, info = received if len(received) == 2 else received[0]
        return self._callback(message, info)
