"""What a notebook shows for an object: HTML from a function that is registered, so that models know no layout."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

Formatter: TypeAlias = Callable[[object], str | None]
"""Returns the HTML of an object; None where it has none."""

_formatters: list[Formatter] = []


def register_formatter(formatter: Formatter) -> None:
    """Let a function format the objects whose class has ``_repr_html_ = notebook_html``; the last one counts."""
    _formatters.append(formatter)


def notebook_html(value: object) -> str | None:
    """Return the HTML that a notebook shows for an object; None where it has none: the notebook shows its text."""
    return _formatters[-1](value) if _formatters else None
