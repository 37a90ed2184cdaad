"""What was left out of a recording, and what was filled in: counted, to be told in every report."""

from collections import Counter
from dataclasses import dataclass, field

DESCRIPTIONS = {
    "no_known_joint": "messages tell of none of the joints",
    "length_mismatch": "messages have values of another number than names, and were left out",
    "duplicates": "messages have the stamp of the one before, and were left out",
    "out_of_order": "messages are older than the one before, and were left out",
    "clock_jumps": "jumps of the clock: what follows each is taken as a stretch of its own",
    "gaps": "gaps: nothing is filled in, filters begin anew after each",
    "not_finite": "rows have a position or effort that is nan or infinite, and were left out",
    "too_short": "samples are in stretches too short to be filtered, and were left out",
    "too_close": "messages are closer to the one before than a third of the usual step, and were left out",
    "unbounded": "samples have positions or efforts so large that nothing can be computed, and were left out",
    "edges": "samples are at the ends of stretches, where the filter sees one side only, and were left out",
    "second_source": "values of joints come from a second topic too, and were left out",
    "zero_stamp": "messages have stamp zero: the time of recording stands for it",
}


MAX_NAMES = 100  # that are told of one sentence


@dataclass
class SampleStatistics:
    """counts: of SENTENCES; messages, samples: read, and used after resampling; origin: the stamp
    [ns] of time 0; joints: {sentence: names of joints}."""

    counts: Counter = field(default_factory=Counter)
    messages: int = 0
    origin: int = 0
    samples: int = 0
    joints: dict = field(default_factory=dict)

    def __setitem__(self, sentence, name):
        names = self.joints.setdefault(sentence, {})
        if len(names) < MAX_NAMES:
            names[name] = None
        elif name not in names:
            names["and others"] = None

    @property
    def sentences(self):
        """What to tell: nothing where nothing was left out."""
        told = [f"{self.counts[key]} {sentence}" for key, sentence in DESCRIPTIONS.items() if self.counts[key]]
        return told + [f"{sentence}: {', '.join(names)}" for sentence, names in self.joints.items()]
