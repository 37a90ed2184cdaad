"""Recordings through the contact observer, sample by sample as the node observes a running robot."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.sample_statistics import SampleStatistics
from robot_dynamics.recordings.signals import choose_cutoff, differentiate, lowpass

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.monitoring.contact_observer import ContactObserver, Observation
    from robot_dynamics.recordings.alignment import SignalSegment
    from robot_dynamics.recordings.recording import ProgressWrapper, Recording


def observe_recording(
    recording: Recording,
    observer: ContactObserver,
    *,
    cutoff: float | None = None,
    rate: float | None = None,
    statistics: SampleStatistics | None = None,
    progress: ProgressWrapper | None = None,
) -> Iterator[Observation]:
    """Yield the observations of a recording, on its uniform grid of times after its beginning.

    Signals are those of the recording, without a filter. Velocities that were not measured are derivatives of filtered
    positions: then residuals have less noise than those of a running robot.

    Parameters
    ----------
    recording : Recording
    observer : ContactObserver
        Of the robot and the drives of the recording. It restarts where the recording has gaps.
    cutoff : float, optional
        Of the filter of positions [Hz], where velocities were not measured; default: 8, or a fifth of the rate.
    rate : float, optional
        Samples per second of the grid; default: as recorded.
    statistics, progress
        As `Recording.signal_segments`.

    Raises
    ------
    RecordingError
        The base of the robot moves, or efforts of a joint were not measured.
    """
    balance = observer.balance
    if balance.dynamics.robot.moving_base:
        raise RecordingError(f"the base of {balance.dynamics.robot.name!r} moves: recordings of it are not observed")
    statistics = SampleStatistics() if statistics is None else statistics
    observer.restart("another recording")
    for segment in recording.signal_segments(statistics, rate, progress):
        if not segment.is_continuation:
            observer.restart("gap in the recording")
        velocities = _velocities(segment, cutoff, recording.drives.names, statistics)
        missing = ~np.isfinite(segment.effort).any(axis=0)
        if missing.any():
            name = recording.drives.names[int(np.argmax(missing))]
            raise RecordingError(f"{recording.name}: efforts of {name!r} were not measured")
        for k in range(len(segment)):
            balance.position[:] = segment.position[k]
            balance.velocity[:] = velocities[k]
            balance.effort[:] = segment.effort[k]
            observation = observer.update(round((segment.time + k / segment.rate) * 1e9))
            if observation is not None:
                yield observation


def _velocities(
    segment: SignalSegment, cutoff: float | None, names: tuple[str, ...], statistics: SampleStatistics
) -> Array:
    """Velocities (N, k) of motors, measured or from filtered positions."""
    is_missing = ~np.isfinite(segment.velocity).all(axis=0)
    if not is_missing.any():
        return segment.velocity
    for column in np.flatnonzero(is_missing):
        statistics.note_joint("velocities that were not measured and are derivatives of positions", names[column])
    filtered = lowpass(segment.position, segment.rate, choose_cutoff(segment.rate, cutoff))
    velocities: Array = np.where(is_missing, differentiate(filtered, segment.rate), segment.velocity)
    return velocities
