"""Bags that break off, of robots that lost power: what can still be read of them, from the beginning to the break.

Both readers yield (topic, type, time of recording [ns], serialized message), and tell `broken(sentence)` where it ends.
"""

import sqlite3
from contextlib import closing, suppress
from pathlib import Path
from urllib.parse import quote

from robot_dynamics.optional_packages import import_optional
from robot_dynamics.recordings.sqlite_pages import SqlitePages

MCAP_MAGIC = b"\x89MCAP0\r\n"
SQLITE_MAGIC = b"SQLite format 3\x00"
MAX_TOPICS = 10_000


def read_damaged_mcap(path, broken):
    """Messages of an MCAP file without its end, in the order in which they were written."""
    count, reader = 0, import_optional("mcap.reader", "reading an MCAP file that breaks off")
    with path.open("rb") as file:
        try:
            for schema, channel, message in reader.NonSeekingReader(file).iter_messages(log_time_order=False):
                yield channel.topic, schema.name if schema else "", message.log_time, message.data
                count += 1
        # what decompression, struct and text decoding raise where bytes are missing is no family of errors
        except Exception as error:
            told = " ".join(str(error).split())[:100] or type(error).__name__
            broken(f"{path.name} breaks off after {count} messages, at byte {file.tell()} ({told})")


def read_damaged_sqlite(path, broken):
    """Messages of an sqlite3 file that is damaged or was never closed, in the order in which they were written."""
    log = Path(f"{path}-wal")
    if log.exists() and log.stat().st_size > 0:
        try:
            with closing(_opened(path)) as database:
                yield from database.execute("SELECT name, type, timestamp, data FROM messages JOIN topics "
                                            "ON topic_id = topics.id ORDER BY messages.id")  # fmt: skip
            return
        except sqlite3.Error as error:
            broken(f"{path.name} cannot be read with its log ({error}): it is read without")
    with path.open("rb") as file:
        try:
            yield from _from_pages(path.name, SqlitePages(file), broken)
        except ValueError as error:
            broken(f"{path.name} breaks off after 0 messages ({error})")


def _from_pages(name, pages, broken):
    """Messages from all leaves that are left, by the number that they were given."""
    cells, lost, count, previous, topics = sorted(pages.cells()), 0, 0, None, {}
    for rowid, number, offset in cells:  # the topics are few, and their rows have the lowest numbers
        if rowid > MAX_TOPICS:
            break
        with suppress(ValueError):
            values = pages.row(number, offset).values
            if len(values) >= 4 and isinstance(values[1], str) and values[3] == "cdr":
                topics[rowid] = values[1:3]
    for rowid, number, offset in cells:
        try:
            values = pages.row(number, offset).values
        except ValueError:
            lost += 1
            continue
        if len(values) == 4 and isinstance(values[3], bytes) and values[1] in topics and rowid != previous:
            yield *topics[values[1]], values[2], values[3]
            count, previous = count + 1, rowid
    broken(f"{name} breaks off after {count} messages: of {pages.declared_count} pages {pages.count} are there, "
           f"and {lost} rows in them are not whole")  # fmt: skip


def _opened(path):
    """The database, with what stands in its write-ahead log; without, where the folder cannot be written to."""
    name = quote(str(path.resolve()))
    try:
        database = sqlite3.connect(f"file:{name}?mode=ro", uri=True)
        database.execute("SELECT count(*) FROM sqlite_master")
    except sqlite3.Error:
        database = sqlite3.connect(f"file:{name}?immutable=1", uri=True)
    return database
