"""Actuators of an MJCF: which joints have a motor, and how much it can deliver."""

from __future__ import annotations

from typing import Any

import numpy as np

JOINT_TRANSMISSIONS = ("mjTRN_JOINT", "mjTRN_JOINTINPARENT")


def actuated_joints(model: dict[str, Any]) -> set[int] | None:
    """Return the numbers of the joints that actuators drive; None: all, where no actuator says otherwise.

    Joints of a fixed tendon count, if an actuator pulls it. Where an actuator acts in another way, such as on a site,
    the joints that it drives are not known: all count.
    """
    driven: set[int] = set()
    for transmission, target in zip(model["actuator_trntype"], model["actuator_trnid"], strict=True):
        if transmission in JOINT_TRANSMISSIONS:
            driven.add(target[0])
        elif transmission == "mjTRN_TENDON":
            joints = _joints_of_tendon(model, target[0])
            if joints is None:
                return None
            driven |= joints
        else:
            return None
    return driven or None


def _joints_of_tendon(model: dict[str, Any], tendon: int) -> set[int] | None:
    """Return the numbers of the joints of a fixed tendon, None of a tendon in space."""
    first = model["tendon_adr"][tendon]
    wraps = range(first, first + model["tendon_num"][tendon])
    if any(model["wrap_type"][wrap] != "mjWRAP_JOINT" for wrap in wraps):
        return None
    return {model["wrap_objid"][wrap] for wrap in wraps}


def actuators_of_joint(model: dict[str, Any], joint: int) -> list[int]:
    """Return the numbers of the actuators that act on a joint itself."""
    kinds, targets = model["actuator_trntype"], model["actuator_trnid"]
    return [n for n, kind in enumerate(kinds) if kind in JOINT_TRANSMISSIONS and targets[n][0] == joint]


def added_to_joint(model: dict[str, Any], field: str, joint: int) -> float:
    """Return what actuators add to the armature or the damping of a joint, referred to the joint."""
    if field not in model:  # an older MuJoCo
        return 0.0
    return float(sum(model[field][n] * model["actuator_gear"][n][0] ** 2 for n in actuators_of_joint(model, joint)))


def effort_limit(model: dict[str, Any], joint: int) -> float:
    """Return the largest effort of a joint in both directions [N m or N], infinite where nothing limits it."""
    limits = [_actuator_limit(model, number) for number in actuators_of_joint(model, joint)]
    limit = sum(limits) if limits else np.inf
    if model["jnt_actfrclimited"][joint]:
        limit = min(limit, _smaller_end(model["jnt_actfrcrange"][joint]))
    return float(limit) if limit > 0 else np.inf


def _actuator_limit(model: dict[str, Any], number: int) -> float:
    """Return the largest effort of an actuator at its joint in both directions."""
    gear: float = abs(model["actuator_gear"][number][0])
    if model["actuator_forcelimited"][number]:
        return gear * _smaller_end(model["actuator_forcerange"][number])
    is_motor = (
        model["actuator_gaintype"][number] == "mjGAIN_FIXED"
        and model["actuator_biastype"][number] == "mjBIAS_NONE"
        and model["actuator_dyntype"][number] == "mjDYN_NONE"
    )
    if is_motor and model["actuator_ctrllimited"][number]:
        gain: float = abs(model["actuator_gainprm"][number][0])
        return gear * gain * _smaller_end(model["actuator_ctrlrange"][number])
    return np.inf


def _smaller_end(span: list[float]) -> float:
    """Return the smaller distance of both ends of a range from zero; the larger one where the other is zero."""
    ends = sorted(map(abs, span))
    return ends[0] or ends[1]
