"""Golden bags: predicted efforts written as a bag, to be plotted beside the measured ones, or to be compared with after
a change of model or software."""

from itertools import islice
from pathlib import Path

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.bags import JOINT_STATE, Bag, import_rosbag2, load_typestore

TOPIC = "/predicted_effort"
STAMP_TOLERANCE = 1_000  # [ns] between stamps that are the same
EFFORT_TOLERANCE = 1e-6  # part of the largest effort of a joint that rounding and compilers may make


class GoldenWriter:
    """Writes a bag of JointStates on TOPIC: filtered positions and velocities, predicted efforts. A context manager.

    path: of a folder that is not there yet. Raises RecordingError, MissingPackageError.
    """

    def __init__(self, path, joint_names):
        self.path, self._names = Path(path), list(joint_names)
        if self.path.exists():
            raise RecordingError(f"{self.path} is there already: a new folder is needed for the golden bag")
        self._store = load_typestore()

    def __enter__(self):
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = import_rosbag2().Writer(
                self.path, version=9, storage_plugin=import_rosbag2().StoragePlugin.MCAP
            )
            self._writer.open()
        except OSError as error:
            raise RecordingError(f"{self.path} cannot be written: {error.strerror}") from None
        self._connection = self._writer.add_connection(TOPIC, JOINT_STATE, typestore=self._store)
        return self

    def __exit__(self, *raised):
        self._writer.close()

    def add(self, motion, predicted, origin):
        """Write the efforts (N, n) predicted for a Motion; origin: stamp [ns] of its time 0."""
        types = self._store.types
        state, header = types[JOINT_STATE], types["std_msgs/msg/Header"]
        clock = types["builtin_interfaces/msg/Time"]
        for time, *values in zip(stamps(motion, origin), motion.q, motion.qd, predicted, strict=True):
            stamp = clock(*divmod(int(time), 1_000_000_000))
            message = state(header(stamp, ""), self._names, *map(np.ascontiguousarray, values))
            self._writer.write(self._connection, int(time), self._store.serialize_cdr(message, JOINT_STATE))


class GoldenComparison:
    """Compares predicted efforts with those of a golden bag, message by message.

    largest: (n,) differences [N m or N] so far, at: when [s]. Raises RecordingError where the bag does not fit.
    """

    def __init__(self, path, joint_names):
        self.joint_names = tuple(joint_names)
        if not Path(path).exists():
            raise RecordingError(f"golden bag {path} is not there")
        bag = Bag(Path(path))
        self._path, self._samples = path, bag.samples(bag.joint_topics([TOPIC]))
        n = len(self.joint_names)
        self.largest, self.at, self._sizes = np.zeros(n), np.zeros(n), np.zeros(n)

    def add(self, motion, predicted, origin):
        """Compare the efforts (N, n) predicted for a Motion; origin: stamp [ns] of its time 0."""
        told = list(islice(self._samples, len(motion)))
        times = np.array([sample.stamp for sample in told])
        if len(told) < len(motion) or np.abs(times - stamps(motion, origin)).max() > STAMP_TOLERANCE:
            raise RecordingError(f"{self._path} is of another recording, or of another cut-off or rate: stamps differ")
        if set(told[0].names) != set(self.joint_names):
            raise RecordingError(f"{self._path} has joints {', '.join(told[0].names)}: {', '.join(self.joint_names)}"
                                 " are needed")  # fmt: skip
        order = [told[0].names.index(name) for name in self.joint_names]
        golden = np.array([sample.effort for sample in told])[:, order]
        differences = np.abs(predicted - golden)
        rows = differences.argmax(axis=0)
        peaks = differences.max(axis=0)
        self.at = np.where(peaks > self.largest, motion.times[rows], self.at)
        self.largest = np.maximum(self.largest, peaks)
        self._sizes = np.maximum(self._sizes, np.abs(golden).max(axis=0))

    @property
    def failures(self):
        """Sentences on the joints that differ by more than rounding; and on messages that are left."""
        found = [f"{name}: predicted effort differs from the golden bag by {largest:.3g} at {at:.4g} s"
                 for name, largest, at, size in
                 zip(self.joint_names, self.largest, self.at, self._sizes, strict=True)
                 if largest > EFFORT_TOLERANCE * max(size, 1.0)]  # fmt: skip
        if next(self._samples, None) is not None:
            found.append(f"{self._path} has more samples than the recording")
        return tuple(found)

    @property
    def agreement(self):
        """The sentence where there are no objections."""
        worst = int(self.largest.argmax())
        return (f"predicted efforts are those of the golden bag {self._path}, to {self.largest[worst]:.2g} at most "
                f"({self.joint_names[worst]})")  # fmt: skip


def stamps(motion, origin):
    """(N,) stamps [ns] of a Motion, the time 0 of which is at `origin` [ns]."""
    return origin + np.round(motion.times * 1e9).astype(np.int64)
