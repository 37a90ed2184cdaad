"""Recorded positions against the joint limits of a model: far beyond them, their unit is probably wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.recordings.joint_motions import Motion
    from robot_dynamics.recordings.sample_statistics import SampleStatistics

RANGE_MARGIN = 0.1  # part of the range of a joint by which positions may exceed its limits without a note


def note_limit_violations(dynamics: Dynamics, motion: Motion, statistics: SampleStatistics) -> None:
    """Note the joints whose positions in a motion are far beyond the limits of the model."""
    robot = dynamics.robot
    for name, q in zip(dynamics.joint_names, motion.q.T, strict=True):
        joint = robot.joints[robot.joint_numbers[name]]
        margin = RANGE_MARGIN * (joint.limits.upper - joint.limits.lower)
        if q.max() > joint.limits.upper + margin or q.min() < joint.limits.lower - margin:
            unit, likely_unit = ("m", "millimetres") if joint.prismatic else ("rad", "degrees")
            sentence = f"positions [{unit}] far beyond the limits of the model (are these {likely_unit}?)"
            statistics.note_joint(sentence, name)
