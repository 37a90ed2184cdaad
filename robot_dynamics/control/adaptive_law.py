"""Adaptive computed torque: the law of Slotine and Li with parameters that stay physical.

With e = q_d - q, q̇_r = q̇_d + Λ e, q̈_r = q̈_d + Λ ė and s = q̇_r - q̇, the efforts are

    τ = Y(q, q̇, q̇_r, q̈_r) θ̂ + D s,    Y θ = A(q) q̈_r + C(q, q̇) q̇_r + g(q) + friction

with the parameters θ̂ of `natural_adaptation`, the gradient g = Yᵀ s, and D = √K_d Â √K_d, so that K_d is a rate [1/s]
for heavy and light joints as in computed_torque. Λ = K_p / K_d. With constant θ̂, the error obeys
ë + (K_d + Λ) ė + K_d Λ e = 0 to first order, where the model is exact. With the matrix C of Christoffel symbols, for
which Ȧ - 2 C is skew-symmetric, V = ½ sᵀ A s + D(P ‖ P̂) / γ obeys

    dV/dt = -sᵀ D s + sᵀ (friction at q̇_d - friction at q̇)

J.-J. Slotine, W. Li, On the adaptive control of robot manipulators, International Journal of Robotics Research 6
(1987).

The regressor R of the inverse model is a quadratic form of the velocity, whose polar form is that of these C: no
further recursion is needed. With R₀ without gravity,

    Y(q, q̇, q̇_r, q̈_r) = R(q, (q̇ + q̇_r) / 2, q̈_r) - R₀(q, s / 2, 0)

Friction is compensated at the velocity of the reference, as in computed_torque. Rotor inertias and the viscous and
Coulomb friction of controlled joints are adapted too, if they are not zero.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.control.natural_adaptation import NaturalAdaptation
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.model.inertia import Inertia, symmetric_matrix
from robot_dynamics.newton_euler.regressor import JOINT_PARAMETERS, LINK_PARAMETERS, parameters

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.control.natural_adaptation import AdaptationLimits, AdaptationSettings
    from robot_dynamics.model.robot import Robot

COLUMNS = len(LINK_PARAMETERS) + len(JOINT_PARAMETERS)
"""Columns of the regressor for each link with its joint."""


class AdaptiveLaw:
    """The adaptive law of the controlled joints of a robot.

    Parameters
    ----------
    dynamics : Dynamics
        A robot on a fixed base whose independent joints are all actuated; it may have closed loops.
    joint_indices : ndarray of int, shape (joints,)
        Indices of the controlled joints in Dynamics.joint_names. Others keep their velocity.
    limits : AdaptationLimits

    Attributes
    ----------
    parameters : NaturalAdaptation
        The present estimates: of links, and the numbers Ia, Fv, Fs of each controlled joint.

    Raises
    ------
    InvalidInputError
        The base moves, a joint has a spring, or an independent joint has no motor.
    """

    def __init__(self, dynamics: Dynamics, joint_indices: IntArray, limits: AdaptationLimits) -> None:
        robot = dynamics.robot
        if robot.moving_base:
            raise InvalidInputError(f"adaptation needs a fixed base, and that of {robot.name!r} moves")
        if dynamics.unactuated_joint_names:
            names = ", ".join(dynamics.unactuated_joint_names)
            raise InvalidInputError(f"adaptation needs a motor at each joint, and {names} of {robot.name!r} have none")
        sprung = ", ".join(joint.name for joint in robot.joints if joint.spring is not None)
        if sprung:
            raise InvalidInputError(
                f"adaptation needs joints without springs, and {sprung} of {robot.name!r} have them"
            )
        self._robot = robot
        self._indices = joint_indices
        frictionless = replace(robot, joints=tuple(joint.without_friction() for joint in robot.joints))
        self._regressor = Dynamics(frictionless).compile("regressor")
        self._weightless_regressor = Dynamics(replace(frictionless, gravity=np.zeros(3))).compile("regressor")
        n = len(dynamics.joint_names)
        columns = COLUMNS * len(robot.joints)
        self._full, self._curvature = np.zeros((n, columns)), np.zeros((n, columns))
        self._zero = np.zeros(n)
        self._numbers = [robot.joint_numbers[dynamics.joint_names[index]] for index in joint_indices]
        table = parameters(frictionless).reshape(len(robot.joints), COLUMNS)
        self._fixed_rotors = table[:, 10].copy()
        self._fixed_rotors[self._numbers] = 0.0
        joints = [robot.joints[number] for number in self._numbers]
        self._initial_friction = np.array([[joint.viscous_friction, joint.coulomb_friction] for joint in joints])
        numbers = np.column_stack([table[self._numbers, 10], self._initial_friction])
        self.parameters = NaturalAdaptation(table[:, :10], numbers.ravel(), limits)
        self._gradients: tuple[Array, Array] | None = None
        self._sliding = np.zeros(len(joint_indices))

    def efforts(
        self,
        positions: Array,
        velocities: Array,
        reference: Array,
        errors: tuple[Array, Array],
        kp: Array | float,
        kd: Array | float,
        out: Array,
    ) -> None:
        """Write the efforts of the law, and keep the gradient of the parameters for `adapt`.

        Parameters
        ----------
        positions : ndarray
            Program positions of the state.
        velocities : ndarray, shape (n,)
            Of the state.
        reference : ndarray, shape (3, joints)
            Positions, velocities and accelerations of the controlled joints.
        errors : pair of ndarray, shape (joints,)
            e and ė.
        kp, kd : ndarray, shape (joints,), or float
            Gains K_p [1/s²] and K_d [1/s], the latter above zero.
        out : ndarray, shape (joints,)
            Efforts [N m or N], written: without the friction that the description has.
        """
        error, rate_error = errors
        index = self._indices
        rate = kp / kd
        s = rate_error + rate * error
        half = np.zeros_like(velocities)
        half[index] = 0.5 * s
        accelerations = np.zeros_like(velocities)
        accelerations[index] = reference[2] + rate * rate_error
        damping = np.zeros_like(velocities)
        damping[index] = np.sqrt(kd) * s
        self._regressor.evaluate(positions, velocities + half, accelerations, self._full)
        self._weightless_regressor.evaluate(positions, half, self._zero, self._curvature)
        Y = self._full - self._curvature
        self._weightless_regressor.evaluate(positions, self._zero, damping, self._curvature)
        theta = self._theta()
        out[:] = (Y @ theta)[index] + np.sqrt(kd) * (self._curvature @ theta)[index]
        friction_columns = np.column_stack([reference[1], np.sign(reference[1])])
        out += ((self.parameters.numbers.reshape(-1, 3)[:, 1:] - self._initial_friction) * friction_columns).sum(axis=1)
        powers = (s @ Y[index]).reshape(-1, COLUMNS)
        numbers = np.column_stack([powers[self._numbers, 10], s[:, None] * friction_columns])
        self._gradients = powers[:, :10], numbers.ravel()
        self._sliding = s

    def adapt(self, step: float, settings: AdaptationSettings) -> bool:
        """Adapt the parameters to the last call of `efforts`, and return whether they were.

        Parameters
        ----------
        step : float
            Time since the last efforts [s].
        settings : AdaptationSettings
        """
        if self._gradients is None:
            return False
        largest = float(np.abs(self._sliding).max(initial=0.0))
        if not largest > settings.dead_zone:
            return False
        part = 1 - settings.dead_zone / largest
        links, numbers = self._gradients
        self.parameters.limits = settings.limits
        self.parameters.update(step, settings.gain, part * links, part * numbers)
        return True

    @property
    def constant_links(self) -> tuple[str, ...]:
        """Names of links with inertia that is not adapted, because it is not that of a body with mass and extent."""
        names = []
        for link, row, is_adapted in zip(
            self._robot.links[1:], self.parameters.links, self.parameters.is_adapted, strict=True
        ):
            if row.any() and not is_adapted:
                names.append(link.name)
        return tuple(names)

    def _theta(self) -> Array:
        """Parameters (p,) of the regressor, without friction."""
        table = np.zeros((len(self._fixed_rotors), COLUMNS))
        table[:, :10] = self.parameters.links
        table[:, 10] = self._fixed_rotors
        table[self._numbers, 10] = self.parameters.numbers.reshape(-1, 3)[:, 0]
        return table.ravel()

    def adapted_robot(self) -> Robot:
        """Return the robot with the present estimates."""
        robot = self._robot
        links = [robot.links[0]]
        for link, values, is_adapted in zip(
            robot.links[1:], self.parameters.links, self.parameters.is_adapted, strict=True
        ):
            inertia = Inertia(values[9], values[6:9], symmetric_matrix(*values[:6]))
            links.append(replace(link, inertia=inertia) if is_adapted else link)
        joints = list(robot.joints)
        for number, (rotor, viscous, coulomb) in zip(
            self._numbers, self.parameters.numbers.reshape(-1, 3).tolist(), strict=True
        ):
            joints[number] = replace(
                joints[number], rotor_inertia=rotor, viscous_friction=viscous, coulomb_friction=coulomb
            )
        return replace(robot, links=tuple(links), joints=tuple(joints))
