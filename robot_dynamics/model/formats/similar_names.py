"""Names that differ from a known one by their case or by few letters: probably misspelled."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

SIMILARITY = 0.75  # of a misspelled name: 1 is equality


def similar_name(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that differs from `name` by its case or by few letters, None where there is none."""
    return next(iter(get_close_matches(name[:60].lower(), list(known), n=1, cutoff=SIMILARITY)), None)
