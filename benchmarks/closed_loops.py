"""Robots with closed loops beside the tree of the same size, MuJoCo and Pinocchio, in the same run.

Rounds of both go in turn, and the ratio is the median of the rounds' ratios: above 1, what is named first is that many
times faster. Calls go round states drawn within the limits of the motors, or of the platform. The tree is the same
robot with a motor in each joint and nothing closed; a link without inertia, at which a loop is cut, has half of that of
the link that it closes on there, as a tree with links of no inertia has no direct model. "The door" is Dynamics, which
closes the loops in each call and checks what it is given; programs, MuJoCo and Pinocchio take closed positions for
granted. What mj_inverse gives are forces of all joints, as of a tree: for the efforts of the motors they are still to
be gathered, which is not counted.

First all have to agree: our efforts and accelerations with Pinocchio's constraintDynamics, efforts with those gathered
from mj_inverse, and velocities with MuJoCo's constraints. Accelerations of mj_forward differ by what its constraints
give way: how much is printed.
"""

import argparse
import os
import platform
import sys
import threading
import time
from dataclasses import replace
from importlib.util import find_spec
from itertools import cycle
from pathlib import Path

import numpy as np
import pinocchio as pin

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from compiled import installed_version, print_row
from inverse_direct import processor_name
from peers.pinocchio_loops import PinocchioLoops, inertias_with_cut_links
from peers.reachable import reachable

from robot_dynamics import Dynamics, Inertia, load_robot

HAS_MUJOCO = find_spec("mujoco") is not None
if HAS_MUJOCO:
    from mujoco_loops import MUJOCO_SETTINGS, MujocoLoops

ROBOTS = ("four_bar", "five_bar", "andrews_squeezer", "bricard", "sr400", "irb460")
STATES = 100  # that single calls go round
SEED_DELAY = 1e-3  # [s] before which a controller has closed the loops the last time
MINIMAL_MASS = 1e-9  # [kg] of a link of which only the moment about its axis is told, for Pinocchio
PROXIMAL, ACCURACY = 1e-5, 1e-6  # of Pinocchio's method: where it takes the least time, and is still exact to 1e-10
SOFTNESS = 2e-3  # part of what constraints change by which mj_forward may miss it


