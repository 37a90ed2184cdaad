"""Checks of recordings: a million samples of seven joints against the model of the Panda, beside Pinocchio in a loop.

The times are those of filters, accelerations, predictions and statistics of samples in memory, of reading a bag, and of
Pinocchio's `rnea` for as many samples, extrapolated from a part of them. The maximum memory is printed too.
"""

import resource
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
import pinocchio as pin

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.checking.check import check
from robot_dynamics.checking.golden_bags import GoldenWriter
from robot_dynamics.checking.tolerances import load_tolerances
from robot_dynamics.model.loading import shipped_robots
from robot_dynamics.recordings.alignment import MESSAGES_PER_CHUNK, SignalSegment
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_motions import Motion
from robot_dynamics.recordings.recording import Recording, open_recording

SAMPLES = 1_000_000
RATE = 1000.0  # [1/s]
PEER_SAMPLES = 20_000
BAG_MESSAGES = 50_000


class InMemory(Recording):
    """A recording that repeats one chunk of motion."""

    name = "a million samples"
    notes = ()
    expected = None

    def signal_segments(self, statistics=None, rate=None, progress=None):
        rng = np.random.default_rng(0)
        position, velocity, effort = np.cumsum(rng.normal(size=(3, MESSAGES_PER_CHUNK, 7)), axis=1) / 1000
        for number in range(self.source // MESSAGES_PER_CHUNK):
            yield SignalSegment(number * MESSAGES_PER_CHUNK / RATE, RATE, position, velocity, effort, number > 0)


def largest_memory():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def seconds(work):
    """Processor time of a function [s], which other work on the machine does not affect."""
    started = time.process_time()
    work()
    return time.process_time() - started


def main():
    dynamics = Dynamics(load_robot("panda"))
    tolerances = load_tolerances()
    drives = direct_drives(dynamics.joint_names)
    check(InMemory(MESSAGES_PER_CHUNK, (), drives), dynamics, tolerances)  # compiles the models
    model = pin.buildModelFromXML(shipped_robots()["panda"].read_text())
    data = model.createData()
    states = np.random.default_rng(0).normal(size=(3, PEER_SAMPLES, 7))

    def loop():
        for q, qd, qdd in zip(*states, strict=True):
            pin.rnea(model, data, q, qd, qdd)

    ours = []
    theirs = []
    memory = []
    for _ in range(3):
        ours.append(seconds(lambda: check(InMemory(SAMPLES // 4, (), drives), dynamics, tolerances)))
        memory.append(largest_memory())
        ours.append(seconds(lambda: check(InMemory(SAMPLES, (), drives), dynamics, tolerances)))
        memory.append(largest_memory())
        theirs.append(seconds(loop) * SAMPLES / PEER_SAMPLES)
    seconds_of_all = np.median(ours[1::2])
    print(
        f"{SAMPLES} samples checked in {seconds_of_all:.2f} s of processor time, "
        f"a quarter of them in {np.median(ours[::2]):.2f} s"
    )
    peer_seconds = np.median(theirs)
    print(f"Pinocchio's rnea alone in a loop: {peer_seconds:.2f} s, {peer_seconds / seconds_of_all:.2f} times as long")
    print(f"memory at most {memory[0]:.0f} MB after a quarter, {memory[-1]:.0f} MB in the end")
    folder = Path(tempfile.mkdtemp())
    try:
        zero = np.zeros((BAG_MESSAGES, 7))
        motion = Motion(0.0, RATE, 8.0, zero, zero, zero, zero, zero, np.ones(7, dtype=bool))
        with GoldenWriter(folder / "bag", dynamics.joint_names) as writer:
            writer.add(motion, zero, 1_600_000_000_000_000_000)
        recording = open_recording(folder / "bag", drives)
        reading_seconds = seconds(lambda: sum(map(len, recording.signal_segments())))
        print(f"reading of a bag: {1e6 * reading_seconds / BAG_MESSAGES:.1f} µs a message")
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
