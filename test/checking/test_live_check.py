"""A check that goes on, fed sample by sample: what it tells is what the check of the whole recording tells."""

import numpy as np
import pytest
from peers.recorded import BEGINNING, JOINTS, REAL_DATA, messages, panda_motion, uneven_times, write_bag

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.checking import live_check
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


def noisy(seed=0):
    rng = np.random.default_rng(seed)
    return MOTION._replace(efforts=MOTION.efforts + 0.3 * rng.normal(size=MOTION.efforts.shape))


def samples(told):
    return [sample_of_joint_state("/joint_states", 0, each) for each in messages(told)]


def new_check(**settings):
    return LiveCheck(DYNAMICS, direct_drives(JOINTS), load_tolerances(), **settings)


def fed(checked, told, every=10, each=None):
    """The Pieces of samples; what can be told is asked for after `every` of them."""
    pieces = []
    for number, sample in enumerate(told, 1):
        pieces += checked.feed(sample)
        if number % every == 0:
            new = checked.advance()
            pieces += new
            if each and new:
                each(number)
    return pieces + checked.finish()


@pytest.mark.parametrize("every", [5, 700])
def test_seconds_add_up_to_the_check_of_the_recording(tmp_path, every):
    told, whole = noisy(), []
    found = check(open_recording(write_bag(tmp_path / "run", messages(told)), direct_drives(JOINTS)), DYNAMICS,
                  load_tolerances(), on_piece=lambda *piece: whole.append(piece))  # fmt: skip
    checked = new_check()
    pieces = fed(checked, samples(told), every)
    stamps, predicted = (
        np.concatenate(parts) for parts in zip(*((p.stamps, p.predicted) for p in pieces), strict=True)
    )
    assert np.abs(stamps - BEGINNING - 1e9 * MOTION.times[13:-13]).max() < 1000  # a period of 8 Hz at either end
    expected = np.concatenate([efforts for _, efforts, _ in whole])
    # margins of pieces are where the filter has settled to 1e-6
    assert np.abs(predicted - expected).max() < 1e-5 * np.abs(expected).max()
    for mine, other in zip(checked.result().verdicts, found.verdicts, strict=True):
        assert mine.passed and mine.joint.rms == pytest.approx(other.joint.rms, rel=1e-4)
        assert mine.tolerance == pytest.approx(other.tolerance, rel=1e-4)


def test_what_is_told_comes_a_second_later_and_the_verdict_when_its_second_is_over():
    late, told = [], noisy()
    checked = new_check()

    def lag(number):
        if checked.latest_motion is not None:
            late.append(number / RATE - checked.latest_motion.end)

    fed(checked, samples(told), 10, lag)
    assert max(late) < 0.75 + 0.3 + 0.2 + 1.0 and len(checked.joint_statuses) == 7


def test_a_flipped_sign_is_found_while_it_lasts_and_is_past_afterwards():
    told, when = noisy(), {}
    told.efforts[800:1200, 3] *= -1
    checked = new_check()

    def watch(number):
        for standing in checked.joint_statuses:
            if standing.failed_since is not None:
                when.setdefault(standing.verdict.joint.joint, number / RATE)

    fed(checked, samples(told), 10, watch)
    assert list(when) == ["panda_joint4"] and when["panda_joint4"] < 8.0 + 3.5
    standing = checked.joint_statuses[3]
    assert standing.failed_since is None and standing.verdict.passed
    first, last = (np.array(standing.last_failure) - BEGINNING) / 1e9
    assert first == pytest.approx(8.0, abs=1.0) and 12.0 <= last < 12.0 + live_check.DEFAULT_SPAN + 2.0
    assert not checked.result().passed


def test_a_clock_that_jumps_back_keeps_the_stamps_of_the_messages():
    first, again = samples(noisy(0)), samples(noisy(1))
    pieces = fed(new_check(), [*first, *again])
    stamps = np.concatenate([piece.stamps for piece in pieces])
    (jump,) = np.flatnonzero(np.diff(stamps) < 0)
    for part in (stamps[: jump + 1], stamps[jump + 1 :]):
        assert np.abs(part - BEGINNING - 1e9 * MOTION.times[13:-13]).max() < 1000


def test_memory_is_limited_where_a_joint_is_never_told_and_names_are_made_up(monkeypatch):
    monkeypatch.setattr(live_check, "MAX_PENDING_ROWS", 500)
    checked, told = new_check(), samples(noisy())
    for number, sample in enumerate(told):
        names = (*sample.names[:6], f"made_up_{number}")
        checked.feed(sample._replace(names=names))
        checked.advance()
        assert checked._assembly.pending_rows <= 501
    assert "joints missing: panda_joint7" in checked.error_message
    assert len(checked._assembly._known) <= 1000 and sum(map(len, checked.statistics.joints.values())) <= 101
    with pytest.raises(RecordingError, match="nothing was compared yet"):
        checked.result()
    assert checked.find_stale_names(sample.receive_time, 1.0) == ["panda_joint7"]


