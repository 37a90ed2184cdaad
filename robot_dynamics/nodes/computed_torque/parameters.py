"""The parameters of computed_torque: what they are, and the Settings that they amount to."""

import numpy as np

from robot_dynamics.control.control_law import (
    COMPUTED_TORQUE,
    FRICTION_VELOCITIES,
    MODES,
    NO_REFERENCE_ACTIONS,
    REFERENCE,
)
from robot_dynamics.control.controller import Settings
from robot_dynamics.errors import InvalidInputError, describe_unknown_name
from robot_dynamics.model.joint import UNLIMITED
from robot_dynamics.model.robot import MASSLESS_WARNING
from robot_dynamics.nodes.parameters import convert_parameter, parse_integer, parse_names, parse_numbers

# name: (default, what it is)
PARAMETERS = {
    "joints": ("", "names of the joints that get efforts, in the order of ~/commands; empty: all that have motors"),
    "mode": (COMPUTED_TORQUE, f"{', '.join(MODES)}"),
    "kp": ([100.0], "gain of the position error [1/s^2], one number or one for each joint"),
    "kd": ([20.0], "gain of the velocity error [1/s], one number or one for each joint"),
    "friction_velocity": (
        REFERENCE,
        "velocity of which mode computed_torque compensates friction: reference or measured",
    ),
    "effort_limits": ("", "most that is sent to each joint [N m or N]; empty: as the description says"),
    "without_reference": ("damp", "what is done while no reference is there: gravity, damp or zero"),
    "ramp_time": (0.1, "in which efforts go to zero after a fault, or over to others after a change [s]"),
    "state_timeout": (0.02, "age at which joint_states are stale [s]"),
    "reference_timeout": (0.1, "how long a point of ~/reference_point counts [s]"),
    "deadline": (0.005, "age of joint_states at which their efforts are out too late [s]"),
    "deadline_misses": (10, "late efforts in a row that are a fault"),
    "allow_massless": (False, "control a robot whose description has no masses: friction alone is then compensated"),
    "state_rate": (50.0, "at which ~/state is published, at most [1/s]; 0: never"),
    "autostart": (True, "configure and activate the node when it has a robot"),
}
CONFIGURATION_PARAMETERS = ("joints", "autostart")  # what is read when the node is configured
CHOICES = {"mode": MODES, "friction_velocity": FRICTION_VELOCITIES, "without_reference": NO_REFERENCE_ACTIONS}
LIST_PARAMETERS = ("kp", "kd", "effort_limits")


def validate_parameter(name, value):
    """The value of a parameter in its type. Raises QuestionError."""
    default, description = PARAMETERS[name]
    if name == "joints":
        return parse_names(name, value)
    if name in LIST_PARAMETERS:
        return _not_negative(name, value, description)
    if name == "deadline_misses":
        return parse_integer(name, value, least=1)
    value = convert_parameter(default, name, value, description)
    if isinstance(default, float):
        least = 0.0 if name in ("ramp_time", "state_rate") else 1e-4
        if not least <= value < np.inf:
            raise InvalidInputError(f"parameter {name} is {value:g}: {least:g} or more is needed, {description}")
    if name in CHOICES and value not in CHOICES[name]:
        raise InvalidInputError(f"parameter {name}: {describe_unknown_name(name, value, CHOICES[name])}")
    return value


def _not_negative(name, value, description):
    told = np.array(parse_numbers(name, value, description))
    if not (told >= 0).all() or (name != "effort_limits" and not np.isfinite(told).all()):
        raise InvalidInputError(
            f"parameter {name} is {told.tolist()}: numbers of zero or more are needed, {description}"
        )
    return told


def settings_from_parameters(values, dynamics, joints, massless=False):
    """The Settings of parameters {name: checked value} for some joints of a robot.

    massless: whether its description has no masses. Raises QuestionError, also where no useful effort could be sent:
    of a description without masses, unless it is allowed, and where it limits all efforts to zero.
    """
    if massless and not values["allow_massless"]:
        raise InvalidInputError(
            f"robot {dynamics.robot.name!r}: {MASSLESS_WARNING}; allow_massless:=true controls it all the same"
        )
    told = {name: values[name] for name in Settings.__dataclass_fields__ if name in values}
    told["kp"], told["kd"] = (_of_each(name, values[name], joints) for name in ("kp", "kd"))
    limits = values["effort_limits"]
    if len(limits):
        told["limits"] = _of_each("effort_limits", limits, joints, alone=False)
    else:
        places = dynamics.robot.joint_numbers
        described = np.array([dynamics.robot.joints[places[name]].limits.effort for name in joints])
        if not described.any():
            raise InvalidInputError(
                f"the description of {dynamics.robot.name!r} limits the effort of {', '.join(joints)} to 0, so that "
                "nothing but zeros could be sent: set effort_limits"
            )
        told["limits"] = np.where(described >= UNLIMITED, np.inf, described)
    return Settings(**told)


def _of_each(name, told, joints, alone=True):
    if len(told) == len(joints):
        return told
    if alone and len(told) == 1:
        return np.full(len(joints), told[0])
    raise InvalidInputError(
        f"parameter {name} has {len(told)} values: {len(joints)} are needed, one for each of {', '.join(joints)}"
    )
