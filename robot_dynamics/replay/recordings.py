"""Recordings by their path: bags, CSV tables and folders of them, to be read as often as is needed."""

from dataclasses import dataclass
from pathlib import Path

from robot_dynamics.errors import RecordingError
from robot_dynamics.replay.alignment import stretches
from robot_dynamics.replay.bags import Bag
from robot_dynamics.replay.base_motion import SIGNALS
from robot_dynamics.replay.motions import motions
from robot_dynamics.replay.tables import Table
from robot_dynamics.replay.tally import Tally


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
    def expected(self):
        """How many messages there are; None where nobody knows before reading."""
        counts = [self.source.counts.get(topic) for topic in self.topics]
        return None if None in counts else sum(counts)

    def stretches(self, tally=None, rate=None, watch=None):
        """Yield the Stretches of the signals; watch: takes and gives an iterator of messages, to show progress."""
        samples = self.source.samples(self.topics, self.base)
        names = self.drives.names + (SIGNALS if self.base is not None else ())
        return stretches(samples if watch is None else watch(samples), names, tally, rate)

    def motions(self, tally=None, *, cutoff=None, rate=None, watch=None):
        """Yield the Motions of the joints. Raises RecordingError, also where there is none in the end."""
        tally, found = Tally() if tally is None else tally, False
        for motion in motions(self.stretches(tally, rate, watch), self.drives, tally, cutoff):
            found = True
            yield motion
        if not found:
            told = "; ".join([*self.notes, *tally.sentences])
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


def moving_base(dynamics):
    """Name of the base link of the robot of a Dynamics where it moves, else None: what `open_recording` is to know."""
    return dynamics.robot.base_link if dynamics.robot.moving_base else None
