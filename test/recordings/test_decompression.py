"""Chunks and messages that unpack to far more than their size are not unpacked; the messages before them are read."""

import tracemalloc

import numpy as np
import pytest
from peers.recorded import BEGINNING, message, messages, of_rosbags, panda_motion, store, write_bag

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.bags import Bag
from robot_dynamics.recordings.decompression import CHUNK_DECOMPRESSORS, import_zstd, unpack_lz4, unpack_zstd

rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="rosbags, which reads bags, is not installed")
records = pytest.importorskip("mcap.records", reason="mcap, which writes chunks, is not installed")
data_stream = pytest.importorskip("mcap.data_stream")
lz4 = pytest.importorskip("lz4.frame")
MOTION = panda_motion(duration=0.5)
TOPIC, KIND = "/joint_states", "sensor_msgs/msg/JointState"
BOMB_SIZE = 300_000_000  # [bytes] unpacked
MEMORY = 200_000_000  # [bytes] that reading may take at most
PACK = {"zstd": lambda content: import_zstd().compress(content), "lz4": lz4.compress}


@pytest.fixture(scope="module")
def bombs():
    """{compression: packed zeros}"""
    content = bytes(BOMB_SIZE)
    return {name: pack(content) for name, pack in PACK.items()}


def written(*items):
    """The bytes of records of MCAP."""
    builder = data_stream.RecordBuilder()
    for item in items:
        item.write(builder)
    return builder.end()


def mcap_file(path, compression, packed_bombs, end, stated_size=BOMB_SIZE):
    """Write a file of a chunk with the motion, and then of bombs. end: "index", "no index", or "missing"."""
    schema = records.Schema(id=1, name=KIND, encoding="ros2msg", data=b"")
    channel = records.Channel(id=1, schema_id=1, topic=TOPIC, message_encoding="cdr", metadata={})
    entries = []
    for number, state in enumerate(messages(MOTION)):
        time = BEGINNING + round(MOTION.times[number] * 1e9)
        data = bytes(store().serialize_cdr(of_rosbags(state, store().types), KIND))
        entries.append(records.Message(channel_id=1, log_time=time, publish_time=time, sequence=number, data=data))
    good = written(schema, channel, *entries)
    first, last = entries[0].log_time, entries[-1].log_time
    content = b"\x89MCAP0\r\n" + written(records.Header(profile="ros2", library="test"))
    indexes = []
    chunks = [(first, last, len(good), PACK[compression](good))]
    chunks += [(last + k, last + k, stated_size, packed) for k, packed in enumerate(packed_bombs, start=1)]
    for begin, until, size, packed in chunks:
        chunk = records.Chunk(
            compression=compression,
            data=packed,
            message_start_time=begin,
            message_end_time=until,
            uncompressed_crc=0,
            uncompressed_size=size,
        )
        data = written(chunk)
        index = written(records.MessageIndex(channel_id=1, records=[(begin, 0)]))
        indexes.append(
            records.ChunkIndex(
                chunk_length=len(data),
                chunk_start_offset=len(content),
                compression=compression,
                compressed_size=len(packed),
                message_start_time=begin,
                message_end_time=until,
                message_index_length=len(index),
                message_index_offsets={1: len(content) + len(data)},
                uncompressed_size=size,
            )
        )
        content += data + index
    content += written(records.DataEnd(data_section_crc=0)) if end != "missing" else b""
    summary = len(content)
    if end == "index":
        content += written(schema, channel, *indexes)
    if end != "missing":
        start = summary if end == "index" else 0
        content += written(records.Footer(summary_start=start, summary_offset_start=0, summary_crc=0))
        content += b"\x89MCAP0\r\n"
    path.write_bytes(content)
    return path


def positions_in_bounded_memory(path):
    """The positions of a bag and the bag, read with little memory."""
    tracemalloc.start()
    try:
        bag = Bag(path)
        positions = np.array([sample.position for sample in bag.samples(bag.joint_topics())])
        assert tracemalloc.get_traced_memory()[1] < MEMORY
    finally:
        tracemalloc.stop()
    return positions, bag


@pytest.mark.parametrize("end", ["index", "no index", "missing"])
@pytest.mark.parametrize("compression", PACK)
def test_chunk_that_unpacks_to_too_much_ends_the_recording_with_a_note(tmp_path, bombs, compression, end):
    for stated_size in (BOMB_SIZE, 1000):
        path = mcap_file(tmp_path / f"{stated_size}.mcap", compression, [bombs[compression]], end, stated_size)
        positions, bag = positions_in_bounded_memory(path)
        np.testing.assert_array_equal(positions, MOTION.q)
        assert any("unpack to more than" in note and "breaks off after 50 messages" in note for note in bag.notes)


@pytest.mark.parametrize("end", ["index", "no index", "missing"])
@pytest.mark.parametrize("compression", PACK)
def test_sound_chunks_are_read_whatever_the_end_of_the_file(tmp_path, compression, end):
    positions, _ = positions_in_bounded_memory(mcap_file(tmp_path / "run.mcap", compression, [], end))
    np.testing.assert_array_equal(positions, MOTION.q)


def test_unknown_compression_of_chunks_is_noted(tmp_path):
    path = mcap_file(tmp_path / "run.mcap", "zstd", [], "missing")
    path.write_bytes(path.read_bytes().replace(b"zstd", b"zip7"))
    with pytest.raises(RecordingError, match="chunks are compressed by 'zip7', which cannot be read"):
        Bag(path).joint_topics()


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_message_that_unpacks_to_too_much_is_skipped_with_a_note(tmp_path, bombs, storage, monkeypatch):
    serialize = type(store()).serialize_cdr
    bomb = message(MOTION.times[-1] + 0.01, ["x"], [0.0])

    def with_bomb(types, value, kind, **options):
        return bytes(BOMB_SIZE) if list(value.name) == ["x"] else serialize(types, value, kind, **options)

    monkeypatch.setattr(type(store()), "serialize_cdr", with_bomb)
    folder = write_bag(tmp_path / "run", [*messages(MOTION), bomb], storage, rosbag2.CompressionMode.MESSAGE)
    assert sum(file.stat().st_size for file in folder.iterdir()) < 100_000
    positions, bag = positions_in_bounded_memory(folder)
    np.testing.assert_array_equal(positions, MOTION.q)
    assert bag.notes == ["1 messages are damaged and were skipped"]


def test_unpacking_takes_what_was_packed_and_no_more():
    content = np.random.default_rng(0).bytes(10_000)
    frames = PACK["zstd"](content) + PACK["zstd"](content)
    assert unpack_zstd(frames, 0) == content * 2 and unpack_zstd(b"", 0) == b""
    assert unpack_lz4(PACK["lz4"](content), 0) == content
    for unpack, pack in ((unpack_zstd, PACK["zstd"]), (unpack_lz4, PACK["lz4"])):
        limit = 1_000_000  # zeros pack better than the ratio
        assert len(unpack(pack(bytes(limit)), limit)) == limit
        with pytest.raises(RecordingError, match="unpack to more than 1 MB"):
            unpack(pack(bytes(limit + 1)), limit)
        with pytest.raises(EOFError):
            unpack(pack(content)[:-3000], 0)
    assert set(CHUNK_DECOMPRESSORS) == {"", "zstd", "lz4"}
