"""Trajectories that show the parameters of a robot: Fourier series of joint positions, within limits, after which the
columns of its efforts are as independent as can be (Swevers et al., "Optimal robot excitation and identification",
1997). They begin and end at rest, without acceleration. Gradients are exact, by the program of the regressor.
"""

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, null_space
from scipy.optimize import minimize

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.identification.condition_number import LogConditionNumber
from robot_dynamics.identification.motion_samples import position_bounds

GRID_POINTS_PER_HARMONIC = 20  # points of the grid for each harmonic, on which limits are kept
SAMPLES_PER_HARMONIC = 12  # of the columns whose condition number is asked for
INITIAL_TRAJECTORIES = 40  # random trajectories, of which the best is improved
ITERATIONS = 50
EVALUATIONS_PER_ITERATION = 1.3
FRICTION_SMOOTHING = 0.1  # part of the rates over which Coulomb friction changes its sign, for the gradient


@dataclass(frozen=True, eq=False)
class JointBounds:
    """lower, upper (n,) positions, velocity, acceleration (n,) in absolute value, infinite where none is known."""

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


@dataclass(frozen=True, eq=False)
class FourierTrajectory:
    """q_j(t) = middle_j + Σ_k cosines_jk cos(k ω t) + sines_jk sin(k ω t), ω = 2π / duration: one period.

    middle (n,); cosines, sines (n, harmonics) [rad or m].
    """

    duration: float
    middle: np.ndarray
    cosines: np.ndarray
    sines: np.ndarray

    def __call__(self, times):
        """Positions, velocities and accelerations (N, n) at times (N,) [s]."""
        coefficients = np.concatenate([self.cosines, self.sines], axis=1).T
        q, qd, qdd = (part @ coefficients for part in fourier_basis(times, self.duration, self.cosines.shape[1]))
        return self.middle + q, qd, qdd


def fourier_basis(times, duration, harmonics):
    """(3, N, 2 harmonics): what [cosines, sines] (2 harmonics,) are multiplied by for position, velocity and
    acceleration at times (N,) of a FourierTrajectory."""
    rates = 2 * np.pi / duration * np.arange(1, harmonics + 1)
    angles = np.multiply.outer(times, rates)
    c, s = np.cos(angles), np.sin(angles)
    return np.stack([np.hstack([c, s]), np.hstack([-s * rates, c * rates]), -np.hstack([c, s]) * np.tile(rates**2, 2)])


def joint_bounds(dynamics, acceleration=np.inf, margin=0.05):
    """The JointBounds that the description of the robot of a Dynamics tells, less a margin of each range.

    acceleration: [rad/s² or m/s²] of every joint, of which descriptions tell nothing. A joint without limits may go
    half a turn or 1 m to either side. Raises QuestionError.
    """
    if not 0 <= margin < 0.5:
        raise InvalidInputError(f"margin {margin:g}: a part of the range of a joint, 0 to 0.5, is needed")
    joints = [dynamics.robot.joints[dynamics.robot.joint_numbers[name]] for name in dynamics.joint_names]
    lower, upper = np.array([position_bounds(joint) for joint in joints]).T
    rates = np.array([joint.limits.velocity for joint in joints])
    rates = np.where(np.isfinite(rates) & (rates > 0), rates, np.inf)
    room = margin * (upper - lower)
    return JointBounds(lower + room, upper - room, (1 - margin) * rates, np.full(len(joints), float(acceleration)))


class TrajectoryScaling(NamedTuple):
    """How numbers of a TrajectoryFamily become trajectories of n joints, c = 2 harmonics coefficients each.

    place, largeness (n,): the first two numbers; coefficients (n, c) before they are scaled; scale (n,); room (n,) that
    is left for the middle; centre (n,) of positions; peaks (3, n): largest position from the centre, velocity and
    acceleration, between points of the grid too, before scaling; rows (3, n, c): their derivatives by coefficients;
    middle_row (n, c): those of the centre; narrowest (n,): which of the three bounds scales.
    """

    middle_parameter: np.ndarray
    size_parameter: np.ndarray
    coefficients: np.ndarray
    scale: np.ndarray
    room: np.ndarray
    centre: np.ndarray
    peaks: np.ndarray
    peak_gradients: np.ndarray
    centre_gradient: np.ndarray
    active_bound: np.ndarray


