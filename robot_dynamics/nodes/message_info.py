"""Subscription callbacks with the times at which a message was published and received."""

import inspect
from collections.abc import Callable
from typing import Any, TypeAlias

MessageInfo: TypeAlias = dict[str, int]
"""source_timestamp and received_timestamp [ns since the epoch], by the clocks of the publisher's and of this machine;
zero if the middleware does not have them. publication_sequence_number of the message among those of its publisher, if
the middleware has it."""


class MessageInfoCallback:
    """A callback(message, info) for `create_subscription` that works with every executor of rclpy.

    EventsExecutor of rclpy 7.1 passes the pair as a single argument where other executors pass two. `info` is a
    MessageInfo.
    """

    __signature__ = inspect.signature(lambda message, info: None)  # rclpy reads the arguments from it

    def __init__(self, callback: Callable[[Any, MessageInfo], None]) -> None:
        self._callback = callback

    def __call__(self, *arguments: Any) -> None:
        message, info = arguments if len(arguments) == 2 else arguments[0]
        self._callback(message, info)
