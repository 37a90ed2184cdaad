"""A thread that runs the newest of the tasks that were submitted, and skips the older ones."""

from __future__ import annotations

import logging
import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

logger = logging.getLogger(__name__)


class LatestTask:
    """Runs tasks one at a time, in a thread of its own. A task that waits is replaced by the next one.

    Parameters
    ----------
    when_idle : callable
        Runs after a task if no other waits.
    interval : float
        Least time from one run of `when_idle` to the next one [s]. Tasks that come meanwhile run. Default: 0.
    """

    def __init__(self, when_idle: Callable[[], None], interval: float = 0.0) -> None:
        self._when_idle = when_idle
        self._interval = interval
        self._idle_time = -float("inf")
        self._condition = threading.Condition()
        self._task: Callable[[], None] | None = None
        self._is_busy = False
        self._is_closed = False
        self._thread = threading.Thread(target=self._run, name="viewer", daemon=True)
        self._thread.start()

    def submit(self, task: Callable[[], None]) -> None:
        """Run a task as soon as the one that runs has ended; a task that waits is dropped."""
        with self._condition:
            self._task = task
            self._condition.notify_all()

    def wait(self, timeout: float) -> bool:
        """Return whether nothing runs and nothing waits, after at most `timeout` seconds."""
        with self._condition:
            return self._condition.wait_for(lambda: self._task is None and not self._is_busy, timeout)

    def close(self) -> None:
        """End the thread after the task that runs."""
        with self._condition:
            self._is_closed = True
            self._condition.notify_all()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._task is not None or self._is_closed)
                if self._is_closed:
                    return
                task, self._task = self._task, None
                self._is_busy = True
            try:
                if task is not None:
                    task()
                if self._is_quiet():
                    self._when_idle()
                    self._idle_time = time.monotonic()
            except Exception:
                logger.exception("The viewer failed to draw")
            finally:
                with self._condition:
                    self._is_busy = False
                    self._condition.notify_all()

    def _is_quiet(self) -> bool:
        """Return whether no task comes until `when_idle` may run again."""
        with self._condition:
            rest = self._idle_time + self._interval - time.monotonic()
            return not self._condition.wait_for(lambda: self._task is not None or self._is_closed, max(0.0, rest))