class TrajectoryParametrization:
    """Trajectories within JointBounds, by numbers without bounds: (n, 2 harmonics) of any size, flattened.

    Of each joint the first number says where in the room that is left its middle is, the second how large the motion is
    of what is allowed, the others its shape, among those that begin and end at rest.
    """

    def __init__(self, bounds, duration, harmonics):
        if harmonics < 2 or not duration > 0:
            raise InvalidInputError(
                f"{harmonics} harmonics in {duration:g} s: at least 2, and more than 0 s, are needed"
            )
        self.bounds, self.duration, self.harmonics = bounds, duration, harmonics
        numbers = np.arange(1, harmonics + 1)
        self._shapes = block_diag(null_space(numbers[None] ** 2.0), null_space(numbers[None] * 1.0))
        points = GRID_POINTS_PER_HARMONIC * harmonics
        self._parts = fourier_basis(np.arange(points) * duration / points, duration, harmonics)
        # what a trigonometric polynomial of this degree can be more between the points of the grid (Ehlich and Zeller)
        self._beyond = 1 / np.cos(np.pi * harmonics / points)
        self.size = len(bounds.lower) * (2 + 2 * (harmonics - 1))

    def random(self, chance):
        """Numbers of a random trajectory, as large as bounds allow."""
        numbers = chance.normal(size=(len(self.bounds.lower), self.size // len(self.bounds.lower)))
        numbers[:, 1] = 2.0
        return numbers.ravel()

    def __call__(self, numbers):
        """The FourierTrajectory of numbers."""
        fit = self._fitted(numbers)
        middle = (
            (self.bounds.lower + self.bounds.upper) / 2
            + fit.room * np.tanh(fit.middle_parameter)
            - fit.scale * fit.centre
        )
        scaled = fit.scale[:, None] * fit.coefficients
        return FourierTrajectory(self.duration, middle, scaled[:, : self.harmonics], scaled[:, self.harmonics :])

    def _fitted(self, numbers):
        """The Fit of numbers to the bounds."""
        bounds = self.bounds
        place, size_parameter, *shape = numbers.reshape(len(bounds.lower), -1).T
        coefficients = np.array(shape).T @ self._shapes.T
        q, qd, qdd = self._parts @ coefficients.T
        joints = np.arange(q.shape[1])
        top, bottom = (np.take(self._parts[0], most, axis=0) for most in (q.argmax(axis=0), q.argmin(axis=0)))
        fastest = np.abs(qd).argmax(axis=0), np.abs(qdd).argmax(axis=0)
        signs = [np.sign(rates[most, joints]) for rates, most in zip((qd, qdd), fastest, strict=True)]
        # of each joint what multiplies its coefficients to give the largest position, velocity and acceleration
        peak_gradients = np.stack([(top - bottom) / 2, *(sign[:, None] * part[most]
                         for sign, part, most in zip(signs, self._parts[1:], fastest, strict=True))])  # fmt: skip
        peak_gradients = self._beyond * peak_gradients
        peaks = np.einsum("kjc,jc->kj", peak_gradients, coefficients) + 1e-300
        half = (bounds.upper - bounds.lower) / 2
        allowed = np.stack([half / peaks[0], bounds.velocity / peaks[1], bounds.acceleration / peaks[2]])
        active_bound = allowed.argmin(axis=0)
        scale = allowed[active_bound, joints] / (1 + np.exp(-size_parameter))
        centre_gradient = (top + bottom) / 2
        centre = np.einsum("jc,jc->j", centre_gradient, coefficients)
        return TrajectoryScaling(place, size_parameter, coefficients, scale, half - scale * peaks[0], centre, peaks, peak_gradients, centre_gradient,
                   active_bound)  # fmt: skip

    def gradient(self, numbers, by_motion, times):
        """(size,) derivatives by numbers, of what has derivatives `by_motion` by positions, velocities and
        accelerations (N, n) at times (N,) of their trajectory."""
        fit, joints = self._fitted(numbers), np.arange(len(self.bounds.lower))
        by_middle = by_motion[0].sum(axis=0)
        parts = fourier_basis(times, self.duration, self.harmonics)
        by_scaled = sum(rates.T @ part for rates, part in zip(by_motion, parts, strict=True))
        way = np.tanh(fit.middle_parameter)
        by_place = fit.room * (1 - way**2) * by_middle
        by_scale = (by_scaled * fit.coefficients).sum(axis=1) - (fit.peaks[0] * way + fit.centre) * by_middle
        by_largeness = by_scale * fit.scale / (1 + np.exp(fit.size_parameter))
        by_peaks = np.zeros_like(fit.peaks)
        by_peaks[0] = -fit.scale * way * by_middle
        by_peaks[fit.active_bound, joints] -= by_scale * fit.scale / fit.peaks[fit.active_bound, joints]
        by_coefficients = fit.scale[:, None] * (by_scaled - by_middle[:, None] * fit.centre_gradient)
        by_coefficients += np.einsum("kj,kjc->jc", by_peaks, fit.peak_gradients)
        return np.column_stack([by_place, by_largeness, by_coefficients @ self._shapes]).ravel()


class Excitation(NamedTuple):
    """trajectory: a FourierTrajectory; condition: number of its columns; iterations: done; complete: whether no time
    limit ended them."""

    trajectory: FourierTrajectory
    condition: float
    iterations: int
    complete: bool


def design_excitation(columns, bounds, *, duration=20.0, harmonics=5, iterations=ITERATIONS, seed=0,
                        time_limit=np.inf, on_estimate=None, on_iteration=None):  # fmt: skip
    """The Excitation with the least condition number that BFGS makes of random trajectories, for EffortColumns within
    JointBounds. The same for a seed, where no time limit ends it.

    time_limit [s]: after which the best trajectory so far is taken; estimated: called once with the time [s] that all
    iterations will take, when it is known; told: called with (iterations done, condition number) after each.

    Raises QuestionError.
    """
    _refuse_undesignable(columns.dynamics)
    family = TrajectoryParametrization(bounds, duration, harmonics)
    samples = SAMPLES_PER_HARMONIC * harmonics
    search = _Search(
        columns, family, np.arange(samples) * duration / samples, time.monotonic() + time_limit, on_iteration
    )
    chance = np.random.default_rng(seed)
    try:
        beginnings = search.ordered([family.random(chance) for _ in range(INITIAL_TRAJECTORIES)])
        search.smooth(beginnings[0])
        if on_estimate is not None:
            on_estimate(EVALUATIONS_PER_ITERATION * iterations * search.seconds_of(beginnings[0]))
        for numbers in beginnings:  # another one where a search ends before its time
            if search.iterations < iterations:
                search.improve(numbers, iterations - search.iterations)
    except _TimeOver:
        return Excitation(family(search.best), float(np.exp(search.value)), search.iterations, False)
    return Excitation(family(search.best), float(np.exp(search.value)), search.iterations, True)


def _refuse_undesignable(dynamics):
    """Raise QuestionError for a robot that trajectories are not designed for."""
    robot, unactuated = dynamics.robot, dynamics.unactuated_joint_names
    if robot.loops or robot.moving_base:
        raise InvalidInputError(f"{robot.name!r}: trajectories are designed for a fixed base without loops")
    if unactuated:
        raise InvalidInputError(f"{robot.name!r}: no motor drives {', '.join(unactuated)}: trajectories are designed for "
                            "robots all joints of which have motors")  # fmt: skip


class _TimeOver(Exception):
    """The time limit of a search is over."""


class _Search:
    """A search for numbers of a TrajectoryFamily with the least condition number at times (N,) of EffortColumns.

    best, value: the numbers so far, and the logarithm of their condition number; iterations: done. It ends with
    _TimeOver after `deadline` [s] of the monotonic clock.
    """

    def __init__(self, columns, family, times, deadline, on_iteration):
        self.model, self.family, self.times, self.deadline, self.on_iteration = (
            columns,
            family,
            times,
            deadline,
            on_iteration,
        )
        self.best, self.value, self.iterations = None, np.inf, 0
        self._exact = LogConditionNumber(columns)
        self._smooth = None

    def ordered(self, beginnings):
        """The beginnings, the best one first."""
        return [beginnings[place] for place in np.argsort([self.tried(numbers) for numbers in beginnings])]

    def tried(self, numbers):
        """The logarithm of the condition number of numbers, kept where it is the best."""
        value = self._exact(*self.family(numbers)(self.times))
        if self.best is None or value < self.value:
            self.best, self.value = numbers.copy(), value
        self._look_at_the_clock()
        return value

    def smooth(self, numbers):
        """Let Coulomb friction change its sign over a part of the rates that numbers have."""
        rates = np.sqrt((self.family(numbers)(self.times)[1] ** 2).mean(axis=0))
        self._smooth = LogConditionNumber(self.model, FRICTION_SMOOTHING * rates)

    def seconds_of(self, numbers):
        """The time [s] that one evaluation takes."""
        began = time.perf_counter()
        self._evaluated(numbers)
        return time.perf_counter() - began

    def improve(self, numbers, iterations):
        """So many iterations of BFGS, or fewer, from numbers."""
        minimize(self._evaluated, numbers, jac=True, method="BFGS", callback=self._after,
                 options={"maxiter": iterations})  # fmt: skip

    def _evaluated(self, numbers):
        """(value, gradient (size,)) with friction smoothed."""
        self._look_at_the_clock()
        value, by_motion = self._smooth.with_gradient(*self.family(numbers)(self.times))
        return value, self.family.gradient(numbers, by_motion, self.times)

    def _after(self, numbers):
        """What is to be done after an iteration that came to numbers."""
        self.iterations += 1
        self.tried(numbers)
        if self.on_iteration is not None:
            self.on_iteration(self.iterations, float(np.exp(self.value)))

    def _look_at_the_clock(self):
        if time.monotonic() > self.deadline:
            raise _TimeOver
