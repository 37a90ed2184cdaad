"""Progress bars for long computations, shown on terminals only."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from tqdm import tqdm

from robot_dynamics.cli.terminal_text import escape_line, unescaped_errors


def progress_wrapper(
    total: int | None, description: str, unit: str = " messages"
) -> Callable[[Iterable[Any]], Iterable[Any]]:
    """Return a function that passes the items of an iterable on and shows a progress bar on stderr."""
    return lambda items: tqdm(
        items,
        total=total,
        desc=escape_line(description),
        unit=unit,
        leave=False,
        disable=not sys.stderr.isatty(),
        file=unescaped_errors(),
    )


@contextmanager
def progress_bar(total: int, description: str, unit: str) -> Iterator[Callable[[float], object]]:
    """Yield a function that sets how much of a total is done, and show a progress bar on stderr."""
    with tqdm(
        total=total,
        desc=escape_line(description),
        unit=unit,
        leave=False,
        disable=not sys.stderr.isatty(),
        file=unescaped_errors(),
    ) as bar:
        yield lambda done: bar.update(done - bar.n)
