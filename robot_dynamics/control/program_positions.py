"""Joint positions as the compiled programs take them: of robots with loops all joints, the loops closed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.constraints.topology import build_topology

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.dynamics import Dynamics


LONGEST_DISTANCE = 0.05
"""Longest distance of the independent joints [rad or characteristic lengths] without a path: at the end of
a longer one Newton's method may find another assembly mode."""


class ProgramPositions:
    """Closes the loops of a robot from call to call, so that it stays in its assembly mode.

    Parameters
    ----------
    dynamics : Dynamics

    Attributes
    ----------
    indices : ndarray, shape (n,)
        Places of Dynamics.joint_names in positions as the programs take them.
    measured, reference : ndarray, shape (all joints,)
        Positions of the last measured state and of the last reference; nan where nothing is known. They are seeds of
        the closure.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        self._dynamics = dynamics
        self._has_loops = bool(dynamics.robot.loops)
        if self._has_loops:
            dynamics.compile("closure")  # now: later it would be compiled while efforts are due
        numbers = {name: number for number, name in enumerate(dynamics.all_joint_names)}
        self._independent = [numbers[name] for name in dynamics.joint_names]
        self._dependent = [numbers[name] for name in dynamics.dependent_joint_names]
        if self._has_loops:
            self._units = build_topology(dynamics.robot).joint_units[self._independent]
        joint_count = len(dynamics.joint_names)
        self.indices: IntArray = np.array(self._independent) if self._has_loops else np.arange(joint_count)
        self.measured = np.full(len(dynamics.robot.joints), np.nan)
        self.reference = np.full(len(dynamics.robot.joints), np.nan)

    def continue_from(self, before: ProgramPositions) -> None:
        """Take over the seeds of the positions that were in use before, if the number of joints is the same."""
        if len(before.measured) == len(self.measured):
            self.measured[:] = before.measured
            self.reference[:] = before.reference

    def at_state(self, q: Array, dependent_positions: Array) -> Array:
        """Program positions at the measured positions q (n,).

        dependent_positions: measured ones of the dependent joints, nan where they are unknown.
        """
        if not self._has_loops:
            return q
        is_known = np.isfinite(dependent_positions)
        self.measured[self._dependent] = np.where(is_known, dependent_positions, self.measured[self._dependent])
        if is_known.any():  # the independent joints are not where they were, but where they are measured
            self.measured[self._independent] = np.nan
        return self._close(q, self.measured)

    def at_reference(self, q: Array) -> Array:
        """Program positions at the reference positions q (n,); a buffer of a robot with loops."""
        return self._close(q, self.reference) if self._has_loops else q

    def at_references(self, q: Array) -> Array:
        """Program positions (nodes, m) at reference positions q (nodes, n)."""
        if not self._has_loops:
            return q
        closed = np.empty((len(q), len(self.reference)))
        for node, positions in enumerate(q):
            # equal positions are closed once: rates at rest are then exactly zero
            is_same = node and np.array_equal(positions, q[node - 1])
            closed[node] = closed[node - 1] if is_same else self._close(positions, self.reference)
        return closed

    def close_again(self, positions: Array) -> Array:
        """Program positions (nodes, m) with the loops closed again at their independent joints."""
        return np.array([self._close(row[self._independent], self.reference).copy() for row in positions])

    def _close(self, q: Array, seeds: Array) -> Array:
        """Positions (all joints,) for q (n,), closed from the seeds (all joints,), which they replace."""
        distance = (np.abs(q - seeds[self._independent]) / self._units).max(initial=0.0)  # nan where nothing is known
        if distance > LONGEST_DISTANCE:
            seeds[:] = self._dynamics.expand_positions(q, previous=seeds)
        else:
            positions = seeds.copy()
            positions[self._independent] = q
            seeds[:] = self._dynamics.expand_positions(positions)
        return seeds
