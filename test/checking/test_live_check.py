"""The live check, sample by sample, against the check of the whole recording."""

import numpy as np
import pytest
from peers.recorded import BEGINNING, JOINTS, REAL_DATA, messages, panda_motion, uneven_times, write_bag

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.checking import live_check, status_tracker
from robot_dynamics.checking.check import check
from robot_dynamics.checking.live_check import LiveCheck
from robot_dynamics.checking.tolerances import load_tolerances
from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings import alignment
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_samples import JointSample, sample_of_joint_state
from robot_dynamics.recordings.recording import open_recording

DYNAMICS = Dynamics(load_robot("panda"))
MOTION = panda_motion(duration=20.0)
RATE = 100.0
WRIST = ["panda_joint5", "panda_joint7"]


def noisy(seed=0):
    rng = np.random.default_rng(seed)
    return MOTION._replace(efforts=MOTION.efforts + 0.3 * rng.normal(size=MOTION.efforts.shape))


def samples(motion):
    return [sample_of_joint_state("/joint_states", 0, state) for state in messages(motion)]


def new_check(**settings):
    return LiveCheck(DYNAMICS, direct_drives(JOINTS), load_tolerances(), **settings)


def feed_all(live, recorded, every=10, on_advance=None):
    """The predictions for samples, with a call of `advance` after `every` of them."""
    predictions = []
    for number, sample in enumerate(recorded, 1):
        predictions += live.feed(sample)
        if number % every == 0:
            new = live.advance()
            predictions += new
            if on_advance and new:
                on_advance(number)
    return predictions + live.finish()


@pytest.mark.slow
@pytest.mark.parametrize("every", [5, 700])
def test_live_check_agrees_with_the_check_of_the_recording(tmp_path, every):
    motion, pieces = noisy(), []
    result = check(
        open_recording(write_bag(tmp_path / "run", messages(motion)), direct_drives(JOINTS)),
        DYNAMICS,
        load_tolerances(),
        on_piece=lambda *piece: pieces.append(piece),
    )
    live = new_check()
    predictions = feed_all(live, samples(motion), every)
    stamps, predicted = (
        np.concatenate(parts) for parts in zip(*((p.stamps, p.predicted) for p in predictions), strict=True)
    )
    assert np.abs(stamps - BEGINNING - 1e9 * MOTION.times[13:-13]).max() < 1000  # a period of 8 Hz at either end
    expected = np.concatenate([efforts for _, efforts, _ in pieces])
    # beyond the margins of pieces the transient of the filter has decayed to 1e-6
    assert np.abs(predicted - expected).max() < 1e-5 * np.abs(expected).max()
    for verdict, expected in zip(live.result().verdicts, result.verdicts, strict=True):
        assert verdict.word == expected.word != "FAILED"
        assert verdict.joint.rms == pytest.approx(expected.joint.rms, rel=1e-3)  # transients of 3 periods
        assert verdict.tolerance == pytest.approx(expected.tolerance, rel=1e-4)


def test_live_check_has_verdicts_when_their_window_is_complete():
    lags, motion = [], noisy()
    live = new_check()

    def note_lag(number):
        if live.latest_motion is not None:
            lags.append(number / RATE - live.latest_motion.end)

    feed_all(live, samples(motion), 10, note_lag)
    assert max(lags) < 0.75 + 0.3 + 0.2 + 1.0 and len(live.joint_statuses) == 7


def test_live_check_reports_a_flipped_sign_during_and_after_it():
    motion, failure_times = noisy(), {}
    motion.efforts[800:1200, 3] *= -1
    live = new_check()

    def note_failures(number):
        for status in live.joint_statuses:
            if status.failed_since is not None:
                failure_times.setdefault(status.verdict.joint.joint, number / RATE)

    feed_all(live, samples(motion), 10, note_failures)
    assert list(failure_times) == ["panda_joint4"] and failure_times["panda_joint4"] < 8.0 + 3.5
    status = live.joint_statuses[3]
    assert status.failed_since is None and status.verdict.passed
    first, last = (np.array(status.last_failure) - BEGINNING) / 1e9
    assert first == pytest.approx(8.0, abs=1.0) and 12.0 <= last < 12.0 + live_check.DEFAULT_SPAN + 2.0
    assert not live.result().passed


