"""Records topics of a node in a bag that rosbag2, Foxglove and PlotJuggler read (MCAP)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription

from robot_dynamics.recordings.bags import import_rosbag2, load_typestore

QUEUE_DEPTH = 2000


class BagRecorder:
    """Writes the messages on topics {name: type} into a new bag; use it in a `with` statement.

    Parameters
    ----------
    path : folder of the bag, which must not exist.
    now : returns the time of a message [ns] when it is received.

    Attributes
    ----------
    message_count : number of messages written.
    """

    def __init__(self, node: Node, path: Path, topics: Mapping[str, type], now: Callable[[], int]) -> None:
        rosbag2 = import_rosbag2()
        self._node = node
        self._topics = topics
        self._now = now
        self._writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP)
        self._subscriptions: list[Subscription] = []
        self._is_open = False
        self.message_count = 0

    def __enter__(self) -> BagRecorder:
        self._writer.open()
        self._is_open = True
        store = load_typestore()
        for name, kind in self._topics.items():
            package = kind.__module__.partition(".")[0]
            connection = self._writer.add_connection(name, f"{package}/msg/{kind.__name__}", typestore=store)
            callback = self._callback(connection)
            self._subscriptions.append(self._node.create_subscription(kind, name, callback, QUEUE_DEPTH, raw=True))
        return self

    def _callback(self, connection: Any) -> Callable[[bytes], None]:
        def write(message: bytes) -> None:
            if not self._is_open:  # an executor may have had it in its queue when the subscription ended
                return
            self._writer.write(connection, self._now(), message)
            self.message_count += 1

        return write

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._is_open = False
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._writer.close()