class Case:
    """A robot with loops at random closed states, and its tree."""

    def __init__(self, name, samples, seed=0):
        self.robot = load_robot(name)
        self.dynamics, self.tree = Dynamics(self.robot), Dynamics(open_tree(self.robot))
        dynamics, rng = self.dynamics, np.random.default_rng(seed)
        self.independent = [self.robot.joint_numbers[name] for name in dynamics.joint_names]
        self.motors = reachable(dynamics, samples, rng)
        self.qd, self.qdd = rng.uniform(-1, 1, (2, *self.motors.shape))
        self.q = dynamics.expand_positions(self.motors)
        self.efforts = dynamics.inverse(self.q, self.qd, self.qdd)
        self.rates = dynamics.expand_velocities(self.qd, self.q)
        self.joint_accelerations = dynamics.expand_accelerations(self.qdd, self.q, self.qd)
        self.tree_efforts = self.tree.inverse(self.q, self.rates, self.joint_accelerations)
        self.seeds = self.q - SEED_DELAY * self.rates
        self.seeds[:, self.independent] = self.motors

    def check(self):
        """Assert that the door, the programs and the peers agree; lines that tell how well."""
        few, dynamics = slice(0, STATES), self.dynamics
        q, qd, qdd, efforts = (values[few] for values in (self.q, self.qd, self.qdd, self.efforts))
        for seeds in (q, self.motors[few], self.seeds[few]):
            assert relative_difference(dynamics.inverse(seeds, qd, qdd), efforts) < 1e-9, "the door differs"
            assert relative_difference(dynamics.direct(seeds, qd, efforts), qdd) < 1e-7, (
                "the door is not its own inverse"
            )
        assert relative_difference(dynamics.compile("inverse").batch(q, qd, qdd), efforts) < 1e-9, "a program differs"
        assert relative_difference(dynamics.compile("direct").batch(q, qd, efforts), qdd) < 1e-7, "a program differs"
        _, call, states = self.pinocchio()
        found = np.array([call(*state).copy() for state in states])
        missed = relative_difference(found, self.to_pinocchio_order(self.joint_accelerations[few]))
        assert missed < 1e-8, "Pinocchio differs"
        yield f"accelerations of Pinocchio differ by {missed:.0e} of the largest"
        if HAS_MUJOCO:
            yield from self.check_mujoco(few)

    def check_mujoco(self, few):
        peer, joint_accelerations = self.mujoco, self.joint_accelerations[few]
        _, direct, states = self.mujoco_calls("direct")
        found, free = map(np.array, zip(*((direct(*state).copy(), peer.free()) for state in states), strict=True))
        exact = peer.to_mujoco_order(joint_accelerations)
        missed, held = (np.abs(values - exact).max(axis=-1) for values in (found, free))
        assert (missed / held).max() < SOFTNESS, "MuJoCo differs"
        apart = missed / np.abs(exact).max(axis=-1)
        _, inverse, states = self.mujoco_calls("inverse")
        forces = np.zeros_like(joint_accelerations)
        forces[:, peer.kept_joints] = np.array([inverse(*state).copy() for state in states])[:, peer.dof_indices]
        inexact = relative_difference(self.dynamics.project_efforts(forces, self.q[few]), self.efforts[few])
        assert inexact < 1e-9, "mj_inverse differs"
        for q, rates in zip(peer.to_mujoco_order(self.q[few]), peer.to_mujoco_order(self.rates[few]), strict=True):
            J = peer.jacobian(q)
            assert np.abs(J @ rates).max() < 1e-9 * max(1, np.abs(rates).max()), "MuJoCo's loops are others"
        yield f"efforts gathered from mj_inverse differ by {inexact:.0e} of the largest"
        told = f"{np.median(apart):.0e}, at most {apart.max():.0e}, of the largest of their state"
        yield f"accelerations of mj_forward, {len(J)} constraints on {peer.model.nv} joints, differ by {told};"
        yield f"that is at most {(missed / held).max():.0e} of what the constraints change"

    def pinocchio(self):
        """(what, call, states) of Pinocchio's direct model."""
        self._pinocchio = peer = PinocchioLoops(with_minimal_masses(self.robot))
        pin.initConstraintDynamics(peer.model, peer.data, peer.contacts, peer.contact_data)
        settings = pin.ProximalSettings(ACCURACY, PROXIMAL, 20)
        told = [self.q, self.rates, self.dynamics.embed_efforts(self.efforts)]
        states = list(zip(*(self.to_pinocchio_order(values[:STATES]) for values in told), strict=True))

        def direct(q, qd, efforts):
            return pin.constraintDynamics(
                peer.model, peer.data, q, qd, efforts, peer.contacts, peer.contact_data, settings
            )

        return "Pinocchio's constraintDynamics", direct, states

    def to_pinocchio_order(self, values):
        """Values (N, all joints) in Pinocchio's order."""
        found = np.empty_like(values)
        found[:, self._pinocchio.rows] = values
        return found

    @property
    def mujoco(self):
        if not hasattr(self, "_mujoco"):
            self._mujoco = MujocoLoops(self.robot, self.dynamics.initial_joint_positions)
        return self._mujoco

    def mujoco_calls(self, model):
        """(what, call, states) of MuJoCo."""
        last = self.joint_accelerations if model == "inverse" else self.dynamics.embed_efforts(self.efforts)
        told = [self.mujoco.to_mujoco_order(values[:STATES]) for values in (self.q, self.rates, last)]
        call = self.mujoco.inverse if model == "inverse" else self.mujoco.direct
        return f"MuJoCo's mj_{'forward' if model == 'direct' else model}", call, list(zip(*told, strict=True))

    def rows(self, model):
        """(what, ours, the other, samples) of one model: inverse or direct."""
        door, tree_door = getattr(self.dynamics, model), getattr(self.tree, model)
        program, tree_program = self.dynamics.compile(model), self.tree.compile(model)
        program.compile_batch(), tree_program.compile_batch()
        last, tree_last = (
            (self.qdd, self.joint_accelerations) if model == "inverse" else (self.efforts, self.tree_efforts)
        )
        given, of_tree = (self.q, self.qd, last), (self.q, self.rates, tree_last)
        positions = {
            "closed positions": self.q,
            f"seeds of {SEED_DELAY * 1e3:g} ms before": self.seeds,
            "positions of motors alone": self.motors,
        }
        warm_up(lambda: door(*(values[0] for values in given)))
        warm_up(lambda: door(self.motors[0], self.qd[0], last[0]))
        warm_up(lambda: tree_door(*(values[0] for values in of_tree)))

        one_of_tree = cycle_calls(tree_door, of_tree)
        for what, q in positions.items():
            yield f"door, {what}, beside the tree's", cycle_calls(door, (q, *given[1:])), one_of_tree, 1
        out, tree_out = np.empty_like(last[0]), np.empty_like(tree_last[0])
        alone = cycle_calls(lambda *state: program.evaluate(*state, out), given)
        tree_alone = cycle_calls(lambda *state: tree_program.evaluate(*state, tree_out), of_tree)
        yield "program, beside the tree's", alone, tree_alone, 1
        peers = [self.mujoco_calls(model)] if HAS_MUJOCO else []
        peers += [self.pinocchio()] if model == "direct" else []
        for what, call, states in peers:
            theirs = cycle_calls(call, list(zip(*states, strict=True)))
            yield f"program, beside {what}", alone, theirs, 1
            yield f"door, closed positions, beside {what}", cycle_calls(door, given), theirs, 1
        count = len(self.q)
        for what, q in positions.items():
            yield (
                f"door, batch of {count}, {what}, beside the tree's",
                lambda q=q: door(q, *given[1:]),
                lambda: tree_door(*of_tree),
                count,
            )
        results, tree_results = np.empty_like(last), np.empty_like(tree_last)
        yield (
            f"program, batch of {count}, beside the tree's",
            lambda: program.batch(*given, out=results),
            lambda: tree_program.batch(*of_tree, out=tree_results),
            count,
        )

    def closure_rows(self):
        """(what, ours, the other, samples) of one step that closes the loops, beside the tree's inverse model."""
        program, tree_program = self.dynamics.compile("closure"), self.tree.compile("inverse")
        leads = [number for number, (leader, _, _) in enumerate(self.robot.mimic_relations) if leader == number]
        q = np.ascontiguousarray(self.q[:, leads])
        out = [np.empty(shape) for _, shape in program.interface.outputs]
        tree_out, of_tree = np.empty_like(self.q[0]), (self.q, self.rates, self.joint_accelerations)
        yield (
            "a step of closing, beside the tree's inverse",
            cycle_calls(lambda q: program.evaluate(q, *out), (q,)),
            cycle_calls(lambda *state: tree_program.evaluate(*state, tree_out), of_tree),
            1,
        )
        many, tree_many = [np.empty((len(q), *values.shape)) for values in out], np.empty_like(self.q)
        yield (
            f"a step of closing, batch of {len(q)}, beside the tree's inverse",
            lambda: program.batch(q, out=many),
            lambda: tree_program.batch(*of_tree, out=tree_many),
            len(q),
        )


