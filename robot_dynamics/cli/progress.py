"""Progress of long work on a terminal; nothing in pipes."""

import sys
from contextlib import contextmanager

from tqdm import tqdm


def progress_wrapper(total, what, unit=" messages"):
    """A function that takes an iterator and gives it, with a bar on stderr where that is a terminal."""
    return lambda items: tqdm(items, total=total, desc=what, unit=unit, leave=False,
                              disable=not sys.stderr.isatty())  # fmt: skip


@contextmanager
def progress_bar(total, what, unit):
    """A function that is told how much is done of a total, with a bar on stderr where that is a terminal."""
    with tqdm(total=total, desc=what, unit=unit, leave=False, disable=not sys.stderr.isatty()) as shown:
        yield lambda done: shown.update(done - shown.n)
