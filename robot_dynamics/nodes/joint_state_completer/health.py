"""The diagnostics of joint_state_completer: its level, and the reason for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from robot_dynamics.nodes.diagnostics import ERROR, OK, STALE, WARN

if TYPE_CHECKING:
    from robot_dynamics.nodes.diagnostics import Level
    from robot_dynamics.nodes.robot_source import RobotSource


@dataclass(frozen=True)
class CompleterStatus:
    """What the level of a completer depends on.

    Attributes
    ----------
    topic : name of the topic of the states.
    standstill : time since the last message [s of the machine]; inf before the first one.
    timeout : after which states are stale [s].
    published, refused, ignored : numbers of messages since the last report; ignored ones have no joint of the robot.
    refusal : of the last message that was refused.
    unknown_names : of joints in the last message.
    """

    topic: str
    standstill: float
    timeout: float
    published: int
    refused: int
    ignored: int
    refusal: str
    unknown_names: tuple[str, ...]


def completer_health(robot: RobotSource, status: CompleterStatus) -> tuple[Level, str]:
    """Return level and message."""
    level, message = robot.health()
    if level == ERROR:
        return level, message
    if status.refused:
        return WARN if status.published else ERROR, f"refused: {status.refusal}"
    if status.standstill > status.timeout:
        return STALE, f"no messages on {status.topic} for {status.timeout:g} s"
    if status.ignored and not status.published:
        names = ", ".join(map(repr, status.unknown_names))
        return WARN, f"messages on {status.topic} have no independent joint of {robot.name!r}; unknown are {names}"
    return (OK, "joint states are complete") if level == OK else (level, message)
