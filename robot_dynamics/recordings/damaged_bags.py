"""Bags that end early, of robots that lost power: the messages from the beginning to the damage.

The functions need neither the `sqlite3` nor the `mcap` command, whose `recover` copies the file first, and they report
where each file ends.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import quote

from robot_dynamics.optional_packages import import_optional
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
    reader = import_optional("mcap.reader", "reading an MCAP file that breaks off")
    with path.open("rb") as file:
        try:
            for schema, channel, message in reader.NonSeekingReader(file).iter_messages(log_time_order=False):
                yield RawMessage(channel.topic, schema.name if schema else "", message.log_time, message.data)
                count += 1
        # decompression, struct and text decoding raise errors of different families where bytes are missing
        except Exception as error:
            note(f"{path.name} breaks off after {count} messages, at byte {file.tell()} ({shorten_error(error)})")


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
    cells = sorted(pages.cells())
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
