"""Notes on several recordings, each sentence once."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

MAX_NAMES = 3  # of recordings, listed in one note
NUMBER = re.compile(r"(?<![\w./-])\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w/])")


def merge_notes(notes: Mapping[str, Sequence[str]]) -> list[str]:
    """Merge the notes on recordings: a sentence on several is there once, with the ranges of its numbers.

    notes: the sentences on each recording, by its name. The names are left out where there is one recording only.
    """
    groups: dict[str, dict[str, str]] = {}
    for recording, sentences in notes.items():
        for sentence in sentences:
            groups.setdefault(NUMBER.sub("#", sentence), {})[recording] = sentence
    return [f"{_name_recordings(list(group), len(notes))}{_merge(list(group.values()))}" for group in groups.values()]


def _name_recordings(names: Sequence[str], count: int) -> str:
    if count == 1:
        return ""
    if len(names) == count:
        return f"{'both' if count == 2 else f'all {count}'} recordings: "
    if len(names) <= MAX_NAMES:
        return f"{', '.join(names)}: "
    return f"{len(names)} of {count} recordings ({names[0]} and others): "


def _merge(sentences: Sequence[str]) -> str:
    """One sentence of several that differ in their numbers only."""
    columns = zip(*(NUMBER.findall(sentence) for sentence in sentences), strict=True)
    ranges = iter([_range(numbers) for numbers in columns])
    return NUMBER.sub(lambda _: next(ranges), sentences[0])


def _range(numbers: Sequence[str]) -> str:
    least, largest = min(numbers, key=float), max(numbers, key=float)
    return least if float(least) == float(largest) else f"{least} to {largest}"