def test_live_check_keeps_the_stamps_of_messages_after_a_clock_jump():
    first, second = samples(noisy(0)), samples(noisy(1))
    predictions = feed_all(new_check(), [*first, *second])
    stamps = np.concatenate([prediction.stamps for prediction in predictions])
    (jump,) = np.flatnonzero(np.diff(stamps) < 0)
    for part in (stamps[: jump + 1], stamps[jump + 1 :]):
        assert np.abs(part - BEGINNING - 1e9 * MOTION.times[13:-13]).max() < 1000


def test_live_check_limits_memory_where_a_joint_has_no_messages_and_names_are_random(monkeypatch):
    monkeypatch.setattr(live_check, "MAX_PENDING_ROWS", 500)
    live = new_check()
    for number, sample in enumerate(samples(noisy())):
        names = (*sample.names[:6], f"random_{number}")
        live.feed(sample._replace(names=names))
        live.advance()
        assert live._resampler.pending_rows <= 501
    assert "joints missing: panda_joint7" in live.error_message
    assert len(live._resampler._layouts._cache) <= 1000 and sum(map(len, live.statistics.joints.values())) <= 101
    with pytest.raises(RecordingError, match="nothing was compared yet"):
        live.result()
    assert live.find_stale_names(sample.receive_time, 1.0) == ["panda_joint7"]


def test_live_check_drops_old_windows(monkeypatch):
    monkeypatch.setattr(status_tracker, "HISTORY_WINDOWS", 5)
    live = new_check()
    feed_all(live, samples(noisy()))
    assert len(live._tracker.total._windows) <= 7 and live._tracker.total.samples == len(MOTION.times) - 26


def test_live_check_skips_and_counts_numbers_that_are_too_large():
    live, motion = new_check(), noisy()
    motion.efforts[1000, 2] = 1e200
    motion.efforts[1500, 1] = np.inf
    feed_all(live, samples(motion))
    notes = "; ".join(live.result().notes)
    assert "too large to compute with" in notes and "nan or infinite" in notes
    assert live.result().passed


def test_live_check_skips_rows_without_positions_at_the_beginning():
    recorded = [
        JointSample("t", each.stamp, 0, each.names, each.position, each.velocity, each.effort)
        for each in samples(noisy())
    ]
    recorded[:150] = [each._replace(position=np.full(7, np.nan)) for each in recorded[:150]]
    live = new_check()
    feed_all(live, recorded)
    assert live.result().passed and live.statistics.counts["not_finite"] == 150


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, 10])
@pytest.mark.parametrize("kind", ["random", "pairs", "pieces"])
def test_live_check_of_uneven_stamps_and_gaps_agrees_with_the_check_of_the_recording(tmp_path, kind, every):
    rng = np.random.default_rng(3)
    motion = panda_motion(times=uneven_times(kind, 20.0))
    motion = motion._replace(efforts=motion.efforts + 0.3 * rng.normal(size=motion.efforts.shape))
    result = check(
        open_recording(write_bag(tmp_path / "run", messages(motion)), direct_drives(JOINTS)),
        DYNAMICS,
        load_tolerances(),
    )
    live = new_check()
    predictions = feed_all(live, samples(motion), every)
    stamps = np.concatenate([prediction.stamps for prediction in predictions])
    assert (np.diff(stamps) > 0).all() and stamps[-1] > BEGINNING + 18e9
    live_result = live.result()
    assert live_result.passed and result.passed
    assert live_result.verdicts[0].joint.samples == pytest.approx(result.verdicts[0].joint.samples, rel=0.1)
    for verdict, expected in zip(live_result.verdicts, result.verdicts, strict=True):
        # interpolation of single samples has data on one side only
        assert verdict.joint.rms == pytest.approx(expected.joint.rms, rel=0.5 if every == 1 else 0.2)
    assert live.statistics.counts["too_short"] > 0 or kind != "pieces"


