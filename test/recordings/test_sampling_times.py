"""Sampling times from stamps that jitter: known times, losses, and stamps that must not be changed."""

import numpy as np
import pytest
from peers.arrivals import arrival_stamps
from peers.recorded import JOINTS, message, messages, panda_motion, uneven_times
from scipy.optimize import linprog

from robot_dynamics.recordings import alignment
from robot_dynamics.recordings.alignment import Resampler, resample_samples
from robot_dynamics.recordings.joint_samples import sample_of_joint_state
from robot_dynamics.recordings.position_jumps import split_at_jumps
from robot_dynamics.recordings.sample_statistics import SampleStatistics
from robot_dynamics.recordings.sampling_times import fit_sampling_times, support_line

RATE = 200.0
MOTION = panda_motion(duration=20.0, rate=RATE)
KINDS = ["bursts", "stalls", "delays", "two_sided"]


def noisy(motion, seed=0):
    rng = np.random.default_rng(seed)
    return motion._replace(
        q=motion.q + 1e-5 * rng.normal(size=motion.q.shape), qd=motion.qd + 1e-3 * rng.normal(size=motion.q.shape)
    )


def select(motion, rows):
    return type(motion)(*(values[rows] for values in motion))


def samples(motion, stamps=None, velocity=True):
    motion = motion if stamps is None else motion._replace(times=stamps)
    states = messages(motion if velocity else motion._replace(qd=motion.qd * np.nan))
    return [sample_of_joint_state("/joint_states", 0, state) for state in states]


def resample(recorded, **settings):
    statistics = SampleStatistics()
    return list(resample_samples(recorded, JOINTS, statistics, **settings)), statistics


def position_error(segments, begin=0.0):
    """RMS [rad] of the positions of segments against the true motion; the shift of their times is fitted."""
    times = begin + np.concatenate([segment.time + np.arange(len(segment)) / segment.rate for segment in segments])
    q = np.concatenate([segment.position for segment in segments])
    truth = panda_motion(times=times)
    error = q - truth.q
    shift = (error * truth.qd).sum() / (truth.qd**2).sum()
    return np.sqrt(np.mean((error - shift * truth.qd) ** 2)), shift


@pytest.mark.parametrize("seed", range(5))
def test_support_line_is_the_solution_of_a_linear_program(seed):
    """The line below all points with the least sum of distances."""
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.integers(1, 4, 150)).astype(float)
    y = 0.01 * x + rng.exponential(0.02, 150)
    slope, offset = support_line(x, y)
    program = linprog([-x.sum(), -len(x)], A_ub=np.stack([x, np.ones(150)], axis=1), b_ub=y, bounds=[(None, None)] * 2)
    assert [slope, offset] == pytest.approx(program.x, abs=1e-7)


@pytest.mark.parametrize("velocity", [True, False])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_times_of_late_stamps_are_those_of_the_sender(kind, seed, velocity):
    """At 20 moments 1 to 4 samples are lost; the clock of the receiver runs 100 ppm fast."""
    rng = np.random.default_rng(seed)
    kept = np.ones(len(MOTION.times), dtype=bool)
    for row in rng.choice(np.arange(100, len(kept) - 100, 60), 20, replace=False):
        kept[row : row + rng.integers(1, 5)] = False
    motion = noisy(MOTION, seed)
    stamps = arrival_stamps(1.0001 * motion.times, kind, seed)[kept]
    qd = motion.qd[kept] if velocity else np.full_like(motion.qd[kept], np.nan)
    model = fit_sampling_times(stamps, motion.q[kept], qd)
    assert model.losses.sum() == (~kept).sum()
    assert model.period == pytest.approx(1.0001 / RATE, rel=2e-4)
    error = model.times - 1.0001 * motion.times[kept]
    assert np.std(error) < (0.3 if kind == "two_sided" else 0.1) / RATE
    # steps, which velocities depend on
    assert np.std(np.diff(error)) < 0.01 / RATE


@pytest.mark.parametrize("velocity", [True, False])
@pytest.mark.parametrize("chunk", [20_000, 157])
@pytest.mark.parametrize("kind", KINDS)
def test_samples_with_late_stamps_are_used(monkeypatch, kind, chunk, velocity):
    monkeypatch.setattr(alignment, "MESSAGES_PER_CHUNK", chunk)
    stamps = arrival_stamps(MOTION.times, kind)
    segments, statistics = resample(samples(MOTION, stamps, velocity))
    assert sum(map(len, segments)) > 0.98 * len(MOTION.times)
    assert statistics.counts["gaps"] == 0
    error, shift = position_error(segments, stamps[0])
    assert error < 6e-4 and abs(shift) < 0.12
    (sentence,) = [text for text in statistics.sentences if "stamps of /joint_states" in text]
    assert sentence.endswith("ms late; times are those of a sender with a period of 5 ms")


