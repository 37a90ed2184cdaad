"""Fourier trajectories within bounds as functions of unbounded parameters, with exact gradients."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import block_diag, null_space

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.identification.fourier_trajectory import FourierTrajectory, fourier_basis

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.identification.fourier_trajectory import JointBounds

GRID_POINTS_PER_HARMONIC = 20  # points per harmonic at which the bounds are checked
INITIAL_SIZE = 2.0  # size parameter of random trajectories: 88 % of the largest motion


class TrajectoryScaling(NamedTuple):
    """Scaling of the trajectories of n joints to their bounds, with c = 2 harmonics coefficients each.

    middle_parameter, size_parameter: (n,) first two parameters of each joint; coefficients: (n, c) before scaling;
    scale: (n,); room: (n,) range that is left for the middle; centre: (n,) of the positions; peaks: (3, n) largest
    distance from the centre, velocity and acceleration before scaling, between grid points too; peak_gradients:
    (3, n, c) and centre_gradient: (n, c) derivatives by the coefficients; active_bound: (n,) index of the peak that
    limits the scale.
    """

    middle_parameter: Array
    size_parameter: Array
    coefficients: Array
    scale: Array
    room: Array
    centre: Array
    peaks: Array
    peak_gradients: Array
    centre_gradient: Array
    active_bound: IntArray


class TrajectoryParametrization:
    """Trajectories within joint bounds as a function of (n, 2 harmonics) unbounded parameters, flattened.

    The first parameter of each joint places the middle of its motion within the room that is left. The second sets the
    size of the motion relative to the largest one allowed. The others define the shape, among those that begin and end
    at rest.

    Raises InvalidInputError if there are fewer than 2 harmonics or the duration [s] is not positive.
    """

    def __init__(self, bounds: JointBounds, duration: float, harmonics: int) -> None:
        if harmonics < 2 or not duration > 0:
            raise InvalidInputError(
                f"{harmonics} harmonics, duration {duration:g} s: at least 2 harmonics and a positive duration are "
                "needed"
            )
        self.bounds = bounds
        self.duration = duration
        self.harmonics = harmonics
        self.size = len(bounds.lower) * (2 + 2 * (harmonics - 1))
        orders = np.arange(1, harmonics + 1)
        self._shapes = block_diag(null_space(orders[None] ** 2.0), null_space(orders[None] * 1.0))
        points = GRID_POINTS_PER_HARMONIC * harmonics
        self._basis = fourier_basis(np.arange(points) * duration / points, duration, harmonics)
        # Ratio of the maximum of a trigonometric polynomial to that on the grid, at most (Ehlich and Zeller).
        self._overshoot = 1 / np.cos(np.pi * harmonics / points)

    def random(self, rng: np.random.Generator) -> Array:
        """Sample the parameters (size,) of a random trajectory that nearly reaches the bounds."""
        n = len(self.bounds.lower)
        parameters = rng.normal(size=(n, self.size // n))
        parameters[:, 1] = INITIAL_SIZE
        return parameters.ravel()

    def __call__(self, parameters: Array) -> FourierTrajectory:
        """Return the trajectory of parameters (size,)."""
        scaling = self._scale_to_bounds(parameters)
        middle = (
            (self.bounds.lower + self.bounds.upper) / 2
            + scaling.room * np.tanh(scaling.middle_parameter)
            - scaling.scale * scaling.centre
        )
        scaled = scaling.scale[:, None] * scaling.coefficients
        return FourierTrajectory(self.duration, middle, scaled[:, : self.harmonics], scaled[:, self.harmonics :])

    def gradient(self, parameters: Array, motion_gradient: tuple[Array, Array, Array], times: Array) -> Array:
        """Compute derivatives (size,) by the parameters.

        motion_gradient: derivatives by positions, velocities and accelerations (N, n) at times (N,) of the trajectory.
        """
        scaling = self._scale_to_bounds(parameters)
        joints = np.arange(len(self.bounds.lower))
        by_middle = motion_gradient[0].sum(axis=0)
        basis = fourier_basis(times, self.duration, self.harmonics)
        by_scaled = sum(by_rates.T @ part for by_rates, part in zip(motion_gradient, basis, strict=True))
        position = np.tanh(scaling.middle_parameter)
        by_middle_parameter = scaling.room * (1 - position**2) * by_middle
        by_scale = (by_scaled * scaling.coefficients).sum(axis=1)
        by_scale = by_scale - (scaling.peaks[0] * position + scaling.centre) * by_middle
        by_size_parameter = by_scale * scaling.scale / (1 + np.exp(scaling.size_parameter))
        by_peaks = np.zeros_like(scaling.peaks)
        by_peaks[0] = -scaling.scale * position * by_middle
        active = scaling.active_bound
        by_peaks[active, joints] -= by_scale * scaling.scale / scaling.peaks[active, joints]
        by_coefficients = scaling.scale[:, None] * (by_scaled - by_middle[:, None] * scaling.centre_gradient)
        by_coefficients += np.einsum("kj,kjc->jc", by_peaks, scaling.peak_gradients)
        return np.column_stack([by_middle_parameter, by_size_parameter, by_coefficients @ self._shapes]).ravel()

    def _scale_to_bounds(self, parameters: Array) -> TrajectoryScaling:
        bounds = self.bounds
        middle_parameter, size_parameter, *shape = parameters.reshape(len(bounds.lower), -1).T
        coefficients = np.array(shape).T @ self._shapes.T
        joints = np.arange(len(bounds.lower))
        peak_gradients, centre_gradient = self._extrema(coefficients)
        peaks = np.einsum("kjc,jc->kj", peak_gradients, coefficients) + 1e-300
        half_range = (bounds.upper - bounds.lower) / 2
        allowed = np.stack([half_range / peaks[0], bounds.velocity / peaks[1], bounds.acceleration / peaks[2]])
        active_bound = allowed.argmin(axis=0)
        scale = allowed[active_bound, joints] / (1 + np.exp(-size_parameter))
        return TrajectoryScaling(
            middle_parameter=middle_parameter,
            size_parameter=size_parameter,
            coefficients=coefficients,
            scale=scale,
            room=half_range - scale * peaks[0],
            centre=np.einsum("jc,jc->j", centre_gradient, coefficients),
            peaks=peaks,
            peak_gradients=peak_gradients,
            centre_gradient=centre_gradient,
            active_bound=active_bound,
        )

    def _extrema(self, coefficients: Array) -> tuple[Array, Array]:
        """Compute derivatives by the coefficients (n, c) of the peaks (3, n, c) and of the centre (n, c)."""
        q, qd, qdd = self._basis @ coefficients.T
        joints = np.arange(q.shape[1])
        highest = np.take(self._basis[0], q.argmax(axis=0), axis=0)
        lowest = np.take(self._basis[0], q.argmin(axis=0), axis=0)
        gradients = [(highest - lowest) / 2]
        for rates, basis in ((qd, self._basis[1]), (qdd, self._basis[2])):
            peak = np.abs(rates).argmax(axis=0)
            gradients.append(np.sign(rates[peak, joints])[:, None] * basis[peak])
        return self._overshoot * np.stack(gradients), (highest + lowest) / 2
