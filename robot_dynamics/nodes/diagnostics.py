"""What a node says of itself on /diagnostics: level, reason, and figures of what it did in the last second."""

import re
from array import array

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
STALE = DiagnosticStatus.STALE
PERIOD = 1.0  # [s]
NUMBER = re.compile(r"\d[\d.e+-]*")
SOONEST = 0.1  # [s] between two messages when what they say changes


def mask_numbers(text):
    """A text (or whether something is so) with its numbers taken out: what stays the same while they change."""
    return NUMBER.sub("#", str(text))


class DurationStatistics:
    """Durations [s] of what happens again and again, since they were last told: how many, percentiles, the longest.

    most: how many of the last ones percentiles are taken of.
    """

    def __init__(self, window=4096):
        self._kept, self._most = array("d", bytes(8 * window)), window
        self._count, self._longest = 0, 0.0

    def add(self, seconds):
        self._kept[self._count % self._most] = seconds
        self._count += 1
        if seconds > self._longest:
            self._longest = seconds

    def tell(self, name, elapsed=None):
        """{key: text}: rate [1/s] over `elapsed` seconds, if told, percentiles, maximum [µs]; then it begins anew."""
        count, longest = self._count, self._longest
        kept = np.frombuffer(self._kept)[: min(count, self._most)]
        told = {f"{name} rate [1/s]": f"{count / elapsed:.1f}"} if elapsed else {}
        if count:
            for percent, value in zip((50, 99), np.percentile(kept, (50, 99)), strict=True):
                told[f"{name} p{percent} [us]"] = f"{value * 1e6:.0f}"
            told[f"{name} max [us]"] = f"{longest * 1e6:.0f}"
        self._count, self._longest = 0, 0.0
        return told


class Diagnostics:
    """Publishes the DiagnosticStatus of a node each second, and at once where its level or message change.

    report(elapsed): gives (level, message, hardware_id, {key: text}) for the last `elapsed` seconds. The second is one
    of the machine, so that something is told where the clock of a simulation stands still. parts: gives what there is
    to tell of parts of the whole, each in a status of its own: [(name, level, message, {key: text})]; None: nothing.
    """

    def __init__(self, node, name, report, parts=None):
        self._node, self._name, self._report, self._parts = node, name, report, parts
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._seen = self._told = None
        self._told_at = self._clock.now().nanoseconds
        self._timer = node.create_timer(PERIOD, self.publish, clock=self._clock)

    def publish_if_changed(self, *what):
        """Tell it now where `what` (texts) is not what it was when this was last asked, but for the numbers in it."""
        if what == self._seen:
            return
        plain = tuple(map(mask_numbers, what))
        if plain == self._told:
            self._seen = what
        elif (self._clock.now().nanoseconds - self._told_at) * 1e-9 > SOONEST:
            self._seen, self._told = what, plain
            self.publish()

    def publish(self):
        now = self._clock.now().nanoseconds
        level, message, hardware, values = self._report(max((now - self._told_at) * 1e-9, 1e-3))
        self._told_at = now
        told = DiagnosticArray(status=[self._status(self._name, level, message, hardware, values)])
        for name, part_level, part_message, part_values in self._parts() if self._parts else ():
            told.status.append(self._status(name, part_level, part_message, hardware, part_values))
        told.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(told)

    def _status(self, name, level, message, hardware, values):
        status = DiagnosticStatus(name=f"{self._node.get_fully_qualified_name()}: {name}", level=level)
        status.message, status.hardware_id = message, hardware
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        return status
