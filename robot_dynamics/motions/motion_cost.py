"""What a motion costs: efforts, power and energy of each actuator beside its limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.motions.time_scaling import LARGEST, find_time_scale, largest_usage

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.motions.actuator_limits import ActuatorLimits
    from robot_dynamics.motions.effort_model import EffortModel
    from robot_dynamics.motions.sampled_motion import SampledMotion
    from robot_dynamics.motions.time_scaling import TimeScale


@dataclass(frozen=True, eq=False)
class ActuatorCost:
    """What a motion costs a joint or motor; limits that do not exist are infinite.

    Attributes
    ----------
    name : of the joint or motor.
    is_prismatic : whether its efforts are forces; else torques.
    rms_effort, peak_effort : [N m or N].
    peak_time : time of the largest effort [s].
    effort_limit : at speed zero [N m or N].
    effort_usage : largest part of the effort limit at the present speed that is used.
    peak_speed, speed_limit : [rad/s or m/s].
    speed_usage : largest part of the speed limit that is used.
    """

    name: str
    is_prismatic: bool
    rms_effort: float
    peak_effort: float
    peak_time: float
    effort_limit: float
    effort_usage: float
    peak_speed: float
    speed_limit: float
    speed_usage: float


@dataclass(frozen=True, eq=False)
class JointEnergy:
    """Energy of a joint.

    Attributes
    ----------
    name : of the joint.
    supplied, regenerated : energy that its actuator supplies where its power is positive, and takes back where it is
        negative [J].
    friction : energy lost in friction and dampers [J].
    peak_power, mean_power : largest magnitude and mean of the power [W].
    position_margin : least distance from its position limits [rad or m]; negative beyond them, infinite without them.
    """

    name: str
    supplied: float
    regenerated: float
    friction: float
    peak_power: float
    mean_power: float
    position_margin: float


@dataclass(frozen=True, eq=False)
class MotionCost:
    """What a motion costs a robot.

    Attributes
    ----------
    times : (N,) [s].
    efforts, powers : (N, n) of the joints [N m or N] and [W].
    effort_usages, speed_usages : (N, c) parts of the limits of the actuators that are used.
    actuators : of the joints, and of motors with limits of their own.
    joints : energies of the joints.
    duration : [s].
    shared_energy : energy that a supply common to all joints delivers, where it can pass on what other joints
        regenerate, but takes nothing back [J].
    time_scale : the smallest factor of time; None where there is none.
    is_too_heavy : whether a limit is passed however slow the motion is.
    """

    times: Array
    efforts: Array
    powers: Array
    effort_usages: Array
    speed_usages: Array
    actuators: tuple[ActuatorCost, ...]
    joints: tuple[JointEnergy, ...]
    duration: float
    shared_energy: float
    time_scale: TimeScale | None
    is_too_heavy: bool

    @property
    def is_within_limits(self) -> bool:
        """Whether no limit of an effort or a speed is passed."""
        return bool(max(self.effort_usages.max(initial=0.0), self.speed_usages.max(initial=0.0)) <= 1)


def compute_motion_cost(model: EffortModel, limits: ActuatorLimits, motion: SampledMotion) -> MotionCost:
    """Compute what a motion costs.

    Raises
    ------
    SingularModelError
        The loops of the robot do not close at a position.
    """
    q = model.close_loops(motion.q)
    efforts = model.efforts(q, motion.qd, motion.qdd)
    powers = efforts * motion.qd
    losses = model.friction(q, motion.qd, motion.qdd) * motion.qd
    effort_usages, speed_usages = limits.usage(efforts, motion.qd)
    time_scale = find_time_scale(model, limits, q, motion.qd, motion.qdd)
    is_too_heavy = time_scale is None and largest_usage(model, limits, q, motion.qd, motion.qdd, LARGEST) > 1
    weights = motion.weights
    return MotionCost(
        times=motion.times,
        efforts=efforts,
        powers=powers,
        effort_usages=effort_usages,
        speed_usages=speed_usages,
        actuators=_actuator_costs(model, limits, motion, efforts, effort_usages, speed_usages),
        joints=tuple(
            JointEnergy(
                name=name,
                supplied=float(weights @ np.maximum(powers[:, k], 0.0)),
                regenerated=float(weights @ np.maximum(-powers[:, k], 0.0)),
                friction=float(weights @ losses[:, k]),
                peak_power=float(np.abs(powers[:, k]).max()),
                mean_power=float(weights @ powers[:, k] / weights.sum()),
                position_margin=_position_margin(model, name, motion.q[:, k]),
            )
            for k, name in enumerate(model.dynamics.joint_names)
        ),
        duration=motion.duration,
        shared_energy=float(weights @ np.maximum(powers.sum(axis=1), 0.0)),
        time_scale=time_scale,
        is_too_heavy=is_too_heavy,
    )


def _actuator_costs(
    model: EffortModel,
    limits: ActuatorLimits,
    motion: SampledMotion,
    joint_efforts: Array,
    effort_usages: Array,
    speed_usages: Array,
) -> tuple[ActuatorCost, ...]:
    efforts = limits.efforts(joint_efforts)
    speeds = limits.speeds(motion.qd)
    at_rest = limits.effort_limits(np.zeros_like(speeds[:1]))[0]
    peaks = np.abs(efforts).argmax(axis=0)
    rms = np.sqrt(motion.weights @ efforts**2 / motion.weights.sum())
    numbers = model.robot.joint_numbers
    joint_count = len(model.dynamics.joint_names)  # the first actuators; motors follow, whose efforts are torques
    return tuple(
        ActuatorCost(
            name=name,
            is_prismatic=k < joint_count and model.robot.joints[numbers[name]].prismatic,
            rms_effort=float(rms[k]),
            peak_effort=float(efforts[peaks[k], k]),
            peak_time=float(motion.times[peaks[k]]),
            effort_limit=float(at_rest[k]),
            effort_usage=float(effort_usages[:, k].max()),
            peak_speed=float(speeds[:, k].max()),
            speed_limit=float(limits.max_speeds[k]),
            speed_usage=float(speed_usages[:, k].max()),
        )
        for k, name in enumerate(limits.names)
    )


def _position_margin(model: EffortModel, name: str, positions: Array) -> float:
    limits = model.robot.joints[model.robot.joint_numbers[name]].limits
    return float(min((positions - limits.lower).min(), (limits.upper - positions).min()))
