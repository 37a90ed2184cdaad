"""The DiagnosticStatus of a node on /diagnostics: level, reason, and statistics of the last second."""

import re
from array import array
from collections.abc import Callable, Iterable, Mapping
from typing import TypeAlias

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

Level: TypeAlias = bytes
"""One of OK, WARN, ERROR, STALE; they are ordered."""

Values: TypeAlias = Mapping[str, object]
"""Entries of a status by key."""

OK: Level = DiagnosticStatus.OK
WARN: Level = DiagnosticStatus.WARN
ERROR: Level = DiagnosticStatus.ERROR
STALE: Level = DiagnosticStatus.STALE

PERIOD = 1.0  # [s]
MIN_INTERVAL = 0.1  # [s] between two messages if the level or reason changes
NUMBER = re.compile(r"\d[\d.e+-]*")


def mask_numbers(text: object) -> str:
    """Return a text, or a truth value as text, without its numbers: it stays the same while only they change."""
    return NUMBER.sub("#", str(text))


class DurationStatistics:
    """Rate, percentiles and maximum of durations [s] since they were last taken.

    window: number of the last durations that percentiles are computed of.
    """

    def __init__(self, window: int = 4096) -> None:
        self._durations = array("d", bytes(8 * window))
        self._window = window
        self._count = 0
        self._maximum = 0.0

    def add(self, seconds: float) -> None:
        """Add a duration."""
        self._durations[self._count % self._window] = seconds
        self._count += 1
        if seconds > self._maximum:
            self._maximum = seconds

    def take(self, name: str, elapsed: float | None = None) -> dict[str, str]:
        """Return {key: text} with the rate [1/s] over `elapsed` seconds, percentiles and maximum [µs], and restart."""
        values = {f"{name} rate [1/s]": f"{self._count / elapsed:.1f}"} if elapsed else {}
        if self._count:
            durations = np.frombuffer(self._durations)[: min(self._count, self._window)]
            for percent, value in zip((50, 99), np.percentile(durations, (50, 99)), strict=True):
                values[f"{name} p{percent} [us]"] = f"{value * 1e6:.0f}"
            values[f"{name} max [us]"] = f"{self._maximum * 1e6:.0f}"
        self._count = 0
        self._maximum = 0.0
        return values


class Diagnostics:
    """Publishes the status of a node each second, and at once if its level or message changes.

    The second is one of the machine, so that there are messages if the clock of a simulation stands still.

    Parameters
    ----------
    name : of the status.
    report : returns (level, message, hardware_id, values) for the last `elapsed` seconds.
    parts : returns (name, level, message, values) of parts of the node, each for a status of its own; None: no parts.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        report: Callable[[float], tuple[Level, str, str, Values]],
        parts: Callable[[], Iterable[tuple[str, Level, str, Values]]] | None = None,
    ) -> None:
        self._node = node
        self._name = name
        self._report = report
        self._parts = parts
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._last_texts: tuple[object, ...] | None = None
        self._last_masked_texts: tuple[str, ...] | None = None
        self._published_at = self._clock.now().nanoseconds
        self._timer = node.create_timer(PERIOD, self.publish, clock=self._clock)

    def publish_if_changed(self, *texts: object) -> None:
        """Publish now if texts, or truth values, are not those of the last call, apart from numbers in them."""
        if texts == self._last_texts:
            return
        masked = tuple(map(mask_numbers, texts))
        if masked == self._last_masked_texts:
            self._last_texts = texts
        elif (self._clock.now().nanoseconds - self._published_at) * 1e-9 > MIN_INTERVAL:
            self._last_texts = texts
            self._last_masked_texts = masked
            self.publish()

    def publish(self) -> None:
        """Publish the status of the node and of its parts."""
        now = self._clock.now().nanoseconds
        level, text, hardware, values = self._report(max((now - self._published_at) * 1e-9, 1e-3))
        self._published_at = now
        message = DiagnosticArray(status=[self._status(self._name, level, text, hardware, values)])
        for name, part_level, part_text, part_values in self._parts() if self._parts else ():
            message.status.append(self._status(name, part_level, part_text, hardware, part_values))
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _status(self, name: str, level: Level, text: str, hardware: str, values: Values) -> DiagnosticStatus:
        return DiagnosticStatus(
            name=f"{self._node.get_fully_qualified_name()}: {name}",
            level=level,
            message=text,
            hardware_id=hardware,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
