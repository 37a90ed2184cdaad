"""Robots with closed loops beside the tree of the same size, MuJoCo and Pinocchio, in the same run.

Rounds of both alternate, and the ratio is the median of the ratios of the rounds: above 1, the first one is that many
times faster. Calls cycle through states drawn within the limits of the motors, or of the platform. The tree is the same
robot with a motor in each joint and without loops. Its links without inertia, at which loops are cut, get half the
inertia of the link on which they close, since a tree with such links has no direct model. Dynamics closes the loops in
each call and checks its arguments; programs, MuJoCo and Pinocchio assume closed positions. mj_inverse returns forces of
all joints, as of a tree; their projection onto the motors is not measured.

All must agree first: our accelerations with Pinocchio's constraintDynamics, our efforts with the projected forces of
mj_inverse, and our velocities with MuJoCo's constraints. MuJoCo's constraints are soft, so the accelerations of
mj_forward differ; the difference is printed.
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
from compiled_models import installed_version, print_row
from inverse_direct import processor_name
from peers.pinocchio_loops import PinocchioLoops, inertias_with_cut_links
from peers.reachable import reachable

from robot_dynamics import Dynamics, Inertia, load_robot
from robot_dynamics.codegen.jit.background import THREAD_NAME

HAS_MUJOCO = find_spec("mujoco") is not None
if HAS_MUJOCO:
    from mujoco_loops import MUJOCO_SETTINGS, MujocoLoops

ROBOTS = ("four_bar", "five_bar", "andrews_squeezer", "bricard", "sr400", "irb460")
STATES = 100
"""States through which single calls cycle."""

SEED_DELAY = 1e-3
"""Age of the seeds, as in a controller at 1 kHz [s]."""

MINIMAL_MASS = 1e-9
"""Mass for Pinocchio of links that have only a moment about their axis [kg]."""

PROXIMAL = 1e-5
ACCURACY = 1e-6
"""Parameters of Pinocchio's proximal method with which it is fastest and still exact to 1e-10."""

SOFTNESS = 2e-3
"""Maximum error of mj_forward, relative to the change of the accelerations by the constraints."""


