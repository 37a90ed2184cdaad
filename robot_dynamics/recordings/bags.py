"""Bags of rosbag2: joint states and odometry in folders and single files, sqlite3 and MCAP, compressed or not.

ROS is not needed: `rosbags` reads complete files, and `damaged_bags` reads files that end early.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from robot_dynamics.errors import RecordingError, describe_unknown_name
from robot_dynamics.optional_packages import import_optional
from robot_dynamics.recordings.chunk_headers import differing_chunks
from robot_dynamics.recordings.damaged_bags import (
    MCAP_MAGIC,
    SQLITE_MAGIC,
    RawMessage,
    read_damaged_mcap,
    read_damaged_sqlite,
    shorten_error,
)
from robot_dynamics.recordings.decompression import MIN_MESSAGE_LIMIT, bound_chunks, unpack_zstd
from robot_dynamics.recordings.joint_samples import sample_of_joint_state
from robot_dynamics.recordings.odometry import OdometryReader
from robot_dynamics.recordings.unpacked_bags import unpack_bag

if TYPE_CHECKING:
    from robot_dynamics.recordings.joint_samples import JointSample

LFS_MAGIC = b"version https://"  # a small text in place of a large file that was not downloaded
JOINT_STATE = "sensor_msgs/msg/JointState"
ODOMETRY = "nav_msgs/msg/Odometry"
STORAGE_SUFFIXES = (".mcap", ".db3")


def import_rosbag2() -> ModuleType:
    """The module of the package `rosbags` that reads and writes bags, which unpacks chunks to a bounded size.

    Raises MissingPackageError.
    """
    module = import_optional("rosbags.rosbag2", "reading or writing a bag")
    bound_chunks()
    return module


def load_typestore() -> Any:  # of rosbags, which may be missing
    """The message types of ROS 2 Jazzy, of the package `rosbags`. Raises MissingPackageError."""
    typesys = import_optional("rosbags.typesys", "reading or writing a bag")
    return typesys.get_typestore(typesys.Stores.ROS2_JAZZY)


class TopicCount(NamedTuple):
    """A topic of a bag file, its type and its number of messages."""

    topic: str
    type: str
    messages: int


class Bag:
    """A bag, complete or damaged.

    Parameters
    ----------
    path : of a folder or a file.

    Attributes
    ----------
    topics : {name: type} of all topics.
    counts : {topic: number of messages}.
    notes : sentences on damage; complete after `samples` was read.

    Raises
    ------
    RecordingError
        Where nothing in the files can be read.
    MissingPackageError
        Where `rosbags` is not installed.
    """

    def __init__(self, path: Path) -> None:
        import_rosbag2()  # first, so that a missing package is not reported as a damaged file
        self.path = path
        self.notes: list[str] = []
        self._unpacked = unpack_bag(path, self.add_note) if path.is_dir() else None  # removed with this object
        self._folder = path if self._unpacked is None else self._unpacked.folder
        self._has_packed_messages = self._unpacked is not None and self._unpacked.has_packed_messages
        self._files = self._readable_parts()
        self._damaged = {file for file in self._files if _is_damaged(file, self.add_note)}
        self.topics: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        for file in self._files:
            for topic, kind, messages in self._topic_counts(file):
                self.topics[topic] = kind
                self.counts[topic] = self.counts.get(topic, 0) + messages

    def _readable_parts(self) -> list[Path]:
        """The path itself, or the files of a folder whose metadata.yaml cannot be used."""
        error = _read_error(self._folder) if self._folder.is_dir() else None
        if error is None:
            return [self._folder]
        files = _storage_files(self._folder)
        if not files:
            suffixes = ", ".join(STORAGE_SUFFIXES)
            raise RecordingError(f"{self.path} is no bag: it has neither metadata.yaml nor files {suffixes}")
        self.add_note(f"metadata.yaml cannot be used ({error}): the files of the folder are read one by one")
        return files

    def add_note(self, sentence: str) -> None:
        """Append a sentence to the notes, once."""
        if sentence not in self.notes:
            self.notes.append(sentence)

    def joint_topics(self, requested: Sequence[str] = ()) -> list[str]:
        """The requested topics, or all of joint states; those named joint_states first.

        Raises RecordingError where a topic is missing or of another type, or there is none.
        """
        for topic in requested:
            if topic not in self.topics:
                raise RecordingError(f"{self.path}: {describe_unknown_name('topic', topic, self.topics)}")
            if self.topics[topic] != JOINT_STATE:
                raise RecordingError(f"{self.path}: topic {topic} is {self.topics[topic]}: {JOINT_STATE} is needed")
        topics = list(requested) or [topic for topic, kind in self.topics.items() if kind == JOINT_STATE]
        if not topics:
            content = "; ".join(f"{topic}: {kind}" for topic, kind in self.topics.items())[:500]
            notes = "".join(f". {note}" for note in self.notes)
            raise RecordingError(f"{self.path} has no topic of {JOINT_STATE}. It has: {content or 'no topics'}{notes}")
        return sorted(topics, key=lambda topic: (not topic.endswith("joint_states"), topic))

    def base_topics(self, requested: Collection[str] = ()) -> list[str]:
        """The topic of odometry: the one that is requested, or the only one.

        Raises RecordingError where there is none, or several and none of them is requested.
        """
        odometry = [topic for topic, kind in self.topics.items() if kind == ODOMETRY]
        topics = [topic for topic in odometry if topic in requested] or sorted(odometry)
        if len(topics) != 1:
            remedy = f"name one of {', '.join(topics)}" if topics else f"it has no topic of {ODOMETRY}"
            raise RecordingError(f"{self.path}: the base of the robot moves, so that odometry is needed: {remedy}")
        return topics

    def time_span(self) -> tuple[int, int] | None:
        """Times of recording [ns] of the first message, and after the last.

        None of a bag that is not complete, or had to be unpacked: each part of it would be unpacked again.
        """
        is_unpacked = self._unpacked is not None and not self._has_packed_messages
        if len(self._files) != 1 or self._damaged or self.notes or is_unpacked:
            return None
        with import_rosbag2().Reader(self._files[0]) as reader:
            return int(reader.start_time), int(reader.end_time)

    def samples(
        self,
        topics: Collection[str],
        base: str | None = None,
        *,
        begin: int | None = None,
        end: int | None = None,
    ) -> Generator[JointSample, None, None]:
        """Yield the joint samples of topics, in the order of the bag.

        base: name of the base link, whose motion topics of odometry contain; begin, end: times of recording [ns] of
        the messages, `end` not included, for complete bags alone. Raises RecordingError where topics of odometry
        contain the motion of another link.
        """
        typestore = load_typestore()
        odometry = OdometryReader(base or "")
        unreadable = 0
        for raw in self._messages(topics, begin, end):
            kind = self.topics[raw.topic]
            try:
                data = unpack_zstd(raw.data, MIN_MESSAGE_LIMIT) if self._has_packed_messages else raw.data
                message = typestore.deserialize_cdr(data, kind)
            except Exception:  # numpy, struct, zstd and text decoding raise different errors for damaged bytes
                unreadable += 1
                continue
            convert = odometry.sample if kind == ODOMETRY else sample_of_joint_state
            yield convert(raw.topic, raw.receive_time, message)
        if unreadable:
            self.add_note(f"{unreadable} messages are damaged and were skipped")

    def _messages(self, topics: Collection[str], begin: int | None, end: int | None) -> Iterator[RawMessage]:
        for file in self._files:
            if file in self._damaged:
                yield from (raw for raw in _read_damaged(file, self.add_note) if raw.topic in topics)
            else:
                yield from self._read_complete(file, topics, begin, end)

    def _read_complete(
        self, file: Path, topics: Collection[str], begin: int | None, end: int | None
    ) -> Iterator[RawMessage]:
        """Yield the messages of a file that `rosbags` opens; where reading fails, a note is added."""
        count = 0
        with ExitStack() as stack:
            reader = stack.enter_context(import_rosbag2().Reader(file))
            connections = [connection for connection in reader.connections if connection.topic in topics]
            if not connections:
                return
            try:
                self._note_chunk_headers(reader.storage)
                for connection, receive_time, data in reader.messages(connections, begin, end):
                    yield RawMessage(connection.topic, connection.msgtype, receive_time, data)
                    count += 1
            except Exception as error:
                self.add_note(f"{file.name} breaks off after {count} messages ({shorten_error(error)})")
                return
            stated = sum(connection.msgcount for connection in connections)
            if begin is None and end is None and count != stated:
                # `rosbags` leaves messages out that lie outside the times which the index states for their chunk
                self.add_note(f"{file.name} is damaged: it states {stated} messages, and {count} can be read")

    def _note_chunk_headers(self, storage: Any) -> None:  # of rosbags, which may be missing
        """Add notes on MCAP files, alone or in a folder, whose chunks have other headers than the index states."""
        for file in getattr(storage, "storages", [storage]):
            offsets = differing_chunks(file.bio, file.chunks) if hasattr(file, "chunks") else []
            if offsets:
                self.add_note(
                    f"{file.path.name} is damaged: the header of a chunk differs from the index ({len(offsets)} of "
                    f"{len(file.chunks)} chunks, first at byte {offsets[0]}): chunks are read as the index states"
                )

    def _topic_counts(self, file: Path) -> list[TopicCount]:
        if file not in self._damaged:
            with import_rosbag2().Reader(file) as reader:
                return [TopicCount(each.topic, each.msgtype, each.msgcount) for each in reader.connections]
        counts: dict[tuple[str, str], int] = {}
        for raw in _read_damaged(file, self.add_note):
            counts[raw.topic, raw.type] = counts.get((raw.topic, raw.type), 0) + 1
        return [TopicCount(*key, count) for key, count in counts.items()]


def _read_error(path: Path) -> str | None:
    """The reason why `rosbags` cannot open a bag; None where it can."""
    try:
        with import_rosbag2().Reader(path):
            return None
    except Exception as error:
        return shorten_error(error, length=200)


def _storage_files(folder: Path) -> list[Path]:
    """Files of a folder; those of a split bag in their order: run_2.mcap before run_10.mcap."""

    def order(path: Path) -> list[int | str]:
        return [int(digits) if digits.isdigit() else digits for digits in re.split(r"(\d+)", path.name)]

    return sorted((path for path in folder.iterdir() if path.suffix in STORAGE_SUFFIXES), key=order)


def _is_damaged(file: Path, note: Callable[[str], None]) -> bool:
    """Whether a file is incomplete or was not closed; then `note` is called with a sentence. False for a folder."""
    if file.is_dir():
        return False
    log = Path(f"{file}-wal")
    if log.exists() and log.stat().st_size > 0:
        _storage_format(file)
        note(f"{file.name} was not closed: its write-ahead log is read too")
        return True
    error = _read_error(file)
    if error is None:
        return False
    note(f"{file.name} is incomplete ({error}): it is read as {_storage_format(file)} to where it breaks off")
    return True


def _storage_format(file: Path) -> Literal["MCAP", "sqlite3"]:
    """The format of a file by its first bytes. Raises RecordingError where it is none of a bag."""
    with file.open("rb") as opened:
        magic = opened.read(16)
    if magic.startswith(MCAP_MAGIC):
        return "MCAP"
    if magic == SQLITE_MAGIC:
        return "sqlite3"
    if magic.startswith(LFS_MAGIC):
        raise RecordingError(f"{file} is a pointer of Git LFS, not the bag itself: download the bag with git lfs pull")
    raise RecordingError(f"{file} is no bag: its first bytes are those of neither MCAP nor sqlite3")


def _read_damaged(file: Path, note: Callable[[str], None]) -> Iterator[RawMessage]:
    read = read_damaged_mcap if _storage_format(file) == "MCAP" else read_damaged_sqlite
    return read(file, note)
