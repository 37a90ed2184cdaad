"""Whatever order, gaps and stamps messages have, the grid has the motion, and the tally what was left out."""

import numpy as np
import pytest
from peers.recorded import BEGINNING, JOINTS, message, messages, panda_motion, uneven_times

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings import alignment
from robot_dynamics.recordings.alignment import resample_samples
from robot_dynamics.recordings.joint_samples import sample_of_joint_state
from robot_dynamics.recordings.sample_statistics import SampleStatistics

MOTION = panda_motion(duration=12.0)
NAMES = list(JOINTS)


def samples(told, topic="/joint_states", late=0.0):
    for each in told:
        stamp = each.header.stamp
        yield sample_of_joint_state(topic, stamp.sec * 1_000_000_000 + stamp.nanosec + round(late * 1e9), each)


def on_grid(told, **settings):
    statistics = SampleStatistics()
    return list(resample_samples(told, JOINTS, statistics, **settings)), statistics


def joined(found, field="position"):
    return np.concatenate([getattr(stretch, field) for stretch in found])


@pytest.mark.parametrize("chunk", [20_000, 157])
def test_even_samples_are_taken_as_they_are_in_pieces_of_any_size(monkeypatch, chunk):
    monkeypatch.setattr(alignment, "MESSAGES_PER_CHUNK", chunk)
    found, statistics = on_grid(samples(messages(MOTION)))
    for field, expected in (("position", MOTION.q), ("velocity", MOTION.qd), ("effort", MOTION.efforts)):
        assert np.array_equal(joined(found, field), expected)
    assert [stretch.is_continuation for stretch in found] == [False] + [True] * (len(found) - 1)
    assert statistics.sentences == [] and statistics.samples == len(MOTION.times)


@pytest.mark.parametrize("chunk", [20_000, 157])
def test_joints_on_several_topics_at_other_times_meet_on_one_grid(monkeypatch, chunk):
    """Three joints at 100 Hz, four at 50 Hz between them: between samples the splines are right to 1e-5."""
    monkeypatch.setattr(alignment, "MESSAGES_PER_CHUNK", chunk)
    arm = [message(t, NAMES[:3], q[:3]) for t, q in zip(MOTION.times, MOTION.q, strict=True)]
    wrist = [message(t + 0.0037, NAMES[3:], q[3:]) for t, q in list(zip(MOTION.times, MOTION.q, strict=True))[::2]]
    told = sorted([*samples(arm, "/arm"), *samples(wrist, "/wrist")], key=lambda sample: sample.receive_time)
    found, statistics = on_grid(told)
    times = np.concatenate([stretch.time + np.arange(len(stretch)) / stretch.rate for stretch in found])
    assert np.allclose(times, 0.0037 + 0.01 * np.arange(len(times)), atol=1e-9)  # from where all joints are known
    expected = panda_motion(duration=12.0, start=times[0]).q[: len(times)]
    assert np.abs(joined(found)[:, :3] - expected[:, :3]).max() < 1e-5
    assert np.abs(joined(found)[:, 3:] - MOTION.q[: len(times), 3:]).max() < 1e-5
    assert len(times) > 1190 and statistics.counts["gaps"] == 0


def test_two_publishers_on_one_topic_and_a_changing_order_of_names():
    rng, told = np.random.default_rng(0), []
    for t, q in zip(MOTION.times, MOTION.q, strict=True):
        order = rng.permutation(4)
        told.append(message(t, [NAMES[k] for k in order] + ["gripper"], [*q[order], 0.02]))
        told.append(message(t, NAMES[4:], q[4:]))
    found, statistics = on_grid(samples(told))
    assert np.array_equal(joined(found), MOTION.q)
    assert statistics.sentences == ["joints that the model does not ask for: gripper"]


