"""The dynamics of parallel robots in one compiled program beside MuJoCo and Pinocchio, in the same run.

Rounds of both go in turn, and the ratio is the median of the rounds' ratios: above 1, the program is that many times
faster. Calls go round states with the platform anywhere in its limits. The program takes closed positions of all joints
and gives the efforts of the motors: legs, Jacobians and projection. mj_inverse takes the same and gives forces of all
joints as of a tree with its equality constraints; what the motors have to do is still to be gathered by its Jacobian,
Γ_a = f_a - J_aᵀ J_d⁻ᵀ f_d, which is counted in a row of its own (NumPy's solve). Neither closes the legs: "platform" is
Dynamics.platform, which does, and is asked for efforts by pose, twist and acceleration.

MuJoCo has no batches of its inverse: beside a batch it is called for each pose.

First all have to agree: efforts with those gathered from mj_inverse (1e-9 of the largest), with the multipliers of
Pinocchio's constraint Jacobians (1e-6), and accelerations with Pinocchio's constraintDynamics (1e-8). Those of
mj_forward differ by what its constraints give way: how much is printed.
"""

import argparse
import os
import platform
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from closed_loops import HAS_MUJOCO, STATES, Case, cycle_calls, relative_difference
from compiled import installed_version
from inverse_direct import processor_name, time_both
from peers.pinocchio_loops import PinocchioLoops

from robot_dynamics import load_robot, shipped_robots

if HAS_MUJOCO:
    from mujoco_loops import MUJOCO_SETTINGS

SAMPLES = 1000  # states; a batch is these again and again
PLATFORM_POSES = 1000  # poses of a batch that is asked of the door
CHECKED_STATES = 10  # states whose efforts Pinocchio's multipliers are asked for


class ParallelCase(Case):
    """A parallel robot at random poses."""

    def check_multipliers(self):
        """A line that tells how well efforts agree with those of multipliers with Pinocchio's Jacobians."""
        peer = PinocchioLoops(self.robot)
        told = np.full_like(self.q, np.nan)
        told[:, self.independent] = self.qdd
        found = [
            peer.inverse(*state).efforts[self.independent]
            for state in zip(self.q[:CHECKED_STATES], self.rates[:CHECKED_STATES], told[:CHECKED_STATES], strict=True)
        ]
        inexact = relative_difference(np.array(found), self.efforts[:CHECKED_STATES])
        assert inexact < 1e-6, "Pinocchio's multipliers differ"
        return f"efforts of multipliers with Pinocchio's Jacobians differ by {inexact:.0e} of the largest"

    def projected_efforts_call(self):
        """(call, states): mj_inverse, and efforts of the motors gathered from it."""
        _, inverse, states = self.mujoco_calls("inverse")
        peer = self.mujoco
        motors = [peer.dof_indices[peer.kept_joints.index(number)] for number in self.independent]
        passive = [place for place in range(peer.model.nv) if place not in motors]

        def call(*state):
            forces = inverse(*state)
            J = peer.data.efc_J.reshape(-1, peer.model.nv)
            multipliers = np.linalg.solve(J[:, passive].T, forces[passive])
            return forces[motors] - J[:, motors].T @ multipliers

        found = np.array([call(*state) for state in states])
        assert relative_difference(found, self.efforts[:STATES]) < 1e-9, "mj_inverse differs"
        return call, states

    def comparisons(self, batch):
        """(what, ours, our samples, theirs, their samples)."""
        program, out = self.dynamics.compile("inverse"), np.empty(len(self.independent))
        program.compile_batch()
        alone = cycle_calls(lambda *state: program.evaluate(*state, out), (self.q, self.qd, self.qdd))
        many = [np.resize(values, (batch, values.shape[1])) for values in (self.q, self.qd, self.qdd)]
        results = np.empty((batch, len(self.independent)))
        assert relative_difference(program.batch(*many, out=results)[: len(self.q)], self.efforts) < 1e-9, (
            "a batch differs"
        )
        if HAS_MUJOCO:
            _, call, states = self.mujoco_calls("inverse")
            theirs = cycle_calls(call, list(zip(*states, strict=True)))
            call, states = self.projected_efforts_call()
            projected = cycle_calls(call, list(zip(*states, strict=True)))
            yield "inverse, one call, beside mj_inverse", alone, 1, theirs, 1
            yield "inverse, one call, beside mj_inverse and efforts gathered", alone, 1, projected, 1
            in_one = lambda: program.batch(*many, out=results)  # noqa: E731
            yield f"inverse, a pose in a batch of {batch}, beside mj_inverse", in_one, batch, theirs, 1
            yield f"inverse, a pose in a batch of {batch}, efforts gathered", in_one, batch, projected, 1
        direct, found = self.dynamics.compile("direct"), np.empty(len(self.independent))
        alone = cycle_calls(lambda *state: direct.evaluate(*state, found), (self.q, self.qd, self.efforts))
        for what, call, states in [self.mujoco_calls("direct")] * HAS_MUJOCO + [self.pinocchio()]:
            yield f"direct, one call, beside {what}", alone, 1, cycle_calls(call, list(zip(*states, strict=True))), 1

    def platform_rows(self):
        """(what, call, samples) of the door that is asked by poses."""
        door = self.dynamics.platform
        poses = door.pose(self.q[:PLATFORM_POSES])
        twists, accelerations = np.random.default_rng(1).uniform(-1, 1, (2, len(poses), 6))
        one = cycle_calls(door.inverse, (poses, twists, accelerations))
        seeded = cycle_calls(
            lambda *told: door.inverse(*told[:3], seed=told[3]), (poses, twists, accelerations, self.q)
        )
        yield "platform.inverse, one pose", one, 1
        yield "platform.inverse, one pose, seed of all joints", seeded, 1
        yield (
            f"platform.inverse, a pose in a batch of {len(poses)}",
            lambda: door.inverse(poses, twists, accelerations),
            len(poses),
        )


