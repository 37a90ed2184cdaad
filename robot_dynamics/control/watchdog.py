"""Watchdog of the joint states: a state machine of times and reasons."""


class Watchdog:
    """Decides whether efforts may be sent, and gives the reason where they may not.

    Parameters
    ----------
    timeout : float
        Age [s] at which a state is stale.
    deadline : float
        Latency [s] from a state to its efforts that is late.
    max_misses : int
        Number of late efforts in a row that are a fault.

    Attributes
    ----------
    stall_count : int
        How often the process stalled: it did not call for longer than the timeout.
    faulted_since : float or None
        Time [s] at which the present fault began.

    Notes
    -----
    A fault lasts until a good state comes; a latched one until `clear_latch`. Call `check_clock` first whenever
    something comes, and more often than every `timeout`.
    """

    def __init__(self, timeout: float, deadline: float, max_misses: int) -> None:
        self.timeout = timeout
        self.deadline = deadline
        self.max_misses = max_misses
        self.stall_count = 0
        self._latched_reason = ""
        self._block_reason = ""
        self.restart()

    def restart(self) -> None:
        """Forget all states."""
        self._last_state_time: float | None = None
        self._now: float | None = None
        self._rejection_reason = "no joint_states yet"
        self._rejected_at: float | None = None  # [s], of a state; None where there was none
        self._stall_reason = ""
        self._misses = 0
        self.faulted_since: float | None = None

    @property
    def last_state_time(self) -> float | None:
        """Time of the last good state [s]; None if there was none."""
        return self._last_state_time

    @property
    def rejection_reason(self) -> str:
        """Why the last state cannot be used; empty where it can."""
        return self._rejection_reason

    def clear_latch(self) -> None:
        """End a latched fault."""
        self._latched_reason = ""

    def block(self, reason: str) -> None:
        """Set a fault that neither a good state nor `clear_latch` ends, only an empty reason."""
        self._block_reason = reason

    def accept_state(self, published: float) -> None:
        """Record a good state that was published at a time [s]."""
        self._last_state_time = published
        self._rejection_reason = ""

    def reject_state(self, reason: str) -> None:
        """Record a state that cannot be used, at the time of `check_clock`."""
        self._rejection_reason = reason
        self._rejected_at = self._now

    def record_latency(self, latency: float) -> None:
        """Record the time [s] from a state to its efforts."""
        self._misses = 0 if latency <= self.deadline else self._misses + 1  # nan is late

    def check_clock(self, now: float) -> None:
        """Detect that the clock jumped back, or that the process stalled, at a time [s].

        A stall is a fault because the last efforts were in force all the while. It ends with the next call.
        """
        previous = self._now
        self._now = now
        self._stall_reason = ""
        if previous is None:
            return
        if now < previous - self.timeout:
            self._latched_reason = (
                f"the clock jumped back by {previous - now:.3f} s; a new reference, another mode or a new activation "
                "clears this fault"
            )
            self._last_state_time = None
            self._rejection_reason = "no joint_states since the clock jumped back"
            self._rejected_at = None
            self.faulted_since = None
        elif now - previous > self.timeout:
            self.stall_count += 1
            if self.faulted_since is None:  # otherwise there is a reason already
                self._stall_reason = f"this node stalled, or its clock jumped ahead, by {now - previous:.3f} s"
                self.faulted_since = self._stale_since(now)

    def fault(self, now: float) -> str:
        """The reason why no efforts may be sent at a time [s]; empty if there is none.

        `faulted_since` becomes the time at which the fault began. It is before `now` where the state became stale
        between two calls.
        """
        reason = self._reason(now)
        if not reason:
            self.faulted_since = None
        elif self.faulted_since is None:
            self.faulted_since = self._stale_since(now)
        return reason

    def _stale_since(self, now: float) -> float:
        """Time [s] at which the last state became stale, at most `now`."""
        return now if self._last_state_time is None else min(now, self._last_state_time + self.timeout)

    def _reason(self, now: float) -> str:
        reason = self._block_reason or self._latched_reason or self._stall_reason
        if reason:
            return reason
        silence = f"no joint_states for more than {self.timeout * 1e3:g} ms"
        if self._rejection_reason:
            if self._rejected_at is not None and now - self._rejected_at > self.timeout:
                return f"{silence}; the last ones could not be used: {self._rejection_reason}"
            return self._rejection_reason
        if self._last_state_time is not None and now - self._last_state_time > self.timeout:
            return silence
        if self._misses >= self.max_misses:
            return f"the efforts for the last {self.max_misses} states were later than {self.deadline * 1e3:g} ms"
        return ""
