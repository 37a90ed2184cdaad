"""A hint that a robot carries a load that its description lacks: residuals that are those of a body at its end.

A load from the first sample on is no fault that `fault_search` names, as nothing distinguishes it from an error of the
model. But where one body explains most of what a check finds wrong, it is the first thing to look at.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.robot import attach_payload

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.recordings.drives import Drives
    from robot_dynamics.recordings.joint_motions import Motion

STEP = 0.1  # [s] between the samples that are kept
MAX_SAMPLES = 4000  # kept; of longer recordings every second one is dropped
MIN_SAMPLES = 50
MIN_EXPLAINED = 0.8  # part of the squares of the residuals, beside a mean of each joint
MIN_MASS = 0.005  # of the mass of the moving links


class LoadHint:
    """Collects residuals, in bounded memory, and compares them with the efforts that a load on the last link needs."""

    def __init__(self, dynamics: Dynamics, drives: Drives) -> None:
        self._dynamics = dynamics
        self._shows_gravity = not drives.excludes_gravity and not dynamics.robot.moving_base
        self._step = STEP
        self._next_time = -np.inf
        self._states: list[Array] = []  # positions, velocities, accelerations
        self._residuals: list[Array] = []  # nan where a joint rests, or has no efforts

    def add(self, motion: Motion, predicted: Array, origin: int = 0) -> None:
        """Add a motion and its predicted efforts (N, n); origin is not used (the interface of `PieceCallback`)."""
        for row, time in enumerate(motion.times if self._shows_gravity else ()):
            if time < self._next_time:
                continue
            self._next_time = time + self._step
            counts = motion.moving[row] & motion.has_efforts
            self._states.append(np.stack([motion.q[row], motion.qd[row], motion.qdd[row]]))
            self._residuals.append(np.where(counts, motion.efforts[row] - predicted[row], np.nan))
        while len(self._states) > MAX_SAMPLES:
            self._halve()

    def append(self, later: LoadHint) -> None:
        """Add the residuals of a later part of the same recording."""
        while self._step < later._step:
            self._halve()
        while later._step < self._step:
            later._halve()
        self._states += later._states
        self._residuals += later._residuals
        while len(self._states) > MAX_SAMPLES:
            self._halve()

    def _halve(self) -> None:
        self._step *= 2
        self._states = self._states[::2]
        self._residuals = self._residuals[::2]

    def sentence(self, tolerances: Array) -> str:
        """The hint; empty where no load explains the residuals. tolerances: (n,) RMS that is tolerated."""
        if len(self._states) < MIN_SAMPLES:
            return ""
        robot = self._dynamics.robot
        link = last_link_name(robot)
        try:
            mass, explained = self._fit(link, tolerances)
        except RobotDynamicsError:  # a hint must not be the reason why there is no verdict
            return ""
        moving_mass = sum(each.inertia.mass for each in robot.links[1:])
        if explained < MIN_EXPLAINED or abs(mass) < MIN_MASS * moving_mass:
            return ""
        suspicion = "does the robot carry a load that the description lacks"
        if mass < 0:
            suspicion = "does the description have a load that the robot does not carry"
        return f"the residuals are like those of a load of {mass:+.2g} kg on {link} throughout: {suspicion}?"

    def _fit(self, link: str, tolerances: Array) -> tuple[float, float]:
        """Mass [kg] of the load that explains the residuals, and the part of their squares that it explains."""
        q, qd, qdd = np.swapaxes(self._states, 0, 1)
        residuals = np.array(self._residuals) / tolerances
        unloaded = self._dynamics.inverse(q, qd, qdd)
        effects = [loaded.inverse(q, qd, qdd) - unloaded for loaded in unit_payload_models(self._dynamics.robot, link)]
        columns = np.stack(effects, axis=-1) / tolerances[:, None]  # (N, n, 4)
        counts = np.isfinite(residuals)
        is_counted = counts[..., None]
        number = np.maximum(counts.sum(axis=0), 1)
        residuals = np.where(counts, residuals, 0.0)
        residuals = np.where(counts, residuals - residuals.sum(axis=0) / number, 0.0)
        columns = np.where(is_counted, columns, 0.0)
        columns = np.where(is_counted, columns - columns.sum(axis=0) / number[:, None], 0.0)
        A, b = columns.reshape(-1, 4), residuals.ravel()
        x = np.linalg.lstsq(A, b, rcond=1e-6)[0]
        squares = float(b @ b)
        return float(x[0]), 1 - float(np.square(b - A @ x).sum()) / squares if squares > 0 else 0.0


def unit_payload_models(robot: Robot, link: str) -> list[Dynamics]:
    """The Dynamics of a robot with payloads on a link: of 1 kg, and with a first moment of 1 kg m along x, y and z.

    Efforts are linear in the payload: their differences from those of the robot are the effects of its parameters.
    """
    payloads = [Inertia(1.0), *(Inertia(0.0, axis) for axis in np.eye(3))]
    return [Dynamics(attach_payload(robot, link, payload)) for payload in payloads]


def last_link_name(robot: Robot) -> str:
    """The name of the last frame that belongs to the last link, which may carry a load."""
    last = len(robot.links) - 1
    return next(frame.name for frame in reversed(robot.frames) if frame.link == last)