def main():
    parallel = [name for name in shipped_robots() if len(load_robot(name).platforms) == 1]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--batch", type=int, default=100_000)
    parser.add_argument("--processor-time", action="store_true", help="not that of the clock: on a busy machine")
    parser.add_argument("--robots", nargs="+", choices=parallel, default=["gough_stewart"])
    options = parser.parse_args()
    clock = time.process_time if options.processor_time else time.perf_counter
    versions = ", ".join(map(installed_version, ("numpy", "llvmlite", "pin", "mujoco")))
    print(f"{processor_name()}, {os.cpu_count()} cores; Python {platform.python_version()}, {versions}")
    print(f"MuJoCo: {MUJOCO_SETTINGS if HAS_MUJOCO else 'missing, pip install mujoco: no row is beside it'}")
    for name in options.robots:
        case = ParallelCase(name, SAMPLES)
        print(f"\n{name}: {len(case.robot.joints)} joints in the tree, motors: {len(case.independent)}")
        for line in (*case.check(), case.check_multipliers()):
            print(f"  {line}")
        for model in ("inverse", "direct", "closure"):
            print(f"  operations, {model}: {case.dynamics.compile(model).interface.operations}")
        print(f"{'':<70} {'ours':>10} {'the other':>10} {'ratio':>8}")
        for what, ours, our_samples, theirs, their_samples in case.comparisons(options.batch):
            mine, peers, ratio = time_both(ours, theirs, options.rounds, clock)
            mine, peers, ratio = mine / our_samples, peers / their_samples, ratio / our_samples * their_samples
            print(f"  {what:<68} {mine * 1e9:>7.0f} ns {peers * 1e9:>7.0f} ns {1 / ratio:>8.3g}", flush=True)
        for what, ours, samples in case.platform_rows():
            mine, _, _ = time_both(ours, lambda: None, options.rounds, clock)
            print(f"  {what:<68} {mine / samples * 1e6:>7.1f} µs", flush=True)


if __name__ == "__main__":
    main()
