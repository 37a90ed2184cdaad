"""Resampling of messages with any order, gaps and stamps: the motion on the grid, and the counts of skipped samples."""

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


def samples(states, topic="/joint_states", late=0.0):
    for state in states:
        stamp = state.header.stamp
        yield sample_of_joint_state(topic, stamp.sec * 1_000_000_000 + stamp.nanosec + round(late * 1e9), state)


def resample(recorded, **settings):
    statistics = SampleStatistics()
    return list(resample_samples(recorded, JOINTS, statistics, **settings)), statistics


def concatenate(segments, field="position"):
    return np.concatenate([getattr(segment, field) for segment in segments])


@pytest.mark.parametrize("chunk", [20_000, 157])
def test_resampling_copies_even_samples_for_chunks_of_any_size(monkeypatch, chunk):
    monkeypatch.setattr(alignment, "MESSAGES_PER_CHUNK", chunk)
    segments, statistics = resample(samples(messages(MOTION)))
    for field, expected in (("position", MOTION.q), ("velocity", MOTION.qd), ("effort", MOTION.efforts)):
        assert np.array_equal(concatenate(segments, field), expected)
    assert [segment.is_continuation for segment in segments] == [False] + [True] * (len(segments) - 1)
    assert statistics.sentences == [] and statistics.samples == len(MOTION.times)


@pytest.mark.parametrize("chunk", [20_000, 157])
def test_resampling_puts_joints_of_several_topics_on_one_grid(monkeypatch, chunk):
    """Three joints at 100 Hz, four at 50 Hz between them: between samples the splines are right to 1e-5."""
    monkeypatch.setattr(alignment, "MESSAGES_PER_CHUNK", chunk)
    arm = [message(t, NAMES[:3], q[:3]) for t, q in zip(MOTION.times, MOTION.q, strict=True)]
    wrist = [message(t + 0.0037, NAMES[3:], q[3:]) for t, q in list(zip(MOTION.times, MOTION.q, strict=True))[::2]]
    recorded = sorted([*samples(arm, "/arm"), *samples(wrist, "/wrist")], key=lambda sample: sample.receive_time)
    segments, statistics = resample(recorded)
    times = np.concatenate([segment.time + np.arange(len(segment)) / segment.rate for segment in segments])
    assert np.allclose(times, 0.0037 + 0.01 * np.arange(len(times)), atol=1e-9)  # from where all joints are known
    expected = panda_motion(duration=12.0, start=times[0]).q[: len(times)]
    assert np.abs(concatenate(segments)[:, :3] - expected[:, :3]).max() < 1e-5
    assert np.abs(concatenate(segments)[:, 3:] - MOTION.q[: len(times), 3:]).max() < 1e-5
    assert len(times) > 1190 and statistics.counts["gaps"] == 0


def test_resampling_matches_names_of_two_publishers_in_changing_order():
    rng, states = np.random.default_rng(0), []
    for t, q in zip(MOTION.times, MOTION.q, strict=True):
        order = rng.permutation(4)
        states.append(message(t, [NAMES[k] for k in order] + ["gripper"], [*q[order], 0.02]))
        states.append(message(t, NAMES[4:], q[4:]))
    segments, statistics = resample(samples(states))
    assert np.array_equal(concatenate(segments), MOTION.q)
    assert statistics.sentences == ["joints that the model does not have: gripper"]


def test_statistics_count_late_repeated_and_damaged_messages():
    states = messages(MOTION)
    states[101], states[100] = states[100], states[101]  # late
    states.insert(300, states[300])  # repeated
    states[500].position[2] = np.nan
    states[600].effort[0] = np.inf
    states.insert(700, message(7.0, ["gripper"], [0.1]))
    states.insert(800, message(8.005, NAMES, MOTION.q[800, :6]))
    segments, statistics = resample(samples(states))
    assert statistics.counts["out_of_order"] == statistics.counts["duplicates"] == 1
    assert statistics.counts["not_finite"] == 2
    assert statistics.counts["no_known_joint"] == statistics.counts["length_mismatch"] == 1
    assert len(concatenate(segments)) == len(MOTION.times) and np.abs(concatenate(segments) - MOTION.q).max() < 1e-6
    assert len(statistics.sentences) == 6


