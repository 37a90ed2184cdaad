"""Recordings by their path: bags, CSV tables and folders of them, to be read as often as is needed."""

from dataclasses import dataclass
from pathlib import Path

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.alignment import resample_samples
from robot_dynamics.recordings.bags import Bag
from robot_dynamics.recordings.joint_motions import filter_motions
from robot_dynamics.recordings.odometry import BASE_SIGNALS
from robot_dynamics.recordings.sample_statistics import SampleStatistics
from robot_dynamics.recordings.tables import Table


@dataclass(frozen=True, eq=False)
class Recording:
    """What was recorded of a robot: a Bag or Table, the topics of it that count, and the Drives of its signals; base:
    name of the base link where it moves, and one of the topics tells how; else None."""

    source: object
    topics: tuple
    drives: object
    base: str | None = None

    def __reduce__(self):
        """Sent to other processes as where it is, to be opened there."""
        topics = () if isinstance(self.source, Table) else self.topics
        return open_recording, (self.source.path.absolute(), self.drives, topics, self.base)

    @property
    def name(self):
        return str(self.source.path)

    @property
    def notes(self):
        """Sentences on what is wrong with the files; complete when all has been read."""
        return tuple(self.source.notes)

    @property
    def message_count(self):
        """How many messages there are; None where nobody knows before reading."""
        counts = [self.source.counts.get(topic) for topic in self.topics]
        return None if None in counts else sum(counts)

    def signal_segments(self, statistics=None, rate=None, progress=None):
        """Yield the Stretches of the signals; watch: takes and gives an iterator of messages, to show progress."""
        samples = self.source.samples(self.topics, self.base)
        names = self.drives.names + (BASE_SIGNALS if self.base is not None else ())
        return resample_samples(samples if progress is None else progress(samples), names, statistics, rate)

    def motions(self, statistics=None, *, cutoff=None, rate=None, progress=None):
        """Yield the Motions of the joints. Raises RecordingError, also where there is none in the end."""
        statistics, found = SampleStatistics() if statistics is None else statistics, False
        for motion in filter_motions(self.signal_segments(statistics, rate, progress), self.drives, statistics, cutoff):
            found = True
            yield motion
        if not found:
            told = "; ".join([*self.notes, *statistics.sentences])
            what = "row" if isinstance(self.source, Table) else "message"
            raise RecordingError(f"{self.name}: nothing is left to look at. {told or f'It has no {what}'}")


def open_recording(path, drives, topics=(), base=None):
    """The Recording at a path: a bag (folder or file), a CSV file, or a folder of those that drives tell.

    topics: names of the topics to be read; none: all with joint states. base: name of the base link where it
    moves: then a topic with odometry is read too. Raises RecordingError.
    """
    path = Path(path)
    try:
        if not path.exists():
            raise RecordingError(f"{path} is not there")
        if path.suffix == ".csv":
            source = Table(path)
        elif path.is_dir() and drives.tables is not None:
            source = Table(path, drives.tables)
        else:
            source = Bag(path)
        of_base = source.base_topics(topics) if base is not None else []
        joints = source.joint_topics([topic for topic in topics if topic not in of_base])
        return Recording(source, (*joints, *of_base), drives, base)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from None


def moving_base_link(dynamics):
    """Name of the base link of the robot of a Dynamics where it moves, else None: what `open_recording` is to know."""
    return dynamics.robot.base_link if dynamics.robot.moving_base else None
