"""Periodic joint trajectories as Fourier series, and bounds on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.identification.motion_samples import position_bounds

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics


@dataclass(frozen=True, eq=False)
class JointBounds:
    """Bounds of the motion of n joints.

    Attributes
    ----------
    lower, upper : (n,) array
        Positions [rad or m].
    velocity, acceleration : (n,) array
        Largest absolute velocities [rad/s or m/s] and accelerations [rad/s² or m/s²]; infinite if unbounded.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True, eq=False)
class FourierTrajectory:
    """One period of q_j(t) = middle_j + Σ_k cosines_jk cos(k ω t) + sines_jk sin(k ω t), with ω = 2π / duration.

    Attributes
    ----------
    duration : float
        Period [s].
    middle : (n,) array
        Constant terms [rad or m].
    cosines, sines : (n, harmonics) array
        Coefficients [rad or m].
    """

    duration: float
    middle: Array
    cosines: Array
    sines: Array

    def __call__(self, times: Array) -> tuple[Array, Array, Array]:
        """Evaluate the trajectory.

        Parameters
        ----------
        times : (N,) array
            Times [s].

        Returns
        -------
        q, qd, qdd : (N, n) array
            Positions, velocities and accelerations.
        """
        coefficients = np.concatenate([self.cosines, self.sines], axis=1).T
        q, qd, qdd = (part @ coefficients for part in fourier_basis(times, self.duration, self.cosines.shape[1]))
        return self.middle + q, qd, qdd


def fourier_basis(times: Array, duration: float, harmonics: int) -> Array:
    """Compute the basis functions (3, N, 2 harmonics) of position, velocity and acceleration at times (N,).

    They multiply the coefficients [cosines, sines] (2 harmonics,) of a FourierTrajectory.
    """
    rates = 2 * np.pi / duration * np.arange(1, harmonics + 1)
    angles = np.multiply.outer(times, rates)
    c = np.cos(angles)
    s = np.sin(angles)
    position = np.hstack([c, s])
    return np.stack([position, np.hstack([-s * rates, c * rates]), -position * np.tile(rates**2, 2)])


def joint_bounds(dynamics: Dynamics, acceleration: float = np.inf, margin: float = 0.05) -> JointBounds:
    """Compute the bounds of the joints of a robot from its description.

    Parameters
    ----------
    dynamics : Dynamics
        Dynamics of the robot. Joints without limits move half a turn or 1 m to each side.
    acceleration : float
        Largest acceleration of every joint [rad/s² or m/s²], which descriptions do not contain.
    margin : float
        Part of each range and velocity that is left free at each end, 0 to 0.5.

    Returns
    -------
    JointBounds
        Bounds of the independent joints.

    Raises
    ------
    InvalidInputError
        If the margin is out of range.
    """
    if not 0 <= margin < 0.5:
        raise InvalidInputError(f"margin {margin:g}: a part of the joint range between 0 and 0.5 is needed")
    joints = [dynamics.robot.joints[dynamics.robot.joint_numbers[name]] for name in dynamics.joint_names]
    lower, upper = np.array([position_bounds(joint) for joint in joints]).T
    rates = np.array([joint.limits.velocity for joint in joints])
    rates = np.where(np.isfinite(rates) & (rates > 0), rates, np.inf)
    room = margin * (upper - lower)
    return JointBounds(lower + room, upper - room, (1 - margin) * rates, np.full(len(joints), float(acceleration)))
