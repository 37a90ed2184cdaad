"""Inputs of a step and conditions of the derivative, as the equations of motion take them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from robot_dynamics.array_checks import require_finite
from robot_dynamics.array_types import Array
from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import ArrayLike
    from robot_dynamics.simulation.attitude_integration import LocalAttitudeChart
    from robot_dynamics.simulation.constrained_motion import LoopCoordinates
    from robot_dynamics.simulation.plant import Plant
    from robot_dynamics.simulation.rate_constraints import BaseType

NO_WRENCH = np.zeros(6)

PrescribedMotion: TypeAlias = Callable[[float], tuple[Array, Array, Array]]
"""Positions, velocities and accelerations (n,) of joints with prescribed motion, at a time [s]."""


class StepInputs(NamedTuple):
    """Inputs that are constant during a step.

    Attributes
    ----------
    efforts : ndarray
        Joint efforts (n,), of a robot with loops (all joints,).
    wrenches : list of ndarray, shape (6,)
        External wrenches on Plant.wrench_links.
    drive : ndarray, shape (6,), or None
        Twist that a planar base is driven to.
    motion : callable or None
        Prescribed motion of the joints.
    is_undisturbed : bool
        Whether gravity alone acts on a free base.
    """

    efforts: Array
    wrenches: list[Array]
    drive: Array | None
    motion: PrescribedMotion | None
    is_undisturbed: bool


class Conditions(NamedTuple):
    """Conditions under which the derivative is evaluated.

    Attributes
    ----------
    pose : ndarray, shape (4, 4)
        Pose of the base where the step begins.
    inputs : StepInputs
    coordinates : LoopCoordinates or None
        Of a robot with loops: the coordinates of the rates.
    direction : ndarray, shape (all joints,), or None
        Velocities near a singular position of the loops; None elsewhere.
    local_charts : sequence of LocalAttitudeChart
        Platforms of which x has a rotation vector in the place of the angles.
    """

    pose: Array
    inputs: StepInputs
    coordinates: LoopCoordinates | None
    direction: Array | None
    local_charts: Sequence[LocalAttitudeChart] = ()


def build_step_inputs(
    plant: Plant,
    base: BaseType,
    has_ground: bool,
    efforts: ArrayLike | None,
    external_wrenches: Mapping[str, ArrayLike] | None,
    drive: ArrayLike | None,
    motion: PrescribedMotion | None,
) -> StepInputs:
    """The inputs of Simulation.advance, checked; the plant takes wrenches on their links from now on.

    Raises InvalidInputError where an argument does not fit the robot.
    """
    dynamics = plant.dynamics
    if efforts is None:
        efforts = np.zeros(plant.size)
    joint_efforts: Array = require_finite("efforts", efforts, plant.size, "joints")
    wrenches: dict[str, Array] = {
        name: require_finite(f"external wrench on {name!r}", wrench, 6, "force and torque components")
        for name, wrench in (external_wrenches or {}).items()
    }
    reference_twist: Array | None = None
    if drive is not None:
        if base != "planar":
            raise InvalidInputError(f"drive needs a planar base, this one is {base}")
        reference_twist = require_finite("drive", drive, 6, "linear and angular components")
    if motion is not None and not callable(motion):
        raise InvalidInputError(
            f"motion is {motion!r:.60}: it must be a function of the time [s] that returns positions, velocities and "
            "accelerations of the joints"
        )
    for name in wrenches:
        dynamics.robot.frame(name)  # raises for an unknown link
    new_links = [name for name in wrenches if name not in plant.wrench_links]
    if new_links:
        plant.set_wrench_links([*plant.wrench_links, *new_links])
    ordered_wrenches = [
        np.ascontiguousarray(wrenches.get(name, NO_WRENCH), dtype=np.float64) for name in plant.wrench_links
    ]
    is_undisturbed = base == "free" and not has_ground and not any(map(np.any, ordered_wrenches))
    if plant.loops is not None:
        joint_efforts = dynamics.embed_efforts(joint_efforts)
    joint_efforts = np.ascontiguousarray(joint_efforts, dtype=np.float64)
    return StepInputs(joint_efforts, ordered_wrenches, reference_twist, motion, is_undisturbed)
