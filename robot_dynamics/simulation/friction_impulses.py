"""Joint friction as impulses at the end of a step: dry friction that sticks, and stiff viscous friction.

Dry friction changes the velocities v* that result from everything else as far as it can: v = v* + W p with |p| ≤ F h.
The impulse p opposes the remaining motion, or is the one that holds the joint at rest. A force F sign(q̇) in explicit
steps would chatter instead. Viscous friction that is too strong for explicit steps is treated here as well, with
p = -Fv h v. Source: J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988 (time stepping).

F is that of the velocity at the start of the step and of the load, Fs + Fst / (1 + (q̇/vs)²) ± Fsa + μ |Γ_l|. The load
Γ_l is that of a joint that slides at the effort of its motor, y / (1 ± μ sign(y)) with y the effort less the rest of
the friction. A joint at rest thus breaks away where the effort that would hold its load without friction differs from
the effort by F at that load: there both loads are equal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.model.joint_friction import FRICTION_FIELDS
from robot_dynamics.newton_euler.friction import load_friction, loads_from_net_efforts
from robot_dynamics.newton_euler.walker_orin import inertia_matrix
from robot_dynamics.procedures import as_array, largest, magnitude, procedure, select, solve

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot

MAX_SWEEPS = 200
CONVERGENCE_TOLERANCE = 1e-12
"""Change in one sweep, relative to the largest impulse, at which the iteration ends."""
STIFF_DAMPING_RATIO = 0.3
"""h Fv / inertia of a joint beyond which its viscous friction is treated as an impulse."""


@dataclass(frozen=True, eq=False)
class ImpulsiveFriction:
    """Friction of the joints of a robot that acts as impulses during a step of length h.

    Attributes
    ----------
    joints : ndarray, shape (k,)
        Numbers of the joints with such friction.
    frictional_joints : tuple of Joint
        These joints, with all of their friction.
    step : float
        Length of a step h [s].
    viscous_gains, viscous_asymmetries : ndarray, shape (k,)
        Viscous impulses per velocity, Fv h and Fva h; zero where viscous friction is a force.
    """

    joints: IntArray
    frictional_joints: tuple[Joint, ...]
    step: float
    viscous_gains: Array
    viscous_asymmetries: Array

    @cached_property
    def _coefficients(self) -> dict[str, Array]:
        """Numbers (k,) of the friction of the joints, by the name of the field."""
        joints = self.frictional_joints
        coefficients = {field: np.array([getattr(joint, field) for joint in joints]) for field in FRICTION_FIELDS}
        has_stribeck_curve = coefficients["stribeck_friction"] != 0
        coefficients["stribeck_velocity"] = np.where(has_stribeck_curve, coefficients["stribeck_velocity"], 1.0)
        return coefficients

    @cached_property
    def constant_limits(self) -> tuple[Array, Array] | None:
        """Lowest and highest impulse (k,) of dry friction; None where they depend on velocities or loads."""
        if any(joint.stribeck_friction or joint.load_friction for joint in self.frictional_joints):
            return None
        dry = self._coefficients["coulomb_friction"]
        asymmetry = self._coefficients["coulomb_asymmetry"]
        return -self.step * (dry + asymmetry), self.step * (dry - asymmetry)

    def impulse_limits(self, velocities: Array, efforts: Array) -> tuple[Array, Array]:
        """Lowest and highest impulse (k,) [N m s or N s] of dry friction.

        velocities: (k,) at the start of the step; efforts: (k,) of the motors, read where friction depends on the load.
        """
        numbers = self._coefficients
        dry = numbers["coulomb_friction"]
        dry = dry + numbers["stribeck_friction"] / (1 + (velocities / numbers["stribeck_velocity"]) ** 2)
        viscous = numbers["viscous_friction"] * velocities + numbers["viscous_asymmetry"] * np.abs(velocities)
        limits = []
        for direction in (1.0, -1.0):
            friction = dry + direction * numbers["coulomb_asymmetry"]
            net_efforts = efforts - viscous - direction * friction
            directions = np.full(len(friction), direction)
            loads = loads_from_net_efforts(self.frictional_joints, directions, net_efforts)
            friction_of_loads = load_friction(self.frictional_joints, directions, loads)
            limits.append(-self.step * (direction * friction + friction_of_loads))
        return limits[0], limits[1]


def separate_friction(robot: Robot, step: float) -> tuple[Robot, ImpulsiveFriction]:
    """The robot without the friction that acts as impulses, and that friction, for steps of a length [s].

    Dry friction is always treated as impulses, viscous friction where it is too strong for explicit steps.
    """
    viscous = step * np.array([joint.viscous_friction for joint in robot.joints])
    asymmetry = step * np.array([joint.viscous_asymmetry for joint in robot.joints])
    is_stiff = viscous + np.abs(asymmetry) > STIFF_DAMPING_RATIO * minimum_joint_inertias(robot)
    joints = []
    numbers = []
    for number, joint in enumerate(robot.joints):
        explicit = joint.without_friction()
        if not is_stiff[number]:
            viscous_friction, viscous_asymmetry = joint.viscous_friction, joint.viscous_asymmetry
            explicit = replace(explicit, viscous_friction=viscous_friction, viscous_asymmetry=viscous_asymmetry)
        joints.append(explicit)
        dry = replace(joint, viscous_friction=0.0, viscous_asymmetry=0.0)
        if dry.has_friction or (is_stiff[number] and joint.viscous_friction):
            numbers.append(number)
    friction = ImpulsiveFriction(
        np.array(numbers, dtype=np.intp),
        tuple(robot.joints[number] for number in numbers),
        step,
        (viscous * is_stiff)[numbers],
        (asymmetry * is_stiff)[numbers],
    )
    return replace(robot, joints=tuple(joints)), friction


def minimum_joint_inertias(robot: Robot) -> Array:
    """Approximate least inertia (all joints,) of each joint: all other joints and a moving base are free."""
    free = replace(robot, loops=(), platforms=(), joints=tuple(replace(joint, mimic=None) for joint in robot.joints))
    A = inertia_matrix(free, np.array([joint.initial_position for joint in robot.joints]))
    with np.errstate(all="ignore"):
        return 1 / np.diagonal(np.linalg.pinv(A))[len(A) - len(robot.joints) :]


@procedure
def friction_impulses(W: Any, velocities: Any, limits: tuple[Any, Any], viscous: Any) -> Any:
    """Impulses p (k,) [N m s or N s] of friction.

    W (k, k): change of the velocities (k,) for unit impulses; limits: lowest and highest impulse (k,) of dry friction;
    viscous (k,): Fv h. The method is Gauss-Seidel with projection; where all joints continue to slide, the initial
    impulses are the solution.
    """
    size = len(velocities)
    right_side = np.concatenate([velocities[:, None], W], axis=1)
    damped = solve(np.eye(size) + W * viscous, right_side)
    damped_velocities = damped[:, 0]
    damped_W = damped[:, 1:]
    impulses = _dry_impulses(damped_W, damped_velocities, *limits)
    return impulses - viscous * (damped_velocities + damped_W @ impulses)


@procedure
def _dry_impulses(W: Any, velocities: Any, lowest: Any, highest: Any) -> Any:
    """Impulses (k,) within the limits (k,) that bring the joints to rest or oppose their motion."""
    size = len(velocities)
    sliding = [select(velocities[k] > 0, lowest[k], select(velocities[k] < 0, highest[k], 0.0)) for k in range(size)]
    impulses = as_array(np.array(sliding))
    if not largest(-((velocities + W @ impulses) * velocities)) <= 0:
        tolerance = CONVERGENCE_TOLERANCE * largest(np.concatenate([highest, -lowest]))
        W, velocities = as_array(W), as_array(velocities)
        lowest, highest = as_array(lowest), as_array(highest)
        for _ in range(MAX_SWEEPS):
            change = 0.0
            for k in range(size):
                previous = impulses[k]
                sticking = previous - (velocities[k] + W[k] @ impulses) / W[k, k]
                raised = select(sticking > lowest[k], sticking, lowest[k])
                impulses[k] = select(raised < highest[k], raised, highest[k])
                change = select(magnitude(impulses[k] - previous) > change, magnitude(impulses[k] - previous), change)
            if change <= tolerance:
                break
    return impulses
