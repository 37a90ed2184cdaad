"""Bags that end early, of robots that lost power: the messages from the beginning to the damage.

The functions need neither the `sqlite3` nor the `mcap` command, whose `recover` copies the file first, and they report
where each file ends.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple
from urllib.parse import quote

from robot_dynamics.errors import RecordingError
from robot_dynamics.optional_packages import import_optional
from robot_dynamics.recordings.decompression import CHUNK_DECOMPRESSORS
from robot_dynamics.recordings.sqlite_pages import SqlitePages

if TYPE_CHECKING:
    from robot_dynamics.recordings.sqlite_pages import Cell

MCAP_MAGIC = b"\x89MCAP0\r\n"
SQLITE_MAGIC = b"SQLite format 3\x00"
MESSAGE_QUERY = (
    "SELECT name, type, timestamp, data FROM messages JOIN topics ON topic_id = topics.id ORDER BY messages.id"
)
MAX_TOPICS = 10_000
MAX_REASON_LENGTH = 100  # characters of the error of another library in a note


class RawMessage(NamedTuple):
    """A serialized message, its topic and type, and the time of recording [ns]."""

    topic: str
    type: str
    receive_time: int
    data: bytes


def shorten_error(error: Exception, length: int = MAX_REASON_LENGTH) -> str:
    """The text of an error in one line, or its type where it has no text."""
    return " ".join(str(error).split())[:length] or type(error).__name__


def read_damaged_mcap(path: Path, note: Callable[[str], None]) -> Iterator[RawMessage]:
    """Yield the messages of an MCAP file without its end, in the order in which they were written.

    note: called with a sentence on where the file ends. Raises MissingPackageError.
    """
    count = 0
    mcap = import_optional("mcap.stream_reader", "reading an MCAP file that breaks off")
    with path.open("rb") as file:
        try:
            for message in _messages_of_records(_mcap_records(mcap, file, path.stat().st_size)):
                yield message
                count += 1
        # decompression, struct and text decoding raise errors of different families where bytes are missing
        except Exception as error:
            note(f"{path.name} breaks off after {count} messages, at byte {file.tell()} ({shorten_error(error)})")


def _mcap_records(mcap: ModuleType, file: BinaryIO, size: int) -> Iterator[Any]:  # of mcap, which may be missing
    """Yield the records of an MCAP file of a size [bytes], and those of its chunks in their place."""
    for record in mcap.StreamReader(file, emit_chunks=True, record_size_limit=size).records:
        if isinstance(record, mcap.Chunk):
            unpack = CHUNK_DECOMPRESSORS.get(record.compression)
            if unpack is None:
                raise RecordingError(f"chunks are compressed by {record.compression[:30]!r}, which cannot be read")
            content = unpack(record.data, record.uncompressed_size)
            yield from mcap.breakup_chunk(replace(record, compression="", data=content))
        else:
            yield record


def _messages_of_records(records: Iterable[Any]) -> Iterator[RawMessage]:
    """Yield the messages of records of MCAP. Raises RecordingError where the topic of a message is missing."""
    schemas: dict[int, str] = {0: ""}
    channels: dict[int, tuple[str, str]] = {}
    for record in records:
        match type(record).__name__:
            case "Schema":
                schemas[record.id] = record.name
            case "Channel":
                if record.schema_id not in schemas:
                    raise RecordingError(f"schema {record.schema_id} of {record.topic[:100]!r} is missing")
                channels[record.id] = (record.topic, schemas[record.schema_id])
            case "Message":
                if record.channel_id not in channels:
                    raise RecordingError(f"channel {record.channel_id} of a message is missing")
                yield RawMessage(*channels[record.channel_id], record.log_time, record.data)


def read_damaged_sqlite(path: Path, note: Callable[[str], None]) -> Iterator[RawMessage]:
    """Yield the messages of an sqlite3 file that is damaged or was not closed, in the order of writing.

    note: called with a sentence on where the file ends.
    """
    log = Path(f"{path}-wal")
    if log.exists() and log.stat().st_size > 0:
        try:
            with closing(_open_with_log(path)) as database:
                yield from map(RawMessage._make, database.execute(MESSAGE_QUERY))
            return
        except sqlite3.Error as error:
            note(f"{path.name} cannot be read with its write-ahead log ({error}): it is read without the log")
    with path.open("rb") as file:
        try:
            yield from _messages_of_pages(path.name, SqlitePages(file), note)
        except ValueError as error:
            note(f"{path.name} breaks off after 0 messages ({error})")


def _messages_of_pages(name: str, pages: SqlitePages, note: Callable[[str], None]) -> Iterator[RawMessage]:
    """Yield the messages of all remaining leaves, by their rowid."""
    cells = sorted(set(pages.cells()))  # a damaged page may point to a cell many times
    topics = _topics(pages, cells)
    count = 0
    incomplete = 0
    previous_rowid = None
    for cell in cells:
        try:
            values = pages.row(cell)
        except ValueError:
            incomplete += 1
            continue
        match values:
            case [_, int(topic), int(receive_time), bytes(data)] if topic in topics and cell.rowid != previous_rowid:
                yield RawMessage(*topics[topic], receive_time, data)
                count += 1
                previous_rowid = cell.rowid
    note(
        f"{name} breaks off after {count} messages: {pages.count} of {pages.declared_count} pages are left, "
        f"with {incomplete} incomplete rows"
    )


def _topics(pages: SqlitePages, cells: list[Cell]) -> dict[int, tuple[str, str]]:
    """{rowid: (name, type)} of the table of topics, in sorted cells: topics are few, and have the lowest rowids."""
    topics = {}
    for cell in cells:
        if cell.rowid > MAX_TOPICS:
            break
        with suppress(ValueError):
            match pages.row(cell):
                case [_, str(name), str(kind), "cdr", *_]:
                    topics[cell.rowid] = (name, kind)
    return topics


def _open_with_log(path: Path) -> sqlite3.Connection:
    """The database with its write-ahead log; without the log where the folder is read-only."""
    name = quote(str(path.resolve()))
    try:
        database = sqlite3.connect(f"file:{name}?mode=ro", uri=True)
        database.execute("SELECT count(*) FROM sqlite_master")
    except sqlite3.Error:
        database = sqlite3.connect(f"file:{name}?immutable=1", uri=True)
    return database
