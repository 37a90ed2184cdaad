"""Counts of the samples of a recording that were skipped or replaced, for the notes of each report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

CountName: TypeAlias = Literal[
    "no_known_joint",
    "length_mismatch",
    "duplicates",
    "out_of_order",
    "clock_jumps",
    "gaps",
    "position_jumps",
    "not_finite",
    "too_short",
    "too_close",
    "unbounded",
    "edges",
    "second_source",
    "zero_stamp",
    "held",
    "lost",
]

DESCRIPTIONS: dict[CountName, str] = {
    "no_known_joint": "messages name no joint of the model and were skipped",
    "length_mismatch": "messages have a different number of values than names and were skipped",
    "duplicates": "messages have the stamp of the previous message and were skipped",
    "out_of_order": "messages are older than the previous message and were skipped",
    "clock_jumps": "clock jumps; the samples after each jump form a separate segment",
    "position_jumps": "jumps of positions that no motion explains; the filters restart after each",
    "gaps": "gaps; no samples are interpolated across a gap, and the filters restart after it",
    "not_finite": "rows have a position or effort that is missing, nan or infinite, and were skipped",
    "too_short": "samples are in segments too short to be filtered and were skipped",
    "too_close": "messages follow the previous message by less than a third of the usual step and were skipped",
    "unbounded": "samples have positions, velocities or efforts too large to compute with and were skipped",
    "edges": "samples are at the ends of segments, where the filter has data on one side only, and were skipped",
    "second_source": "values of joints come from a second topic and were skipped",
    "zero_stamp": "messages have stamp zero; the time of recording is used instead",
    "held": "messages repeat the values of the previous message and were skipped",
    "lost": "samples were lost between others; their times show it",
}

MAX_NAMES = 100  # names listed in one sentence


@dataclass
class SampleStatistics:
    """Counts of skipped samples.

    Attributes
    ----------
    counts : number of cases of each kind in `DESCRIPTIONS`.
    messages : messages read.
    origin : stamp [ns] of time 0.
    samples : samples after resampling.
    recorded_duration : time [s] that the messages cover, without pauses of more than a second.
    joints : {sentence: names of the joints that it holds for}; a dict of names to None keeps their order.
    sampling_times : {topic: largest delay of its stamps, period of its sender [s]}, where stamps jitter; the topic of a
        table is empty.
    stray_start : sentence on samples at the start that were skipped for their stamps; empty: none.
    """

    counts: Counter[CountName] = field(default_factory=Counter)
    messages: int = 0
    origin: int = 0
    samples: int = 0
    recorded_duration: float = 0.0
    joints: dict[str, dict[str, None]] = field(default_factory=dict)
    sampling_times: dict[str, tuple[float, float]] = field(default_factory=dict)
    stray_start: str = ""

    def note_joint(self, sentence: str, name: str) -> None:
        """Add a joint to those that a sentence holds for; beyond `MAX_NAMES` only "and others" is added."""
        names = self.joints.setdefault(sentence, {})
        if len(names) < MAX_NAMES:
            names[name] = None
        elif name not in names:
            names["and others"] = None

    def note_sampling_times(self, source: str, delay: float, period: float) -> None:
        """Note that times of a topic are from a model of its sender: delay of a stamp, period of the sender [s]."""
        largest, _ = self.sampling_times.get(source, (0.0, period))
        self.sampling_times[source] = max(largest, delay), period

    def note_stray_start(self, stamps: Sequence[float], first_stamp: float) -> None:
        """Note that the first messages, with these stamps [s], were skipped; first_stamp: of the next message [s]."""
        if len(stamps) == 1:
            skipped = f"message was skipped: its stamp is {stamps[0]:.13g} s"
        else:
            skipped = (
                f"{len(stamps)} messages were skipped: their stamps are from {min(stamps):.13g} to {max(stamps):.13g} s"
            )
        self.stray_start = (
            f"the first {skipped}, and the stamps of the messages that follow begin at {first_stamp:.13g} s"
        )

    def append(self, later: SampleStatistics) -> None:
        """Add the counts of a later part of the same recording."""
        self.counts.update(later.counts)
        self.messages += later.messages
        self.samples += later.samples
        self.recorded_duration += later.recorded_duration
        for sentence, names in later.joints.items():
            for name in names:
                self.note_joint(sentence, name)
        for source, (delay, period) in later.sampling_times.items():
            self.note_sampling_times(source, delay, period)

    @property
    def sentences(self) -> list[str]:
        """Notes for a report; empty where nothing was skipped or replaced."""
        counted = [f"{self.counts[key]} {sentence}" for key, sentence in DESCRIPTIONS.items() if self.counts[key]]
        jitter = [
            f"stamps{f' of {source}' if source else ''} are up to {1e3 * delay:.3g} ms late; times are those of a "
            f"sender with a period of {1e3 * period:.3g} ms"
            for source, (delay, period) in self.sampling_times.items()
        ]
        stray = [self.stray_start] if self.stray_start else []
        return stray + counted + jitter + [f"{sentence}: {', '.join(names)}" for sentence, names in self.joints.items()]
