"""Work in the background: one thread of the process does it, in the order in which it was added.

There is one thread because LLVM compiles one program at a time anyway, and a program that a call waits for should wait
for at most one other. The thread ends when there is no work left, so that an idle process has none.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from threading import Lock, Thread, main_thread
from typing import Any
from weakref import WeakMethod

THREAD_NAME = "robot_dynamics background"
"""Name of the thread."""


class _WorkQueue:
    """Methods to call, and the thread that calls them while there are any."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[WeakMethod[Callable[..., object]], tuple[Any, ...]]] = deque()
        self._lock = Lock()
        self._is_running = False

    def add(self, method: Callable[..., object], arguments: tuple[Any, ...]) -> None:
        with self._lock:
            self._waiting.append((WeakMethod(method), arguments))
            if not self._is_running:
                self._is_running = True
                Thread(target=self._run, name=THREAD_NAME).start()

    def _run(self) -> None:
        while (item := self._next()) is not None:
            reference, arguments = item
            if (method := reference()) is not None:
                method(*arguments)
            del method  # or its object would live until the next item

    def _next(self) -> tuple[WeakMethod[Callable[..., object]], tuple[Any, ...]] | None:
        with self._lock:
            # Python waits for its threads once the main one has ended: the remaining work has no reader.
            if self._waiting and main_thread().is_alive():
                return self._waiting.popleft()
            self._is_running = False
            return None


_queue = _WorkQueue()


def run_in_background(method: Callable[..., object], *arguments: Any) -> None:
    """Call a method later, in the background thread.

    The method is not called if its object is deleted before, or if the program has ended. It must not raise.
    """
    _queue.add(method, arguments)


def _reset() -> None:
    global _queue
    _queue = _WorkQueue()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_reset)  # a child process does not inherit threads
