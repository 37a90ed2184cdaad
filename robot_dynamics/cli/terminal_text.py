"""Text for terminals: names in descriptions and recordings may contain control characters.

A terminal runs escape sequences: they change colours, move the cursor over other lines, or set the title of the window.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import Any, TextIO, cast

CONTROL_CHARACTERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
LINE_BREAKS = re.compile("[\t\n]")


def escape_controls(text: str, pattern: re.Pattern[str] = CONTROL_CHARACTERS) -> str:
    """Return a text with backslash escapes in place of control characters, but tabs and line feeds."""
    return pattern.sub(lambda match: match.group().encode("unicode_escape").decode(), text)


def escape_line(text: str) -> str:
    """Return a text as one line: tabs and line feeds are escaped too."""
    return escape_controls(escape_controls(text), LINE_BREAKS)


class _EscapingStream:
    """A text stream that escapes the control characters of what is written to it."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write a text."""
        self._stream.write(escape_controls(text))
        return len(text)

    @property
    def unescaped(self) -> TextIO:
        """The stream itself."""
        return self._stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def escaped_output() -> Iterator[None]:
    """Escape control characters in what the block prints to stdout and stderr.

    Progress bars need carriage returns: they are written to the stream itself, see `unescaped_errors`.
    """
    output, errors = (cast(TextIO, _EscapingStream(stream)) for stream in (sys.stdout, sys.stderr))
    with redirect_stdout(output), redirect_stderr(errors):
        yield


def unescaped_errors() -> TextIO:
    """The stream behind stderr, for a text without names."""
    stream: TextIO = getattr(sys.stderr, "unescaped", sys.stderr)
    return stream
