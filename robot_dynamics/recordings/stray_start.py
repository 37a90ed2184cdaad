"""Stray stamps at the start of a recording: samples before the first ones whose stamps continue each other.

A driver may send rows before its clock is set, or what was left in its buffers. Their stamps are far from all others,
and the time between them and the first sample of the motion is not known.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import TYPE_CHECKING

from robot_dynamics.recordings.clock import BACKWARD_JUMP, FORWARD_JUMP
from robot_dynamics.recordings.messages import NANOSECONDS_PER_SECOND
from robot_dynamics.recordings.sample_bands import MIN_SAMPLES

if TYPE_CHECKING:
    from robot_dynamics.recordings.joint_samples import JointSample
    from robot_dynamics.recordings.sample_statistics import SampleStatistics

MAX_STRAY_SAMPLES = 100  # with more, stamps are left as they are
MAX_PAUSE = 3600.0  # [s] between stamps beyond which a clock was set anew, where times of recording are not known


def skip_stray_start(samples: Iterable[JointSample], statistics: SampleStatistics) -> Iterator[tuple[int, JointSample]]:
    """Return numbers and samples, from the first sample on that begins a sequence of stamps without a jump.

    Samples are skipped only where the stamps jump as those of a clock that is set anew. A pause is no jump. Numbers are
    counted from 0, with the samples that are skipped. `statistics` notes what was skipped.
    """
    remaining = iter(samples)
    first_samples: list[JointSample] = []
    skipped = 0
    start = 0  # number of the first of the latest samples without a jump or a pause between them
    has_jump = False
    for sample in remaining:
        if first_samples:
            is_jump, is_pause = _compare_stamps(first_samples[-1], sample)
            has_jump |= is_jump
            start = len(first_samples) if is_jump or is_pause else start
        first_samples.append(sample)
        is_continued = len(first_samples) - start >= MIN_SAMPLES
        if is_continued or len(first_samples) > MAX_STRAY_SAMPLES:
            if is_continued and has_jump:
                stamps = [stray.stamp / NANOSECONDS_PER_SECOND for stray in first_samples[:start]]
                statistics.note_stray_start(stamps, first_samples[start].stamp / NANOSECONDS_PER_SECOND)
                skipped = start
            break
    return enumerate(chain(first_samples[skipped:], remaining), skipped)


def _compare_stamps(before: JointSample, after: JointSample) -> tuple[bool, bool]:
    """Whether the clock was set anew between two samples, and whether there is a pause between them."""
    step = ((after.stamp or after.receive_time) - (before.stamp or before.receive_time)) / NANOSECONDS_PER_SECOND
    elapsed = (after.receive_time - before.receive_time) / NANOSECONDS_PER_SECOND
    has_receive_times = bool(before.receive_time and after.receive_time)
    is_ahead = step - elapsed > FORWARD_JUMP if has_receive_times else step > MAX_PAUSE
    return step < -BACKWARD_JUMP or is_ahead, step > FORWARD_JUMP