def test_late_repeated_and_damaged_messages_are_left_out_and_counted():
    told = messages(MOTION)
    told[101], told[100] = told[100], told[101]  # one is late
    told.insert(300, told[300])  # one is there twice
    told[500].position[2] = np.nan
    told[600].effort[0] = np.inf
    told.insert(700, message(7.0, ["gripper"], [0.1]))
    told.insert(800, message(8.005, NAMES, MOTION.q[800, :6]))
    found, statistics = on_grid(samples(told))
    assert statistics.counts["out_of_order"] == statistics.counts["duplicates"] == 1
    assert statistics.counts["not_finite"] == 2
    assert statistics.counts["no_known_joint"] == statistics.counts["length_mismatch"] == 1
    assert len(joined(found)) == len(MOTION.times) and np.abs(joined(found) - MOTION.q).max() < 1e-6
    assert len(statistics.sentences) == 6


def test_nothing_is_filled_in_across_a_gap():
    told = [each for each, t in zip(messages(MOTION), MOTION.times, strict=True) if not 4 < t < 6]
    found, statistics = on_grid(samples(told))
    assert [stretch.is_continuation for stretch in found] == [False, False]
    assert found[1].time == pytest.approx(6.0) and statistics.counts["gaps"] == 1
    assert np.array_equal(joined(found), MOTION.q[(MOTION.times <= 4) | (MOTION.times >= 6)])


@pytest.mark.parametrize("chunk", [20_000, 157, 5, 1])
@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_a_piece_too_short_for_a_spline_is_left_out_and_counted_in_chunks_of_any_size(monkeypatch, chunk, size):
    """Between 4 and 6 s a few samples alone, beside the grid; a piece of 4 is the least that is not left out."""
    monkeypatch.setattr(alignment, "MESSAGES_PER_CHUNK", chunk)
    alone = 5.0 + np.array([0.0, 0.0113, 0.0208, 0.0311])[:size]
    times = np.array([*MOTION.times[MOTION.times <= 4], *alone, *MOTION.times[MOTION.times >= 6]])
    motion = panda_motion(times=times)
    found, statistics = on_grid(samples(messages(motion)))
    long = joined([stretch for stretch in found if not 4.5 < stretch.time < 5.5])
    # bits of what is on the grid, where no spline is needed
    assert np.abs(long - MOTION.q[(MOTION.times <= 4) | (MOTION.times >= 6)]).max() < 1e-9
    assert statistics.counts["gaps"] == 2
    middle = [stretch for stretch in found if 4.5 < stretch.time < 5.5]
    if size < 4:
        # of the time from the first of them to the last, the grid has so many samples
        assert statistics.counts["too_short"] == size and middle == []
        assert any("too short" in sentence for sentence in statistics.sentences)
    else:
        assert statistics.counts["too_short"] == 0
        expected = panda_motion(times=5.0 + 0.01 * np.arange(4)).q
        assert np.abs(joined(middle) - expected[: sum(map(len, middle))]).max() < 1e-6


@pytest.mark.parametrize("chunk", [20_000, 20, 1])
@pytest.mark.parametrize("kind", ["random", "pairs", "pieces"])
def test_uneven_stamps_give_the_motion_where_they_give_one_and_each_sample_is_accounted_for(monkeypatch, kind, chunk):
    monkeypatch.setattr(alignment, "MESSAGES_PER_CHUNK", chunk)
    motion = panda_motion(times=uneven_times(kind, 12.0))
    rng = np.random.default_rng(1)
    noisy = motion._replace(efforts=motion.efforts + 0.01 * rng.normal(size=motion.efforts.shape))
    found, statistics = on_grid(samples(messages(noisy)))
    begins = motion.times[0]
    on_time = [begins + stretch.time + np.arange(len(stretch)) / stretch.rate for stretch in found]
    covered = sum(len(stretch) / stretch.rate for stretch in found)
    expected = panda_motion(times=np.concatenate(on_time))
    assert np.abs(joined(found) - expected.q).max() < 1e-3
    # a spline through samples of which no two are too close makes little more of their noise
    assert np.abs(joined(found, "effort") - expected.efforts).max() < 0.2
    assert covered > {"random": 11.0, "pairs": 11.9, "pieces": 8.0}[kind]
    assert statistics.counts["too_short"] > 0 or kind != "pieces"
    assert statistics.counts["too_close"] > 0 or kind == "pieces"
    if kind == "pieces":
        pauses = np.flatnonzero(np.diff(motion.times) > 0.055)
        assert statistics.counts["gaps"] == len(pauses)


