"""Efforts without jumps: where what is wanted jumps, the difference to what was sent goes to zero in a stated time."""

import numpy as np


class BumplessTransfer:
    """What is sent follows what is wanted; after `begin` it comes to it along a straight line.

    size: how many efforts; duration: [s] in which a difference is gone; limits: (size,) what is sent never exceeds.
    """

    def __init__(self, size, duration, limits):
        self.duration, self.limits = duration, np.array(limits, dtype=float)
        self.last_efforts = np.zeros(size)
        self.saturated = np.zeros(size, dtype=bool)
        self._difference = np.zeros(size)
        self._begun = self._since = None
        self._jumps = False

    def start_transition(self, since=None):
        """Something else is wanted from a time [s] on, the next `send` if None, which may be far from what is sent."""
        self._jumps, self._since = True, since

    def stop(self):
        """Send zeros now. What is wanted next is sent at once, unless `begin` says that it jumps."""
        self.last_efforts[:], self.saturated[:] = 0.0, False
        self._begun, self._jumps = None, False

    def update(self, now, wanted):
        """The efforts (size,) to send at a time [s] for those that are wanted. What was given is left as it was."""
        if self._jumps:
            self._jumps, self._begun = False, now if self._since is None else self._since
            np.subtract(self.last_efforts, wanted, out=self._difference)
        np.copyto(self.last_efforts, wanted)
        if self._begun is not None:
            left = 1.0 - (now - self._begun) / self.duration if self.duration > 0 else 0.0
            if 0.0 < left <= 1.0:
                self.last_efforts += left * self._difference
            else:
                self._begun = None
        np.greater(np.abs(self.last_efforts), self.limits, out=self.saturated)
        np.minimum(self.last_efforts, self.limits, out=self.last_efforts)
        np.maximum(self.last_efforts, -self.limits, out=self.last_efforts)
        return self.last_efforts
