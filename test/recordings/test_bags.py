"""Bags of all storage formats; damaged ones are read to where they break off, with a note."""

import shutil
import sqlite3
import tempfile
import tracemalloc

import numpy as np
import pytest
import yaml
from peers.recorded import BEGINNING, message, messages, of_rosbags, panda_motion, store, write_bag

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings import unpacked_bags
from robot_dynamics.recordings.bags import JOINT_STATE, SQLITE_MAGIC, Bag
from robot_dynamics.recordings.decompression import import_zstd
from robot_dynamics.recordings.sqlite_pages import SqlitePages

rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="rosbags, which reads bags, is not installed")
mcap = pytest.importorskip("mcap.reader", reason="mcap is not installed")
MOTION = panda_motion(duration=6.0)
MODES = rosbag2.CompressionMode
KINDS = [
    ("mcap", None),
    ("sqlite3", None),
    ("mcap", MODES.MESSAGE),
    ("mcap", MODES.FILE),
    ("sqlite3", MODES.FILE),
    ("mcap", MODES.STORAGE),
]


def positions(bag, requested=()):
    return np.array([sample.position for sample in bag.samples(bag.joint_topics(requested))])


def storage_file(folder):
    return next(path for path in folder.iterdir() if path.suffix in (".mcap", ".db3"))


@pytest.mark.parametrize(("storage", "compression"), KINDS)
def test_bag_of_every_storage_format_gives_the_written_messages(tmp_path, storage, compression):
    bag = Bag(write_bag(tmp_path / "run", messages(MOTION), storage, compression))
    samples = list(bag.samples(bag.joint_topics()))
    for field, expected in (("position", MOTION.q), ("velocity", MOTION.qd), ("effort", MOTION.efforts)):
        assert np.array_equal([getattr(sample, field) for sample in samples], expected)
    stamps = np.array([sample.stamp for sample in samples])
    assert np.array_equal(stamps - stamps[0], np.round(MOTION.times * 1e9).astype(int))
    assert bag.notes == [] and bag.counts == {"/joint_states": len(MOTION.times)}


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_bag_reads_a_single_file(tmp_path, storage):
    bag = Bag(storage_file(write_bag(tmp_path / "run", messages(MOTION), storage)))
    assert np.array_equal(positions(bag), MOTION.q) and bag.notes == []


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_bag_reads_a_folder_without_metadata_with_a_note(tmp_path, storage):
    folder = write_bag(tmp_path / "run", messages(MOTION), storage)
    (folder / "metadata.yaml").unlink()
    bag = Bag(folder)
    assert np.array_equal(positions(bag), MOTION.q)
    assert "metadata.yaml cannot be used" in bag.notes[0]


def test_bag_reads_the_files_of_a_split_bag_in_the_order_of_their_numbers(tmp_path):
    whole = messages(MOTION)
    (tmp_path / "run").mkdir()
    for number in range(12):
        part = write_bag(tmp_path / "part", whole[number * 50 : (number + 1) * 50])
        shutil.move(storage_file(part), tmp_path / "run" / f"run_{number}.mcap")
        shutil.rmtree(part)
    assert np.array_equal(positions(Bag(tmp_path / "run")), MOTION.q)


@pytest.fixture(scope="module", params=["mcap", "sqlite3"])
def long_bag(request, tmp_path_factory):
    """(storage, content of the file, the motion): several chunks of an MCAP, a tree of three levels in sqlite3."""
    long = panda_motion(duration=60.0)
    folder = write_bag(tmp_path_factory.mktemp("long") / "run", messages(long), request.param)
    return request.param, storage_file(folder).read_bytes(), long


