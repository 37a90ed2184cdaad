"""Which lines of the package an input reaches first: inputs that reach new lines are kept and mutated further.

From Python 3.12 on, `sys.monitoring` reports each line once and costs nothing afterwards. Before, a trace function
follows all lines of functions that have lines left: each input that is traced takes several times as long, so that the
campaign traces a part of them.
"""

from __future__ import annotations

import dis
import sys
from collections.abc import Sequence
from types import CodeType, FrameType
from typing import Any

TOOL = 3  # number of a tool that no debugger or profiler uses


class LineCoverage:
    """The lines of files that have been reached.

    Parameters
    ----------
    folders : beginnings of the paths of the files that are watched.

    Attributes
    ----------
    count : number of lines.
    is_cheap : whether each input can be traced.
    """

    def __init__(self, folders: Sequence[str]) -> None:
        self._folders = tuple(folders)
        self._remaining: dict[CodeType, set[int]] = {}
        self.count = 0
        self.is_cheap = hasattr(sys, "monitoring")
        if self.is_cheap:
            monitoring = sys.monitoring  # type: ignore[attr-defined]
            monitoring.use_tool_id(TOOL, "fuzz")
            monitoring.register_callback(TOOL, monitoring.events.LINE, self._on_new_line)

    def start(self) -> None:
        """Watch from here on."""
        if self.is_cheap:
            monitoring = sys.monitoring  # type: ignore[attr-defined]
            monitoring.set_events(TOOL, monitoring.events.LINE)
        else:
            sys.settrace(self._on_call)

    def stop(self) -> None:
        """Watch no more."""
        if self.is_cheap:
            sys.monitoring.set_events(TOOL, 0)  # type: ignore[attr-defined]
        else:
            sys.settrace(None)

    def _on_new_line(self, code: CodeType, _line: int) -> Any:
        self.count += code.co_filename.startswith(self._folders)
        return sys.monitoring.DISABLE  # type: ignore[attr-defined]

    def _on_call(self, frame: FrameType, _event: str, _argument: object) -> Any:
        code = frame.f_code
        remaining = self._remaining.get(code)
        if remaining is None:
            is_watched = code.co_filename.startswith(self._folders)
            remaining = {line for _, line in dis.findlinestarts(code) if line} if is_watched else set()
            self._remaining[code] = remaining
        return self._on_line if remaining else None

    def _on_line(self, frame: FrameType, event: str, _argument: object) -> Any:
        if event == "line":
            remaining = self._remaining[frame.f_code]
            if frame.f_lineno in remaining:
                remaining.discard(frame.f_lineno)
                self.count += 1
        return self._on_line
