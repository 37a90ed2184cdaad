"""The parameters of computed_torque, and the Settings of a controller that follow from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.control.controller_settings import Settings
from robot_dynamics.control.goal_tolerances import GoalTolerances
from robot_dynamics.control.modes import (
    ADAPTIVE,
    COLLISION_ACTIONS,
    COMPUTED_TORQUE,
    FRICTION_VELOCITIES,
    MODES,
    NO_REFERENCE_ACTIONS,
    REFERENCE,
)
from robot_dynamics.control.natural_adaptation import AdaptationLimits, AdaptationSettings
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.model.joint import UNLIMITED
from robot_dynamics.model.robot import MASSLESS_WARNING
from robot_dynamics.nodes.parameters import ParameterSpec, by_name

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.parameters import ParameterValues

SMALLEST_RATIO = 1.001  # of adaptation.max_ratio
SHORTEST_TIME = 1e-4  # [s] smallest value of timeouts

PARAMETERS = by_name(
    ParameterSpec(
        "joints",
        "",
        "names of the joints that get efforts, in the order of ~/commands; empty: all that have motors",
        list_kind="names",
        read_at="configuration",
    ),
    ParameterSpec("mode", COMPUTED_TORQUE, ", ".join(MODES), choices=tuple(MODES)),
    ParameterSpec(
        "kp",
        [100.0],
        "gain of the position error [1/s^2], one number or one for each joint",
        list_kind="numbers",
        lower_bound=0.0,
    ),
    ParameterSpec(
        "kd",
        [20.0],
        "gain of the velocity error [1/s], one number or one for each joint",
        list_kind="numbers",
        lower_bound=0.0,
    ),
    ParameterSpec(
        "friction_velocity",
        REFERENCE,
        "velocity of which mode computed_torque compensates friction: reference or measured",
        choices=tuple(FRICTION_VELOCITIES),
    ),
    ParameterSpec(
        "effort_limits",
        "",
        "maximum effort of each joint [N m or N]; empty: limits of the description",
        list_kind="numbers",
        lower_bound=0.0,
        upper_bound=None,
    ),
    ParameterSpec(
        "without_reference",
        "damp",
        "behaviour without a reference: gravity, damp or zero",
        choices=tuple(NO_REFERENCE_ACTIONS),
    ),
    ParameterSpec(
        "ramp_time",
        0.1,
        "time in which efforts go to zero after a fault, or change after a parameter change [s]",
        lower_bound=0.0,
    ),
    ParameterSpec("deactivate_on_fault", False, "deactivate the node when a fault has brought the efforts to zero"),
    ParameterSpec("state_timeout", 0.02, "age at which joint_states are stale [s]", lower_bound=SHORTEST_TIME),
    ParameterSpec(
        "reference_timeout", 0.1, "how long a point of ~/reference_point is valid [s]", lower_bound=SHORTEST_TIME
    ),
    ParameterSpec(
        "deadline", 0.005, "age of joint_states from which their efforts count as late [s]", lower_bound=SHORTEST_TIME
    ),
    ParameterSpec("deadline_misses", 10, "number of consecutive late efforts that is a fault", lower_bound=1),
    ParameterSpec(
        "allow_massless",
        False,
        "control a robot whose description has no masses: friction alone is then compensated",
    ),
    ParameterSpec("state_rate", 50.0, "maximum rate of ~/state [1/s]; 0: never", lower_bound=0.0),
    ParameterSpec(
        "adaptation.gain",
        20.0,
        "of mode adaptive_computed_torque [1/J]: a wrong power of 1 W for 1 s changes parameters by about this part",
        lower_bound=0.0,
    ),
    ParameterSpec(
        "adaptation.dead_zone",
        0.01,
        "filtered error of the velocity [rad/s or m/s] up to which nothing is adapted",
        lower_bound=0.0,
    ),
    ParameterSpec(
        "adaptation.max_ratio",
        20.0,
        "largest ratio of an adapted parameter to that of the description, or of that to it",
        lower_bound=SMALLEST_RATIO,
    ),
    ParameterSpec(
        "adaptation.max_rate", 2.0, "largest relative rate of change of an adapted parameter [1/s]", lower_bound=0.0
    ),
    ParameterSpec(
        "collision_reaction",
        "none",
        "what a true message on collision causes: none, hold, retract or gravity_compensation",
        choices=tuple(COLLISION_ACTIONS),
    ),
    ParameterSpec(
        "constraints.goal_time",
        0.0,
        "time after the end of a goal in which the joints must come within its goal tolerances [s]; 0: no limit",
        lower_bound=0.0,
    ),
    ParameterSpec(
        "constraints.stopped_velocity_tolerance",
        0.01,
        "velocity of each joint at the end of a goal [rad/s or m/s]; 0: no limit",
        lower_bound=0.0,
    ),
    ParameterSpec(
        "action_monitor_rate", 20.0, "maximum rate of the feedback of a goal [1/s]; 0: never", lower_bound=0.0
    ),
    ParameterSpec("autostart", True, "configure and activate the node when it has a robot", read_at="configuration"),
)


JOINT_TOLERANCES = by_name(
    ParameterSpec(
        "trajectory", 0.0, "largest error of the position on the way to a goal [rad or m]; 0: no limit", lower_bound=0.0
    ),
    ParameterSpec(
        "goal", 0.0, "largest error of the position at the end of a goal [rad or m]; 0: no limit", lower_bound=0.0
    ),
)
"""The parameters constraints.<joint>.<name> of each joint that is controlled."""


def joint_tolerance_parameters(joints: Sequence[str]) -> dict[str, ParameterSpec]:
    """Return the specifications of JOINT_TOLERANCES with their full names for joints."""
    return {
        f"constraints.{joint}.{name}": replace(spec, name=f"constraints.{joint}.{name}")
        for joint in joints
        for name, spec in JOINT_TOLERANCES.items()
    }


def default_tolerances(values: ParameterValues, joints: Sequence[str]) -> GoalTolerances:
    """Return the tolerances of goals for joints of these names."""
    trajectory, goal = ([values[f"constraints.{joint}.{name}"] for joint in joints] for name in JOINT_TOLERANCES)
    velocity = values["constraints.stopped_velocity_tolerance"]
    return GoalTolerances.from_defaults(trajectory, goal, velocity, values["constraints.goal_time"])


def validate_parameter(name: str, value: object) -> object:
    """Return the value of a parameter in its type. Raises InvalidInputError."""
    return PARAMETERS[name].validate(value)


def settings_from_parameters(
    values: ParameterValues, dynamics: Dynamics, joints: Sequence[str], massless: bool = False
) -> Settings:
    """Return the Settings of validated parameters for some joints of a robot.

    massless: whether its description has no masses. Raises InvalidInputError, also if no useful effort could be sent:
    if a description without masses is not allowed, and if all efforts are limited to zero.
    """
    if massless and not values["allow_massless"]:
        raise InvalidInputError(
            f"robot {dynamics.robot.name!r}: {MASSLESS_WARNING}; allow_massless:=true controls it all the same"
        )
    effort_limits = values["effort_limits"]
    if effort_limits:
        limits = _expand_to_joints("effort_limits", effort_limits, joints, allow_one=False)
        if not limits.any():
            raise InvalidInputError("parameter effort_limits: all are 0, so that nothing but zeros could be sent")
    else:
        limits = _limits_of_description(dynamics, joints)
    kd = _expand_to_joints("kd", values["kd"], joints)
    if values["mode"] == ADAPTIVE and not (kd > 0).all():
        raise InvalidInputError(f"parameter kd: mode {ADAPTIVE} needs gains above 0, and {kd.tolist()} has others")
    return Settings(
        mode=values["mode"],
        kp=_expand_to_joints("kp", values["kp"], joints),
        kd=kd,
        limits=limits,
        without_reference=values["without_reference"],
        state_timeout=values["state_timeout"],
        reference_timeout=values["reference_timeout"],
        ramp_time=values["ramp_time"],
        deadline=values["deadline"],
        deadline_misses=values["deadline_misses"],
        friction_velocity=values["friction_velocity"],
        adaptation=AdaptationSettings(
            values["adaptation.gain"], values["adaptation.dead_zone"], adaptation_limits(values)
        ),
    )


def adaptation_limits(values: ParameterValues) -> AdaptationLimits:
    """Return the limits of the adaptation of validated parameters."""
    return AdaptationLimits(values["adaptation.max_ratio"], values["adaptation.max_rate"])


def describe_settings(settings: Settings) -> str:
    """Return the settings that decide what is sent, without the limits, as one line of a log."""
    return (
        f"mode {settings.mode}, kp {_shorten(settings.kp)} 1/s^2, kd {_shorten(settings.kd)} 1/s, "
        f"without_reference {settings.without_reference}, ramp_time {settings.ramp_time:g} s, "
        f"state_timeout {settings.state_timeout:g} s, reference_timeout {settings.reference_timeout:g} s, "
        f"deadline {settings.deadline:g} s"
    )


def _shorten(values: Array) -> object:
    """Return the one number that all values are, else a list."""
    return f"{values[0]:g}" if len(values) and (values == values[0]).all() else values.tolist()


def limits_warning(dynamics: Dynamics, joints: Sequence[str], limits: Array) -> str:
    """Return a sentence on efforts that may exceed the limits of the description, empty if none may.

    Parameters
    ----------
    joints : names of n joints.
    limits : (n,) of their efforts [N m or N].

    Notes
    -----
    A limit of 0 in a description states none: many URDFs have it for joints whose limit nobody entered.
    """
    described = _described_limits(dynamics, joints)
    excessive = [
        f"{name} {limit:g} ({allowed:g})"
        for name, limit, allowed in zip(joints, limits, described, strict=True)
        if limit > allowed > 0
    ]
    return f"effort_limits exceed those of the description: {', '.join(excessive)}" if excessive else ""


def _described_limits(dynamics: Dynamics, joints: Sequence[str]) -> Array:
    robot = dynamics.robot
    return np.array([robot.joints[robot.joint_numbers[name]].limits.effort for name in joints])


def _limits_of_description(dynamics: Dynamics, joints: Sequence[str]) -> Array:
    limits = _described_limits(dynamics, joints)
    if not limits.any():
        raise InvalidInputError(
            f"the description of {dynamics.robot.name!r} limits the effort of {', '.join(joints)} to 0, so that "
            "nothing but zeros could be sent: set effort_limits"
        )
    return np.where(limits >= UNLIMITED, np.inf, limits)


def _expand_to_joints(name: str, values: Sequence[float], joints: Sequence[str], allow_one: bool = True) -> Array:
    """Return (joints,) of the value of a parameter: one number for each joint, or one for all if `allow_one`."""
    if len(values) == len(joints):
        return np.array(values)
    if allow_one and len(values) == 1:
        return np.full(len(joints), values[0])
    raise InvalidInputError(
        f"parameter {name} has {len(values)} values: {len(joints)} are needed, one for each of {', '.join(joints)}"
    )
