"""The diagnostics of computed_torque: its level, and the reasons for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.control.modes import GRAVITY
from robot_dynamics.nodes.computed_torque.parameters import limits_warning
from robot_dynamics.nodes.diagnostics import ERROR, OK, WARN

if TYPE_CHECKING:
    from robot_dynamics.nodes.computed_torque.control_loop import ControlLoop
    from robot_dynamics.nodes.diagnostics import Level
    from robot_dynamics.nodes.robot_source import RobotSource


def control_health(
    robot: RobotSource,
    loop: ControlLoop | None,
    configuration_error: str,
    last_fault: str,
    refusal: str,
    conflicts: Sequence[str],
    deadline_misses: int,
) -> tuple[Level, str]:
    """Return level and message.

    Parameters
    ----------
    loop : None while the node is not configured.
    configuration_error : why the node could not be configured; empty if it could, or has not tried.
    last_fault : that deactivated the node; empty if none did.
    refusal : why the last reference was refused; empty for none.
    conflicts : with other publishers: of the simulated time, of efforts, of states.
    deadline_misses : since the last report.
    """
    level, message = robot.health()
    if level == ERROR:
        return ERROR, message
    if configuration_error:
        return ERROR, configuration_error
    if loop is None or not loop.is_active:
        if last_fault:
            return ERROR, f"deactivated by a fault: {last_fault}. Activate the node when the robot may move again"
        return WARN, refusal or "not active: no efforts are sent"
    controller = loop.controller
    if controller.fault:
        return ERROR, "; ".join([f"efforts go to zero: {controller.fault}", *conflicts])
    if not controller.activity:
        return WARN, "use_sim_time is set, and nothing came on /clock yet"
    warnings = []
    if robot.rejection_reason:
        warnings.append(f"last change refused: {robot.rejection_reason}")
    if controller.saturated.any():
        warnings.append(f"at its limit: {', '.join(np.array(loop.law.joints)[controller.saturated])}")
    if controller.collision != "none":
        warnings.append(f"collision: {controller.collision}, references are refused")
    if controller.settings.mode != GRAVITY and controller.no_reference_reason:
        warnings.append(controller.no_reference_reason)
    if refusal:
        warnings.append(refusal)
    warnings.extend(conflicts)
    warnings.extend(filter(None, [limits_warning(loop.law.dynamics, loop.law.joints, controller.settings.limits)]))
    if robot.reliability_warning:
        warnings.append(robot.reliability_warning)
    if loop.unreported_joint_names:
        warnings.append(f"no messages on {', '.join(loop.unreported_joint_names)}, taken to be at zero")
    if deadline_misses:
        warnings.append(f"{deadline_misses} efforts were late")
    return (WARN if warnings else OK), "; ".join([controller.activity, *warnings])
