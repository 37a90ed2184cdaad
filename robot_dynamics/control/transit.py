"""How long messages were under way, by clocks of two machines that need not agree."""

import math

WINDOW = 1000  # messages


class TransitTimes:
    """Delays of messages of one publisher beyond that of the quickest of late.

    The difference between the time of reception and that of publication is the delay and what the two clocks differ
    by; the latter is the same for all messages. So delays are counted from the least difference among the last
    `WINDOW` to 2 `WINDOW` messages: where a clock is set, delays are right again after as many.
    """

    def __init__(self):
        self.restart()

    def restart(self):
        """Forget all messages."""
        self._count, self._least, self._least_before = 0, math.inf, math.inf

    def delay(self, received, published):
        """Delay [s] of a message received and published at times [ns] by the clocks of both sides; 0 where it is not
        known when it was published, which is a time of 0."""
        if not published:
            return 0.0
        difference = received - published
        if self._count == WINDOW:
            self._count, self._least, self._least_before = 0, math.inf, self._least
        self._count += 1
        if difference < self._least:
            self._least = difference
        return (difference - min(self._least, self._least_before)) * 1e-9
