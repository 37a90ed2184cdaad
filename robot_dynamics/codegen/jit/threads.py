"""Threads that share work which they take piece by piece, so that none need be there from the beginning."""

from _thread import allocate_lock, start_new_thread  # threading.Thread would wait for each helper to have begun


def run_in_threads(work, threads):
    """Call a function in so many threads at once, this one among them, until all are done.

    `work` takes what is left to do, and returns when nothing is. Helpers that cannot be started are left out.
    """
    helpers = []
    try:
        for _ in range(threads - 1):
            done = allocate_lock()
            done.acquire()
            start_new_thread(_until_done, (work, done))
            helpers.append(done)
    except RuntimeError:  # the system has no more threads
        pass
    try:
        work()
    finally:
        for done in helpers:
            done.acquire()


def _until_done(work, done):
    try:
        work()
    finally:
        done.release()
