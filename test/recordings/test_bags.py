"""Bags of all storage formats; damaged ones are read to where they break off, with a note."""

import shutil
import sqlite3

import numpy as np
import pytest
from peers.recorded import message, messages, of_rosbags, panda_motion, store, write_bag

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.bags import JOINT_STATE, Bag

rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="rosbags, which reads bags, is not installed")
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
