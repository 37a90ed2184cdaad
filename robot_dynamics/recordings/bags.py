"""Bags of rosbag2, folders and single files, sqlite3 and MCAP, compressed or not: their joint states, one by one.

Without ROS: `rosbags` reads what is whole, and what breaks off is read up to there (`broken_bags`).
"""

import re
from contextlib import ExitStack
from pathlib import Path

from robot_dynamics.errors import RecordingError, describe_unknown_name
from robot_dynamics.optional_packages import import_optional
from robot_dynamics.recordings.damaged_bags import MCAP_MAGIC, SQLITE_MAGIC, read_damaged_mcap, read_damaged_sqlite
from robot_dynamics.recordings.joint_samples import sample_of_joint_state
from robot_dynamics.recordings.odometry import OdometryReader

JOINT_STATE = "sensor_msgs/msg/JointState"
ODOMETRY = "nav_msgs/msg/Odometry"
STORAGE_SUFFIXES = (".mcap", ".db3")


def import_rosbag2():
    """The module of the package `rosbags` that reads and writes bags. Raises MissingPackageError."""
    return import_optional("rosbags.rosbag2", "reading or writing a bag")


def load_typestore():
    """The message types of ROS 2 Jazzy, of the package `rosbags`. Raises MissingPackageError."""
    typesys = import_optional("rosbags.typesys", "reading or writing a bag")
    return typesys.get_typestore(typesys.Stores.ROS2_JAZZY)


class Bag:
    """A bag: `topics` {name: type}; `notes`, sentences on what is wrong with it; `samples`, as often as asked for.

    path: a Path of a folder or a file. Raises RecordingError where nothing in it can be read, MissingPackageError
    where the package that reads bags is not installed.
    """

    def __init__(self, path):
        import_rosbag2()  # before anything that would take its absence for a fault of the file
        self.path, self.notes = path, []
        self._parts = [path]
        if path.is_dir() and (trouble := _trouble(path)):
            self._parts = _storage_files(path)
            if not self._parts:
                raise RecordingError(
                    f"{path} is no bag: it has neither metadata.yaml nor files {', '.join(STORAGE_SUFFIXES)}"
                )
            self.add_note(f"metadata.yaml cannot be used ({trouble}): the files of the folder are read one by one")
        self._broken = {part: _is_broken(part, self.add_note) for part in self._parts}
        self.topics, self.counts = {}, {}
        for part in self._parts:
            for topic, kind, count in self._listed(part):
                self.topics[topic] = kind
                self.counts[topic] = self.counts.get(topic, 0) + count

    def add_note(self, sentence):
        if sentence not in self.notes:
            self.notes.append(sentence)

    def joint_topics(self, requested=()):
        """The topics that are wanted, else all with joint states. Raises RecordingError where there is none."""
        for topic in requested:
            if topic not in self.topics:
                raise RecordingError(f"{self.path}: {describe_unknown_name('topic', topic, self.topics)}")
            if self.topics[topic] != JOINT_STATE:
                raise RecordingError(f"{self.path}: topic {topic} is {self.topics[topic]}: {JOINT_STATE} is needed")
        found = list(requested) or sorted(topic for topic, kind in self.topics.items() if kind == JOINT_STATE)
        if not found:
            told = "; ".join([*self.notes, *(f"{topic}: {kind}" for topic, kind in self.topics.items())])
            raise RecordingError(f"{self.path} has no topic of {JOINT_STATE}. It has: {told[:500] or 'nothing'}")
        return sorted(found, key=lambda topic: (not topic.endswith("joint_states"), topic))

    def base_topics(self, requested=()):
        """The topic that tells how the base moves: the one of ODOMETRY that is wanted, else the only one there is."""
        odometry = [topic for topic, kind in self.topics.items() if kind == ODOMETRY]
        found = [topic for topic in odometry if topic in requested] or sorted(odometry)
        if len(found) != 1:
            told = f"name one of {', '.join(found)}" if found else f"it has no topic of {ODOMETRY}"
            raise RecordingError(f"{self.path}: the base of the robot moves, and how must be recorded: {told}")
        return found

    def samples(self, topics, base=None):
        """Yield the JointSamples of topics, in the order of the bag; of ODOMETRY those of the link `base`."""
        store, unread = load_typestore(), 0
        odometry = OdometryReader(base)
        for topic, recorded, data in self._messages(topics):
            try:
                message = store.deserialize_cdr(data, self.topics[topic])
            except Exception:  # bytes that are no message: numpy, struct and text decoding say so each in its way
                unread += 1
                continue
            read = odometry.sample if self.topics[topic] == ODOMETRY else sample_of_joint_state
            yield read(topic, recorded, message)
        if unread:
            self.add_note(f"{unread} messages are damaged, and were left out")

    def _messages(self, topics):
        for part in self._parts:
            if self._broken[part]:
                for topic, _, recorded, data in _until_broken(part, self.add_note):
                    if topic in topics:
                        yield topic, recorded, data
            else:
                yield from self._whole(part, topics)

    def _whole(self, part, topics):
        count = 0
        with ExitStack() as stack:
            reader = stack.enter_context(import_rosbag2().Reader(part))
            connections = [connection for connection in reader.connections if connection.topic in topics]
            try:
                for connection, recorded, data in reader.messages(connections) if connections else ():
                    yield connection.topic, recorded, data
                    count += 1
            except Exception as error:
                told = " ".join(str(error).split())[:100] or type(error).__name__
                self.add_note(f"{part.name} breaks off after {count} messages ({told})")

    def _listed(self, part):
        """(topic, type, messages) of a part."""
        if not self._broken[part]:
            with import_rosbag2().Reader(part) as reader:
                return [(each.topic, each.msgtype, each.msgcount) for each in reader.connections]
        counts = {}
        for topic, kind, _, _ in _until_broken(part, self.add_note):
            counts[topic, kind] = counts.get((topic, kind), 0) + 1
        return [(*key, count) for key, count in counts.items()]


def _trouble(path):
    """Why `rosbags` refuses a bag; empty where it does not."""
    try:
        with import_rosbag2().Reader(path):
            return ""
    except Exception as error:
        return " ".join(str(error).split())[:200] or type(error).__name__


def _storage_files(folder):
    """Files of a folder, those of a split bag in their order: run_2.mcap before run_10.mcap."""

    def order(path):
        return [int(digits) if digits.isdigit() else digits for digits in re.split(r"(\d+)", path.name)]

    return sorted((path for path in folder.iterdir() if path.suffix in STORAGE_SUFFIXES), key=order)


def _is_broken(part, note):
    """Whether a file has to be read without its end; a folder has been read already."""
    if part.is_dir():
        return False
    log = Path(f"{part}-wal")
    unwritten = log.exists() and log.stat().st_size > 0
    if not unwritten and not (trouble := _trouble(part)):
        return False
    kind = _kind(part)
    note(f"{part.name} was not closed: its write-ahead log is read too" if unwritten else
         f"{part.name} is not whole ({trouble}): it is read as {kind} up to where it breaks")  # fmt: skip
    return True


def _kind(part):
    with part.open("rb") as file:
        beginning = file.read(16)
    if beginning.startswith(MCAP_MAGIC):
        return "MCAP"
    if beginning == SQLITE_MAGIC:
        return "sqlite3"
    raise RecordingError(f"{part} is no bag: its first bytes are those of neither MCAP nor sqlite3")


def _until_broken(part, note):
    return (read_damaged_mcap if _kind(part) == "MCAP" else read_damaged_sqlite)(part, note)
