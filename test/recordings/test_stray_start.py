"""Stray stamps at the start of a recording are skipped and named; clocks that run, pauses and mixed clocks are kept."""

import numpy as np
import pytest

from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_samples import JointSample
from robot_dynamics.recordings.recording import open_recording
from robot_dynamics.recordings.sample_range import SampleRange
from robot_dynamics.recordings.sample_statistics import SampleStatistics
from robot_dynamics.recordings.stray_start import skip_stray_start

NOTHING = np.zeros(0)
EPOCH = 1_700_000_000.0


def samples(stamps, receive_times=None):
    receive_times = np.zeros(len(stamps)) if receive_times is None else receive_times
    return [
        JointSample("", round(stamp * 1e9), round(received * 1e9), (), NOTHING, NOTHING, NOTHING)
        for stamp, received in zip(stamps, receive_times, strict=True)
    ]


def kept_numbers(stamps, receive_times=None):
    statistics = SampleStatistics()
    return [number for number, _ in skip_stray_start(samples(stamps, receive_times), statistics)], statistics.sentences


@pytest.mark.parametrize(
    "stray",
    [[1e4], [0.0, -3047.8, -3046.9, 2.7e154, -3047.7, -3000.1, -3047.7, -3047.7], [5.0, 5.01, 5.02], [-2 * EPOCH]],
)
def test_samples_before_a_jump_at_the_start_are_skipped(stray):
    numbers, sentences = kept_numbers([*stray, *(0.366 + 0.01 * np.arange(200))])
    assert numbers == list(range(len(stray), len(stray) + 200))
    (sentence,) = sentences
    count = "message was" if len(stray) == 1 else f"{len(stray)} messages were"
    assert sentence.startswith(f"the first {count} skipped: ") and sentence.endswith("begin at 0.366 s")
    assert f"{max(stray):.13g} s" in sentence


def test_stamp_zero_before_stamps_since_1970_is_skipped():
    """Without times of recording, as in a CSV file, and with them."""
    stamps = np.array([1e-9, *(EPOCH + 0.01 * np.arange(100))])
    for receive_times in (None, EPOCH + 0.01 * np.arange(101)):
        numbers, sentences = kept_numbers(stamps, receive_times)
        assert numbers[0] == 1
        assert sentences == [
            "the first message was skipped: its stamp is 1e-09 s, and the stamps of the messages that follow begin at "
            "1700000000 s"
        ]


@pytest.mark.parametrize("late", [0.0, 0.5])
def test_pauses_late_messages_and_clocks_that_are_set_later_are_kept(late):
    even = 0.01 * np.arange(100)
    paused = np.where(np.arange(100) < 3, even, even + 60.0)
    swapped = even.copy()
    swapped[4] -= late
    mixed = np.where(np.arange(100) % 2, even, even + EPOCH)
    later = np.where(np.arange(100) < 8, even + 50, even)
    few = np.array([5.0, 0.0, 0.01])
    for stamps in (even, paused, swapped, mixed, later, few, np.zeros(0)):
        numbers, sentences = kept_numbers(stamps)
        assert numbers == list(range(len(stamps))) and sentences == []
    numbers, sentences = kept_numbers(
        np.zeros(100), EPOCH + 60.0 * np.arange(100)
    )  # stamps of zero: times of recording
    assert len(numbers) == 100 and sentences == []


def test_table_with_a_stray_first_row_is_read_and_its_times_count_from_the_second_row(tmp_path):
    path = tmp_path / "run.csv"
    times = np.array([9000.0, *(20 + 0.01 * np.arange(500))])
    q = np.sin(times)
    rows = np.stack([times, q, np.cos(times), 3 * q], axis=1)
    np.savetxt(path, rows, delimiter=",", header="time,j.position,j.velocity,j.effort", comments="")
    drives = direct_drives(("j",))
    statistics = SampleStatistics()
    (segment,) = open_recording(path, drives).signal_segments(statistics)
    assert segment.time == 0 and segment.position[:, 0] == pytest.approx(q[1:], abs=1e-12)
    assert statistics.sentences[0].startswith("the first message was skipped: its stamp is 9000 s")
    part = SampleRange(start=1.0, end=3.0, first=110)
    (segment,) = open_recording(path, drives, sample_range=part).signal_segments()
    assert segment.position[:, 0] == pytest.approx(q[110:301], abs=1e-12)
