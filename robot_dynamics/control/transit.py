"""Transit times of messages between two machines whose clocks need not agree."""

import math

WINDOW = 1000
"""Number of messages after which the least difference of the clocks is renewed."""


class TransitTimes:
    """Delays of the messages of one publisher, relative to its fastest recent message.

    The difference between the time of reception and that of publication is the delay plus the offset between the two
    clocks, which is the same for all messages. Delays are therefore counted from the least difference among the last
    `WINDOW` to 2 `WINDOW` messages. After one of the clocks is set, delays are right again after as many messages.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget all messages."""
        self._count = 0
        self._least: float = math.inf
        self._previous_least: float = math.inf

    def delay(self, received: int, published: int) -> float:
        """Delay [s] of a message, received and published at times [ns] by the clocks of both sides.

        It is 0 where the time of publication is unknown, which a time of 0 means.
        """
        if not published:
            return 0.0
        difference = received - published
        if self._count == WINDOW:
            self._count = 0
            self._previous_least = self._least
            self._least = math.inf
        self._count += 1
        if difference < self._least:
            self._least = difference
        return (difference - min(self._least, self._previous_least)) * 1e-9
