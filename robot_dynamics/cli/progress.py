"""Progress bars for long computations, shown on terminals only."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from tqdm import tqdm


def progress_wrapper(
    total: int | None, description: str, unit: str = " messages"
) -> Callable[[Iterable[Any]], Iterable[Any]]:
    """Return a function that passes the items of an iterable on and shows a progress bar on stderr."""
    return lambda items: tqdm(
        items, total=total, desc=description, unit=unit, leave=False, disable=not sys.stderr.isatty()
    )


@contextmanager
def progress_bar(total: int, description: str, unit: str) -> Iterator[Callable[[float], object]]:
    """Yield a function that sets how much of a total is done, and show a progress bar on stderr."""
    with tqdm(total=total, desc=description, unit=unit, leave=False, disable=not sys.stderr.isatty()) as bar:
        yield lambda done: bar.update(done - bar.n)