class Case:
    """A robot with loops at random closed states, and its tree."""

    def __init__(self, name, samples, seed=0):
        self.robot = load_robot(name)
        self.dynamics = dynamics = Dynamics(self.robot)
        self.tree = Dynamics(open_tree(self.robot))
        rng = np.random.default_rng(seed)
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
        """Assert that Dynamics, the programs and the peers agree; yield lines with the differences."""
        checked = slice(0, STATES)
        dynamics = self.dynamics
        q, qd, qdd, efforts = (values[checked] for values in (self.q, self.qd, self.qdd, self.efforts))
        for seeds in (q, self.motors[checked], self.seeds[checked]):
            assert relative_difference(dynamics.inverse(seeds, qd, qdd), efforts) < 1e-9, (
                "the efforts of Dynamics depend on the seeds"
            )
            assert relative_difference(dynamics.direct(seeds, qd, efforts), qdd) < 1e-7, (
                "direct is not the inverse of inverse"
            )
        assert relative_difference(dynamics.compile("inverse").batch(q, qd, qdd), efforts) < 1e-9, "a program differs"
        assert relative_difference(dynamics.compile("direct").batch(q, qd, efforts), qdd) < 1e-7, "a program differs"
        _, call, states = self.pinocchio()
        accelerations = np.array([call(*state).copy() for state in states])
        difference = relative_difference(accelerations, self.to_pinocchio_order(self.joint_accelerations[checked]))
        assert difference < 1e-8, "Pinocchio differs"
        yield f"accelerations of Pinocchio differ by {difference:.0e} of the largest"
        if HAS_MUJOCO:
            yield from self.check_mujoco(checked)

    def check_mujoco(self, checked):
        peer, joint_accelerations = self.mujoco, self.joint_accelerations[checked]
        _, direct, states = self.mujoco_calls("direct")
        pairs = [(direct(*state).copy(), peer.free()) for state in states]
        accelerations, free_accelerations = map(np.array, zip(*pairs, strict=True))
        exact = peer.to_mujoco_order(joint_accelerations)
        errors = np.abs(accelerations - exact).max(axis=-1)
        changes = np.abs(free_accelerations - exact).max(axis=-1)
        assert (errors / changes).max() < SOFTNESS, "MuJoCo differs"
        relative_errors = errors / np.abs(exact).max(axis=-1)
        _, inverse, states = self.mujoco_calls("inverse")
        forces = np.zeros_like(joint_accelerations)
        forces[:, peer.kept_joints] = np.array([inverse(*state).copy() for state in states])[:, peer.dof_indices]
        difference = relative_difference(self.dynamics.project_efforts(forces, self.q[checked]), self.efforts[checked])
        assert difference < 1e-9, "mj_inverse differs"
        for q, rates in zip(
            peer.to_mujoco_order(self.q[checked]), peer.to_mujoco_order(self.rates[checked]), strict=True
        ):
            J = peer.jacobian(q)
            assert np.abs(J @ rates).max() < 1e-9 * max(1, np.abs(rates).max()), (
                "the velocities violate MuJoCo's constraints"
            )
        yield f"projected forces of mj_inverse differ by {difference:.0e} of the largest"
        median, maximum = np.median(relative_errors), relative_errors.max()
        yield f"accelerations of mj_forward, {len(J)} constraints on {peer.model.nv} joints, differ by a median of"
        yield f"{median:.0e} and at most {maximum:.0e} of the largest in their state,"
        yield f"at most {(errors / changes).max():.0e} of their change by the constraints"

    def pinocchio(self):
        """(label, call, states) of Pinocchio's direct model."""
        self._pinocchio = peer = PinocchioLoops(with_minimal_masses(self.robot))
        pin.initConstraintDynamics(peer.model, peer.data, peer.contacts, peer.contact_data)
        settings = pin.ProximalSettings(ACCURACY, PROXIMAL, 20)
        arrays = [self.q, self.rates, self.dynamics.embed_efforts(self.efforts)]
        states = list(zip(*(self.to_pinocchio_order(values[:STATES]) for values in arrays), strict=True))

        def direct(q, qd, efforts):
            return pin.constraintDynamics(
                peer.model, peer.data, q, qd, efforts, peer.contacts, peer.contact_data, settings
            )

        return "Pinocchio's constraintDynamics", direct, states

    def to_pinocchio_order(self, values):
        """Values (N, all joints) in Pinocchio's order."""
        ordered = np.empty_like(values)
        ordered[:, self._pinocchio.rows] = values
        return ordered

    @property
    def mujoco(self):
        if not hasattr(self, "_mujoco"):
            self._mujoco = MujocoLoops(self.robot, self.dynamics.initial_joint_positions)
        return self._mujoco

    def mujoco_calls(self, model):
        """(label, call, states) of a model in MuJoCo."""
        last = self.joint_accelerations if model == "inverse" else self.dynamics.embed_efforts(self.efforts)
        arrays = [self.mujoco.to_mujoco_order(values[:STATES]) for values in (self.q, self.rates, last)]
        call = self.mujoco.inverse if model == "inverse" else self.mujoco.direct
        return f"MuJoCo's mj_{'forward' if model == 'direct' else model}", call, list(zip(*arrays, strict=True))

    def rows(self, model):
        """(label, our call, peer's call, samples) of the rows of one model, inverse or direct."""
        call = getattr(self.dynamics, model)
        tree_call = getattr(self.tree, model)
        program = self.dynamics.compile(model)
        tree_program = self.tree.compile(model)
        program.compile_batch()
        tree_program.compile_batch()
        last, tree_last = self.efforts, self.tree_efforts
        if model == "inverse":
            last, tree_last = self.qdd, self.joint_accelerations
        arguments = (self.q, self.qd, last)
        tree_arguments = (self.q, self.rates, tree_last)
        positions = {
            "closed positions": self.q,
            f"seeds of {SEED_DELAY * 1e3:g} ms before": self.seeds,
            "positions of motors alone": self.motors,
        }
        warm_up(lambda: call(*(values[0] for values in arguments)))
        warm_up(lambda: call(self.motors[0], self.qd[0], last[0]))
        warm_up(lambda: tree_call(*(values[0] for values in tree_arguments)))

        single_tree_call = cycle_calls(tree_call, tree_arguments)
        for kind, q in positions.items():
            single_call = cycle_calls(call, (q, *arguments[1:]))
            yield f"Dynamics, {kind}, beside the tree", single_call, single_tree_call, 1
        out = np.empty_like(last[0])
        tree_out = np.empty_like(tree_last[0])
        run_program = cycle_calls(lambda *state: program.evaluate(*state, out), arguments)
        run_tree_program = cycle_calls(lambda *state: tree_program.evaluate(*state, tree_out), tree_arguments)
        yield "program, beside the tree's", run_program, run_tree_program, 1
        peers = [self.mujoco_calls(model)] if HAS_MUJOCO else []
        peers += [self.pinocchio()] if model == "direct" else []
        for label, peer_call, states in peers:
            theirs = cycle_calls(peer_call, list(zip(*states, strict=True)))
            yield f"program, beside {label}", run_program, theirs, 1
            yield f"Dynamics, closed positions, beside {label}", cycle_calls(call, arguments), theirs, 1
        count = len(self.q)
        for kind, q in positions.items():
            yield (
                f"Dynamics, batch of {count}, {kind}, beside the tree",
                lambda q=q: call(q, *arguments[1:]),
                lambda: tree_call(*tree_arguments),
                count,
            )
        results = np.empty_like(last)
        tree_results = np.empty_like(tree_last)
        yield (
            f"program, batch of {count}, beside the tree's",
            lambda: program.batch(*arguments, out=results),
            lambda: tree_program.batch(*tree_arguments, out=tree_results),
            count,
        )

    def closure_rows(self):
        """(label, our call, the tree's call, samples) of one closure step, beside the inverse model of the tree."""
        program = self.dynamics.compile("closure")
        tree_program = self.tree.compile("inverse")
        leaders = [number for number, (leader, _, _) in enumerate(self.robot.mimic_relations) if leader == number]
        q = np.ascontiguousarray(self.q[:, leaders])
        out = [np.empty(shape) for _, shape in program.interface.outputs]
        tree_out = np.empty_like(self.q[0])
        tree_arguments = (self.q, self.rates, self.joint_accelerations)
        yield (
            "closure step, beside the tree's inverse",
            cycle_calls(lambda q: program.evaluate(q, *out), (q,)),
            cycle_calls(lambda *state: tree_program.evaluate(*state, tree_out), tree_arguments),
            1,
        )
        results = [np.empty((len(q), *values.shape)) for values in out]
        tree_results = np.empty_like(self.q)
        yield (
            f"closure step, batch of {len(q)}, beside the tree's inverse",
            lambda: program.batch(q, out=results),
            lambda: tree_program.batch(*tree_arguments, out=tree_results),
            len(q),
        )


