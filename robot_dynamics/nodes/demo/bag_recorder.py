"""Messages of a node's topics, written as they come into a bag that rosbag2, Foxglove and PlotJuggler read (MCAP)."""

from robot_dynamics.recordings.bags import import_rosbag2, load_typestore

DEEP = 2000  # messages that may wait


class BagRecorder:
    """Writes what topics {name: type} tell into a new bag; use it in a `with`.

    path: the folder of the bag, which must not be there. now: gives the time of a message [ns] as it comes.
    """

    def __init__(self, node, path, topics, now):
        self._node, self._now = node, now
        self._writer = import_rosbag2().Writer(path, version=9, storage_plugin=import_rosbag2().StoragePlugin.MCAP)
        self._topics, self.message_count = topics, 0

    def __enter__(self):
        self._writer.open()
        store = load_typestore()
        self._held = []
        for name, kind in self._topics.items():
            package, _, _ = kind.__module__.split(".", 2)
            told = f"{package}/msg/{kind.__name__}"
            connection = self._writer.add_connection(name, told, typestore=store)
            self._held.append(self._node.create_subscription(kind, name, self._keeping(connection), DEEP, raw=True))
        return self

    def _keeping(self, connection):
        def keep(message):
            self._writer.write(connection, self._now(), message)
            self.message_count += 1

        return keep

    def __exit__(self, *_):
        for subscription in self._held:
            self._node.destroy_subscription(subscription)
        self._writer.close()