def test_resampling_fills_in_nothing_across_a_gap():
    states = [state for state, t in zip(messages(MOTION), MOTION.times, strict=True) if not 4 < t < 6]
    segments, statistics = resample(samples(states))
    assert [segment.is_continuation for segment in segments] == [False, False]
    assert segments[1].time == pytest.approx(6.0) and statistics.counts["gaps"] == 1
    assert np.array_equal(concatenate(segments), MOTION.q[(MOTION.times <= 4) | (MOTION.times >= 6)])


@pytest.mark.slow
@pytest.mark.parametrize("chunk", [20_000, 157, 5, 1])
@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_resampling_skips_pieces_too_short_for_a_spline_for_chunks_of_any_size(monkeypatch, chunk, size):
    """Between 4 and 6 s there are only a few samples, off the grid; a spline needs 4 of them."""
    monkeypatch.setattr(alignment, "MESSAGES_PER_CHUNK", chunk)
    lone_times = 5.0 + np.array([0.0, 0.0113, 0.0208, 0.0311])[:size]
    times = np.array([*MOTION.times[MOTION.times <= 4], *lone_times, *MOTION.times[MOTION.times >= 6]])
    motion = panda_motion(times=times)
    segments, statistics = resample(samples(messages(motion)))
    long = concatenate([segment for segment in segments if not 4.5 < segment.time < 5.5])
    # samples on the grid are copied, without a spline
    assert np.abs(long - MOTION.q[(MOTION.times <= 4) | (MOTION.times >= 6)]).max() < 1e-9
    assert statistics.counts["gaps"] == 2
    middle = [segment for segment in segments if 4.5 < segment.time < 5.5]
    if size < 4:
        # the points of the grid from the first sample to the last are counted
        assert statistics.counts["too_short"] == size and middle == []
        assert any("too short" in sentence for sentence in statistics.sentences)
    else:
        assert statistics.counts["too_short"] == 0
        expected = panda_motion(times=5.0 + 0.01 * np.arange(4)).q
        assert np.abs(concatenate(middle) - expected[: sum(map(len, middle))]).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("chunk", [20_000, 20, 1])
@pytest.mark.parametrize("kind", ["random", "pairs", "pieces"])
def test_resampling_of_uneven_stamps_gives_the_motion_and_accounts_for_each_sample(monkeypatch, kind, chunk):
    monkeypatch.setattr(alignment, "MESSAGES_PER_CHUNK", chunk)
    motion = panda_motion(times=uneven_times(kind, 12.0))
    rng = np.random.default_rng(1)
    noisy = motion._replace(efforts=motion.efforts + 0.01 * rng.normal(size=motion.efforts.shape))
    segments, statistics = resample(samples(messages(noisy)))
    begins = motion.times[0]
    segment_times = [begins + segment.time + np.arange(len(segment)) / segment.rate for segment in segments]
    covered = sum(len(segment) / segment.rate for segment in segments)
    expected = panda_motion(times=np.concatenate(segment_times))
    assert np.abs(concatenate(segments) - expected.q).max() < 1e-3
    # a spline through samples that are not too close hardly amplifies their noise
    assert np.abs(concatenate(segments, "effort") - expected.efforts).max() < 0.2
    assert covered > {"random": 11.0, "pairs": 11.9, "pieces": 8.0}[kind]
    assert statistics.counts["too_short"] > 0 or kind != "pieces"
    assert statistics.counts["too_close"] > 0 or kind == "pieces"
    if kind == "pieces":
        pauses = np.flatnonzero(np.diff(motion.times) > 0.055)
        assert statistics.counts["gaps"] == len(pauses)


