"""The dynamics of parallel robots in one compiled program beside MuJoCo and Pinocchio, in the same run.

Rounds of both alternate, and the ratio is the median of the ratios of the rounds: above 1, the program is that many
times faster. Calls cycle through states with the platform anywhere within its limits. The program takes closed
positions of all joints and computes the efforts of the motors: legs, Jacobians and projection. mj_inverse takes the
same positions and computes forces of all joints as of a tree with equality constraints. Their projection onto the
motors by its Jacobian, Γ_a = f_a - J_aᵀ J_d⁻ᵀ f_d (NumPy's solve), is measured in a row of its own. Neither closes the
legs; Dynamics.platform does, with pose, twist and acceleration of the platform as arguments.

MuJoCo has no batches of its inverse model: beside a batch it is called for each pose.

All must agree first: efforts with the projected forces of mj_inverse (1e-9 of the largest) and with the multipliers of
Pinocchio's constraint Jacobians (1e-6), and accelerations with Pinocchio's constraintDynamics (1e-8). MuJoCo's
constraints are soft, so the accelerations of mj_forward differ; the difference is printed.
"""

import argparse
import os
import platform
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from closed_loops import HAS_MUJOCO, STATES, Case, cycle_calls, relative_difference
from compiled_models import installed_version
from inverse_direct import processor_name, time_both
from peers.pinocchio_loops import PinocchioLoops

from robot_dynamics import load_robot, shipped_robots

if HAS_MUJOCO:
    from mujoco_loops import MUJOCO_SETTINGS

SAMPLES = 1000
"""Number of states; batches repeat them."""

PLATFORM_POSES = 1000
"""Poses in a batch of Dynamics.platform."""

CHECKED_STATES = 10
"""States of which the efforts are compared with Pinocchio's multipliers."""


class ParallelCase(Case):
    """A parallel robot at random poses."""

    def check_multipliers(self):
        """A line with the difference of the efforts from those by multipliers with Pinocchio's Jacobians."""
        peer = PinocchioLoops(self.robot)
        qdd = np.full_like(self.q, np.nan)
        qdd[:, self.independent] = self.qdd
        efforts = [
            peer.inverse(*state).efforts[self.independent]
            for state in zip(self.q[:CHECKED_STATES], self.rates[:CHECKED_STATES], qdd[:CHECKED_STATES], strict=True)
        ]
        difference = relative_difference(np.array(efforts), self.efforts[:CHECKED_STATES])
        assert difference < 1e-6, "Pinocchio's multipliers differ"
        return f"efforts of multipliers with Pinocchio's Jacobians differ by {difference:.0e} of the largest"

    def projected_efforts_call(self):
        """(call, states) of mj_inverse and the projection of its forces onto the motors."""
        _, inverse, states = self.mujoco_calls("inverse")
        peer = self.mujoco
        motors = [peer.dof_indices[peer.kept_joints.index(number)] for number in self.independent]
        passive = [dof for dof in range(peer.model.nv) if dof not in motors]

        def call(*state):
            forces = inverse(*state)
            J = peer.data.efc_J.reshape(-1, peer.model.nv)
            multipliers = np.linalg.solve(J[:, passive].T, forces[passive])
            return forces[motors] - J[:, motors].T @ multipliers

        efforts = np.array([call(*state) for state in states])
        assert relative_difference(efforts, self.efforts[:STATES]) < 1e-9, "mj_inverse differs"
        return call, states

    def comparisons(self, batch):
        """(label, our call, our samples, peer's call, peer's samples)."""
        program = self.dynamics.compile("inverse")
        program.compile_batch()
        out = np.empty(len(self.independent))
        single_call = cycle_calls(lambda *state: program.evaluate(*state, out), (self.q, self.qd, self.qdd))
        arguments = [np.resize(values, (batch, values.shape[1])) for values in (self.q, self.qd, self.qdd)]
        results = np.empty((batch, len(self.independent)))
        assert relative_difference(program.batch(*arguments, out=results)[: len(self.q)], self.efforts) < 1e-9, (
            "a batch differs"
        )
        if HAS_MUJOCO:
            _, call, states = self.mujoco_calls("inverse")
            theirs = cycle_calls(call, list(zip(*states, strict=True)))
            call, states = self.projected_efforts_call()
            projected = cycle_calls(call, list(zip(*states, strict=True)))
            yield "inverse, one call, beside mj_inverse", single_call, 1, theirs, 1
            yield "inverse, one call, beside mj_inverse and projection", single_call, 1, projected, 1
            batch_call = partial(program.batch, *arguments, out=results)
            yield f"inverse, a pose in a batch of {batch}, beside mj_inverse", batch_call, batch, theirs, 1
            yield f"inverse, a pose in a batch of {batch}, and projection", batch_call, batch, projected, 1
        direct = self.dynamics.compile("direct")
        accelerations = np.empty(len(self.independent))
        single_call = cycle_calls(
            lambda *state: direct.evaluate(*state, accelerations), (self.q, self.qd, self.efforts)
        )
        for label, call, states in [self.mujoco_calls("direct")] * HAS_MUJOCO + [self.pinocchio()]:
            peer_call = cycle_calls(call, list(zip(*states, strict=True)))
            yield f"direct, one call, beside {label}", single_call, 1, peer_call, 1

    def platform_rows(self):
        """(label, call, samples) of Dynamics.platform."""
        platform_dynamics = self.dynamics.platform
        poses = platform_dynamics.pose(self.q[:PLATFORM_POSES])
        twists, accelerations = np.random.default_rng(1).uniform(-1, 1, (2, len(poses), 6))
        single_call = cycle_calls(platform_dynamics.inverse, (poses, twists, accelerations))

        def inverse_with_seed(pose, twist, acceleration, q):
            return platform_dynamics.inverse(pose, twist, acceleration, seed=q)

        seeded = cycle_calls(inverse_with_seed, (poses, twists, accelerations, self.q))
        yield "platform.inverse, one pose", single_call, 1
        yield "platform.inverse, one pose, seed of all joints", seeded, 1
        yield (
            f"platform.inverse, a pose in a batch of {len(poses)}",
            lambda: platform_dynamics.inverse(poses, twists, accelerations),
            len(poses),
        )


