"""Rollouts: many simulations of one robot from different states and with different efforts."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.array_checks import require_finite
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.simulation.simulation import Simulation
from robot_dynamics.simulation.step_limits import RECORDED_STEPS

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, BoolArray, IntArray
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.simulation.constrained_motion import LoopCoordinates


class Rollouts(NamedTuple):
    """Motions of N simulations of T steps.

    Attributes
    ----------
    times : ndarray, shape (T + 1,)
        Times of the states [s], the initial one first.
    positions, velocities : ndarray, shape (N, T + 1, n)
        Joints of Dynamics.joint_names [rad or m; rad/s or m/s].
    """

    times: Array
    positions: Array
    velocities: Array


def simulate(
    robot: Robot,
    positions: ArrayLike,
    velocities: ArrayLike,
    efforts: ArrayLike,
    *,
    step: float = 0.001,
    threads: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> Rollouts:
    """Simulate a robot on a fixed base from many states, with the efforts of each step.

    Parameters
    ----------
    robot : Robot
    positions, velocities : array_like, shape (N, n) or (n,)
        Initial states of the joints of Dynamics.joint_names [rad or m; rad/s or m/s].
    efforts : array_like, shape (N, T, n) or (T, n)
        Efforts [N m or N], held during each of T steps.
    step : float
        Length of a step [s].
    threads : int, optional
        Threads that share the work; by default as many as the process has processors.
    progress : callable, optional
        Called with the part that is done, from 0 to 1, after every RECORDED_STEPS steps.

    Returns
    -------
    Rollouts

    Raises
    ------
    InvalidInputError
        An argument does not fit the robot, or its base moves.
    SimulationError, SingularModelError
        As Simulation.advance.

    Notes
    -----
    Each simulation computes what a Simulation does from the same state. The results do not depend on the number of
    threads, nor on the other simulations.
    """
    if threads is not None and (not isinstance(threads, int | np.integer) or threads < 1):
        raise InvalidInputError(f"threads is {threads!r:.60}: it must be a positive number of threads")
    simulation = Simulation(robot, step=step)
    if simulation.base != "fixed":
        raise InvalidInputError(f"{robot.name!r} has a moving base: simulate it with Simulation, one by one")
    size = len(simulation.joint_names)
    q, qd, u = (
        require_finite(label, values, size, "joints")
        for label, values in (("positions", positions), ("velocities", velocities), ("efforts", efforts))
    )
    if q.ndim > 2 or qd.ndim > 2 or u.ndim not in (2, 3):
        raise InvalidInputError(
            f"positions and velocities must have the shape (N, {size}), and efforts (N, T, {size}) or (T, {size}), not "
            f"{q.shape}, {qd.shape} and {u.shape}"
        )
    try:
        (samples,) = np.broadcast_shapes(q.shape[:-1], qd.shape[:-1], u.shape[:-2], (1,))
    except ValueError:
        raise InvalidInputError(
            f"positions {q.shape}, velocities {qd.shape} and efforts {u.shape} are for different numbers of simulations"
        ) from None
    steps = u.shape[-2]
    q, qd = np.broadcast_to(q, (samples, size)), np.broadcast_to(qd, (samples, size))
    runner = _Runner(simulation, q, qd, threads or _processor_count())
    recorded = np.empty((2, samples, steps + 1, size))
    recorded[0, :, 0], recorded[1, :, 0] = q, qd
    for first in range(0, steps, RECORDED_STEPS):
        end = min(first + RECORDED_STEPS, steps)
        part_of_efforts = np.broadcast_to(u[..., first:end, :], (samples, end - first, size))
        recorded[:, :, first + 1 : end + 1] = runner.advance(part_of_efforts)
        if progress is not None:
            progress(end / steps)
    return Rollouts(step * np.arange(steps + 1), recorded[0], recorded[1])


def _processor_count() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Runner:
    """The present states of all simulations, and a Simulation for steps that the machine code leaves to Python.

    positions: (N, ...) as the programs take them; rates: (N, n); coordinates: those of the rates of each simulation.
    """

    def __init__(self, simulation: Simulation, q: Array, qd: Array, threads: int) -> None:
        self._stepping = simulation.stepping
        self._simulation = simulation
        self._threads = threads
        self._steps = 0
        self._coordinates: list[LoopCoordinates | None] = [None] * len(q)
        self._positions, self._rates = q.copy(), qd.copy()
        if simulation.robot.loops:
            states = []
            for positions, velocities in zip(q, qd, strict=True):
                simulation.start(positions, velocities)
                states.append(simulation.state)
            self._coordinates = [state.coordinates for state in states]
            self._positions = np.array([state.joint_positions for state in states])

    def advance(self, efforts: Array) -> Array:
        """Positions and velocities (2, N, K, n) after each of K steps with efforts (N, K, n)."""
        recorded = np.empty((2, *efforts.shape))
        done = np.zeros(len(efforts), dtype=bool)
        samples = np.array([k for k, own in enumerate(self._coordinates) if self._stepping.is_recorded(own)], dtype=int)
        if len(samples):
            done[samples] = self._advance_together(samples, efforts[samples], recorded)
        for sample in np.flatnonzero(~done):
            self._advance_alone(int(sample), efforts[sample], recorded[:, sample])
        self._steps += efforts.shape[1]
        return recorded

    def _advance_together(self, samples: IntArray, efforts: Array, recorded: Array) -> BoolArray:
        """(M,) whether the machine code took all steps of M simulations, with efforts (M, K, n); records those."""
        coordinates = [self._coordinates[sample] for sample in samples]
        run = self._stepping.record(self._positions[samples], self._rates[samples], efforts, coordinates, self._threads)
        done = run.is_complete
        recorded[0][samples[done]] = run.positions[done][..., self._stepping.joint_columns]
        recorded[1][samples[done]] = run.rates[done]
        self._positions[samples[done]] = run.positions[done, -1]
        self._rates[samples[done]] = run.rates[done, -1]
        for sample, own in zip(samples[done], run.coordinates(coordinates, done), strict=True):
            self._coordinates[sample] = own
        return done

    def _advance_alone(self, sample: int, efforts: Array, recorded: Array) -> None:
        """Steps of one simulation with efforts (K, n) by a Simulation; records them (2, K, n)."""
        simulation, stepping = self._simulation, self._stepping
        coordinates = self._coordinates[sample]
        simulation.reset(stepping.state_at(self._steps, self._positions[sample], self._rates[sample], coordinates))
        for k, step_efforts in enumerate(efforts):
            state = simulation.advance(efforts=step_efforts)
            recorded[:, k] = state.positions, state.velocities
        self._positions[sample], self._rates[sample] = stepping.program_positions(state), state.rates[6:]
        self._coordinates[sample] = state.coordinates
