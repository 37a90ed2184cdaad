"""Work that nobody waits for: one thread of the process does it, in the order in which it came.

One and no more: LLVM translates one program at a time anyhow, and a program that somebody waits for should wait for
one other at most. The thread ends when there is no more to do, so that a process at rest has none.
"""

import os
from collections import deque
from threading import Lock, Thread, main_thread
from weakref import WeakMethod

THREAD_NAME = "robot_dynamics background"  # of the thread


class _Background:
    def __init__(self):
        self._waiting, self._lock, self._working = deque(), Lock(), False

    def add(self, method, arguments):
        with self._lock:
            self._waiting.append((WeakMethod(method), arguments))
            if not self._working:
                self._working = True
                Thread(target=self._work, name=THREAD_NAME).start()

    def _work(self):
        while (following := self._next()) is not None:
            reference, arguments = following
            if (method := reference()) is not None:
                method(*arguments)
            del method  # or its object would live until the next comes

    def _next(self):
        with self._lock:
            # Python waits for its threads once the main one has ended: what is left is for nobody.
            if self._waiting and main_thread().is_alive():
                return self._waiting.popleft()
            self._working = False
            return None


def run_in_background(method, *arguments):
    """Call a method of an object later, in another thread; not at all if until then the object is gone, or the program
    has come to its end. The method must not raise."""
    _background.add(method, arguments)


def _begin():
    global _background
    _background = _Background()


_begin()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin)  # threads do not come along