def test_live_check_drops_rows_that_raise_an_error(monkeypatch):
    """The rows that raise are dropped, and the samples after them are compared."""
    interpolate_on_grid, raised = alignment.interpolate_on_grid, []

    def fails_once(times, values, grid):
        if not raised:
            raised.append(times[0])
            raise RuntimeError("a fault of the interpolation")
        return interpolate_on_grid(times, values, grid)

    monkeypatch.setattr(alignment, "interpolate_on_grid", fails_once)
    live, failures = new_check(), 0
    for number, sample in enumerate(samples(noisy()), 1):
        live.feed(sample)
        if number % 10 == 0:
            try:
                live.advance()
            except RuntimeError:
                failures += 1
    live.finish()
    assert failures == 1 and live.result().passed and live.result().verdicts[0].joint.samples > 1700


@pytest.mark.slow
@pytest.mark.skipif(not REAL_DATA.is_dir(), reason=f"no real data in {REAL_DATA}")
@pytest.mark.parametrize(
    ("robot", "bag", "reversed_joint", "expected"),
    [
        (str(REAL_DATA / "ur10/ur10.urdf"), "ur10/ur10_unisa_mcap", None, "all"),
        # the description has no friction, which is most of the effort of the wrist
        ("panda", "panda/panda_unisa_mcap", None, WRIST),
        ("panda", "panda/panda_unisa_mcap", "panda_joint2", ["panda_joint2", *WRIST]),
    ],
)
def test_live_check_of_real_robots_reports_the_joints_out_of_tolerance(robot, bag, reversed_joint, expected):
    pytest.importorskip("rosbags", reason="rosbags, which reads bags, is not installed")
    dynamics, failed = Dynamics(load_robot(robot)), set()
    drives = direct_drives(dynamics.joint_names)
    recording = open_recording(REAL_DATA / bag, drives)
    live = LiveCheck(dynamics, drives, load_tolerances())
    for number, sample in enumerate(recording.source.samples(recording.topics)):
        if reversed_joint and number > 300:
            sign = [-1 if name == reversed_joint else 1 for name in sample.names]
            sample = sample._replace(effort=sample.effort * sign)
        live.feed(sample)
        if number % 20 == 0:
            live.advance()
            failed |= {each.verdict.joint.joint for each in live.joint_statuses if each.failed_since is not None}
    assert failed == set(dynamics.joint_names if expected == "all" else expected)


def test_live_check_of_which_little_can_be_compared_does_not_pass():
    """Pieces of 0.3 s between pauses of 0.1 s are too short for the filter; one of 3 s is not."""
    times = np.arange(0, 20, 0.01)
    motion = panda_motion(times=times[(times < 3) | (times % 0.4 < 0.3)])
    live, failures = new_check(), []
    feed_all(live, samples(motion), 10, lambda number: failures.append(live.coverage_failure))
    assert failures[0] == "" and "of the recorded time was compared" in live.coverage_failure
    result = live.result()
    assert result.coverage == live.coverage < 0.3 and not result.passed
    assert not any(verdict.failed for verdict in result.verdicts)
    steady, failures = new_check(), []
    feed_all(steady, samples(noisy()), 10, lambda number: failures.append(steady.coverage_failure))
    assert steady.result().coverage > 0.95 and len(failures) > 20 and not any(failures)


@pytest.mark.parametrize("field", ["velocity", "effort", "position"])
def test_a_value_that_no_robot_has_once_a_second_is_skipped_and_counted(field):
    sound, disturbed = samples(noisy()), samples(noisy())
    for number, sample in enumerate(disturbed):
        if number % RATE == RATE // 2:
            getattr(sample, field)[2] = (-1) ** number * 1e300
    live, expected = new_check(), new_check()
    feed_all(live, disturbed)
    feed_all(expected, sound)
    assert live.statistics.counts["unbounded"] == round(MOTION.times[-1])
    for verdict, usual in zip(live.result().verdicts, expected.result().verdicts, strict=True):
        assert verdict.word == usual.word
        assert verdict.joint.rms == pytest.approx(usual.joint.rms, rel=0.05)
