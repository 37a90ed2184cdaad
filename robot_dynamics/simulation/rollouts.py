"""Rollouts: many simulations of one robot from different states and with different efforts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.array_checks import require_finite
from robot_dynamics.codegen.jit.threads import available_processors
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.model.robot import Robot
from robot_dynamics.notebook_display import notebook_html
from robot_dynamics.simulation.distributed_rollouts import distribute_rollouts
from robot_dynamics.simulation.rollout_runner import RolloutRunner
from robot_dynamics.simulation.simulation import Simulation
from robot_dynamics.simulation.step_limits import RECORDED_STEPS
from robot_dynamics.simulation.varied_inertias import VariedInertias, compare_inertias

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike

NOTHING_VARIED = VariedInertias((), np.zeros((1, 0)))

DEFAULT_STEP = 0.001
"""Length of a step [s]."""


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

    def _repr_html_(self) -> str | None:
        return notebook_html(self)


def simulate(
    robot: Robot | Simulation | Sequence[Robot],
    positions: ArrayLike,
    velocities: ArrayLike,
    efforts: ArrayLike,
    *,
    step: float | None = None,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: Callable[[float], object] | None = None,
) -> Rollouts:
    """Simulate a robot on a fixed base from many states, with the efforts of each step.

    Parameters
    ----------
    robot : Robot, Simulation or sequence of N Robot
        The programs of a Simulation are used again: pass one where `simulate` is called often. It keeps its state, but
        no other thread may use it at the same time. Several robots, one for each simulation, may differ in the inertias
        of their links, as with a payload of its own (Robot.with_payload).
    positions, velocities : array_like, shape (N, n) or (n,)
        Initial states of the joints of Dynamics.joint_names [rad or m; rad/s or m/s].
    efforts : array_like, shape (N, T, n) or (T, n)
        Efforts [N m or N], held during each of T steps.
    step : float, optional
        Length of a step [s]; by default 0.001, or that of the Simulation.
    threads : int, optional
        Threads that share the work; by default as many as the process has processors. With an executor: threads of
        each task, by default 1.
    executor : concurrent.futures.Executor, optional
        Its processes simulate, as those of a Dask cluster (``distributed.Client(address).get_executor(pure=False)``).
        By default this process does.
    progress : callable, optional
        Called with the part that is done, from 0 to 1: every 50 steps (RECORDED_STEPS); with an executor after every
        task.

    Returns
    -------
    Rollouts

    Raises
    ------
    InvalidInputError
        An argument does not fit the robot, its base moves, or several robots differ in more than inertias.
    SimulationError, SingularModelError
        As Simulation.advance. The message begins with the number of the simulation, from 0. Nothing is returned of the
        others.

    Notes
    -----
    Steps run in machine code, several simulations in each vector of the processor, as far as those of Simulation do: a
    step that machine code does not take runs in Python, and later ones in machine code again. If `robot` is a
    Simulation, its attribute `python_steps` counts such steps.

    Each simulation computes what a Simulation does from the same state, to rounding. The results do not depend on the
    number of threads, nor on the other simulations, nor on the executor if its processors have the same instructions.
    Of several robots the inertias of the first decide whether viscous friction is so strong that it acts as impulses.
    """
    if threads is not None and (not isinstance(threads, int | np.integer) or threads < 1):
        raise InvalidInputError(f"threads is {threads!r:.60}: it must be a positive number of threads")
    template, robots = _split_robots(robot)
    simulation = _get_simulation(template, step)
    if simulation.base != "fixed":
        raise InvalidInputError(f"{simulation.robot.name!r} has a moving base: simulate it with Simulation, one by one")
    q, qd, u = _read_inputs(simulation, len(robots) or 1, positions, velocities, efforts)
    times = simulation.step * np.arange(u.shape[-2] + 1)
    varied = compare_inertias(robots) if len(robots) > 1 else NOTHING_VARIED
    if executor is not None:
        _require_executor(executor)
        task = partial(_simulate_range, simulation.robot, simulation.step, threads or 1, varied.links)
        inertias = np.broadcast_to(varied.values, (len(q), varied.values.shape[1]))
        return Rollouts(times, *distribute_rollouts(executor, task, q, qd, u, inertias, progress))
    return Rollouts(times, *_record(simulation, varied, q, qd, u, threads or available_processors(), 0, progress))


def _record(
    simulation: Simulation,
    varied: VariedInertias,
    q: Array,
    qd: Array,
    u: Array,
    threads: int,
    first_number: int,
    progress: Callable[[float], object] | None,
) -> Array:
    """Positions and velocities (2, N, T + 1, n) of N simulations, in this process."""
    samples, size = q.shape
    steps = u.shape[-2]
    runner = RolloutRunner(simulation, varied if varied.links else None, q, qd, threads, first_number)
    recorded = np.empty((2, samples, steps + 1, size))
    recorded[0, :, 0], recorded[1, :, 0] = q, qd
    for first in range(0, steps, RECORDED_STEPS):
        end = min(first + RECORDED_STEPS, steps)
        part_of_efforts = np.broadcast_to(u[..., first:end, :], (samples, end - first, size))
        runner.advance(part_of_efforts, recorded[:, :, first + 1 : end + 1])
        if progress is not None:
            progress(end / steps)
    return recorded


def _simulate_range(
    robot: Robot,
    step: float,
    threads: int,
    varied_links: tuple[int, ...],
    first_number: int,
    q: Array,
    qd: Array,
    efforts: Array,
    inertias: Array,
) -> Array:
    """Positions and velocities (2, M, T + 1, n) of M simulations, in the process of a task."""
    varied = VariedInertias(varied_links, inertias)
    return _record(Simulation(robot, step=step), varied, q, qd, efforts, threads, first_number, None)


def _require_executor(executor: object) -> None:
    if not isinstance(executor, Executor):
        raise InvalidInputError(
            f"executor is {executor!r:.60}: it must be an Executor of concurrent.futures; that of a Dask client is "
            "client.get_executor(pure=False)"
        )


def _split_robots(robot: object) -> tuple[Robot | Simulation, Sequence[Robot]]:
    """The robot or the Simulation, and no others; or the first of several robots, and all of them."""
    if isinstance(robot, Robot | Simulation):
        return robot, ()
    robots = list(robot) if isinstance(robot, Iterable) else []
    if not robots or not all(isinstance(entry, Robot) for entry in robots):
        raise InvalidInputError(f"robot is {robot!r:.60}: it must be a Robot, a Simulation, or several Robots")
    return robots[0], robots


def _get_simulation(robot: Robot | Simulation, step: float | None) -> Simulation:
    """The Simulation that has the programs."""
    if not isinstance(robot, Simulation):
        return Simulation(robot, step=DEFAULT_STEP if step is None else step)
    if step is not None and step != robot.step:
        raise InvalidInputError(f"step is {step!r:.60}, and the Simulation has steps of {robot.step:g} s")
    if robot.ground is not None:
        raise InvalidInputError("the Simulation has a ground: simulate takes robots without ground contact")
    return Simulation(robot.robot, step=robot.step) if robot.stepping.takes_wrenches else robot


def _read_inputs(
    simulation: Simulation, robots: int, positions: ArrayLike, velocities: ArrayLike, efforts: ArrayLike
) -> tuple[Array, Array, Array]:
    """Positions (N, n), velocities (N, n) and efforts (N, T, n) or (T, n) of `simulate`, checked."""
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
        (samples,) = np.broadcast_shapes(q.shape[:-1], qd.shape[:-1], u.shape[:-2], (robots,))
    except ValueError:
        raise InvalidInputError(
            f"positions {q.shape}, velocities {qd.shape}, efforts {u.shape} and the number of robots, {robots}, are "
            "for different numbers of simulations"
        ) from None
    return np.broadcast_to(q, (samples, size)), np.broadcast_to(qd, (samples, size)), u
