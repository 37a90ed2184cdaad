"""From messages to stretches: joints of all topics on one uniform grid, in pieces that fit the memory.

Stamps may jump, repeat or run back, joints may be spread over messages and topics in any order, values may be missing:
all of it is counted in a Tally, and nothing is filled in across a gap.
"""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.sample_statistics import SampleStatistics
from robot_dynamics.recordings.signals import MIN_SPLINE_SAMPLES, interpolate_on_grid

MESSAGES_PER_CHUNK = 20_000  # messages that are put on the grid at once
BACKWARD_JUMP = 1.0  # [s] back that is another clock, and not a message that came late
FORWARD_JUMP = 10.0  # [s] ahead of the time of recording that is another clock
GAP_STEPS = 5.5  # steps of the grid, or of a slower topic, without a sample that are a gap
OVERLAP_SAMPLES = 8  # samples kept for the interpolation of what follows
MIN_SAMPLES = 8  # to tell the rate from
MAX_STEPS_KEPT = 1000  # the latest ones of a topic, of which one is typical
BURST_RATIO = 2.0  # median steps in a mean one, beyond which stamps come in bursts and the mean is the step
MIN_BURST_SAMPLES = 50  # samples to tell that from
MIN_STEP_RATIO = 0.3  # of a step: two samples closer to each other would give a spline the slope of their noise
MAX_MESSAGE_LAYOUTS = 1000  # sorts of messages that are remembered


@dataclass(frozen=True, eq=False)
class SignalSegment:
    """Samples without a gap on a uniform grid.

    time: of the first sample [s] after the beginning of the recording; rate [1/s]; position, velocity, effort: (N, k),
    columns of velocity and effort nan where they were not measured; continues: whether it goes on where the Stretch
    before it ended.
    """

    time: float
    rate: float
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    is_continuation: bool

    def __len__(self):
        return len(self.position)


class Clock:
    """Times [s] of samples after the first one: by their stamps, and by times of recording where the clock jumps."""

    def __init__(self, statistics):
        self.statistics, self.offset, self.jumped = statistics, None, False
        self.latest = self.receive_time = 0

    def time(self, sample):
        """The time of a sample; `jumped`: whether the clock was set anew before it."""
        stamp, self.jumped = sample.stamp, False
        if stamp == 0 and sample.receive_time:
            self.statistics.counts["zero_stamp"] += 1
            stamp = sample.receive_time
        if self.offset is None:
            self.offset, self.receive_time, self.statistics.origin = -stamp, sample.receive_time, stamp
        time, passed = stamp + self.offset, sample.receive_time - self.receive_time
        ahead = time - self.latest
        if ahead < -BACKWARD_JUMP * 1e9 or (sample.receive_time and ahead - passed > FORWARD_JUMP * 1e9):
            self.jumped = True
            self.statistics.counts["clock_jumps"] += 1
            self.offset += self.latest + max(passed, 1_000_000) - time
            time = stamp + self.offset
        self.latest, self.receive_time = max(self.latest, time), sample.receive_time
        return time * 1e-9


