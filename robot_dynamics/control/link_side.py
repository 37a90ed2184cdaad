"""The link side of series elastic actuators: loads of the springs, and the motion of the links at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.control.deflection_solver import DeflectionSolver

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray
    from robot_dynamics.control.law_models import LawModels
    from robot_dynamics.control.program_positions import ProgramPositions
    from robot_dynamics.control.series_elastic_actuators import SeriesElasticActuators
    from robot_dynamics.dynamics import Dynamics

REST_ITERATIONS = 10
"""Iterations of the deflections of a robot at rest."""


class LinkSide:
    """Motions and loads of a robot with series elastic actuators, for references of its links.

    Parameters
    ----------
    dynamics : Dynamics
    joint_indices : ndarray, shape (joints,)
        Indices of the joints that get efforts in Dynamics.joint_names.
    actuators : SeriesElasticActuators
    models : LawModels
    positions : ProgramPositions
    q, qd : ndarray, shape (n,)
        The measured state, buffers.

    Attributes
    ----------
    solver : DeflectionSolver
    """

    def __init__(
        self,
        dynamics: Dynamics,
        joint_indices: IntArray,
        actuators: SeriesElasticActuators,
        models: LawModels,
        positions: ProgramPositions,
        q: Array,
        qd: Array,
    ) -> None:
        self._joint_indices = joint_indices
        self._actuators = actuators
        self._models = models
        self._positions = positions
        self._q = q
        self._qd = qd
        self._has_loops = bool(dynamics.robot.loops)
        unactuated = [dynamics.joint_names.index(name) for name in dynamics.unactuated_joint_names]
        self._unactuated: IntArray = np.setdiff1d(unactuated, actuators.springs).astype(np.intp)
        self.solver = DeflectionSolver(actuators, self._place_links, self._spring_loads, len(joint_indices))

    def link_motion(self, is_measured: BoolArray) -> Array:
        """Positions and velocities (2, joints) of the links beyond springs, of motors elsewhere.

        is_measured: (springs,) whether the position of a spring is measured; otherwise its deflection is that of a
        robot at rest at the positions of its motors.
        """
        actuators = self._actuators
        motion = np.stack([self._q[self._joint_indices], self._qd[self._joint_indices]])
        motors = motion[0, actuators.motors].copy()
        deflections = np.where(is_measured, self._q[actuators.springs] - actuators.rest, 0.0)
        motion[1, actuators.motors] += np.where(is_measured, self._qd[actuators.springs], 0.0)
        samples = np.zeros((1, 3, len(self._joint_indices)))
        for _ in range(0 if is_measured.all() else REST_ITERATIONS):
            samples[0, 0] = motion[0]
            samples[0, 0, actuators.motors] = motors + deflections
            rest_deflections = np.zeros((1, 3, len(motors)))
            rest_deflections[0, 0] = deflections
            loads = self._spring_loads(self._place_links(samples), samples, rest_deflections)[0]
            deflections = np.where(is_measured, deflections, -loads / actuators.stiffness)
        motion[0, actuators.motors] = motors + deflections
        return motion

    def _place_links(self, samples: Array) -> Array:
        """Program positions (nodes, m) for samples (nodes, 3, joints) of the links; springs are at rest."""
        q = np.tile(self._q, (len(samples), 1))
        q[:, self._joint_indices] = samples[:, 0]
        q[:, self._actuators.springs] = self._actuators.rest
        return self._positions.at_references(q)

    def _spring_loads(self, positions: Array, samples: Array, deflections: Array) -> Array:
        """The rows (nodes, springs) of the springs in the inverse model, for motions of the links.

        positions: of `_place_links`; samples: (nodes, 3, joints); deflections: (nodes, 3, springs) of the springs, by
        which the motors stay behind the links. Other joints stay at their positions, and unactuated ones keep their
        velocities.
        """
        actuators = self._actuators
        motors, springs = self._joint_indices[actuators.motors], actuators.springs
        velocities = np.zeros((len(samples), len(self._q)))
        accelerations = np.zeros((len(samples), len(self._q)))
        velocities[:, self._unactuated] = self._qd[self._unactuated]
        velocities[:, self._joint_indices] = samples[:, 1]
        accelerations[:, self._joint_indices] = samples[:, 2]
        link_velocities = velocities.copy()  # with these the rates of passive joints of loops at rest are exactly zero
        positions = positions.copy()
        indices = self._positions.indices
        _deflect(positions, indices[motors], indices[springs], deflections[:, 0])
        _deflect(velocities, motors, springs, deflections[:, 1])
        _deflect(accelerations, motors, springs, deflections[:, 2])
        if self._has_loops and not actuators.has_unbranched_motor_links:
            positions = self._positions.close_again(positions)
            link_velocities = velocities
        loads = np.empty((len(samples), len(springs)))
        for node, q in enumerate(positions):
            loads[node] = self._models.inverse(q, velocities[node], accelerations[node])[springs]
            friction = self._models.friction(q, link_velocities[node]) if self._has_loops else None
            if friction is not None:
                loads[node] += friction[springs]
        return loads


def _deflect(values: Array, motors: IntArray, springs: IntArray, deflections: Array) -> None:
    """Shift values (nodes, m) from the motors to the springs by deflections (nodes, springs)."""
    values[:, motors] -= deflections
    values[:, springs] += deflections
