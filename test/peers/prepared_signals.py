"""Motions that this project prepares from recordings, in the form of the independent analysis."""

from dataclasses import replace

import numpy as np

from peers.pinocchio_analysis import FilteredMotion
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.recording import open_recording
from robot_dynamics.recordings.sample_statistics import SampleStatistics


class RestampedSource:
    """A source whose samples get other stamps, or lose their velocities.

    stamps: (N,) [s], or None; measured_velocities: whether samples keep their velocities.
    """

    def __init__(self, source, measured_velocities=True, stamps=None):
        self.source = source
        self.measured_velocities = measured_velocities
        self.stamps = stamps

    def __getattr__(self, name):
        return getattr(self.source, name)

    def samples(self, *arguments):
        for number, sample in enumerate(self.source.samples(*arguments)):
            if not self.measured_velocities:
                sample = sample._replace(velocity=np.zeros(0))
            if self.stamps is not None:
                sample = sample._replace(stamp=10**18 + round(1e9 * self.stamps[number]))
            yield sample


def prepare_motion(path, joints, cutoff, measured_velocities=True, stamps=None):
    """Return (FilteredMotion, SampleStatistics) of a recording of joints; cutoff [Hz]; stamps: see RestampedSource."""
    recording = open_recording(path, direct_drives(joints))
    recording = replace(recording, source=RestampedSource(recording.source, measured_velocities, stamps))
    statistics = SampleStatistics()
    motions = list(recording.motions(statistics, cutoff=cutoff))
    values = [np.concatenate([getattr(motion, name) for motion in motions]) for name in ("times", "q", "qd", "qdd")]
    return FilteredMotion(*values, np.concatenate([motion.efforts for motion in motions])), statistics