@pytest.mark.parametrize("velocity", [True, False])
@pytest.mark.parametrize("kind", ["delays", "two_sided"])
def test_an_encoder_that_jumps_is_not_taken_for_lost_samples(kind, velocity):
    """A joint is set anew by 0.03 to 0.08 rad, 4 to 9 times the travel of a step, and 3 samples are lost elsewhere."""
    stamps = arrival_stamps(MOTION.times, kind)
    kept = np.ones(len(stamps), dtype=bool)
    kept[1000:1003] = False
    for seed in range(8):
        rng = np.random.default_rng(seed)
        row, joint, size = rng.integers(1500, 3500), rng.integers(7), rng.uniform(0.03, 0.08)
        motion = noisy(MOTION, seed)
        motion.q[row:, joint] += size
        segments, statistics = resample(samples(select(motion, kept), stamps[kept], velocity))
        assert statistics.counts["lost"] == 3 and statistics.counts["gaps"] == 0
        assert "/joint_states" in statistics.sampling_times
        (segment,) = segments
        _, after = split_at_jumps(segment, 7)
        assert after.jump.time + stamps[0] == pytest.approx(MOTION.times[row], abs=3 / RATE)
        assert after.jump.sizes[joint] == pytest.approx(size, rel=0.2)


@pytest.mark.parametrize("kind", KINDS)
def test_late_stamps_are_corrected_as_they_come(kind):
    """Ten samples at a time: no sample waits for longer than a second."""
    statistics = SampleStatistics()
    resampler = Resampler(JOINTS, statistics)
    stamps = arrival_stamps(MOTION.times, kind)
    segments = []
    pending = 0
    for number, sample in enumerate(samples(MOTION, stamps), 1):
        resampler.feed(sample)
        if number % 10 == 0 and number > RATE:
            segments += resampler.drain()
            pending = max(pending, resampler.pending_rows)
    segments += resampler.drain(final=True)
    assert sum(map(len, segments)) > 0.95 * len(MOTION.times)
    assert pending < 1.2 * RATE
    assert position_error(segments, stamps[0])[0] < 1e-3


@pytest.mark.parametrize("velocity", [True, False])
@pytest.mark.parametrize("kind", ["random", "pairs", "pieces", "slow_loop", "quantised_loop"])
def test_stamps_of_uneven_sampling_are_not_changed(kind, velocity):
    """Samples that were taken at uneven times: a program that sleeps 10 ms after each, and reads a clock of 2 ms."""
    rng = np.random.default_rng(0)
    if kind == "slow_loop":
        times = np.cumsum(0.01 + rng.exponential(1e-3, 2000))
    elif kind == "quantised_loop":
        times = np.unique(np.floor(np.cumsum(rng.uniform(0.0101, 0.0113, 2000)) / 0.002) * 0.002)
    else:
        times = uneven_times(kind, 20.0)
    motion = panda_motion(times=times)
    segments, statistics = resample(samples(noisy(motion), velocity=velocity))
    assert statistics.sampling_times == {}
    assert position_error(segments, times[0])[0] < 1e-3 and abs(position_error(segments, times[0])[1]) < 1e-4


def test_even_stamps_and_those_of_a_robot_at_rest_are_not_changed():
    even, statistics = resample(samples(MOTION))
    assert np.array_equal(np.concatenate([segment.position for segment in even]), MOTION.q)
    assert statistics.sentences == []
    rest = MOTION._replace(
        q=MOTION.q[:1] + 1e-6 * np.random.default_rng(0).normal(size=MOTION.q.shape), qd=0 * MOTION.qd
    )
    _, statistics = resample(samples(rest, arrival_stamps(MOTION.times, "stalls")))
    assert statistics.sampling_times == {}


def test_a_pause_of_the_sender_stays_a_gap():
    kept = (MOTION.times < 8) | (MOTION.times > 11.0137)
    stamps = arrival_stamps(MOTION.times, "stalls")
    segments, statistics = resample(samples(select(MOTION, kept), stamps[kept]))
    assert statistics.counts["gaps"] == 1
    assert sum(map(len, segments)) == pytest.approx(kept.sum(), abs=20)
    assert position_error(segments, stamps[0])[0] < 1e-3


@pytest.mark.parametrize("velocity", [True, False])
def test_values_that_a_faster_publisher_repeats_are_skipped(velocity):
    """Values each 34 ms, published each 33.33 ms with the latest values, as in a bag of a real Panda."""
    values = panda_motion(times=0.034 * np.arange(1200))
    stamps = np.arange(1, 1190) / 30.0
    latest = np.floor(stamps / 0.034 + 1e-9).astype(int)
    repeated = (np.diff(latest) == 0).sum()
    assert repeated > 20
    published = select(values, latest)
    segments, statistics = resample(samples(published, stamps, velocity))
    assert statistics.counts["held"] == repeated
    assert segments[0].rate == pytest.approx(1 / 0.034, rel=1e-3)
    error, _ = position_error(segments, stamps[0])
    assert error < 1e-3
    # by their stamps the same samples are wrong by more
    assert np.sqrt(np.mean((published.q - panda_motion(times=stamps - np.mean(stamps % 0.034)).q) ** 2)) > 5 * error


def test_a_robot_that_stops_repeats_its_values_without_a_gap():
    """A simulated robot without noise: its values are equal at rest."""
    times = np.arange(3000) / 100.0
    moving = panda_motion(times=np.minimum(times, 10.0))
    states = [message(t, JOINTS, q, 0 * q, e) for t, q, e in zip(times, moving.q, moving.efforts, strict=True)]
    segments, statistics = resample([sample_of_joint_state("/joint_states", 0, state) for state in states])
    assert statistics.counts["gaps"] == 0 and sum(map(len, segments)) == 3000
    states = [message(t, JOINTS, q, (), e) for t, q, e in zip(times, moving.q, moving.efforts, strict=True)]
    segments, statistics = resample([sample_of_joint_state("/joint_states", 0, state) for state in states])
    assert statistics.counts["gaps"] == 0 and sum(map(len, segments)) == 3000
