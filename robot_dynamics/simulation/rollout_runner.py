"""The steps of many simulations: in machine code together, and by a Simulation where the machine code leaves them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import SimulationError, SingularModelError
from robot_dynamics.simulation.closed_starts import get_start_closure
from robot_dynamics.simulation.constrained_motion import LoopCoordinates
from robot_dynamics.simulation.simulation import Simulation
from robot_dynamics.simulation.time_stepping import NO_TWIST
from robot_dynamics.simulation.varied_inertias import with_inertias

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray
    from robot_dynamics.simulation.constrained_motion import ConstrainedMotion
    from robot_dynamics.simulation.varied_inertias import VariedInertias

ROLLOUTS_PER_THREAD = 256
"""Rollouts of each thread in one call of machine code: what they record, some megabytes, stays in its cache."""


class RolloutRunner:
    """The present states of N simulations, and a Simulation for steps that the machine code leaves to Python.

    Parameters
    ----------
    simulation : Simulation
        Of the robot, or of the first one of several robots: then it is used here alone.
    varied : VariedInertias or None
        The inertias of each simulation; None where all have those of the robot.
    q, qd : ndarray, shape (N, n)
        Initial positions and velocities of the joints of Dynamics.joint_names.
    threads : int
    first_number : int
        Number of the first simulation in errors.

    Raises
    ------
    SingularModelError
        The loops do not close somewhere.
    """

    def __init__(
        self,
        simulation: Simulation,
        varied: VariedInertias | None,
        q: Array,
        qd: Array,
        threads: int,
        first_number: int = 0,
    ) -> None:
        self._stepping = simulation.stepping
        self._simulation = simulation
        self._varied = varied
        self._simulations: dict[int, Simulation] = {}
        self._first_number = first_number
        if varied is not None:
            self._stepping.vary_inertias(varied.links)
        self._threads = threads
        self._steps = 0
        self._coordinates: list[LoopCoordinates | None] = [None] * len(q)
        self._positions, self._rates = q.copy(), qd.copy()
        if self._stepping.loops is not None:
            self._close_loops(self._stepping.loops, q, qd)

    def _close_loops(self, loops: ConstrainedMotion, q: Array, qd: Array) -> None:
        """Close the loops from positions and velocities (N, n) of Dynamics.joint_names."""
        stepping, dynamics = self._stepping, self._simulation.dynamics
        self._positions = np.empty((len(q), len(dynamics.all_joint_names)))
        done = np.zeros(len(q), dtype=bool)
        if stepping.is_recorded(LoopCoordinates(loops.default_independent, 1.0, 1.0)):
            done, self._positions, quality = get_start_closure(dynamics, loops).close(q, self._threads)
            self._coordinates = [LoopCoordinates(loops.default_independent, value, value) for value in quality.tolist()]
        for sample in np.flatnonzero(~done).tolist():
            rates = np.concatenate([NO_TWIST, qd[sample]])
            with self._named(sample):
                joint_positions = dynamics.expand_positions(q[sample])
                state = stepping.initial_state(np.eye(4), joint_positions, rates, has_base_motion=False)
            self._positions[sample], self._coordinates[sample] = state.joint_positions, state.coordinates

    def advance(self, efforts: Array, recorded: Array) -> None:
        """Take K steps with efforts (N, K, n); record positions and velocities (2, N, K, n) after each."""
        sets = {coordinates and coordinates.independent: coordinates for coordinates in self._coordinates}
        recorded_sets = [key for key, coordinates in sets.items() if self._stepping.is_recorded(coordinates)]
        is_recorded = [(coordinates and coordinates.independent) in recorded_sets for coordinates in self._coordinates]
        done = np.zeros(len(efforts), dtype=bool)
        samples = np.flatnonzero(is_recorded)
        rollouts_per_call = ROLLOUTS_PER_THREAD * self._threads
        for first in range(0, len(samples), rollouts_per_call):
            part = samples[first : first + rollouts_per_call]
            done[part] = self._advance_together(part, efforts, recorded)
        for sample in np.flatnonzero(~done).tolist():
            with self._named(sample):
                self._advance_alone(sample, efforts[sample], recorded[:, sample])
        self._steps += efforts.shape[1]

    @contextmanager
    def _named(self, sample: int) -> Iterator[None]:
        """Name a simulation in errors."""
        try:
            yield
        except (SimulationError, SingularModelError) as error:
            raise type(error)(f"simulation {self._first_number + sample}: {error}") from error

    def _advance_together(self, samples: IntArray, efforts: Array, recorded: Array) -> BoolArray:
        """(M,) whether the machine code took all steps of M simulations, of the N to which the arrays belong."""
        coordinates = [self._coordinates[sample] for sample in samples]
        run = self._stepping.record(
            self._positions[samples],
            self._rates[samples],
            efforts[samples],
            coordinates,
            self._threads,
            None if self._varied is None else self._varied.values[samples],
        )
        done = run.is_complete
        finished = samples[done]
        rows: IntArray | slice = finished
        taken: BoolArray | slice = done
        if len(finished) == samples[-1] - samples[0] + 1:  # slices copy once
            rows, taken = slice(samples[0], samples[-1] + 1), slice(None)
        recorded[0][rows] = run.positions[taken][..., self._stepping.joint_columns]
        recorded[1][rows] = run.rates[taken]
        self._positions[rows] = run.positions[taken, -1]
        self._rates[rows] = run.rates[taken, -1]
        for sample, end_coordinates in zip(finished, run.coordinates(coordinates, done), strict=True):
            self._coordinates[sample] = end_coordinates
        return done

    def _advance_alone(self, sample: int, efforts: Array, recorded: Array) -> None:
        """Steps of one simulation with efforts (K, n) by a Simulation; records them (2, K, n)."""
        simulation = self._simulation_of(sample)
        stepping = simulation.stepping
        coordinates = self._coordinates[sample]
        state_before = simulation.state
        try:
            simulation.state = stepping.state_at(self._steps, self._positions[sample], self._rates[sample], coordinates)
            for k, step_efforts in enumerate(efforts):
                state = simulation.advance(efforts=step_efforts)
                recorded[:, k] = state.positions, state.velocities
        finally:
            simulation.state = state_before
        self._positions[sample] = stepping.program_positions(state.joint_positions)
        self._rates[sample] = state.rates[6:]
        self._coordinates[sample] = state.coordinates

    def _simulation_of(self, sample: int) -> Simulation:
        """A Simulation of the robot of one simulation."""
        if self._varied is None:
            return self._simulation
        if sample not in self._simulations:
            robot = with_inertias(self._simulation.robot, self._varied, sample)
            self._simulations[sample] = Simulation(robot, step=self._simulation.step)
        return self._simulations[sample]
