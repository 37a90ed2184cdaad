"""Motions that are played: of a recording or a trajectory, or one that moves each joint through its range."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.recording import open_recording
from robot_dynamics.recordings.sample_statistics import SampleStatistics

if TYPE_CHECKING:
    from pathlib import Path

    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.viewing.configuration import Configuration

SWEEP_SECONDS = 3.0
"""Duration of the motion of one joint through its range."""
MAX_SWEPT_JOINTS = 12
"""The joints of a robot with more of them move all at once."""

SAME_CLOCK_SHARE = 0.5
"""Part of the shorter of two motions that is in the time of the other one, if they have the same clock."""


@dataclass(frozen=True, eq=False)
class PlayedMotion:
    """A motion of all joints, to be played.

    Attributes
    ----------
    times : (N,) [s], ascending, from zero.
    positions : (N, all joints) [rad or m], with loops closed.
    efforts : (N, n) efforts of the model at the independent joints [N m or N]; nan where the model has none.
    measured_efforts : (N, n) measured efforts [N m or N]; nan where not measured.
    start : time of the clock of the recording at `times` zero [s].
    reference : (N, all joints) positions of a second motion, which is drawn beside this one; None without one.
    """

    times: Array
    positions: Array
    efforts: Array
    measured_efforts: Array
    start: float = 0.0
    reference: Array | None = None

    @property
    def duration(self) -> float:
        """Time of the last sample [s]."""
        return float(self.times[-1])

    def at(self, time: float) -> Array:
        """Return the positions (all joints,) of the sample nearest to a time [s]."""
        positions: Array = self.positions[self._nearest(np.array(time))]
        return positions

    def some_positions(self, count: int = 20) -> Array:
        """Return positions (N, all joints) of about `count` samples of the motion and of its reference."""
        both = [self.positions] if self.reference is None else [self.positions, self.reference]
        step = max(1, len(self.times) // count)
        return np.concatenate([positions[::step] for positions in both])

    def reference_at(self, time: float) -> Array | None:
        """Return the positions (all joints,) of the reference at the sample nearest to a time [s]; None without one."""
        return None if self.reference is None else self.reference[self._nearest(np.array(time))]

    def beside(self, reference: PlayedMotion, delay: float | None = None) -> PlayedMotion:
        """Return the same motion with a reference, which has the sample nearest to each time.

        Before the first and after the last sample of the reference it is at rest there.

        Parameters
        ----------
        reference : PlayedMotion
        delay : float, optional
            Time from the first sample of this motion to the first one of the reference [s]. Default: what the clocks of
            the recordings say, if more than half of the shorter motion is at the same time as the other one; else zero.
        """
        if delay is None:
            ends = min(self.start + self.duration, reference.start + reference.duration)
            common = ends - max(self.start, reference.start)
            has_one_clock = common > SAME_CLOCK_SHARE * min(self.duration, reference.duration)
            delay = reference.start - self.start if has_one_clock else 0.0
        return replace(self, reference=reference.positions[reference._nearest(self.times - delay)])

    def _nearest(self, times: Array) -> IntArray:
        """Return the numbers (...) of the samples nearest to times (...)."""
        if len(self.times) == 1:
            return np.zeros(times.shape, dtype=int)
        after = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        is_before = times - self.times[after - 1] < self.times[after] - times
        return np.asarray(after - is_before)


def recorded_motion(dynamics: Dynamics, path: Path, rate: float = 50.0) -> PlayedMotion:
    """Read the motion of a bag or CSV file: filtered, with the efforts of the model beside the measured ones.

    Parameters
    ----------
    dynamics : Dynamics
        Model of the robot.
    path : Path
        Bag, or CSV file with the columns time, <joint>.position and optionally <joint>.velocity and <joint>.effort.
    rate : float
        Samples per second that are read. Default: 50.

    Raises
    ------
    RecordingError
        The file cannot be read, or has not the signals of all independent joints.
    SingularModelError
        The loops do not close at the recorded positions.
    """
    recording = open_recording(path, direct_drives(dynamics.joint_names))
    statistics = SampleStatistics()
    pieces = list(recording.motions(statistics=statistics, rate=rate))
    times = np.concatenate([piece.times for piece in pieces])
    q = np.concatenate([dynamics.expand_trajectory(piece.q) for piece in pieces])
    efforts = np.concatenate([_model_efforts(dynamics, piece.q, piece.qd, piece.qdd) for piece in pieces])
    measured = np.concatenate([np.where(piece.has_efforts, piece.efforts, np.nan) for piece in pieces])
    start = statistics.origin * 1e-9 + float(times[0])
    return PlayedMotion(times - times[0], q, efforts, measured, start)


def _model_efforts(dynamics: Dynamics, q: Array, qd: Array, qdd: Array) -> Array:
    """Return the efforts (N, n) of the model, nan where it has none."""
    try:
        return dynamics.inverse(dynamics.expand_trajectory(q), qd, np.where(np.isfinite(qdd), qdd, 0.0))
    except RobotDynamicsError:
        return np.full(q.shape, np.nan)


def sweep_joints(configuration: Configuration, extent: float, rate: float = 24.0) -> PlayedMotion:
    """Return a motion of each independent joint to its upper limit, to its lower limit, and back, one after the other.

    A joint turns round where the loops do not close farther. Many joints move all at once.

    Parameters
    ----------
    configuration : Configuration
        Where the motion begins and ends; it is moved and put back.
    extent : float
        Extent of the robot [m]: the range of prismatic joints without limits.
    rate : float
        Samples per second.
    """
    start = configuration.q
    robot = configuration.robot
    columns = [n for n, index in enumerate(configuration.independent) if robot.joints[index].mimic is None]
    groups = [[column] for column in columns] if len(columns) <= MAX_SWEPT_JOINTS else [columns]
    phases = np.linspace(0.0, 2 * np.pi, int(SWEEP_SECONDS * rate), endpoint=False)
    samples = [start]
    for group in groups:
        configuration.q = start
        home = configuration.independent_positions
        ends = [configuration.joint_range(configuration.independent[column], extent) for column in group]
        for sine in np.sin(phases):
            target = home.copy()
            for column, (lower, upper) in zip(group, ends, strict=True):
                target[column] += sine * (upper - home[column] if sine > 0 else home[column] - lower)
            configuration.move_joints(target)
            samples.append(configuration.q)
    configuration.q = start
    configuration.problem = ""
    samples.append(start)
    nothing = np.full((len(samples), len(configuration.independent)), np.nan)
    return PlayedMotion(np.arange(len(samples)) / rate, np.array(samples), nothing, nothing)
