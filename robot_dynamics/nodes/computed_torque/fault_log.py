"""Faults of a controller for who looks at a terminal: each at once, but many in a second in one line."""

from time import monotonic

from robot_dynamics.nodes.diagnostics import mask_numbers

PERIOD = 1.0  # [s] between two lines, at least


class FaultLog:
    """Logs where efforts go to zero, and where they come back.

    `update` is to be called again and again: what changes within PERIOD of the last line is logged together when that
    time is over. logger: of a node. now: gives the time [s] of the machine.
    """

    def __init__(self, logger, now=monotonic):
        self._logger, self._now = logger, now
        self._seen = self._plain = self._logged = self._last_fault = ""
        self._faults, self._last_line = 0, -PERIOD

    def restart(self, reason):
        """Begin with a fault that needs no line."""
        self._plain = self._logged = mask_numbers(reason)
        self._faults = 0

    def update(self, fault):
        """Take the fault that there is, an empty text for none."""
        if fault is self._seen and self._plain == self._logged and not self._faults:
            return
        if fault is not self._seen:
            self._seen, before, self._plain = fault, self._plain, mask_numbers(fault)
            if fault and self._plain != before:
                self._faults, self._last_fault = self._faults + 1, fault
        if self._plain == self._logged and not self._faults:
            return
        now = self._now()
        if now - self._last_line >= PERIOD:
            self._log(fault, now - self._last_line)
            self._logged, self._faults, self._last_line = self._plain, 0, now

    def _log(self, fault, elapsed):
        if self._faults > 1:
            after = "" if fault else "; they are sent again"
            often = f"efforts went to zero {self._faults} times in {elapsed:.1f} s"
            self._logger.warning(f"{often}, the last time: {self._last_fault}{after}")
        elif fault:
            self._logger.warning(f"efforts go to zero: {fault}")
        elif self._faults:
            self._logger.warning(f"efforts went to zero for a moment: {self._last_fault}; they are sent again")
        else:
            self._logger.info("efforts are sent again")