def test_seconds_of_long_ago_are_forgotten(monkeypatch):
    monkeypatch.setattr(live_check, "HISTORY_WINDOWS", 5)
    checked = new_check()
    fed(checked, samples(noisy()))
    assert len(checked._total.windows) <= 7 and checked._total.samples == len(MOTION.times) - 26


def test_numbers_beyond_all_bounds_are_left_out_and_counted():
    checked, told = new_check(), noisy()
    told.efforts[1000, 2] = 1e200
    told.efforts[1500, 1] = np.inf
    fed(checked, samples(told))
    notes = "; ".join(checked.result().notes)
    assert "nothing can be computed" in notes and "nan or infinite" in notes
    assert checked.result().passed


def test_rows_without_positions_at_the_beginning_do_no_harm():
    told = [JointSample("t", each.stamp, 0, each.names, each.position, each.velocity, each.effort)
            for each in samples(noisy())]  # fmt: skip
    told[:150] = [each._replace(position=np.full(7, np.nan)) for each in told[:150]]
    checked = new_check()
    fed(checked, told)
    assert checked.result().passed and checked.statistics.counts["not_finite"] == 150


@pytest.mark.parametrize("every", [1, 10])
@pytest.mark.parametrize("kind", ["random", "pairs", "pieces"])
def test_uneven_stamps_and_pieces_between_gaps_are_compared_as_in_a_recording(tmp_path, kind, every):
    rng = np.random.default_rng(3)
    motion = panda_motion(times=uneven_times(kind, 20.0))
    motion = motion._replace(efforts=motion.efforts + 0.3 * rng.normal(size=motion.efforts.shape))
    found = check(open_recording(write_bag(tmp_path / "run", messages(motion)), direct_drives(JOINTS)), DYNAMICS,
                  load_tolerances())  # fmt: skip
    checked = new_check()
    pieces = fed(checked, samples(motion), every)
    stamps = np.concatenate([piece.stamps for piece in pieces])
    assert (np.diff(stamps) > 0).all() and stamps[-1] > BEGINNING + 18e9
    mine = checked.result()
    assert mine.passed and found.passed
    assert mine.verdicts[0].joint.samples == pytest.approx(found.verdicts[0].joint.samples, rel=0.1)
    for verdict, other in zip(mine.verdicts, found.verdicts, strict=True):
        # what is interpolated at once sees one side only
        assert verdict.joint.rms == pytest.approx(other.joint.rms, rel=0.5 if every == 1 else 0.2)
    assert checked.statistics.counts["too_short"] > 0 or kind != "pieces"


def test_what_raises_in_one_piece_is_not_tried_again(monkeypatch):
    """Whatever it is: the rows that raise are dropped, and what comes after them is compared."""
    interpolate_on_grid, raised = alignment.interpolate_on_grid, []

    def fails_once(times, values, grid):
        if not raised:
            raised.append(times[0])
            raise RuntimeError("by a fault of the interpolation")
        return interpolate_on_grid(times, values, grid)

    monkeypatch.setattr(alignment, "interpolate_on_grid", fails_once)
    checked, told, failures = new_check(), samples(noisy()), 0
    for number, sample in enumerate(told, 1):
        checked.feed(sample)
        if number % 10 == 0:
            try:
                checked.advance()
            except RuntimeError:
                failures += 1
    checked.finish()
    assert failures == 1 and checked.result().passed and checked.result().verdicts[0].joint.samples > 1700


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason=f"no real data in {REAL_DATA}")
@pytest.mark.parametrize(
    ("robot", "bag", "reversed_joint", "expected"),
    [
        (str(REAL_DATA / "ur10/ur10.urdf"), "ur10/ur10_unisa_mcap", None, "all"),
        ("panda", "panda/panda_unisa_mcap", None, []),
        ("panda", "panda/panda_unisa_mcap", "panda_joint2", ["panda_joint2"]),
    ],
)
def test_real_robots_are_out_of_tolerance_where_they_are_and_only_there(robot, bag, reversed_joint, expected):
    dynamics, found = Dynamics(load_robot(robot)), set()
    drives = direct_drives(dynamics.joint_names)
    recording = open_recording(REAL_DATA / bag, drives)
    checked = LiveCheck(dynamics, drives, load_tolerances())
    for number, sample in enumerate(recording.source.samples(recording.topics)):
        if reversed_joint and number > 300:
            sign = [-1 if name == reversed_joint else 1 for name in sample.names]
            sample = sample._replace(effort=sample.effort * sign)
        checked.feed(sample)
        if number % 20 == 0:
            checked.advance()
            found |= {each.verdict.joint.joint for each in checked.joint_statuses if each.failed_since is not None}
    assert found == set(dynamics.joint_names if expected == "all" else expected)