@pytest.mark.parametrize("chunk", [20_000, 50])
def test_statistics_count_a_lone_message_of_one_of_two_topics(monkeypatch, chunk):
    monkeypatch.setattr(alignment, "MESSAGES_PER_CHUNK", chunk)
    recorded = []
    for number, (t, q) in enumerate(zip(MOTION.times, MOTION.q, strict=True)):
        recorded += samples([message(t, NAMES[:3], q[:3])], "/arm")
        if not 400 <= number < 600 or number == 500:
            recorded += samples([message(t, NAMES[3:], q[3:])], "/wrist")
    segments, statistics = resample(recorded)
    assert statistics.counts["gaps"] == 2 and statistics.counts["too_short"] == 1
    assert np.abs(concatenate(segments) - MOTION.q[(MOTION.times < 3.995) | (MOTION.times > 5.995)]).max() < 1e-9


def test_gaps_of_a_slow_topic_are_those_of_its_own_steps_after_a_pause():
    """Three joints at 100 Hz, four at 10 Hz, in chunks; both restart after a pause."""
    statistics = SampleStatistics()
    resampler = alignment.Resampler(JOINTS, statistics)
    pieces = []
    for number, (t, q) in enumerate(zip(MOTION.times, MOTION.q, strict=True)):
        if number == 600:
            pieces += resampler.drain(final=True)
        states = [message(t, NAMES[:3], q[:3])]
        if number % 10 == 0:
            states.append(message(t + 0.003, NAMES[3:], q[3:]))
        for state, topic in zip(states, ("/arm", "/wrist"), strict=False):
            (sample,) = samples([state], topic)
            resampler.feed(sample)
        if number % 10 == 5 and number > 100:
            pieces += resampler.drain()
    pieces += resampler.drain(final=True)
    assert statistics.counts["gaps"] == statistics.counts["too_short"] == 0
    assert sum(map(len, pieces)) > 1170 and sum(not piece.is_continuation for piece in pieces) == 2


def test_clock_that_is_set_back_or_begins_at_zero_begins_a_new_segment():
    """A bag of a simulation that was restarted; and a recorder whose first stamps are near zero."""
    first, second = messages(MOTION)[:400], messages(MOTION)[:500]
    recorded = [*samples(first), *samples(second, late=4.0)]
    segments, statistics = resample(recorded)
    assert statistics.counts["clock_jumps"] == 1
    assert [len(segment) for segment in segments] == [400, 500]
    assert segments[1].time == pytest.approx(4.01, abs=0.02)
    assert np.array_equal(segments[1].position, MOTION.q[:500])
    first_samples = [sample._replace(stamp=sample.stamp - BEGINNING + 1) for sample in samples(messages(MOTION)[:10])]
    segments, statistics = resample([*first_samples, *samples(messages(MOTION)[10:])])
    assert statistics.counts["clock_jumps"] == 1
    assert segments[-1].time + len(segments[-1]) / segments[-1].rate == pytest.approx(12.0, abs=0.03)
    assert np.array_equal(segments[-1].position, MOTION.q[10:])


def test_time_of_recording_replaces_missing_stamps():
    recorded = [sample._replace(stamp=0) for sample in samples(messages(MOTION))]
    segments, statistics = resample(recorded)
    assert np.array_equal(concatenate(segments), MOTION.q) and statistics.counts["zero_stamp"] == len(recorded)


def test_resampling_refuses_missing_joints_and_too_few_samples():
    states = [message(t, NAMES[:6], q[:6]) for t, q in zip(MOTION.times, MOTION.q, strict=True)]
    with pytest.raises(RecordingError, match="joints missing: panda_joint7"):
        resample(samples(states))
    with pytest.raises(RecordingError, match="1 samples of the joints: at least 8"):
        resample(samples(messages(MOTION)[:1]))
    with pytest.raises(RecordingError, match="joint 'panda_joint1' is named twice"):
        resample(samples([message(0, ["panda_joint1", "panda_joint1"], [1, 2])]))
