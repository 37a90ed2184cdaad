"""Golden bags: predicted efforts written as a bag, to plot beside the measured ones, or to compare with after a change
of model or software."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.bags import JOINT_STATE, Bag, import_rosbag2, load_typestore

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.recordings.joint_motions import Motion

TOPIC = "/predicted_effort"
STAMP_TOLERANCE = 1_000  # [ns] between stamps that are the same
EFFORT_TOLERANCE = 1e-6  # part of the largest effort of a joint, for differences by rounding and compilers


class GoldenWriter:
    """Writes a bag of JointStates on TOPIC: filtered positions and velocities, predicted efforts. A context manager.

    The folder appears when the bag is complete; after an error there is none.

    Parameters
    ----------
    path : path of the folder of the bag, which must not exist.
    joint_names : names of the n joints.

    Raises
    ------
    RecordingError
        Where the folder exists, or on entering cannot be written.
    MissingPackageError
        Where `rosbags` is not installed.
    """

    def __init__(self, path: str | Path, joint_names: tuple[str, ...]) -> None:
        self.path = Path(path)
        self._joint_names = list(joint_names)
        if self.path.exists():
            raise RecordingError(f"{self.path} exists already: a new folder is needed for the golden bag")
        self._typestore = load_typestore()
        self._folder: TemporaryDirectory[str] | None = None  # beside the path, on its file system
        self._writer: Any = None  # of rosbags, which may be missing
        self._connection: object = None

    def __enter__(self) -> GoldenWriter:
        rosbag2 = import_rosbag2()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._folder = TemporaryDirectory(dir=self.path.parent, prefix=f".{self.path.name[:60]}.")
            unfinished = Path(self._folder.name, self.path.name)  # the name of the folder is in its metadata
            self._writer = rosbag2.Writer(unfinished, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP)
            self._writer.open()
        except OSError as error:
            raise RecordingError(f"{self.path} cannot be written: {error.strerror}") from None
        self._connection = self._writer.add_connection(TOPIC, JOINT_STATE, typestore=self._typestore)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._folder is None:
            return
        with self._folder as folder:
            try:
                self._writer.close()
                if error is None:
                    Path(folder, self.path.name).rename(self.path)
            except OSError as failure:
                if error is None:
                    raise RecordingError(f"{self.path} cannot be written: {failure.strerror}") from None

    def add(self, motion: Motion, predicted: Array, origin: int) -> None:
        """Write the predicted efforts (N, n) of a motion; origin: stamp [ns] of its time 0."""
        types = self._typestore.types
        JointState = types[JOINT_STATE]
        Header = types["std_msgs/msg/Header"]
        Time = types["builtin_interfaces/msg/Time"]
        for stamp, *signals in zip(_stamps(motion, origin).tolist(), motion.q, motion.qd, predicted, strict=True):
            header = Header(Time(*divmod(stamp, 1_000_000_000)), "")
            message = JointState(header, self._joint_names, *map(np.ascontiguousarray, signals))
            data = self._typestore.serialize_cdr(message, JOINT_STATE)
            try:
                self._writer.write(self._connection, stamp, data)
            except OSError as error:
                raise RecordingError(f"{self.path} cannot be written: {error.strerror}") from None


class GoldenComparison:
    """Compares predicted efforts with those of a golden bag, message by message.

    Parameters
    ----------
    path : path of the golden bag.
    joint_names : names of the n joints.

    Attributes
    ----------
    largest, at : (n,) largest absolute difference so far [N m or N] and its time [s].

    Raises
    ------
    RecordingError
        Where the bag cannot be read, or has other joints or stamps.
    """

    def __init__(self, path: str | Path, joint_names: tuple[str, ...]) -> None:
        self.joint_names = tuple(joint_names)
        self._path = Path(path)
        if not self._path.exists():
            raise RecordingError(f"golden bag {path} does not exist")
        bag = Bag(self._path)
        self._samples = bag.samples(bag.joint_topics([TOPIC]))
        n = len(self.joint_names)
        self.largest = np.zeros(n)
        self.at = np.zeros(n)
        self._sizes = np.zeros(n)  # largest absolute efforts

    def add(self, motion: Motion, predicted: Array, origin: int) -> None:
        """Compare the predicted efforts (N, n) of a motion; origin: stamp [ns] of its time 0."""
        samples = list(islice(self._samples, len(motion)))
        stamps = np.array([sample.stamp for sample in samples])
        if len(samples) < len(motion) or np.abs(stamps - _stamps(motion, origin)).max() > STAMP_TOLERANCE:
            raise RecordingError(
                f"{self._path} belongs to another recording, or to another cut-off or rate: stamps differ"
            )
        names = samples[0].names
        if set(names) != set(self.joint_names):
            raise RecordingError(
                f"{self._path} has joints {', '.join(names)}: {', '.join(self.joint_names)} are needed"
            )
        order = [names.index(name) for name in self.joint_names]
        golden = np.array([sample.effort for sample in samples])[:, order]
        differences = np.abs(predicted - golden)
        rows = differences.argmax(axis=0)
        peaks = differences.max(axis=0)
        self.at = np.where(peaks > self.largest, motion.times[rows], self.at)
        self.largest = np.maximum(self.largest, peaks)
        self._sizes = np.maximum(self._sizes, np.abs(golden).max(axis=0))

    @property
    def failures(self) -> tuple[str, ...]:
        """Sentences on the joints that differ by more than rounding, and on samples that are left."""
        sentences = [
            f"{name}: predicted effort differs from the golden bag by {largest:.3g} at {time:.4g} s"
            for name, largest, time, size in zip(self.joint_names, self.largest, self.at, self._sizes, strict=True)
            if largest > EFFORT_TOLERANCE * max(size, 1.0)
        ]
        if next(self._samples, None) is not None:
            sentences.append(f"{self._path} has more samples than the recording")
        return tuple(sentences)

    @property
    def agreement(self) -> str:
        """The sentence for a comparison without failures."""
        worst = int(self.largest.argmax())
        return (
            f"predicted efforts are those of the golden bag {self._path}, to {self.largest[worst]:.2g} at most "
            f"({self.joint_names[worst]})"
        )


def _stamps(motion: Motion, origin: int) -> IntArray:
    """Stamps (N,) [ns] of the samples of a motion, whose time 0 has the stamp `origin` [ns]."""
    stamps: IntArray = origin + np.round(motion.times * 1e9).astype(np.int64)
    return stamps
