"""Counts and durations of computed_torque for /diagnostics."""

from dataclasses import dataclass, field

from robot_dynamics.nodes.diagnostics import DurationStatistics


@dataclass
class ControlStatistics:
    """Counts and durations since the last report on /diagnostics, and over the whole time."""

    latencies: DurationStatistics = field(default_factory=DurationStatistics)
    state_ages: DurationStatistics = field(default_factory=DurationStatistics)
    deadline_misses: int = 0
    saturated: int = 0
    out_of_order: int = 0  # over the whole time

    def take(self, elapsed: float) -> dict[str, object]:
        """Return the entries of a report for the last `elapsed` seconds, and start the next period."""
        entries = {
            **self.latencies.take("efforts", elapsed),
            **self.state_ages.take("age of state"),
            "deadline misses": self.deadline_misses,
            "saturated": self.saturated,
            "states out of order": self.out_of_order,
        }
        self.deadline_misses = 0
        self.saturated = 0
        return entries