def open_tree(robot):
    """The Robot without its loops, with a motor in each joint and inertia in each link."""
    inertias = inertias_with_cut_links(robot)
    links = tuple(replace(link, inertia=inertia) for link, inertia in zip(robot.links, inertias, strict=True))
    joints = tuple(replace(joint, actuated=True) for joint in robot.joints)
    return replace(robot, links=links, joints=joints, loops=(), platforms=())


def with_minimal_masses(robot):
    """The same robot for a peer that accepts no moments without a mass."""
    light = Inertia(MINIMAL_MASS, np.zeros(3), np.zeros((3, 3)))
    links = tuple(
        replace(link, inertia=link.inertia + light) if link.inertia.is_moment_about_z else link for link in robot.links
    )
    return replace(robot, links=links)


def relative_difference(actual, expected):
    """The largest difference, relative to the largest number."""
    return np.abs(actual - expected).max() / np.abs(expected).max()


def warm_up(call):
    """Call until Dynamics has compiled its programs, which it does in the background."""
    started = time.perf_counter()
    while time.perf_counter() - started < 0.2:
        call()
    for thread in threading.enumerate():
        if thread.name == THREAD_NAME:
            thread.join()


def cycle_calls(call, arrays):
    """A function that calls with the next row of the arrays, and starts over after the last one."""
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
    print(f"MuJoCo: {MUJOCO_SETTINGS if HAS_MUJOCO else 'missing, pip install mujoco: no rows beside it'}")
    for name in options.robots:
        case = Case(name, options.batch)
        motors, loops = len(case.independent), len(case.robot.loops)
        print(f"\n{name}: {len(case.robot.joints)} joints in the tree, motors: {motors}, loops: {loops}")
        for line in case.check():
            print(f"  {line}")
        print(f"{'':<80} {'ours':>12} {'peer':>12} {'ratio':>8}")
        for model in ("inverse", "direct"):
            for label, *row in case.rows(model):
                print_row(f"  {model}: {label}", *row, options.rounds, width=80)
        for label, *row in case.closure_rows():
            print_row(f"  {label}", *row, options.rounds, width=80)


if __name__ == "__main__":
    main()
