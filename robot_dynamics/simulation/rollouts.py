"""Rollouts: many simulations of one robot from different states and with different efforts."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.array_checks import require_finite
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.simulation.compiled_steps import RECORDED_STEPS
from robot_dynamics.simulation.simulation import Simulation

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.simulation.simulation_state import SimulationState


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
        Called with the part that is done, from 0 to 1, after every %d steps.

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
    samples = np.broadcast_shapes(q.shape[:-1], qd.shape[:-1], u.shape[:-2], (1,))[0]
    steps = u.shape[-2]
    q, qd = np.broadcast_to(q, (samples, size)), np.broadcast_to(qd, (samples, size))
    runner = _Runner(simulation, q, qd, threads or len(os.sched_getaffinity(0)))
    recorded = np.empty((2, samples, steps + 1, size))
    recorded[0, :, 0], recorded[1, :, 0] = q, qd
    for first in range(0, steps, RECORDED_STEPS):
        end = min(first + RECORDED_STEPS, steps)
        part_of_efforts = np.broadcast_to(u[..., first:end, :], (samples, end - first, size))
        recorded[:, :, first + 1 : end + 1] = runner.advance(part_of_efforts)
        if progress is not None:
            progress(end / steps)
    return Rollouts(step * np.arange(steps + 1), recorded[0], recorded[1])


class _Runner:
    """The present states of all simulations, and a Simulation for steps that the machine code leaves to Python."""

    def __init__(self, simulation: Simulation, q: Array, qd: Array, threads: int) -> None:
        self._simulation = simulation
        self._threads = threads
        self._states: list[SimulationState] = []
        for positions, velocities in zip(q, qd, strict=True):
            simulation.start(positions, velocities)
            self._states.append(simulation.state)

    def advance(self, efforts: Array) -> Array:
        """Positions and velocities (2, N, K, n) after each of K steps with efforts (N, K, n)."""
        recorded = np.empty((2, *efforts.shape))
        groups: dict[tuple[int, ...] | None, list[int]] = {}
        for sample, state in enumerate(self._states):
            independent = None if state.coordinates is None else state.coordinates.independent
            groups.setdefault(independent, []).append(sample)
        for independent, samples in groups.items():
            program = self._simulation.step_program(independent)
            done = np.zeros(len(samples), dtype=bool)
            if program is not None:
                done = self._advance_together(program, np.array(samples), efforts, recorded)
            for sample in np.array(samples)[~done]:
                self._advance_alone(sample, efforts[sample], recorded[:, sample])
        return recorded

