"""Parts of a long bag: together they have the samples and the counts of the whole bag."""

from dataclasses import replace

import numpy as np
import pytest
from peers.recorded import JOINTS, messages, panda_motion, write_bag

from robot_dynamics.recordings import recording_division
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_samples import JointSample
from robot_dynamics.recordings.recording import open_recording
from robot_dynamics.recordings.recording_division import divide_recording
from robot_dynamics.recordings.recording_parts import IndivisibleRecordingError
from robot_dynamics.recordings.sample_range import SampleRange
from robot_dynamics.recordings.sample_statistics import SampleStatistics

MOTION = panda_motion(100.0)
FIELDS = ("q", "qd", "qdd", "efforts", "unfiltered_efforts")


@pytest.fixture(scope="module", params=["mcap", "sqlite3"])
def recording(request, tmp_path_factory):
    """100 s at 100 Hz, with a gap of 2 s, a lost message and 5 messages of an efforts that is not finite."""
    rows = [*range(4000), *range(4200, 6003), *range(6004, len(MOTION.times))]
    motion = MOTION._replace(**{name: getattr(MOTION, name)[rows] for name in ("times", "q", "qd", "efforts")})
    motion.efforts[[100, 2500, 3000, 7000, 9000], 2] = np.nan
    path = write_bag(tmp_path_factory.mktemp("bag") / "long", messages(motion), request.param)
    return open_recording(path, direct_drives(JOINTS))


@pytest.fixture(autouse=True)
def short_context(monkeypatch):
    monkeypatch.setattr(recording_division, "CONTEXT_ROWS", 500)


def read(recording):
    """Times and signals of the samples that belong to a recording, and its statistics."""
    statistics = SampleStatistics()
    start, stop = recording.time_range
    motions = []
    for motion in recording.motions(statistics):
        motions.append(motion.slice_samples(*np.searchsorted(motion.times, [start, stop])))
    signals = [np.concatenate([getattr(motion, field) for motion in motions]) for field in FIELDS]
    return np.concatenate([motion.times for motion in motions]), signals, statistics


def test_parts_have_the_samples_and_the_counts_of_the_whole(recording):
    parts = divide_recording(recording, part_messages=2400)
    assert len(parts) == 4 and parts[1].part.start == pytest.approx(25, abs=0.02)
    times, signals, statistics = read(recording)
    results = [read(part) for part in parts]
    np.testing.assert_allclose(np.concatenate([result[0] for result in results]), times, atol=1e-9)
    for k, (field, expected) in enumerate(zip(FIELDS, signals, strict=True)):
        values = np.concatenate([result[1][k] for result in results])
        # pieces of the filter end elsewhere: 1e-6 of the signal is left of its transients there
        np.testing.assert_allclose(values, expected, atol=2e-6 * np.abs(expected).max(), err_msg=field)
    total = results[0][2]
    for _, _, later in results[1:]:
        total.append(later)
    assert total.counts == statistics.counts and total.counts["gaps"] == 1 and total.counts["not_finite"] == 5
    assert (total.messages, total.samples) == (statistics.messages, statistics.samples)
    assert total.recorded_duration == pytest.approx(statistics.recorded_duration, abs=1e-9)
    assert total.sentences == statistics.sentences and total.origin == statistics.origin


def test_parts_end_at_the_times_of_the_messages(recording):
    first, *_, last = divide_recording(recording, part_messages=2400)
    assert first.part.begin is None and last.part.end is None
    assert last.part.duration == pytest.approx(100.0, abs=0.02)


def test_short_and_partial_recordings_and_long_filters_are_not_divided(recording):
    assert divide_recording(recording) == (recording,)
    assert len(divide_recording(recording, part_messages=2400, cutoff=1.0)) == 1
    assert len(divide_recording(replace(recording, sample_range=SampleRange(start=1.0)), part_messages=2400)) == 1
    part = divide_recording(recording, part_messages=2400)[2]
    assert divide_recording(part, part_messages=600) == (part,)


def test_bag_that_is_compressed_as_a_whole_is_not_divided(tmp_path):
    modes = pytest.importorskip("rosbags.rosbag2").CompressionMode
    path = write_bag(tmp_path / "packed", messages(MOTION), "mcap", modes.FILE)
    packed = open_recording(path, direct_drives(JOINTS))
    assert divide_recording(packed, part_messages=2400) == (packed,)


def test_part_with_a_clock_jump_is_refused(recording, monkeypatch):
    part = divide_recording(recording, part_messages=2400)[2]
    samples = list(part.source.samples(part.topics, begin=part.part.read_range[0], end=part.part.read_range[1]))
    samples[1500:] = [each._replace(stamp=each.stamp - 90_000_000_000) for each in samples[1500:]]
    assert isinstance(samples[0], JointSample)
    monkeypatch.setattr(part.source, "samples", lambda *arguments, **options: iter(samples))
    with pytest.raises(IndivisibleRecordingError, match="the clock jumps"):
        list(part.motions())
