"""Bags of `ros2 bag record` (data/README.md), read as the mcap library and sqlite3 read them, with the known motion."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest
import yaml
from peers.recorded import BEGINNING, JOINTS, panda_motion, store

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.checking.check import check
from robot_dynamics.checking.tolerances import load_tolerances
from robot_dynamics.recordings.bags import Bag
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.recording import open_recording

pytest.importorskip("rosbags.rosbag2", reason="rosbags, which reads bags, is not installed")
DATA = Path(__file__).parent / "data"
BAGS = ["panda_mcap", "panda_sqlite3", "panda_sqlite3_zstd"]
MOTION = panda_motion(duration=4.0, rate=50.0)


def serialised_messages(folder):
    """Messages as (receive time [ns], bytes), in the order of the files."""
    for path in sorted(path for path in folder.iterdir() if path.suffix in (".mcap", ".db3")):
        if path.suffix == ".mcap":
            reader = pytest.importorskip("mcap.reader", reason="mcap, which reads MCAP, is not installed")
            with path.open("rb") as file:
                yield from ((entry.log_time, entry.data) for _, _, entry in reader.make_reader(file).iter_messages())
        else:
            with sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True) as database:
                yield from database.execute("SELECT timestamp, data FROM messages ORDER BY timestamp, id")


@pytest.mark.parametrize("name", BAGS)
def test_bags_are_those_of_the_recorder_of_jazzy(name):
    metadata = yaml.safe_load((DATA / name / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert metadata["ros_distro"] == "jazzy" and metadata["message_count"] == len(MOTION.times)
    assert len(metadata["relative_file_paths"]) == 2
    assert all((DATA / name / path).is_file() for path in metadata["relative_file_paths"])


@pytest.mark.parametrize("name", BAGS)
def test_samples_are_those_that_were_published(name):
    bag = Bag(DATA / name)
    samples = list(bag.samples(bag.joint_topics()))
    assert bag.notes == [] and bag.counts == {"/joint_states": len(MOTION.times)}
    assert all(sample.names == JOINTS and sample.source == "/joint_states" for sample in samples)
    stamps = [sample.stamp - BEGINNING for sample in samples]
    assert stamps == np.round(MOTION.times * 1e9).astype(int).tolist()
    for field, expected in (("position", MOTION.q), ("velocity", MOTION.qd), ("effort", MOTION.efforts)):
        assert np.allclose([getattr(sample, field) for sample in samples], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", BAGS[:2])
def test_samples_are_those_that_other_readers_find(name):
    samples = list(Bag(DATA / name).samples(["/joint_states"]))
    entries = list(serialised_messages(DATA / name))
    assert len(entries) == len(samples) == len(MOTION.times)
    for sample, (receive_time, content) in zip(samples, entries, strict=True):
        state = store().deserialize_cdr(content, "sensor_msgs/msg/JointState")
        assert sample.receive_time == receive_time
        for field in ("position", "velocity", "effort"):
            assert np.array_equal(getattr(sample, field), getattr(state, field))


@pytest.mark.parametrize("name", BAGS)
def test_check_of_a_recorded_bag_passes(name):
    """Efforts are those of Pinocchio; 7 samples at each end have no filter."""
    dynamics = Dynamics(load_robot("panda"))
    result = check(open_recording(DATA / name, direct_drives(dynamics.joint_names)), dynamics, load_tolerances())
    assert all(verdict.passed for verdict in result.verdicts) and result.comparison.samples == len(MOTION.times) - 14
    spread = MOTION.efforts.std(axis=0)
    assert (np.array([verdict.joint.rms for verdict in result.verdicts]) < 1e-3 * spread).all()
