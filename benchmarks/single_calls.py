"""Time of one call of Dynamics for one sample, with all its checks, beside Pinocchio's functions without checks.

Rounds of both alternate, and the ratio is the median of the ratios of the rounds: above 1, the peer is that many times
faster. All times are processor time. For robots with loops there is no peer that closes them; beside each call stands
the program alone, at positions that close the loops. Geometry stands beside the same call without compiled programs.
"""

import argparse
import sys
import threading
import time
from functools import partial
from itertools import cycle
from pathlib import Path

import numpy as np
import pinocchio as pin

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from inverse_direct import time_both
from peers.reachable import reachable

from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.codegen.jit.background import THREAD_NAME

LOOPED = ("four_bar", "irb460", "gough_stewart")
STATES = 100
"""Samples through which calls cycle."""

NEAR = 0.3
"""Part of the reachable positions that is used, around the initial ones."""


def wait_for_programs():
    """Wait until nothing is compiled in the background."""
    while any(thread.name == THREAD_NAME for thread in threading.enumerate()):
        time.sleep(0.01)


def through(function, states):
    """A call that takes the next of the states each time."""
    following = cycle(states).__next__

    def call():
        return function(*following())

    return call


def tree_rows(name):
    """(label, our call, the call beside it) of a robot without loops."""
    urdf = shipped_robots()[name].read_text()
    dynamics, model = Dynamics(load_robot(urdf)), pin.buildModelFromXML(urdf)
    data = model.createData()
    order = [model.joints[model.getJointId(joint)].idx_v for joint in dynamics.joint_names]
    states = list(np.random.default_rng(0).uniform(-1, 1, (STATES, 3, len(order))))
    peer_states = []
    for state in states:
        full = np.empty_like(state)
        full[:, order] = state
        peer_states.append(full)
    for kind, peer in (("inverse", pin.rnea), ("direct", pin.aba)):
        program, bound = dynamics.compile(kind), dynamics.bind(kind)
        getattr(dynamics, kind)(*states[0])
        wait_for_programs()
        theirs = through(lambda *arrays, peer=peer: peer(model, data, *arrays), peer_states)
        method = getattr(dynamics, kind)
        yield f"{name}, Dynamics.{kind} beside Pinocchio's {peer.__name__}", through(method, states), theirs
        yield f"{name}, bind({kind!r}) beside Pinocchio's {peer.__name__}", through(bound, states), theirs
        yield f"{name}, Dynamics.{kind} beside its program", through(method, states), through(program.evaluate, states)


def loop_rows(name):
    """(label, our call, the call beside it) of a robot with loops."""
    dynamics = Dynamics(load_robot(name))
    rng = np.random.default_rng(0)
    start = dynamics.initial_joint_positions[[dynamics.robot.joint_numbers[joint] for joint in dynamics.joint_names]]
    motors = start + NEAR * (reachable(dynamics, STATES, rng) - start)
    closed = dynamics.expand_positions(motors)
    rates = rng.uniform(-1, 1, (STATES, 2, len(start)))
    for kind in ("inverse", "direct"):
        program, method = dynamics.compile(kind), getattr(dynamics, kind)
        dynamics.bind(kind)  # compiles now all that a call needs
        method(closed[0], *rates[0])
        wait_for_programs()
        closed_states = [(q, *state) for q, state in zip(closed, rates, strict=True)]
        motor_states = [(q, *state) for q, state in zip(motors, rates, strict=True)]
        for closed_state, motor_state in zip(closed_states, motor_states, strict=True):
            np.testing.assert_allclose(method(*motor_state), method(*closed_state), rtol=1e-7, atol=1e-7)
        alone = through(program.evaluate, closed_states)
        yield f"{name}, Dynamics.{kind}, closed positions, beside its program", through(method, closed_states), alone
        yield f"{name}, Dynamics.{kind}, motors alone, beside its program", through(method, motor_states), alone


def geometry_rows(name):
    """(label, our call, the call beside it) of closures, and of the geometry of a platform."""
    dynamics, recursion = Dynamics(load_robot(name)), Dynamics(load_robot(name), compiled=False)
    start = dynamics.initial_joint_positions
    columns = [dynamics.robot.joint_numbers[joint] for joint in dynamics.joint_names]
    motors = start[columns] + 0.02 * np.random.default_rng(0).uniform(-1, 1, (STATES, len(columns)))
    closed = recursion.expand_positions(motors)
    dynamics.compile("closure")
    calls = {
        "expand_positions, motors alone": (motors, "expand_positions", {}),
        "expand_positions, seed": (closed + 1e-3, "expand_positions", {}),
        "expand_positions, previous": (motors, "expand_positions", {"previous": start}),
    }
    if len(dynamics.robot.platforms) == 1:
        poses = recursion.platform.pose(closed)
        calls["platform.joint_positions"] = (poses, "joint_positions", {})
        calls["platform.pose, motors alone"] = (motors, "pose", {})
    for label, (arguments, method, options) in calls.items():
        owners = [each.platform if label.startswith("platform") else each for each in (dynamics, recursion)]
        ours, theirs = (partial(getattr(owner, method), **options) for owner in owners)
        states = [(argument,) for argument in arguments]
        deadline = time.perf_counter() + 0.3
        while time.perf_counter() < deadline:  # compiles now all that a call needs
            ours(*states[0])
        wait_for_programs()
        np.testing.assert_allclose(ours(*states[0]), theirs(*states[0]), rtol=1e-7, atol=1e-7)
        yield f"{name}, {label}, beside NumPy", through(ours, states), through(theirs, states)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15)
    options = parser.parse_args()
    print(f"{'':62} {'ours':>9} {'beside':>9} {'ratio':>7}")
    rows = [*tree_rows("panda"), *(row for name in LOOPED for row in loop_rows(name))]
    rows += [row for name in LOOPED for row in geometry_rows(name)]
    for label, ours, theirs in rows:
        seconds, peer_seconds, ratio = time_both(ours, theirs, options.rounds, time.process_time)
        print(f"{label:62} {1e6 * seconds:6.2f} µs {1e6 * peer_seconds:6.2f} µs {ratio:7.2g}")


if __name__ == "__main__":
    main()
