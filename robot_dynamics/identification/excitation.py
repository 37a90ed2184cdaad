"""Design of excitation trajectories for identification.

An excitation trajectory is a Fourier series of joint positions within the joint bounds, for which the columns of the
identification model are as independent as possible (Swevers et al., "Optimal robot excitation and identification",
1997). It begins and ends at rest, with zero acceleration. Gradients are exact, from the program of the regressor.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import minimize

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.identification.condition_number import LogConditionNumber
from robot_dynamics.identification.fourier_trajectory import joint_bounds
from robot_dynamics.identification.trajectory_parametrization import TrajectoryParametrization

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.identification.fourier_trajectory import FourierTrajectory, JointBounds
    from robot_dynamics.identification.identification_model import IdentificationModel

__all__ = ["Excitation", "design_excitation", "joint_bounds"]

SAMPLES_PER_HARMONIC = 12  # samples of the columns whose condition number is minimised
INITIAL_TRAJECTORIES = 40  # random trajectories, of which the best one is improved
ITERATIONS = 50
EVALUATIONS_PER_ITERATION = 1.3
FRICTION_SMOOTHING = 0.1  # part of the RMS velocity over which Coulomb friction changes its sign, for the gradient


class Excitation(NamedTuple):
    """Result of the design of an excitation trajectory.

    Attributes
    ----------
    trajectory : FourierTrajectory
        The best trajectory.
    condition : float
        Condition number of the identification columns along the trajectory, each scaled to length 1.
    iterations : int
        Number of completed iterations.
    complete : bool
        False if the time limit ended the search.
    """

    trajectory: FourierTrajectory
    condition: float
    iterations: int
    complete: bool


def design_excitation(
    model: IdentificationModel,
    bounds: JointBounds,
    *,
    duration: float = 20.0,
    harmonics: int = 5,
    iterations: int = ITERATIONS,
    seed: int = 0,
    time_limit: float = np.inf,
    on_estimate: Callable[[float], object] | None = None,
    on_iteration: Callable[[int, float], object] | None = None,
) -> Excitation:
    """Design a trajectory that minimises the condition number of identification.

    Parameters
    ----------
    model : IdentificationModel
        Model to identify. The robot has a fixed base, no loops, and only actuated joints.
    bounds : JointBounds
        Bounds of the motion, such as those of `joint_bounds`.
    duration : float
        Period of the trajectory [s].
    harmonics : int
        Number of harmonics of the Fourier series, at least 2.
    iterations : int
        Maximum number of iterations of BFGS.
    seed : int
        Seed of the random initial trajectories. Equal seeds give equal results unless the time limit ends the search.
    time_limit : float
        Time [s] after which the best trajectory so far is returned.
    on_estimate : callable, optional
        Called once with the estimated time [s] of all iterations.
    on_iteration : callable, optional
        Called after each iteration with the number of iterations and the lowest condition number.

    Returns
    -------
    Excitation
        Trajectory with the lowest condition number.

    Raises
    ------
    InvalidInputError
        If the robot, its drives or the parameters of the series are not supported.

    Notes
    -----
    Source: Swevers et al., "Optimal robot excitation and identification" (1997).
    """
    _require_designable(model.dynamics)
    parametrization = TrajectoryParametrization(bounds, duration, harmonics)
    samples = SAMPLES_PER_HARMONIC * harmonics
    times = np.arange(samples) * duration / samples
    search = _Search(model, parametrization, times, time.monotonic() + time_limit, on_iteration)
    rng = np.random.default_rng(seed)
    try:
        candidates = search.rank([parametrization.random(rng) for _ in range(INITIAL_TRAJECTORIES)])
        search.smooth_friction(candidates[0])
        if on_estimate is not None:
            on_estimate(EVALUATIONS_PER_ITERATION * iterations * search.measure_evaluation(candidates[0]))
        for candidate in candidates:  # a search may converge early; the next candidate uses the remaining iterations
            if search.iterations < iterations:
                search.improve(candidate, iterations - search.iterations)
    except _TimeLimitReached:
        return search.result(complete=False)
    return search.result(complete=True)


def _require_designable(dynamics: Dynamics) -> None:
    """Raise InvalidInputError for robots that no trajectory can be designed for."""
    robot = dynamics.robot
    unactuated = dynamics.unactuated_joint_names
    if robot.loops or robot.moving_base:
        raise InvalidInputError(
            f"{robot.name!r}: excitation trajectories are designed for robots with a fixed base and without loops"
        )
    if unactuated:
        raise InvalidInputError(
            f"{robot.name!r}: no motor drives {', '.join(unactuated)}: excitation trajectories are designed for robots "
            "with only actuated joints"
        )


class _TimeLimitReached(Exception):
    """The time limit of a search is reached."""


class _Search:
    """Search for the parameters of a trajectory with the lowest condition number at times (N,).

    best: (size,) best parameters so far; value: logarithm of their condition number; iterations: number of completed
    iterations. Evaluations after `deadline` [s] of the monotonic clock raise _TimeLimitReached.
    """

    def __init__(
        self,
        model: IdentificationModel,
        parametrization: TrajectoryParametrization,
        times: Array,
        deadline: float,
        on_iteration: Callable[[int, float], object] | None,
    ) -> None:
        self.best: Array = np.zeros(parametrization.size)
        self.value = np.inf
        self.iterations = 0
        self._model = model
        self._parametrization = parametrization
        self._times = times
        self._deadline = deadline
        self._on_iteration = on_iteration
        self._exact = LogConditionNumber(model)
        self._smooth = self._exact

    def result(self, *, complete: bool) -> Excitation:
        """Return the best trajectory."""
        return Excitation(self._parametrization(self.best), float(np.exp(self.value)), self.iterations, complete)

    def rank(self, candidates: list[Array]) -> list[Array]:
        """Sort parameters by the condition number of their trajectories, lowest first."""
        return [candidates[index] for index in np.argsort([self._evaluate(candidate) for candidate in candidates])]

    def smooth_friction(self, parameters: Array) -> None:
        """Smooth the sign of Coulomb friction over a part of the RMS velocities of a trajectory."""
        _, qd, _ = self._parametrization(parameters)(self._times)
        self._smooth = LogConditionNumber(self._model, FRICTION_SMOOTHING * np.sqrt((qd**2).mean(axis=0)))

    def measure_evaluation(self, parameters: Array) -> float:
        """Measure the time [s] of one evaluation with gradient."""
        start = time.perf_counter()
        self._evaluate_with_gradient(parameters)
        return time.perf_counter() - start

    def improve(self, parameters: Array, iterations: int) -> None:
        """Run BFGS from parameters, for at most a number of iterations."""
        minimize(
            self._evaluate_with_gradient,
            parameters,
            jac=True,
            method="BFGS",
            callback=self._finish_iteration,
            options={"maxiter": iterations},
        )

    def _evaluate(self, parameters: Array) -> float:
        """Compute the logarithm of the condition number, and keep the parameters if they are the best."""
        value = self._exact(*self._parametrization(parameters)(self._times))
        if not np.isfinite(self.value) or value < self.value:
            self.best = parameters.copy()
            self.value = value
        self._check_deadline()
        return value

    def _evaluate_with_gradient(self, parameters: Array) -> tuple[float, Array]:
        """Compute the value and its gradient (size,) with smoothed friction."""
        self._check_deadline()
        value, motion_gradient = self._smooth.with_gradient(*self._parametrization(parameters)(self._times))
        return value, self._parametrization.gradient(parameters, motion_gradient, self._times)

    def _finish_iteration(self, parameters: Array) -> None:
        self.iterations += 1
        self._evaluate(parameters)
        if self._on_iteration is not None:
            self._on_iteration(self.iterations, float(np.exp(self.value)))

    def _check_deadline(self) -> None:
        if time.monotonic() > self._deadline:
            raise _TimeLimitReached