class Resampler:
    """Puts JointSamples together; `feed` them one by one, and `drain` what can be put on the grid."""

    def __init__(self, names, statistics, rate=None):
        self.names, self.statistics = tuple(names), statistics
        self.step = None if rate is None else 1 / rate
        self._places = {name: place for place, name in enumerate(self.names)}
        self._known = {}  # (topic, names of a message) to (joints told, their columns)
        self._owners = {}  # topic that tells of each joint
        self._clock = Clock(statistics)
        self._rows, self._count = {}, 0  # {joints: [(time, position, velocity, effort)]}
        self._end = None  # time of the last sample on the grid
        self._short_end = -np.inf  # end of the last piece that was left out
        self._counted, self._seen = {}, {}  # {joints: time up to which gaps are in the tally, and steps known}
        self._steps = {}  # {joints: the latest steps (N,) [s] of their samples}
        self.finished = []

    def feed(self, sample):
        """Take one sample; what a jump of the clock ends comes out in `finished`."""
        self.statistics.messages += 1
        key = sample.source, sample.names
        if key not in self._known:
            if len(self._known) >= MAX_MESSAGE_LAYOUTS:
                self._known.clear()
            self._known[key] = self._match(sample)
        joints, columns = self._known[key]
        if not joints:
            self.statistics.counts["no_known_joint"] += 1
            return
        size = len(sample.names)
        if len(sample.position) != size:
            self.statistics.counts["length_mismatch"] += 1
            return
        time = self._clock.time(sample)
        if self._clock.jumped:
            self.finished += self.drain(final=True)
        missing = np.full(len(joints), np.nan)
        velocity, effort = (values[columns] if len(values) == size else missing
                            for values in (sample.velocity, sample.effort))  # fmt: skip
        self._rows.setdefault(joints, []).append((time, sample.position[columns], velocity, effort))
        self._count += 1

    def _match(self, sample):
        """(numbers of the joints that messages like this tell of, ascending; their columns)."""
        found = {}
        for column, name in enumerate(sample.names):
            place = self._places.get(name)
            if place is None:
                self.statistics["joints that the model does not ask for"] = name
            elif self._owners.setdefault(place, sample.source) != sample.source:
                self.statistics.counts["second_source"] += 1
                self.statistics[f"joints that {sample.source} tells of too, and {self._owners[place]} before it"] = name
            elif place in found:
                raise RecordingError(f"{sample.source}: joint {name!r} is named twice in one message")
            else:
                found[place] = column
        joints = tuple(sorted(found))
        return joints, [found[place] for place in joints]

    @property
    def is_full(self):
        return self._count >= MESSAGES_PER_CHUNK

    @property
    def pending_rows(self):
        """Rows that wait to be put on the grid, or for joints that are not told of."""
        return sum(map(len, self._rows.values()))

    @property
    def offset(self):
        """What is added to stamps [ns] to have times, as the clock stands; None before the first sample."""
        return self._clock.offset

    def drain(self, final=False):
        """The Stretches that are ready; with `final` all, and what comes next is not joined to them."""
        told = {place for joints in self._rows for place in joints}
        missing = [name for place, name in enumerate(self.names) if place not in told]
        if missing and not (final and self.statistics.messages):
            return []
        if missing:
            self._forget()
            recorded = ", ".join(self.names[place] for place in sorted(told)) or "none of them"
            raise RecordingError(
                f"joints missing: {', '.join(missing)}. Positions of all joints are needed, recorded are: {recorded}"
            )
        try:
            signal_segments, bands, limit = self._gridded(self._bands(), final)
        except Exception:
            self._forget()  # else the same rows would raise it again with each drain
            raise
        self.statistics.samples += sum(map(len, signal_segments))
        if final:
            self._forget()
        else:
            self._keep(bands, limit)
        return signal_segments

    def _gridded(self, bands, final):
        """(the Stretches of bands, the bands, time up to which they are on the grid or left out)."""
        without_any = not final and any(len(times) == 0 for _, times, *_ in bands)
        if without_any or (self.step is None and not self._measure_step(bands, final)):
            return [], bands, -np.inf
        bands = [self._thinned(*band) for band in bands]
        limit = np.inf if final else min(times[-1] for _, times, *_ in bands)
        signal_segments, waiting = self._stretches(bands, limit)
        return signal_segments, bands, min(limit, waiting)

    def _stretches(self, bands, limit):
        """(the Stretches up to a time, beginning of a piece that has too few samples and may go on, inf if none does).

        A piece between two gaps that has too few samples for a spline is left out, and counted.
        """
        signal_segments, waiting = [], np.inf
        for start, end in _intersected([self._intervals(joints, times) for joints, times, *_ in bands]):
            done = self._short_end if self._end is None else max(self._short_end, self._end + 0.5 * self.step)
            if start > limit or end <= done:
                continue
            if all(len(range(*self._near(joints, times, start, min(end, limit)))) >= MIN_SPLINE_SAMPLES
                   for joints, times, *_ in bands):  # fmt: skip
                signal_segments.append(self._stretch(bands, start, min(end, limit)))
            elif end >= limit:
                waiting = start
            else:
                self.statistics.counts["too_short"] += self._size(start, end)
                self._short_end = end
        return [stretch for stretch in signal_segments if stretch is not None], waiting

    def _bands(self):
        """[(joints, times, position, velocity, effort)] of joints that are told together, in the order of time."""
        partial = {place: [key for key in self._rows if place in key] for place in range(len(self.names))}
        sets = {}
        for place, keys in partial.items():
            if keys:
                sets.setdefault(tuple(keys), []).append(place)
        return [self._band(keys, tuple(joints)) for keys, joints in sets.items()]

    def _band(self, keys, joints):
        parts = []
        for key in keys:
            columns, rows = [key.index(place) for place in joints], self._rows[key]
            times = np.array([row[0] for row in rows])
            parts.append((times, *(np.array([row[field] for row in rows])[:, columns] for field in (1, 2, 3))))
        times, *fields = (np.concatenate(part) for part in zip(*parts, strict=True))
        if len(parts) > 1:
            order = np.argsort(times, kind="stable")
            times, fields = times[order], [field[order] for field in fields]
        return self._sound(joints, times, *fields)

    def _sound(self, joints, times, position, velocity, effort):
        """The rows that are finite and later than all before them."""
        latest = np.maximum.accumulate(times)
        late = np.concatenate([[False], times[1:] <= latest[:-1]]) if len(times) else np.zeros(0, dtype=bool)
        repeated = late & np.concatenate([[False], np.diff(times) == 0])[: len(late)]
        measured = np.isfinite(effort).any(axis=0)
        finite = np.isfinite(position).all(axis=1) & np.isfinite(effort[:, measured]).all(axis=1)
        self.statistics.counts["duplicates"] += int(repeated.sum())
        self.statistics.counts["out_of_order"] += int((late & ~repeated).sum())
        self.statistics.counts["not_finite"] += int((~finite & ~late).sum())
        good = finite & ~late
        return joints, times[good], position[good], velocity[good], effort[good]

    def _thinned(self, joints, times, *fields):
        """A band without samples that are much closer to the one before than its samples are on the whole."""
        self._note_steps(joints, times)
        if len(times) < 2 or np.diff(times).min() >= (least := MIN_STEP_RATIO * self._typical(joints)):
            return joints, times, *fields
        kept, latest = np.zeros(len(times), dtype=bool), -np.inf
        for row, time in enumerate(times):
            if time - latest >= least:
                kept[row], latest = True, time
        self.statistics.counts["too_close"] += int((~kept).sum())
        return joints, times[kept], *(field[kept] for field in fields)

    def _note_steps(self, joints, times):
        """Put the steps of a band that are new to those before them."""
        latest, known = self._seen.get(joints, -np.inf), self._steps.get(joints, np.zeros(0))
        if len(times) and times[-1] > latest:
            new = times[max(0, np.searchsorted(times, latest, side="right") - 1) :]
            self._steps[joints] = np.concatenate([known, np.diff(new)])[-MAX_STEPS_KEPT:]
            self._seen[joints] = times[-1]

    def _measure_step(self, bands, final):
        steps = [np.diff(times) for _, times, *_ in bands if len(times) >= MIN_SAMPLES]
        if not final and any(
            len(each) < MIN_BURST_SAMPLES and np.mean(each) > BURST_RATIO * np.median(each) for each in steps
        ):
            return False  # gaps or bursts: more samples will show which
        fastest = min(map(typical_step, steps), default=None)
        if fastest is None and final:
            most = max((len(times) for _, times, *_ in bands), default=0)
            self._forget()
            left_out = "".join(f"; {sentence}" for sentence in self.statistics.sentences)
            raise RecordingError(f"{most} samples of the joints: {MIN_SAMPLES} at least are needed{left_out}")
        self.step = fastest
        return fastest is not None

    def _intervals(self, joints, times):
        """(start, end) of the pieces between gaps."""
        if len(times) < 2:
            return [(times[0], times[0])] if len(times) else []
        cuts = np.flatnonzero(np.diff(times) > self._gap(joints))
        self.statistics.counts["gaps"] += int((times[cuts + 1] > self._counted.get(joints, -np.inf)).sum())
        self._counted[joints] = times[-1]
        return list(zip(times[[0, *(cuts + 1)]], times[[*cuts, -1]], strict=True))

    def _near(self, joints, times, start, end):
        """(first, behind the last) of the samples that a spline from start to end takes: none beyond a gap."""
        first = max(0, np.searchsorted(times, start) - OVERLAP_SAMPLES)
        behind = min(len(times), np.searchsorted(times, end, side="right") + OVERLAP_SAMPLES)
        cuts = 1 + first + np.flatnonzero(np.diff(times[first:behind]) > self._gap(joints))
        before, after = cuts[times[cuts] <= start], cuts[times[cuts] > end]
        return (before[-1] if len(before) else first), (after[0] if len(after) else behind)

    def _gap(self, joints):
        """The time [s] without a sample of a band that is a gap."""
        steps = self._steps.get(joints, ())
        if len(steps) < MIN_SAMPLES - 1:
            return GAP_STEPS * self.step
        typical = typical_step(steps)
        return GAP_STEPS * max(self.step, typical, np.mean(steps[steps <= GAP_STEPS * typical]))

    def _typical(self, joints):
        """The typical step [s] of a band; 0 where there are too few of them yet."""
        steps = self._steps.get(joints, ())
        return typical_step(steps) if len(steps) >= MIN_SAMPLES - 1 else 0.0

    def _size(self, first, end):
        """How many samples of the grid there are from the first one to a time."""
        return int(np.floor((end - first) / self.step + 1e-3)) + 1

    def _stretch(self, bands, start, end):
        is_continuation = self._end is not None and start <= self._end + 1e-6 * self.step
        first = self._end + self.step if is_continuation else start
        size = self._size(first, end)
        if size < 1:
            return None
        grid = first + self.step * np.arange(size)
        arrays = np.full((3, size, len(self.names)), np.nan)
        for joints, times, *fields in bands:
            near = slice(*self._near(joints, times, grid[0], grid[-1]))
            for array, values in zip(arrays, fields, strict=True):
                array[:, joints] = interpolate_on_grid(times[near], values[near], grid)
        self._end = grid[-1]
        return SignalSegment(float(first), 1 / self.step, *arrays, is_continuation)

    def _keep(self, bands, limit):
        """Forget all but what the interpolation of the next samples needs."""
        self._rows = {}
        for joints, times, *fields in bands:
            first = max(0, np.searchsorted(times, limit) - OVERLAP_SAMPLES)
            if first < len(times):
                self._rows[tuple(joints)] = list(zip(times[first:], *(field[first:] for field in fields), strict=True))
        self._count = 0

    def _forget(self):
        self._rows, self._count, self._end = {}, 0, None


