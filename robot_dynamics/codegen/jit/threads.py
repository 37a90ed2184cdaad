"""Threads that share work piece by piece, so that a thread that starts late delays none of the others; processors."""

import os
from _thread import LockType, allocate_lock, start_new_thread  # threading.Thread would wait until each thread runs
from collections.abc import Callable


def available_processors() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_in_threads(work: Callable[[], object], threads: int) -> None:
    """Call a function in several threads at once, this one among them, until all calls have returned.

    `work` takes the remaining pieces one after the other, and returns when there are none. Threads that cannot be
    started are left out.
    """
    helpers: list[LockType] = []
    try:
        for _ in range(threads - 1):
            done = allocate_lock()
            done.acquire()
            start_new_thread(_run_and_release, (work, done))
            helpers.append(done)
    except RuntimeError:  # the system has no more threads
        pass
    try:
        work()
    finally:
        for done in helpers:
            done.acquire()


def _run_and_release(work: Callable[[], object], done: LockType) -> None:
    try:
        work()
    finally:
        done.release()
