"""Time of the inverse and the direct model, for one sample and for a batch, beside Pinocchio in the same run.

Rounds of both alternate, and the ratio is the median of the ratios of the rounds, so that a drifting clock rate does
not favour either. A ratio above 1 means that Pinocchio is that many times faster.
"""

import argparse
import os
import platform
import statistics
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pinocchio as pin

from robot_dynamics import Dynamics, load_robot, shipped_robots

sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from peers.real_robots import real_urdf

ROBOTS = {
    "panda": lambda: shipped_robots()["panda"].read_text(),
    "ur5e": lambda: shipped_robots()["ur5e"].read_text(),
    "talos_reduced": lambda: real_urdf("talos_reduced"),
}


def seconds(work, repetitions, clock=time.perf_counter):
    started = clock()
    for _ in range(repetitions):
        work()
    return (clock() - started) / repetitions


def time_both(ours, theirs, rounds, clock=time.perf_counter):
    """(our median [s], median of the peer [s], median of the ratios of the rounds)."""
    ours()
    theirs()
    # about 50 ms a turn, so that the resolution of the clock and short interruptions do not matter
    counts = [max(1, int(0.05 / max(seconds(work, 1), 1e-7))) for work in (ours, theirs)]
    pairs = [(seconds(ours, counts[0], clock), seconds(theirs, counts[1], clock)) for _ in range(rounds)]
    our_seconds, peer_seconds = zip(*pairs, strict=True)
    return statistics.median(our_seconds), statistics.median(peer_seconds), statistics.median(a / b for a, b in pairs)


def cases(urdf, batch, seed=0):
    """(label, our call, Pinocchio's call, samples), after a check that both compute the same numbers."""
    dynamics = Dynamics(load_robot(urdf))
    model = pin.buildModelFromXML(urdf)
    data = model.createData()
    order = [model.joints[model.getJointId(name)].idx_v for name in dynamics.joint_names]
    q, qd, qdd = np.random.default_rng(seed).uniform(-1, 1, (3, batch, len(order)))
    peer_states = [np.empty_like(q) for _ in range(3)]
    for full, values in zip(peer_states, (q, qd, qdd), strict=True):
        full[:, order] = values
    efforts = dynamics.inverse(q, qd, qdd) - dynamics.friction(qd)
    peer_efforts = np.empty_like(q)
    peer_efforts[:, order] = efforts
    columns = [np.asfortranarray(values.T) for values in (*peer_states, peer_efforts)]
    pool = pin.ModelPool(model, 1)

    for name, our_model, peer_model, peer_batch in (
        ("inverse", dynamics.inverse, pin.rnea, pin.rneaInParallel),
        ("direct", dynamics.direct, pin.aba, pin.abaInParallel),
    ):
        last, peer_last, column = (
            (qdd, peer_states[2], columns[2]) if name == "inverse" else (efforts, peer_efforts, columns[3])
        )
        expected = np.array(
            [peer_model(model, data, *sample) for sample in zip(peer_states[0], peer_states[1], peer_last, strict=True)]
        )
        last_argument = last if name == "inverse" else last + dynamics.friction(qd)
        result = our_model(q, qd, last_argument) - (dynamics.friction(qd) if name == "inverse" else 0)
        assert np.abs(result - expected[:, order]).max() < 1e-9 * np.abs(expected).max(), f"{name} models differ"
        single = [values[0].copy() for values in (q, qd, last_argument)]
        peer_single = [values[0].copy() for values in (peer_states[0], peer_states[1], peer_last)]
        yield (
            f"{name}, one call",
            lambda our_model=our_model, single=single: our_model(*single),
            lambda peer_model=peer_model, peer_single=peer_single: peer_model(model, data, *peer_single),
            1,
        )
        yield (
            f"{name}, batch of {batch}",
            lambda our_model=our_model, last_argument=last_argument: our_model(q, qd, last_argument),
            lambda peer_batch=peer_batch, column=column: peer_batch(1, pool, columns[0], columns[1], column),
            batch,
        )


def processor_name():
    """The name of the processor, from /proc/cpuinfo."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--batch", type=int, default=10_000)
    options = parser.parse_args()
    versions = ", ".join(f"{package} {version(package)}" for package in ("numpy", "pin"))
    print(f"{processor_name()}, {os.cpu_count()} cores; Python {platform.python_version()}, {versions}")
    print("robot_dynamics: the NumPy recursions, without a compiled model; Pinocchio: called from Python, one thread\n")
    print(f"{'':<40} {'robot_dynamics':>16} {'Pinocchio':>12} {'ratio':>8}")
    for robot, urdf in ROBOTS.items():
        for label, ours, theirs, samples in cases(urdf(), options.batch):
            our_seconds, peer_seconds, ratio = time_both(ours, theirs, options.rounds)
            columns = [f"{t / samples * 1e6:.2f} µs" for t in (our_seconds, peer_seconds)]
            print(f"{robot + ': ' + label:<40} {columns[0]:>16} {columns[1]:>12} {ratio:>8.1f}")


if __name__ == "__main__":
    main()