def open_tree(robot):
    """The Robot without its loops, a motor in each joint and inertia in each link."""
    inertias = inertias_with_cut_links(robot)
    links = tuple(replace(link, inertia=inertia) for link, inertia in zip(robot.links, inertias, strict=True))
    joints = tuple(replace(joint, actuated=True) for joint in robot.joints)
    return replace(robot, links=links, joints=joints, loops=(), platforms=())


def with_minimal_masses(robot):
    """The same robot for a peer that takes no moments without a mass."""
    light = Inertia(MINIMAL_MASS, np.zeros(3), np.zeros((3, 3)))
    links = tuple(
        replace(link, inertia=link.inertia + light) if link.inertia.is_moment_about_z else link for link in robot.links
    )
    return replace(robot, links=links)


def relative_difference(found, expected):
    """The largest difference as a part of the largest number."""
    return np.abs(found - expected).max() / np.abs(expected).max()


def warm_up(ask):
    """Ask until the door has its programs, which it makes beside the questions."""
    started = time.perf_counter()
    while time.perf_counter() - started < 0.2:
        ask()
    for thread in threading.enumerate():
        if thread.name.startswith("compile "):
            thread.join()


def cycle_calls(call, arrays):
    """A function that calls with rows of the arrays, one state after the other, round and round."""
    states = cycle(list(zip(*(list(values[:STATES]) for values in arrays), strict=True)))
    return lambda: call(*next(states))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--batch", type=int, default=10_000)
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS))
    options = parser.parse_args()
    versions = ", ".join(map(installed_version, ("numpy", "llvmlite", "pin", "mujoco")))
    print(f"{processor_name()}, {os.cpu_count()} cores; Python {platform.python_version()}, {versions}")
    print(f"Pinocchio: proximal method with mu {PROXIMAL:g}, accuracy {ACCURACY:g}")
    print(f"MuJoCo: {MUJOCO_SETTINGS if HAS_MUJOCO else 'missing, pip install mujoco: no row is beside it'}")
    for name in options.robots:
        case = Case(name, options.batch)
        motors, loops = len(case.independent), len(case.robot.loops)
        print(f"\n{name}: {len(case.robot.joints)} joints in the tree, motors: {motors}, loops: {loops}")
        for line in case.check():
            print(f"  {line}")
        print(f"{'':<80} {'ours':>12} {'the other':>12} {'ratio':>8}")
        for model in ("inverse", "direct"):
            for what, *row in case.rows(model):
                print_row(f"  {model}: {what}", *row, options.rounds, width=80)
        for what, *row in case.closure_rows():
            print_row(f"  {what}", *row, options.rounds, width=80)


if __name__ == "__main__":
    main()
