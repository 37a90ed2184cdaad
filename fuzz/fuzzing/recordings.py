"""Recordings: CSV, MCAP, sqlite3, bags with compressed chunks, messages and files.

An input is a line with its kind, and the content of a file; of a folder also metadata.yaml before `SEPARATOR`.
A recording is refused with a RecordingError, or read, with notes on damage. Where it is read without a note, another
reader finds the same samples.
"""

from __future__ import annotations

import csv
import io
import math
import random
import re
import shutil
import sqlite3
import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from fuzzing.campaign import Outcome
from fuzzing.mutations import mutate_bytes, mutate_text

from robot_dynamics import RobotDynamicsError
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.recording import open_recording

try:
    from mcap.reader import make_reader
except ImportError:
    make_reader = None

SEPARATOR = b"\n\x00--file--\x00\n"
JOINTS = ("shoulder", "elbow")
MEMORY_FOLDER = "/dev/shm"
KINDS = {"csv": "run.csv", "mcap": "run.mcap", "db3": "run.db3"}  # of single files
FOLDERS = {"folder.mcap": "run.mcap", "folder.db3": "run.db3", "folder.zstd": "run.db3.zstd"}
JOINT_STATE = "sensor_msgs/msg/JointState"


class RecordingTarget:
    """Files for `open_recording`."""

    name = "recordings"

    def prepare(self) -> None:
        """Nothing to load."""

    def mutate(self, data: bytes, rng: random.Random, corpus: list[bytes]) -> bytes:
        """Return a mutated recording of the same kind, mostly."""
        kind, _, content = data.partition(b"\n")
        alike = [entry.partition(b"\n")[2] for entry in corpus if entry.startswith(kind)] or [content]
        if rng.random() < 0.02:
            kind = rng.choice(corpus).partition(b"\n")[0]
        if kind == b"csv":
            return b"csv\n" + mutate_text(content, rng, alike)
        metadata, separator, file = content.partition(SEPARATOR)
        if separator and rng.random() < 0.3:
            return kind + b"\n" + mutate_text(metadata, rng, alike[:1]) + separator + file
        if separator:
            return kind + b"\n" + metadata + separator + mutate_bytes(file, rng, alike)
        return kind + b"\n" + mutate_bytes(content, rng, alike)

    def run(self, data: bytes) -> Outcome:
        """Read a recording and its motions."""
        folder = tempfile.mkdtemp(dir=MEMORY_FOLDER if Path(MEMORY_FOLDER).is_dir() else None)
        try:
            path = write_recording(Path(folder), data)
            return Outcome("refused", "kind") if path is None else read_recording(path)
        finally:
            shutil.rmtree(folder)


def write_recording(folder: Path, data: bytes) -> Path | None:
    """Write the files of an input; returns the path of the recording."""
    line, _, content = data.partition(b"\n")
    kind = line.decode("latin-1")
    if kind in KINDS:
        path = folder / KINDS[kind]
        path.write_bytes(content)
        return path
    if kind not in FOLDERS:
        return None
    metadata, _, file = content.partition(SEPARATOR)
    path = folder / "run"
    path.mkdir()
    (path / "metadata.yaml").write_bytes(metadata)
    (path / FOLDERS[kind]).write_bytes(file)
    return path


def read_recording(path: Path) -> Outcome:
    """Read a recording, and compare its samples with those of another reader."""
    try:
        recording = open_recording(path, direct_drives(JOINTS))
        samples = list(recording.source.samples(recording.topics))
        notes = recording.notes
    except RobotDynamicsError as error:
        return _refused(error)
    try:
        for motion in recording.motions():
            for values in (motion.q, motion.qd, motion.qdd):
                assert np.isfinite(values).all(), "a motion is not finite"
        detail = " ".join(re.sub(r"[^a-z ]", "", note)[:30] for note in notes)
    except RobotDynamicsError as error:
        detail = _refused(error).detail
    if notes or not samples:
        return Outcome("accepted", detail)
    expected = other_samples(path)
    if expected is None:
        return Outcome("accepted", "not covered")
    rows = [(sample.names, *map(_rounded, (sample.position, sample.velocity, sample.effort))) for sample in samples]
    assert sorted(rows) == sorted(expected), f"{len(rows)} samples, another reader has {len(expected)}"
    return Outcome("compared", detail, len(rows))


def _refused(error: RobotDynamicsError) -> Outcome:
    text = str(error)
    assert "\n" not in text and len(text) < 3000, text[:300]
    return Outcome("refused", re.sub(r"'[^']*'|[\d.]+|/\S+", "", text)[:60])


def _rounded(values) -> tuple[float, ...]:
    """Values that compare and sort: NaN as a large number."""
    return tuple(1e308 if math.isnan(value) else float(value) for value in values)


def other_samples(path: Path) -> list[tuple] | None:
    """The samples by csv, mcap or sqlite3 and by `read_joint_state`; None where these cannot read them."""
    try:
        if path.suffix == ".csv":
            return list(_table_samples(path))
        if path.is_dir():
            return None
        messages = _mcap_messages(path) if path.suffix == ".mcap" else _database_messages(path)
        return [sample for data in messages if (sample := read_joint_state(data)) is not None]
    except Exception:  # what another reader refuses is not compared
        return None


def _table_samples(path: Path) -> Iterator[tuple]:
    rows = list(csv.DictReader(io.StringIO(path.read_bytes().decode("utf-8-sig"), newline="")))
    for row in rows:
        fields = ([float(row[f"{name}.{field}"]) for name in JOINTS] for field in ("position", "velocity", "effort"))
        yield (JOINTS, *map(_rounded, fields))


def _mcap_messages(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        for schema, _, message in make_reader(file).iter_messages():
            if schema is not None and schema.name == JOINT_STATE:
                yield message.data


def _database_messages(path: Path) -> Iterator[bytes]:
    database = sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True)
    try:
        query = "SELECT data FROM messages JOIN topics ON topic_id = topics.id WHERE type = ?"
        yield from (data for (data,) in database.execute(query, (JOINT_STATE,)))
    finally:
        database.close()


def read_joint_state(data: bytes) -> tuple | None:
    """(names, position, velocity, effort) of a serialized JointState in little-endian CDR; None of another encoding."""
    if data[:2] != b"\x00\x01":
        return None
    data = data[4:]
    position = 8

    def length() -> int:
        nonlocal position
        position += -position % 4
        position += 4
        return struct.unpack_from("<I", data, position - 4)[0]

    def text() -> str:
        nonlocal position
        size = length()
        position += size
        return data[position - size : position - 1].decode()

    def numbers() -> tuple[float, ...]:
        nonlocal position
        count = length()
        if count:
            position += -position % 8
        position += 8 * count
        return struct.unpack_from(f"<{count}d", data, position - 8 * count)

    text()
    names = tuple(text() for _ in range(length()))
    return (names, *map(_rounded, (numbers(), numbers(), numbers())))
