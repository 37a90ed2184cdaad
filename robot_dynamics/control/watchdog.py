"""Whether what comes in can be trusted with torque: a state machine of time and reasons, nothing else."""


class Watchdog:
    """Says why there must be no torque, if so.

    timeout: [s] after which a state is stale. deadline: [s] in which a state should be answered; most_misses: how many
    answers in a row may be later. A fault lasts until good input comes; one that is latched until `release`. `look` is
    called first of all at each time at which something comes, and more often than every `timeout`.
    """

    def __init__(self, timeout, deadline, max_misses):
        self.timeout, self.deadline, self.max_misses = timeout, deadline, max_misses
        self._latched = self._blocked = ""
        self.stall_count = 0  # how often nothing was looked at for longer than timeout
        self.restart()

    def restart(self):
        """Nothing was heard yet."""
        self._heard = self._now = None
        self._refused = "no joint_states yet"
        self._misses, self._stood_still = 0, ""
        self.faulted_since = None

    @property
    def last_state_time(self):
        """The time of the last good state [s], None if there was none."""
        return self._heard

    @property
    def reason(self):
        """Why the last state cannot be used, empty where it can."""
        return self._refused

    def clear_latch(self):
        """What was latched is known, and ends."""
        self._latched = ""

    def block(self, reason):
        """A fault that neither good input nor `release` ends, only `block` with an empty reason."""
        self._blocked = reason

    def accept_state(self, published):
        """A good state came, which was published at a time [s]."""
        self._heard, self._refused = published, ""

    def reject_state(self, reason):
        """A state came that cannot be used."""
        self._refused = reason

    def record_latency(self, latency):
        """A state was answered so long [s] after it had come."""
        self._misses = self._misses + 1 if latency > self.deadline else 0

    def check_clock(self, now):
        """It is `now` [s]. A clock that jumped back is a fault, and so is a time in which nothing was looked at: the
        process stood still, and what it sent before was in force all the while. That one ends with the next look."""
        before, self._now = self._now, now
        self._stood_still = ""
        if before is None:
            return
        if now < before - self.timeout:
            self._latched = (
                f"the clock jumped back by {before - now:.3f} s; a new reference, another mode or a new activation "
                "starts again"
            )
            self._heard = None
            self._refused = "no joint_states since the clock jumped back"
            self.faulted_since = None
        elif now - before > self.timeout:
            self.stall_count += 1
            if self.faulted_since is None:  # else there is a reason already
                self._stood_still = f"this node stood still, or its clock jumped ahead, by {now - before:.3f} s"
                self.faulted_since = self._stale_since(now)

    def fault(self, now):
        """The reason why there must be no torque at a time [s], empty if there is none. `faulted_since` is the time at
        which it began, which is earlier than `now` where the state became stale before anyone looked."""
        reason = self._reason(now)
        if not reason:
            self.faulted_since = None
        elif self.faulted_since is None:
            self.faulted_since = self._stale_since(now)
        return reason

    def _stale_since(self, now):
        return now if self._heard is None else min(now, self._heard + self.timeout)

    def _reason(self, now):
        present = self._blocked or self._latched or self._stood_still or self._refused
        if present:
            return present
        if now - self._heard > self.timeout:
            return f"no joint_states for more than {self.timeout * 1e3:g} ms"
        if self._misses >= self.max_misses:
            return f"the last {self.max_misses} states were answered later than {self.deadline * 1e3:g} ms"
        return ""
