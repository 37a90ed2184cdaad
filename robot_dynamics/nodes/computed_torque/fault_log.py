"""Faults of a controller as lines of a log: the first at once, many within a second in one line."""

from collections.abc import Callable
from time import monotonic

from rclpy.impl.rcutils_logger import RcutilsLogger

from robot_dynamics.nodes.diagnostics import mask_numbers

PERIOD = 1.0  # [s] shortest time between two lines


class FaultLog:
    """Logs when efforts go to zero, and when they are sent again.

    `update` is called periodically: changes within PERIOD of the last line are logged together when that time is over.
    now: returns the time [s] of the machine.
    """

    def __init__(self, logger: RcutilsLogger, now: Callable[[], float] = monotonic) -> None:
        self._logger = logger
        self._now = now
        self._current = ""  # text of the fault at the last update
        self._masked = ""  # the same without numbers
        self._logged = ""  # masked text of the last line
        self._last_fault = ""
        self._fault_count = 0  # since the last line
        self._last_line_time = -PERIOD

    def restart(self, reason: str) -> None:
        """Start with a fault that needs no line."""
        self._masked = mask_numbers(reason)
        self._logged = self._masked
        self._fault_count = 0

    def update(self, fault: str) -> None:
        """Take the present fault, an empty text for none."""
        if fault is self._current and self._masked == self._logged and not self._fault_count:
            return
        if fault is not self._current:
            previous = self._masked
            self._current = fault
            self._masked = mask_numbers(fault)
            if fault and self._masked != previous:
                self._fault_count += 1
                self._last_fault = fault
        if self._masked == self._logged and not self._fault_count:
            return
        now = self._now()
        if now - self._last_line_time >= PERIOD:
            self._log(fault, now - self._last_line_time)
            self._logged = self._masked
            self._fault_count = 0
            self._last_line_time = now

    def _log(self, fault: str, elapsed: float) -> None:
        if self._fault_count > 1:
            end = "" if fault else "; they are sent again"
            self._logger.warning(
                f"efforts began to go to zero {self._fault_count} times in {elapsed:.1f} s, the last time: "
                f"{self._last_fault}{end}"
            )
        elif fault:
            self._logger.warning(f"efforts go to zero: {fault}")
        elif self._fault_count:
            self._logger.warning(f"efforts began to go to zero: {self._last_fault}; they are sent again")
        else:
            self._logger.info("efforts are sent again")
