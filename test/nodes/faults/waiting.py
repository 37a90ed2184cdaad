"""How long threads that are judged were ready to run while a busy machine had no processor for them."""

import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

PERIOD = 0.005  # [s]


@dataclass(frozen=True)
class Waiting:
    """Times [ns], and how long [ns] the sender (N,) and each thread of the receiver (N, threads) had waited by then."""

    times: np.ndarray
    sender: np.ndarray
    receiver: np.ndarray

    @classmethod
    def constant(cls, share):
        """A sender that waits for a share of all time."""
        times = np.array([0, 2**62])
        return cls(times, times * share, np.zeros((2, 1)))

    def between(self, first, last):
        """How long [ns] the sender and the thread that receives can have waited between times [ns], also arrays."""
        before = np.maximum(np.searchsorted(self.times, first, side="right") - 1, 0)
        after = np.minimum(np.searchsorted(self.times, last), len(self.times) - 1)
        return self.sender[after] - self.sender[before] + (self.receiver[after] - self.receiver[before]).max(axis=-1)


class WaitingRecorder:
    """Records a Waiting while a block runs.

    sender : returns the number of the thread that sends. receiver : number of the process that receives.
    """

    def __init__(self, sender, receiver):
        self._sender = sender
        self._receiver = [int(path.name) for path in sorted(Path(f"/proc/{receiver}/task").iterdir())]
        self._rows = []
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._record)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stopped.set()
        self._thread.join()

    def _record(self):
        previous, total = {}, np.zeros(1 + len(self._receiver))
        while not self._stopped.wait(PERIOD if self._rows else 0.0):
            threads = [self._sender(), *self._receiver]
            now = [waited(thread) for thread in threads]
            if self._rows:
                total = total + [after - previous.get(thread, 0) for thread, after in zip(threads, now, strict=True)]
            previous = dict(zip(threads, now, strict=True))
            self._rows.append((time.time_ns(), *total))

    def waiting(self):
        """The Waiting until now."""
        rows = list(self._rows)
        times = np.array([row[0] for row in rows])
        total = np.array([row[1:] for row in rows])
        return Waiting(times, total[:, 0], total[:, 1:])


def waited(thread):
    """How long [ns] a thread was ready to run without a processor; 0 for one that has ended."""
    with suppress(FileNotFoundError, ProcessLookupError):
        return int(Path(f"/proc/{thread}/schedstat").read_text().split()[1])
    return 0
