"""Time of samples since the first sample of a recording, across jumps of the clock that stamped them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robot_dynamics.recordings.joint_samples import JointSample
    from robot_dynamics.recordings.sample_statistics import SampleStatistics

BACKWARD_JUMP = 1.0  # [s] backward beyond which the clock was set anew; less is a late message
FORWARD_JUMP = 10.0  # [s] ahead of the time of recording beyond which the clock was set anew
MIN_STEP_AFTER_JUMP = 1_000_000  # [ns]


class Clock:
    """Times of samples since the first sample: by stamps, and across a clock jump by the time of recording.

    Attributes
    ----------
    offset : added to stamps [ns] to get times; None before the first sample, if it is not known.
    jumped : whether the clock was set anew before the last sample.
    """

    def __init__(self, statistics: SampleStatistics, offset: int | None = None) -> None:
        self.offset = offset
        self.jumped = False
        self._statistics = statistics
        self._latest: int | None = None
        self._receive_time = 0

    def time(self, sample: JointSample) -> float:
        """Time [s] of a sample."""
        self.jumped = False
        stamp = sample.stamp
        if stamp == 0 and sample.receive_time:
            self._statistics.counts["zero_stamp"] += 1
            stamp = sample.receive_time
        if self.offset is None:
            self.offset = -stamp
        if self._latest is None:
            self._latest = stamp + self.offset
            self._receive_time = sample.receive_time
            self._statistics.origin = -self.offset
        time = stamp + self.offset
        elapsed = sample.receive_time - self._receive_time
        ahead = time - self._latest
        if ahead < -BACKWARD_JUMP * 1e9 or (sample.receive_time and ahead - elapsed > FORWARD_JUMP * 1e9):
            self.jumped = True
            self._statistics.counts["clock_jumps"] += 1
            self.offset += self._latest + max(elapsed, MIN_STEP_AFTER_JUMP) - time
            time = stamp + self.offset
        self._latest = max(self._latest, time)
        self._receive_time = sample.receive_time
        return time * 1e-9
