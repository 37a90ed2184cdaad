"""Simulated time beside the time of the machine."""

import time

MAX_LAG = 0.1  # [s] of simulated time that is caught up with; more is skipped


class Pacer:
    """Compares simulated time with that of the machine since `restart`."""

    def __init__(self) -> None:
        self.restart(0)

    def restart(self, simulated_ns: int) -> None:
        """Let simulated time [ns] and that of the machine run together from now on."""
        self._machine_start = time.monotonic()
        self._simulated_start_ns = simulated_ns

    def lag(self, simulated_ns: int, factor: float) -> float:
        """Return by how much simulated time is late [s] if it runs `factor` times as fast as that of the machine."""
        elapsed = time.monotonic() - self._machine_start
        return elapsed * factor - (simulated_ns - self._simulated_start_ns) * 1e-9
