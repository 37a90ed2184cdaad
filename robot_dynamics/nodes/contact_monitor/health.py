"""The diagnostics of contact_monitor: level, message and figures of the observer and of each joint."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from robot_dynamics.nodes.diagnostics import ERROR, OK, STALE, WARN

if TYPE_CHECKING:
    from robot_dynamics.monitoring.contact_observer import Observation
    from robot_dynamics.monitoring.frame_wrench import FrameWrench
    from robot_dynamics.nodes.contact_monitor.monitoring_setup import Monitoring
    from robot_dynamics.nodes.diagnostics import Level, Values
    from robot_dynamics.nodes.robot_source import RobotSource


@dataclass
class MonitorStatus:
    """Counts since the last report, and what the last messages were.

    Attributes
    ----------
    observed, refused, ignored : numbers of messages; ignored ones have no joint of the robot.
    refusal : why the last message was refused.
    restarts : restarts of the observer since the last report.
    standstill : time since the last message [s of the machine]; inf before the first one.
    timeout : after which messages are missing [s].
    topic : of the states.
    """

    observed: int = 0
    refused: int = 0
    ignored: int = 0
    refusal: str = ""
    restarts: int = 0
    standstill: float = 0.0
    timeout: float = 1.0
    topic: str = ""


def monitor_health(
    robot: RobotSource, monitoring: Monitoring | None, setup_error: str, status: MonitorStatus, is_collision: bool
) -> tuple[Level, str]:
    """Return level and message.

    monitoring: None if there is none, because of `setup_error` or because no robot is loaded.
    """
    level, message = robot.health()
    if level == ERROR:
        return level, message
    if monitoring is None:
        return ERROR, f"nothing is observed: {setup_error}"
    observer = monitoring.observer
    if is_collision:
        return ERROR, str(observer.detector.event)
    if status.refused and not status.observed:
        return ERROR, f"nothing is observed: {status.refusal}"
    if status.standstill > status.timeout:
        return STALE, f"no messages on {status.topic} for {status.timeout:g} s"
    warnings = [message] if level != OK else []
    if status.refused:
        warnings.append(f"messages were refused: {status.refusal}")
    if status.ignored and not status.observed:
        warnings.append(f"messages on {status.topic} have no joint of {robot.name!r}")
    if status.restarts:
        warnings.append(f"the observer restarted: {observer.restart_reason}")
    if warnings:
        return WARN, "; ".join(warnings)
    if not monitoring.has_learnt_thresholds:
        return OK, "no collision; thresholds are a share of the effort limits: learn them from a recording"
    return OK, "no collision"


def joint_parts(monitoring: Monitoring, observation: Observation) -> Iterator[tuple[str, Level, str, Values]]:
    """Yield name, level, message and values of each joint."""
    detector = monitoring.observer.detector
    rows = zip(detector.thresholds.joint_names, observation.efforts, detector.bounds, strict=True)
    for name, effort, bound in rows:
        is_beyond = abs(effort) > bound
        comparison = "beyond" if is_beyond else "within"
        yield (
            name,
            ERROR if is_beyond else OK,
            f"external effort {effort:.3g}, {comparison} {bound:.3g}",
            {"external effort": f"{effort:.4g}", "threshold": f"{bound:.4g}"},
        )


def wrench_figures(frame_wrench: FrameWrench) -> Values:
    """Return how well the joints determine the wrench, as entries of a status."""
    return {
        "condition of the wrench": f"{frame_wrench.condition:.3g}",
        "components not determined": ", ".join(frame_wrench.undetermined),
        "torques beside the wrench, relative to thresholds": f"{frame_wrench.unexplained:.3g}",
    }