@pytest.mark.parametrize("tenth", range(10))
def test_bag_reads_the_rest_of_a_truncated_file(tmp_path, long_bag, tenth):
    storage, content, long = long_bag
    cut = tmp_path / ("cut.mcap" if storage == "mcap" else "cut.db3")
    cut.write_bytes(content[: len(content) * tenth // 10])
    try:
        bag = Bag(cut)
        bag_positions = positions(bag)
    except RecordingError as error:  # no message is left
        assert tenth == 0 or (storage == "mcap" and tenth <= 4)
        assert "is no bag" in str(error) or "breaks off after 0 messages" in str(error)
        return
    assert any("breaks off after" in note for note in bag.notes)
    assert np.array_equal(bag_positions, long.q[: len(bag_positions)])
    assert len(bag_positions) > (tenth / 10 - (0.35 if storage == "mcap" else 0.1)) * len(long.q)


def test_bag_without_a_complete_chunk_has_no_topics(tmp_path):
    content = storage_file(write_bag(tmp_path / "run", messages(MOTION))).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content[:2000])
    with pytest.raises(RecordingError, match=r"It has: no topics\. cut\.mcap is incomplete .*: it is read as MCAP"):
        Bag(cut).joint_topics()


def test_bag_reads_a_database_that_was_not_closed_with_its_log(tmp_path):
    """`rosbags` does not read messages that are in the write-ahead log only."""
    file = storage_file(write_bag(tmp_path / "run", messages(MOTION)[:100], "sqlite3"))
    writer = sqlite3.connect(file)
    writer.execute("PRAGMA journal_mode=WAL")
    types = store()
    rows = [
        (1, 1_600_000_100_000_000_000 + k, types.serialize_cdr(of_rosbags(state, types.types), JOINT_STATE))
        for k, state in enumerate(messages(MOTION)[100:200])
    ]
    writer.executemany(
        "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)",
        [(topic, stamp, bytes(data)) for topic, stamp, data in rows],
    )
    writer.commit()
    for suffix in ("", "-wal"):
        shutil.copy(f"{file}{suffix}", tmp_path / f"lost.db3{suffix}")
    writer.close()
    bag = Bag(tmp_path / "lost.db3")
    assert np.array_equal(positions(bag), MOTION.q[:200])
    assert "was not closed" in bag.notes[0]


def test_bag_refuses_other_files_and_missing_topics(tmp_path):
    text = tmp_path / "notes.mcap"
    text.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n")
    with pytest.raises(RecordingError, match=r"notes\.mcap is a pointer of Git LFS"):
        Bag(text)
    text.write_text("this is no bag at all")
    with pytest.raises(RecordingError, match=r"notes\.mcap is no bag"):
        Bag(text)
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match=r"neither metadata\.yaml nor files"):
        Bag(tmp_path / "empty")
    string = store().types["std_msgs/msg/String"]("hello")
    mixed = [
        ("/joint_states", message(0, ["a"], [1])),
        ("/chatter", string),
        ("/arm/joint_states", message(0, ["b"], [1])),
    ]
    bag = Bag(write_bag(tmp_path / "mixed", mixed))
    with pytest.raises(RecordingError, match="did you mean '/joint_states'"):
        bag.joint_topics(["/joint_state"])
    with pytest.raises(RecordingError, match="/chatter is std_msgs/msg/String: sensor_msgs/msg/JointState is needed"):
        bag.joint_topics(["/chatter"])
    assert bag.joint_topics() == ["/arm/joint_states", "/joint_states"]
    bag = Bag(write_bag(tmp_path / "chatter", [("/chatter", string)]))
    with pytest.raises(RecordingError, match=r"has no topic of sensor_msgs/msg/JointState\. It has: /chatter"):
        bag.joint_topics()


def varint(value):
    groups = [value & 0x7F]
    while value := value >> 7:
        groups.append(value & 0x7F | 0x80)
    return bytes(reversed(groups))


def damaged_database(path, overflow, size):
    """A file of three pages of 4096 bytes: a leaf with a row of `size` bytes that continues on a page."""
    header = bytearray(SQLITE_MAGIC + bytes(84))
    header[16:18], header[28:32] = (4096).to_bytes(2, "big"), (9).to_bytes(4, "big")
    local = (4096 - 12) * 32 // 255 - 23
    local += (size - local) % 4092 if local + (size - local) % 4092 <= 4096 - 35 else 0
    row = varint(size) + varint(1) + varint(4) + bytes(local - 1) + overflow.to_bytes(4, "big")
    leaf = bytearray(4096)
    leaf[0], leaf[3:5], leaf[8:10] = 0x0D, (1).to_bytes(2, "big"), (4096 - len(row)).to_bytes(2, "big")
    leaf[4096 - len(row) :] = row
    path.write_bytes(bytes(header) + bytes(3996) + bytes(leaf) + overflow.to_bytes(4, "big") + bytes(4092))
    return path


@pytest.mark.parametrize("size", [10_000, 1 << 40])
def test_overflow_page_that_continues_on_itself_takes_no_memory(tmp_path, size):
    path = damaged_database(tmp_path / "loop.db3", 3, size)
    with path.open("rb") as file:
        pages = SqlitePages(file)
        (cell,) = pages.cells()
        tracemalloc.start()
        try:
            with pytest.raises(ValueError, match=r"its own again|longer than the file"):
                pages.row(cell)
            assert tracemalloc.get_traced_memory()[1] < 1e6
        finally:
            tracemalloc.stop()
    assert Bag(path).topics == {}


