"""The diagnostics of mobile_base_simulator: its level, and the reason for it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from robot_dynamics.nodes.diagnostics import ERROR, OK, WARN

if TYPE_CHECKING:
    from robot_dynamics.nodes.diagnostics import Level
    from robot_dynamics.nodes.robot_source import RobotSource


@dataclass(frozen=True)
class SimulatorStatus:
    """What the level of a simulator depends on.

    Attributes
    ----------
    failure : why nothing is simulated, or why the simulation stopped; empty otherwise.
    conflicts : with other publishers: of /clock, and of the states.
    notes : on other publishers that may be no conflict.
    paused_robot : name of the robot of a paused simulation; empty otherwise.
    commands_timed_out : whether efforts were received, and are no longer valid.
    skipped_time : how often simulated time was skipped since the last report.
    refusal : of the last message, if one was refused since the last report; empty otherwise.
    awaited_topics : names of the topics of efforts, while time stands still until they come.
    standstill : how long time has stood still since the last efforts [s of the machine]; inf before the first ones.
    """

    failure: str
    conflicts: tuple[str, ...]
    notes: tuple[str, ...]
    paused_robot: str
    commands_timed_out: bool
    skipped_time: int
    refusal: str
    awaited_topics: tuple[str, ...]
    standstill: float


def simulator_health(robot: RobotSource, status: SimulatorStatus) -> tuple[Level, str]:
    """Return level and message."""
    level, message = robot.health()
    if status.failure:
        return ERROR, status.failure
    if level != OK:
        return level, message
    if status.conflicts:
        return WARN, "; ".join(status.conflicts)
    if status.paused_robot:
        return OK, "; ".join([f"paused, {status.paused_robot!r}", *status.notes])
    if status.commands_timed_out:
        return WARN, "commands stopped: efforts are zero"
    if status.skipped_time:
        return WARN, "the machine is too slow for real_time_factor: simulated time was delayed"
    if status.refusal:
        return WARN, f"refused: {status.refusal}"
    if status.awaited_topics:
        topics = " or ".join(status.awaited_topics)
        if math.isinf(status.standstill):
            return WARN, f"time stands still until the first efforts come on {topics}"
        return WARN, f"time stands still: no efforts came on {topics} for {status.standstill:.0f} s"
    return level, "; ".join([message, *status.notes])