def resample_samples(samples, names, statistics=None, rate=None):
    """Yield the Stretches of JointSamples: positions, velocities and efforts of the joints `names`, in this order.

    rate: samples per second of the grid; None: as recorded. Raises RecordingError.
    """
    assembly = Resampler(names, SampleStatistics() if statistics is None else statistics, rate)
    for sample in samples:
        assembly.feed(sample)
        yield from assembly.finished
        assembly.finished = []
        if assembly.is_full:
            yield from assembly.drain()
    yield from assembly.drain(final=True)


def typical_step(steps):
    """The typical one of the steps (N,) [s] between samples: the median, or the mean without gaps where that is much
    longer, as where stamps come in bursts."""
    median, mean = np.median(steps), np.mean(steps)
    while mean > BURST_RATIO * median and len(steps) >= MIN_BURST_SAMPLES:
        without_gaps = steps[steps <= GAP_STEPS * mean]
        if len(without_gaps) == len(steps):
            return float(mean)
        steps = without_gaps
        mean = np.mean(steps)
    return float(median)


def _intersected(lists):
    """What all of some lists of intervals have in common."""
    found = lists[0]
    for others in lists[1:]:
        pairs = ((max(a, c), min(b, d)) for a, b in found for c, d in others)
        found = [(start, end) for start, end in pairs if start <= end]
    return found