def database_of_two_rows(path, pointers):
    """Three pages of 4096 bytes: a leaf with a false and a good row of 4581 bytes, both of which go on at page 3.

    pointers: numbers of the rows, 0 and 1, that the leaf points to.
    """
    size = 489 + 4092
    blob = bytes(range(256)) * 17
    blob += bytes(size - len(blob) - 10)
    record = varint(6) + varint(0) + varint(1) + varint(1) + varint(12 + 2 * len(blob))
    record = bytes([len(record)]) + record[1:] + b"\x05\x07" + blob
    assert len(record) <= size
    record += bytes(size - len(record))
    false = varint(3) + varint(12 + 2 * 5000) + bytes(size)
    header = bytearray(SQLITE_MAGIC + bytes(84))
    header[16:18], header[28:32] = (4096).to_bytes(2, "big"), (3).to_bytes(4, "big")
    leaf = bytearray(4096)
    leaf[0], leaf[3:5] = 0x0D, len(pointers).to_bytes(2, "big")
    offsets = (3000, 3550)
    for number, (offset, payload) in enumerate(zip(offsets, (false, record), strict=True)):
        row = varint(size) + varint(number + 1) + payload[:489] + (3).to_bytes(4, "big")
        leaf[offset : offset + len(row)] = row
    for index, number in enumerate(pointers):
        leaf[8 + 2 * index : 10 + 2 * index] = offsets[number].to_bytes(2, "big")
    path.write_bytes(bytes(header) + bytes(3996) + bytes(leaf) + bytes(4) + record[489:])
    return blob


def test_false_row_does_not_take_the_pages_of_a_good_row(tmp_path):
    blob = database_of_two_rows(tmp_path / "false.db3", [0, 1])
    with (tmp_path / "false.db3").open("rb") as file:
        pages = SqlitePages(file)
        false, good = pages.cells()
        with pytest.raises(ValueError, match="incomplete"):
            pages.row(false)
        assert pages.row(good) == [None, 5, 7, blob]


@pytest.mark.parametrize("row", [0, 1])
def test_cell_with_many_pointers_is_read_once(tmp_path, monkeypatch, row):
    database_of_two_rows(tmp_path / "repeated.db3", [row] * 1400)
    reads = []
    read_page = SqlitePages.page
    monkeypatch.setattr(SqlitePages, "page", lambda pages, number: reads.append(number) or read_page(pages, number))
    assert Bag(tmp_path / "repeated.db3").counts == {}
    assert len(reads) < 20


def test_compressed_file_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    folder = write_bag(tmp_path / "run", messages(MOTION), "sqlite3", MODES.FILE)
    packed = next(path for path in folder.iterdir() if path.suffix == ".zstd")
    content = packed.read_bytes()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    packed.write_bytes(content + import_zstd().compress(bytes(100_000_000)))
    with pytest.raises(RecordingError, match=r"unpacks to more than 67 MB, \d+ times its size"):
        Bag(folder)
    packed.write_bytes(content)
    monkeypatch.setattr(unpacked_bags, "MIN_FREE_SPACE", 1 << 60)
    with pytest.raises(RecordingError, match=r"are free in .*temporary\. Set TMPDIR"):
        Bag(folder)
    assert list((tmp_path / "temporary").iterdir()) == []


def with_file_names(folder, names):
    """A compressed bag whose metadata have a YAML text as the names of its files."""
    metadata = folder / unpacked_bags.METADATA
    content = yaml.safe_load(metadata.read_text())
    content[unpacked_bags.INFORMATION]["relative_file_paths"] = "NAMES"
    metadata.write_text(yaml.safe_dump(content).replace("NAMES", names))
    return folder


def test_nested_aliases_in_the_place_of_file_names_take_no_memory(tmp_path):
    folder = write_bag(tmp_path / "run", messages(MOTION), "sqlite3", MODES.FILE)
    with_file_names(folder, "[&a0 [x, x], " + ", ".join(f"&a{k} [*a{k - 1}, *a{k - 1}]" for k in range(1, 20)) + "]")
    tracemalloc.start()
    try:
        with pytest.raises(RecordingError):
            Bag(folder)
        assert tracemalloc.get_traced_memory()[1] < 2e6
    finally:
        tracemalloc.stop()


