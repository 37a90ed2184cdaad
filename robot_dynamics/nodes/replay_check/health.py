"""The diagnostics of replay_check: level, message and figures of a live check and of each joint."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from robot_dynamics.nodes.diagnostics import ERROR, OK, STALE, WARN

if TYPE_CHECKING:
    from robot_dynamics.checking.live_check import LiveCheck
    from robot_dynamics.checking.status_tracker import JointStatus
    from robot_dynamics.nodes.diagnostics import Level, Values
    from robot_dynamics.nodes.robot_source import RobotSource


def check_health(
    robot: RobotSource, check: LiveCheck | None, setup_error: str, stale_names: Sequence[str], stale_after: float
) -> tuple[Level, str]:
    """Return level and message of a check.

    Parameters
    ----------
    check : None if there is none, because of `setup_error` or because no robot is loaded.
    stale_names : of joints, or the base, without messages for `stale_after` [s].
    """
    level, message = robot.health()
    if level == ERROR:
        return ERROR, message
    if check is None:
        return ERROR, f"nothing is checked: {setup_error}"
    statuses = check.joint_statuses
    failed = [status.verdict.joint.joint for status in statuses if status.failed_since is not None]
    warnings = []
    if robot.rejection_reason:
        warnings.append(f"last change refused: {robot.rejection_reason}")
    if failed:
        warnings.append(f"out of tolerance: {', '.join(failed)}")
    if stale_names:
        warnings.append(f"no messages on {', '.join(stale_names)} for {stale_after:g} s")
    if check.coverage_failure:
        warnings.append(check.coverage_failure)
    if not statuses:
        warnings.append("nothing was compared yet")
    warnings += [f"{status.verdict.joint.joint}: {status.warning}" for status in statuses if status.warning]
    if failed:
        level = ERROR
    else:
        level = WARN if warnings else OK
    return level, "; ".join(warnings) or "efforts fit the model"


def check_figures(check: LiveCheck) -> Values:
    """Return the figures of a check as entries of a status."""
    values = {}
    if check.rate is not None:
        values["rate [1/s]"] = f"{check.rate:.5g}"
    if check.latest_motion is not None:
        values["cut-off [Hz]"] = f"{check.latest_motion.cutoff:.3g}"
        values["compared [s]"] = f"{check.latest_motion.end:.5g}"
        values["coverage [%]"] = f"{100 * check.coverage:.3g}"
    if check.error_message:
        values["last stretch"] = check.error_message
    notes = {f"note {number}": note for number, note in enumerate(check.statistics.sentences, 1)}
    return {**values, **notes}


def joint_parts(check: LiveCheck, is_stale: bool) -> Iterator[tuple[str, Level, str, Values]]:
    """Yield name, level, message and values of each joint. is_stale: whether no new data arrive."""
    for status in check.joint_statuses:
        level, message = _joint_health(status)
        if is_stale:
            level = STALE
            message = f"no new data; before: {message}"
        verdict = status.verdict
        values = {
            "verdict": verdict.word.lower(),
            "RMS": f"{verdict.joint.rms:.4g}",
            "tolerated": f"{verdict.tolerance:.4g}",
            "bias": f"{verdict.joint.bias:.4g}",
            "largest": f"{verdict.joint.largest:.4g}",
            "samples": verdict.joint.samples,
            "at rest [%]": f"{100 * verdict.joint.resting:.3g}",
        }
        if status.failed_since is not None:
            values["since [s]"] = _format_seconds(status.failed_since)
        yield verdict.joint.joint, level, message, values


def _joint_health(status: JointStatus) -> tuple[Level, str]:
    verdict = status.verdict
    if status.failed_since is not None:
        return ERROR, f"{'; '.join(verdict.failures)}; since {_format_seconds(status.failed_since)} s"
    if status.warning:
        return WARN, status.warning
    fits = f"RMS {verdict.joint.rms:.3g} where {verdict.tolerance:.3g} is tolerated"
    if verdict.not_judged:
        fits = f"not judged: {verdict.not_judged}"
    if status.last_failure is not None:
        first, last = map(_format_seconds, status.last_failure)
        return WARN, f"{fits}; was out of tolerance from {first} to {last} s"
    return OK, fits


def _format_seconds(stamp: int) -> str:
    return f"{stamp / 1e9:.2f}"