def main():
    parallel = [name for name in shipped_robots() if len(load_robot(name).platforms) == 1]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--batch", type=int, default=100_000)
    parser.add_argument("--processor-time", action="store_true", help="measure processor time, for a busy machine")
    parser.add_argument("--robots", nargs="+", choices=parallel, default=["gough_stewart"])
    options = parser.parse_args()
    clock = time.process_time if options.processor_time else time.perf_counter
    versions = ", ".join(map(installed_version, ("numpy", "llvmlite", "pin", "mujoco")))
    print(f"{processor_name()}, {os.cpu_count()} cores; Python {platform.python_version()}, {versions}")
    print(f"MuJoCo: {MUJOCO_SETTINGS if HAS_MUJOCO else 'missing, pip install mujoco: no rows beside it'}")
    for name in options.robots:
        case = ParallelCase(name, SAMPLES)
        print(f"\n{name}: {len(case.robot.joints)} joints in the tree, motors: {len(case.independent)}")
        for line in (*case.check(), case.check_multipliers()):
            print(f"  {line}")
        for model in ("inverse", "direct", "closure"):
            print(f"  operations, {model}: {case.dynamics.compile(model).interface.operations}")
        print(f"{'':<70} {'ours':>10} {'peer':>10} {'ratio':>8}")
        for label, ours, our_samples, theirs, their_samples in case.comparisons(options.batch):
            our_seconds, peer_seconds, ratio = time_both(ours, theirs, options.rounds, clock)
            our_seconds /= our_samples
            peer_seconds /= their_samples
            speedup = our_samples / their_samples / ratio
            print(
                f"  {label:<68} {our_seconds * 1e9:>7.0f} ns {peer_seconds * 1e9:>7.0f} ns {speedup:>8.3g}", flush=True
            )
        for label, ours, samples in case.platform_rows():
            our_seconds, _, _ = time_both(ours, lambda: None, options.rounds, clock)
            print(f"  {label:<68} {our_seconds / samples * 1e6:>7.1f} µs", flush=True)


if __name__ == "__main__":
    main()
