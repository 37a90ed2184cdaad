"""Natural frequencies of the NaVARo: M, K and all 90 frequencies, beside a finite-element program in the same run.

The paper (Briot and Khalil) reports 0.01 s for a pose with its model, compiled from C, and 6 s with Cast3M, on a
Pentium 4. OpenSees is measured where it is installed; its beams have no rotary inertia, so its frequencies are slightly
higher.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy: 90 x 90 is small

import contextlib
import statistics
import sys
import time
from importlib import import_module
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from peers.navaro import navaro_frame

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.flexible.eigenmodes import natural_frequencies
from robot_dynamics.flexible.frequency_map import frequency_map
from robot_dynamics.parallel.platform_dynamics import pose_from_coordinates

POSE = (0.05, 0.03, 0.2)
POSES = 500
GRID = 100


def median(function, repetitions=200):
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def opensees(pose):
    """A function that computes the first 20 frequencies of the same frame by OpenSees; None if it is not installed."""
    try:
        program = import_module("openseespy.opensees")
    except (ImportError, RuntimeError) as error:
        print(f"OpenSees is not available: {error}")
        return None
    frame = navaro_frame(*pose)

    def run():
        program.wipe()
        program.model("basic", "-ndm", 3, "-ndf", 6)
        owners = {}
        for node, (position, numbers) in enumerate(zip(frame.positions, frame.numbers, strict=True), start=1):
            program.node(node, *map(float, position))
            if numbers[0] in owners:
                program.equalDOF(owners[numbers[0]], node, 1, 2, 3, 4, 5)
            else:
                owners[numbers[0]] = node
            if numbers[0] in frame.fixed:
                program.fix(node, 1, 1, 1, 1, 1, 1)
        for tag, (ends, section) in enumerate(frame.described, start=1):
            A, I_y, I_z, I_0, _, E, G, rho = section
            program.geomTransf("Linear", tag, 0.0, 0.0, 1.0)
            nodes = [frame.numbers.index(numbers) + 1 for numbers in ends]
            program.element("elasticBeamColumn", tag, *nodes, A, E, G, I_0, I_y, I_z, tag, "-mass", rho * A, "-cMass")
        return np.sqrt(np.array(program.eigen("-genBandArpack", 20))) / (2 * np.pi)

    return run


def main():
    dynamics = Dynamics(load_robot("navaro"))
    elastodynamics = dynamics.elastodynamics
    pose = pose_from_coordinates(np.array([POSE[0], POSE[1], 0, POSE[2], 0, 0]))
    q = dynamics.platform.joint_positions(pose)
    recursion = median(lambda: elastodynamics.matrices(q), 20)
    start = time.perf_counter()
    elastodynamics.compile()
    print(f"program of M and K: {elastodynamics.operations}; compiled or loaded in {time.perf_counter() - start:.2f} s")
    print("  the paper: 37341 × and ÷ / 36183 + and -")
    M, K, *_ = elastodynamics.matrices(q)
    rng = np.random.default_rng(0)
    x = np.zeros((POSES, 6))
    x[:, [0, 1, 3]] = rng.uniform(-1, 1, (POSES, 3)) * (0.08, 0.08, 0.4)
    q_of_poses = dynamics.platform.joint_positions(pose_from_coordinates(x))
    start = time.perf_counter()
    elastodynamics.frequencies(q_of_poses)
    seconds_per_pose = (time.perf_counter() - start) / POSES
    frame = median(lambda: navaro_frame(*POSE).frequencies(), 10)
    rows = [
        ("M and K by the recursion", recursion),
        ("M and K by the program", median(lambda: elastodynamics.matrices(q))),
        ("eigenvalue solver alone", median(lambda: natural_frequencies(M, K))),
        ("M, K and 90 frequencies of a pose, joints known", median(lambda: elastodynamics.frequencies(q))),
        (
            "  including the joints from the platform pose",
            median(lambda: elastodynamics.frequencies(pose=pose), 50),
        ),
        (f"M, K and 90 frequencies, each of {POSES} poses, one core", seconds_per_pose),
        ("frame of finite elements in NumPy (test/peers), 90 frequencies", frame),
    ]
    peer = opensees(POSE)
    if peer is not None:
        with contextlib.redirect_stdout(None):
            peer_frequencies = peer()
        difference = np.abs(peer_frequencies / elastodynamics.frequencies(q)[:20] - 1).max()
        rows.append(
            (f"OpenSees, 20 frequencies, relative difference {difference:.1e}", median(peer, 20)),
        )
    for name, seconds in rows:
        print(f"{seconds * 1e3:9.3f} ms  {name}")
    start = time.perf_counter()
    axes = {name: np.linspace(-0.08, 0.08, GRID) for name in ("x", "y")}
    result = frequency_map(dynamics, axes, threads=2)
    seconds = time.perf_counter() - start
    print(f"{seconds:9.1f} s   map of {GRID} x {GRID} poses on two cores, {result.reachable.mean():.0%} reachable")


if __name__ == "__main__":
    main()
