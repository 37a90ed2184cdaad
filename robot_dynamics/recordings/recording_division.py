"""Division of long bags into parts. It depends on the bag alone: results do not depend on the number of processes."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.alignment import Resampler
from robot_dynamics.recordings.bags import Bag
from robot_dynamics.recordings.messages import NANOSECONDS_PER_SECOND
from robot_dynamics.recordings.recording_parts import RecordingPart
from robot_dynamics.recordings.sample_range import WHOLE
from robot_dynamics.recordings.sample_statistics import SampleStatistics
from robot_dynamics.recordings.signals import choose_cutoff

if TYPE_CHECKING:
    from robot_dynamics.recordings.joint_samples import JointSample
    from robot_dynamics.recordings.recording import Recording

PART_MESSAGES = 200_000  # in a part: half an hour at 125 Hz
# Periods of the lowest cut-off: two filters one after the other have margins of 6 periods each, and edges.
CONTEXT_PERIODS = 30
CONTEXT_ROWS = 3000  # messages: the models of stamps and of steps keep 1000
LAST_DURATION = 10.0  # [s] in which the last message is searched


def divide_recording(
    recording: Recording,
    *,
    rate: float | None = None,
    cutoff: float | None = None,
    band: float | None = None,
    part_messages: int | None = None,
) -> tuple[Recording, ...]:
    """Divide a long recording into parts.

    Parameters
    ----------
    recording : the recording.
    rate : samples per second of the grid; None: as recorded.
    cutoff, band : cut-off frequencies of the filters [Hz]; None: their defaults.
    part_messages : number of messages in a part; None: PART_MESSAGES.

    Returns
    -------
    tuple of Recording
        The recording alone where it is short, damaged, compressed as a whole, no bag, or used in part
        (`sample_range`), or its clock jumps.
    """
    source = recording.source
    count = recording.message_count
    if not isinstance(source, Bag) or count is None or recording.sample_range != WHOLE or recording.part is not None:
        return (recording,)
    number = round(count / (part_messages or PART_MESSAGES))
    span = source.time_span() if number > 1 else None
    if span is None:
        return (recording,)
    begin, end = span
    limits = [begin + k * (end - begin) // number for k in range(1, number)]
    try:
        first = _first_part(recording, rate)
        frequency = min(choose_cutoff(1 / first.step, cutoff), band or choose_cutoff(1 / first.step))
        times = [_stamp_after(recording, limit) for limit in limits]
        last = _last_stamp(recording, end)
    except (RecordingError, StopIteration):  # reading the whole recording reports the reason
        return (recording,)
    starts = [(stamp + first.offset) / NANOSECONDS_PER_SECOND for stamp in times]
    duration = (last + first.offset) / NANOSECONDS_PER_SECOND + first.step
    context = int(max(CONTEXT_PERIODS / frequency, CONTEXT_ROWS * first.step) * NANOSECONDS_PER_SECOND)
    if any(after <= before for before, after in pairwise([0.0, *starts, duration])) or 4 * context > limits[0] - begin:
        return (recording,)
    return tuple(
        replace(
            recording,
            part=replace(first, begin=a, end=b, context=context, start=start, stop=stop, duration=duration),
        )
        for (a, b), (start, stop) in zip(
            pairwise([None, *limits, None]), pairwise([float("-inf"), *starts, float("inf")]), strict=True
        )
    )


def _first_part(recording: Recording, rate: float | None) -> RecordingPart:
    """Step, grid and offset of the first messages. Raises RecordingError or StopIteration where they have none."""
    statistics = SampleStatistics()
    resampler = Resampler(recording.signal_names, statistics, rate)
    with closing(recording.source.samples(recording.topics, recording.base)) as samples:
        for sample in recording.sample_range.select(samples, statistics):
            resampler.feed(sample)
            if resampler.is_full:
                break
    first = next(iter([*resampler.finished, *resampler.drain()]))
    if statistics.counts["clock_jumps"] or resampler.offset is None:
        raise StopIteration
    return RecordingPart(
        begin=None,
        end=None,
        context=0,
        start=float("-inf"),
        stop=float("inf"),
        duration=0.0,
        step=1 / first.rate,
        anchor=first.time,
        offset=resampler.offset,
        sources=tuple(resampler.sources.items()),
    )


def _stamp_after(recording: Recording, begin: int) -> int:
    """Stamp [ns] of the first message at or after a time of recording [ns]."""
    with closing(_samples_of_joints(recording, begin)) as samples:
        sample = next(samples)
    return sample.stamp or sample.receive_time


def _last_stamp(recording: Recording, end: int) -> int:
    """Latest stamp [ns] of the last messages before a time of recording [ns]."""
    with closing(_samples_of_joints(recording, end - int(LAST_DURATION * NANOSECONDS_PER_SECOND))) as samples:
        return max((sample.stamp or sample.receive_time for sample in samples), default=0)


def _samples_of_joints(recording: Recording, begin: int) -> Generator[JointSample, None, None]:
    """Yield the samples of the first topic from a time of recording [ns] on."""
    assert isinstance(recording.source, Bag)
    return recording.source.samples(recording.topics[:1], begin=begin)