def test_file_name_longer_than_the_system_allows_is_refused(tmp_path):
    folder = write_bag(tmp_path / "run", messages(MOTION), "sqlite3", MODES.FILE)
    with pytest.raises(RecordingError):
        Bag(with_file_names(folder, f"[{'x' * 300}]"))


def test_file_name_that_yaml_cannot_convert_is_refused(tmp_path):
    folder = write_bag(tmp_path / "run", messages(MOTION), "sqlite3", MODES.FILE)
    with pytest.raises(RecordingError):  # PyYAML raises an IndexError
        Bag(with_file_names(folder, "[!!int ]"))


def test_compressed_files_are_unpacked_once_and_within_one_limit(tmp_path, monkeypatch):
    folder = write_bag(tmp_path / "run", messages(MOTION), "sqlite3", MODES.FILE)
    packed = next(path for path in folder.iterdir() if path.suffix == ".zstd")
    size = len(import_zstd().decompress(packed.read_bytes()))
    monkeypatch.setattr(unpacked_bags, "MAX_RATIO", 0)
    monkeypatch.setattr(unpacked_bags, "MIN_LIMIT", size * 3 // 2)
    bag = Bag(with_file_names(folder, f"[{packed.name}, ./{packed.name}]"))
    assert len(positions(bag)) == len(MOTION.times)
    shutil.copy(packed, folder / "copy.db3.zstd")
    with pytest.raises(RecordingError, match="unpacks to more than"):
        Bag(with_file_names(folder, f"[{packed.name}, copy.db3.zstd]"))


def test_damaged_compressed_file_is_read_to_where_it_breaks_off(tmp_path):
    folder = write_bag(tmp_path / "run", messages(MOTION), "sqlite3", MODES.FILE)
    packed = next(path for path in folder.iterdir() if path.suffix == ".zstd")
    content = packed.read_bytes()
    packed.write_bytes(content[: len(content) * 3 // 4])
    bag = Bag(folder)
    assert "is damaged: it was unpacked to where it breaks off" in bag.notes[0]
    assert 0 < len(positions(bag)) < len(MOTION.times)
    for damage in (b"", b"damaged"):
        packed.write_bytes(damage)
        with pytest.raises(RecordingError, match="the files are damaged"):
            Bag(folder)


def test_messages_outside_the_times_of_their_chunk_are_noted(tmp_path):
    """The index of chunks states their first and last times; `rosbags` leaves out what lies outside them."""
    path = storage_file(write_bag(tmp_path / "run", messages(MOTION), "mcap", MODES.STORAGE))
    assert Bag(path).notes == []
    content = path.read_bytes()
    last = BEGINNING + round(MOTION.times[-1] * 1e9)
    earlier = BEGINNING + round(MOTION.times[99] * 1e9)
    index = content.rindex(last.to_bytes(8, "little"), 0, content.rindex(b"zstd"))
    path.write_bytes(content[:index] + earlier.to_bytes(8, "little") + content[index + 8 :])
    bag = Bag(path)
    assert len(positions(bag)) == 100
    assert bag.notes[-1] == f"{path.name} is damaged: it states {len(MOTION.times)} messages, and 100 can be read"


@pytest.mark.parametrize(
    ("place", "value"),
    [(1, bytes(8)), (9, bytes(8)), (17, bytes(8)), (25, bytes(8)), (37, b"\x03"), (41, b"\x00std"), (45, bytes(8))],
    ids=["length", "first time", "last time", "unpacked size", "length of name", "compression", "packed size"],
)
def test_header_of_a_chunk_that_differs_from_the_index_is_noted(tmp_path, place, value):
    """The package `mcap` reads chunks as their headers state, without a word: of an unknown compression none."""
    folder = write_bag(tmp_path / "run", messages(MOTION), "mcap", MODES.STORAGE)
    path = storage_file(folder)
    content = path.read_bytes()
    with path.open("rb") as file:
        chunk = mcap.make_reader(file).get_summary().chunk_indexes[0].chunk_start_offset + place
    path.write_bytes(content[:chunk] + value + content[chunk + len(value) :])
    for source in (path, folder):
        bag = Bag(source)
        assert np.array_equal(positions(bag), MOTION.q)
        assert [note for note in bag.notes if "header of a chunk" in note], bag.notes
    if place == 41:
        with path.open("rb") as file:
            assert list(mcap.make_reader(file).iter_messages()) == []
