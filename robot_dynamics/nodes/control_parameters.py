"""The parameters of computed_torque: what they are, and the Settings that they amount to."""

import numpy as np

from robot_dynamics.control.controller import Settings
from robot_dynamics.control.law import COMPUTED_TORQUE, MODES, WITHOUT_REFERENCE
from robot_dynamics.errors import QuestionError, unknown_name
from robot_dynamics.model.joint import UNLIMITED
from robot_dynamics.nodes.robot_source import typed_as

# name: (default, what it is)
PARAMETERS = {
    "joints": ("", "names of the joints that get efforts, in the order of ~/commands; empty: all that have motors"),
    "mode": (COMPUTED_TORQUE, f"{', '.join(MODES)}"),
    "kp": ([100.0], "gain of the position error [1/s^2], one number or one for each joint"),
    "kd": ([20.0], "gain of the velocity error [1/s], one number or one for each joint"),
    "effort_limits": ("", "most that is sent to each joint [N m or N]; empty: as the description says"),
    "without_reference": ("damp", "what is done while no reference is there: gravity, damp or zero"),
    "ramp_time": (0.1, "in which efforts go to zero after a fault, or over to others after a change [s]"),
    "state_timeout": (0.02, "age at which joint_states are stale [s]"),
    "reference_timeout": (0.1, "how long a point of ~/reference_point counts [s]"),
    "deadline": (0.005, "age of joint_states at which their efforts are out too late [s]"),
    "deadline_misses": (10, "late efforts in a row that are a fault"),
    "state_rate": (50.0, "at which ~/state is published, at most [1/s]; 0: never"),
    "autostart": (True, "configure and activate the node when it has a robot"),
}
FIXED = ("joints", "autostart")  # what is read when the node is configured
LISTS = ("joints", "kp", "kd", "effort_limits")


def checked(name, value):
    """The value of a parameter in its type. Raises QuestionError."""
    default, description = PARAMETERS[name]
    if name in LISTS:
        return _list(name, value, description)
    if name == "deadline_misses":
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise QuestionError(f"parameter {name} is {value!r}: a whole number from 1 on is needed")
        return value
    value = typed_as(default, name, value, description)
    if isinstance(default, float):
        least = 0.0 if name in ("ramp_time", "state_rate") else 1e-4
        if not least <= value < np.inf:
            raise QuestionError(f"parameter {name} is {value:g}: {least:g} or more is needed, {description}")
    for choice, known in (("mode", MODES), ("without_reference", WITHOUT_REFERENCE)):
        if name == choice and value not in known:
            raise QuestionError(f"parameter {name}: {unknown_name(name, value, known)}")
    return value


def _list(name, value, description):
    values = [] if isinstance(value, str) and not value else np.ravel(value).tolist()
    if name == "joints":
        if not all(isinstance(item, str) for item in values):
            raise QuestionError(f"parameter joints is {value!r}: a list of names is needed")
        return tuple(values)
    numbers = np.array(typed_as([0.0] * len(values), name, values, description))
    if not (numbers >= 0).all() or (name != "effort_limits" and not np.isfinite(numbers).all()):
        raise QuestionError(f"parameter {name} is {value!r}: numbers of zero or more are needed, {description}")
    return numbers


def settings_of(values, dynamics, joints):
    """The Settings of parameters {name: checked value} for some joints of a robot. Raises QuestionError."""
    told = {name: values[name] for name in Settings.__dataclass_fields__ if name in values}
    told["kp"], told["kd"] = (_of_each(name, values[name], joints) for name in ("kp", "kd"))
    limits = values["effort_limits"]
    if len(limits):
        told["limits"] = _of_each("effort_limits", limits, joints, alone=False)
    else:
        numbers = dynamics.robot.joint_numbers
        described = np.array([dynamics.robot.joints[numbers[name]].limits.effort for name in joints])
        told["limits"] = np.where(described >= UNLIMITED, np.inf, described)
    return Settings(**told)


def _of_each(name, numbers, joints, alone=True):
    if len(numbers) == len(joints):
        return numbers
    if alone and len(numbers) == 1:
        return np.full(len(joints), numbers[0])
    raise QuestionError(
        f"parameter {name} has {len(numbers)} values: {len(joints)} are needed, one for each of {', '.join(joints)}"
    )
