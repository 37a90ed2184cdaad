"""Derivatives of the inverse and direct models beside Pinocchio's, and for loops beside numerical differentiation.

Rounds of both alternate. All times are processor time, each the least of its rounds: above 1, the ratio says how many
times longer the peer takes. Batches are computed by one thread, beside a loop over Pinocchio's function in Python.
Numerical differentiation takes central differences of one batch of `Dynamics`, with the loops closed again by
`Dynamics.expand_positions` from the motors.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import pinocchio as pin

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from peers.frictions import without_friction
from peers.real_robots import real_urdf
from single_calls import wait_for_programs

from robot_dynamics import Dynamics, load_robot, shipped_robots

TREES = {
    "ur5e": lambda: shipped_robots()["ur5e"].read_text(),
    "panda": lambda: shipped_robots()["panda"].read_text(),
    "talos_reduced": lambda: real_urdf("talos_reduced"),
}
LOOPED = ("four_bar", "irb460", "delta", "gough_stewart")
PEERS = {"inverse": pin.computeRNEADerivatives, "direct": pin.computeABADerivatives}
SAMPLES = 2000
"""Samples of a batch."""

STEP = 1e-6


def seconds(work, count):
    """Processor time of a call."""
    started = time.process_time()
    for _ in range(count):
        work()
    return (time.process_time() - started) / count


def least_of_both(ours, theirs, rounds):
    """Least processor times [s] of a call, in rounds that alternate, of about 20 ms each."""
    ours(), theirs()
    counts = [max(1, int(0.02 / max(seconds(work, 1), 1e-7))) for work in (ours, theirs)]
    pairs = [(seconds(ours, counts[0]), seconds(theirs, counts[1])) for _ in range(rounds)]
    return [min(times) for times in zip(*pairs, strict=True)]


def tree_rows(name):
    """(label, our call, the peer's, samples of our call) of a robot without loops."""
    urdf = TREES[name]()
    dynamics, model = Dynamics(without_friction(load_robot(urdf))), pin.buildModelFromXML(urdf)
    data = model.createData()
    order = [model.joints[model.getJointId(joint)].idx_v for joint in dynamics.joint_names]
    states = np.random.default_rng(0).uniform(-1, 1, (3, SAMPLES, len(order)))
    peer_states = np.empty_like(states)
    peer_states[:, :, order] = states
    one, peer_one = ([np.array(array[0]) for array in arrays] for arrays in (states, peer_states))
    for kind, peer in PEERS.items():
        program = dynamics.compile(f"{kind}_derivatives")
        outputs = [np.empty(shape) for _, shape in program.interface.outputs]
        batch = [np.empty((SAMPLES, *shape)) for _, shape in program.interface.outputs]
        for ours, theirs in zip(program.evaluate(*one), peer(model, data, *peer_one), strict=True):
            expected = np.array(theirs)[np.ix_(order, order)]
            np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-10 * max(1, np.abs(expected).max()))

        getattr(dynamics, program.interface.name)(*one)
        wait_for_programs()

        def theirs(peer=peer):
            return peer(model, data, *peer_one)

        def program_call(program=program, outputs=outputs):
            program.evaluate(*one, *outputs)

        def method_call(name=program.interface.name):
            getattr(dynamics, name)(*one)

        def batch_call(program=program, batch=batch):
            program.batch(*states, out=batch)

        label = f"{name}, {kind}, {program.interface.operations}"
        yield f"{label}: program", program_call, theirs, 1
        yield f"{label}: Dynamics", method_call, theirs, 1
        yield f"{label}: batch", batch_call, theirs, SAMPLES


def loop_rows(name):
    """(label, our call, numerical differentiation, 1) of a robot with loops."""
    dynamics = Dynamics(load_robot(name))
    dynamics.compile("closure")
    start = dynamics.initial_joint_positions[[dynamics.robot.joint_numbers[joint] for joint in dynamics.joint_names]]
    n = len(start)
    q = start + 0.02 * np.random.default_rng(0).uniform(-1, 1, n)
    qd, last = np.random.default_rng(1).uniform(-1, 1, (2, n))
    closed = dynamics.expand_positions(q)
    steps = STEP * np.concatenate([np.eye(n), -np.eye(n), np.zeros((2 * n, n))])
    moved = q + steps, qd + np.roll(steps, 2 * n, axis=0)
    for kind in PEERS:
        program, model = dynamics.compile(f"{kind}_derivatives"), getattr(dynamics, kind)
        dynamics.bind(kind)  # compiles now all that a call needs
        outputs = [np.empty(shape) for _, shape in program.interface.outputs]

        def differences(model=model):
            rows = model(dynamics.expand_positions(moved[0]), moved[1], last).reshape(4, n, n)
            return [(rows[k] - rows[k + 1]).T / (2 * STEP) for k in (0, 2)]

        def program_call(program=program, outputs=outputs):
            program.evaluate(closed, qd, last, *outputs)

        deadline = time.perf_counter() + 1.0
        while time.perf_counter() < deadline:  # calls start the compilation of what they need
            differences()
        wait_for_programs()
        pairs = zip(program.evaluate(closed, qd, last), differences(), strict=False)
        error = max(np.abs(ours - theirs).max() / np.abs(ours).max() for ours, theirs in pairs)
        label = f"{name}, {kind}, {program.interface.operations}"
        yield f"{label}: differences, error {error:.0e}", program_call, differences, 1


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("robots", nargs="*", default=[*TREES, *LOOPED])
    options = parser.parse_args()
    print(f"{'':86} {'ours':>10} {'beside':>10} {'ratio':>6}")
    for name in options.robots:
        for label, ours, theirs, samples in (tree_rows if name in TREES else loop_rows)(name):
            our_seconds, peer_seconds = least_of_both(ours, theirs, options.rounds)
            our_microseconds, peer_microseconds = 1e6 * our_seconds / samples, 1e6 * peer_seconds
            ratio = peer_microseconds / our_microseconds
            print(f"{label:86} {our_microseconds:7.2f} µs {peer_microseconds:7.2f} µs {ratio:6.1f}", flush=True)


if __name__ == "__main__":
    main()
