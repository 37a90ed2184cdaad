"""Recorded positions against the joint limits of a model."""

RANGE_MARGIN = 0.1  # part of the range of a joint by which positions may be beyond it before that is told


def note_limit_violations(dynamics, motion, statistics):
    """Put into a Tally what positions of a Motion the joints of a robot cannot have, by far."""
    robot = dynamics.robot
    for name, q in zip(dynamics.joint_names, motion.q.T, strict=True):
        joint = robot.joints[robot.joint_numbers[name]]
        room = RANGE_MARGIN * (joint.limits.upper - joint.limits.lower)
        if q.max() > joint.limits.upper + room or q.min() < joint.limits.lower - room:
            unit, other = ("m", "millimetres") if joint.prismatic else ("rad", "degrees")
            statistics[f"positions [{unit}] far beyond the limits of the model (are these {other}?)"] = name