@pytest.mark.parametrize("chunk", [20_000, 50])
def test_a_lone_message_of_one_of_two_topics_is_counted_too(monkeypatch, chunk):
    monkeypatch.setattr(alignment, "MESSAGES_PER_CHUNK", chunk)
    told = []
    for number, (t, q) in enumerate(zip(MOTION.times, MOTION.q, strict=True)):
        told += samples([message(t, NAMES[:3], q[:3])], "/arm")
        if not 400 <= number < 600 or number == 500:
            told += samples([message(t, NAMES[3:], q[3:])], "/wrist")
    found, statistics = on_grid(told)
    assert statistics.counts["gaps"] == 2 and statistics.counts["too_short"] == 1
    assert np.abs(joined(found) - MOTION.q[(MOTION.times < 3.995) | (MOTION.times > 5.995)]).max() < 1e-9


def test_a_slow_topic_has_no_gaps_after_a_pause_that_its_steps_do_not_make():
    """Three joints at 100 Hz, four at 10 Hz, in chunks; both begin anew after a pause."""
    assembly, statistics = None, SampleStatistics()
    assembly = alignment.Resampler(JOINTS, statistics)
    pieces = []
    for number, (t, q) in enumerate(zip(MOTION.times, MOTION.q, strict=True)):
        if number == 600:
            pieces += assembly.drain(final=True)
        told = [message(t, NAMES[:3], q[:3])]
        if number % 10 == 0:
            told.append(message(t + 0.003, NAMES[3:], q[3:]))
        for each in zip(told, ("/arm", "/wrist"), strict=False):
            (sample,) = samples(each[:1], each[1])
            assembly.feed(sample)
        if number % 10 == 5 and number > 100:
            pieces += assembly.drain()
    pieces += assembly.drain(final=True)
    assert statistics.counts["gaps"] == statistics.counts["too_short"] == 0
    assert sum(map(len, pieces)) > 1170 and sum(not piece.is_continuation for piece in pieces) == 2


def test_a_clock_that_is_set_back_or_begins_at_zero_makes_a_stretch_of_its_own():
    """A bag of a simulation started anew; and a recorder whose first stamps are near zero."""
    first, second = messages(MOTION)[:400], messages(MOTION)[:500]
    told = [*samples(first), *samples(second, late=4.0)]
    found, statistics = on_grid(told)
    assert statistics.counts["clock_jumps"] == 1
    assert [len(stretch) for stretch in found] == [400, 500]
    assert found[1].time == pytest.approx(4.01, abs=0.02)
    assert np.array_equal(found[1].position, MOTION.q[:500])
    begun = [sample._replace(stamp=sample.stamp - BEGINNING + 1) for sample in samples(messages(MOTION)[:10])]
    found, statistics = on_grid([*begun, *samples(messages(MOTION)[10:])])
    assert statistics.counts["clock_jumps"] == 1
    assert found[-1].time + len(found[-1]) / found[-1].rate == pytest.approx(12.0, abs=0.03)
    assert np.array_equal(found[-1].position, MOTION.q[10:])


def test_without_stamps_the_time_of_recording_counts():
    told = [sample._replace(stamp=0) for sample in samples(messages(MOTION))]
    found, statistics = on_grid(told)
    assert np.array_equal(joined(found), MOTION.q) and statistics.counts["zero_stamp"] == len(told)


def test_missing_joints_and_too_few_samples_are_refused():
    told = [message(t, NAMES[:6], q[:6]) for t, q in zip(MOTION.times, MOTION.q, strict=True)]
    with pytest.raises(RecordingError, match="joints missing: panda_joint7"):
        on_grid(samples(told))
    with pytest.raises(RecordingError, match="1 samples of the joints: 8 at least"):
        on_grid(samples(messages(MOTION)[:1]))
    with pytest.raises(RecordingError, match="joint 'panda_joint1' is named twice"):
        on_grid(samples([message(0, ["panda_joint1", "panda_joint1"], [1, 2])]))
