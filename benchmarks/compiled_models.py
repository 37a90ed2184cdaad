"""Compiled models beside Pinocchio in the same run: single calls, batches, threads, and compile times.

Rounds of both alternate; the ratio is the median of the ratios of the rounds. A ratio above 1 means that robot_dynamics
is that many times faster. Batches of Pinocchio are computed by its rneaInParallel and abaInParallel on one thread.
"""

import argparse
import operator
import os
import platform
import re
import sys
import tempfile
import time
from array import array
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from shutil import which
from threading import Thread
from typing import NamedTuple

import numpy as np
import pinocchio as pin

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from inverse_direct import processor_name, time_both
from peers.real_robots import real_urdf

from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.codegen.jit import engine
from robot_dynamics.codegen.jit.compiled_models import MODELS
from robot_dynamics.codegen.jit.python_functions import python_function
from robot_dynamics.codegen.trace.program import OperationCount

ROBOTS = {
    "panda": lambda: shipped_robots()["panda"].read_text(),
    "ur5e": lambda: shipped_robots()["ur5e"].read_text(),
    "talos_reduced": lambda: real_urdf("talos_reduced"),
}


class Case:
    """A robot here and in Pinocchio, at the same random states."""

    def __init__(self, urdf, samples, seed=0):
        self.urdf = urdf
        self.robot = load_robot(urdf)
        self.dynamics = Dynamics(self.robot, compiled=False)
        self.model = pin.buildModelFromXML(urdf)
        self.data = self.model.createData()
        names = self.dynamics.joint_names
        order = [self.model.joints[self.model.getJointId(name)].idx_v for name in names]
        assert self.model.nq == len(names), "joints with cosine and sine as coordinates are not supported here"
        self.states = np.random.default_rng(seed).uniform(-1, 1, (3, samples, len(names)))
        self.peer_states = np.empty_like(self.states)
        self.peer_states[:, :, order] = self.states
        self.order = order

    def model_rows(self, model):
        """(label, our call, Pinocchio's call, samples) of the rows of one model, inverse or direct."""
        peer, peer_batch = (pin.rnea, pin.rneaInParallel) if model == "inverse" else (pin.aba, pin.abaInParallel)
        program = self.dynamics.compile(model)
        program.compile_batch()
        q, qd, last = (np.ascontiguousarray(state[0]) for state in self.states)
        arrays = [array("d", values) for values in (q, qd, last, np.zeros_like(q))]
        out = np.empty_like(q)
        peer_arguments = [np.ascontiguousarray(state[0]) for state in self.peer_states]
        expected = peer(self.model, self.data, *peer_arguments)[self.order]
        friction = self.dynamics.friction(qd)
        result = program.evaluate(q, qd, last + (0 if model == "inverse" else friction))
        assert np.abs(result - expected - (friction if model == "inverse" else 0)).max() < 1e-9 * np.abs(expected).max()

        def theirs():
            peer(self.model, self.data, *peer_arguments)

        yield f"{model}, out=", lambda: program.evaluate(q, qd, last, out), theirs, 1
        yield f"{model}, array.array in and out", lambda: program.evaluate(*arrays), theirs, 1
        yield f"{model}, new array", lambda: program.evaluate(q, qd, last), theirs, 1
        pool = pin.ModelPool(self.model, 1)
        columns = [np.asfortranarray(state.T) for state in self.peer_states]
        result = np.empty_like(self.states[0])
        peer_result = np.asfortranarray(np.empty_like(columns[0]))
        yield (
            f"{model}, batch of {len(result)}",
            lambda: program.batch(*self.states, out=result),
            lambda: peer_batch(1, pool, *columns, peer_result),
            len(result),
        )
        yield (
            f"{model}, batch, two threads beside one",
            lambda: program.batch(*self.states, out=result, threads=2),
            lambda: program.batch(*self.states, out=result),
            len(result),
        )

    def other_peers(self):
        """(label, our call, peer's call, samples) of one inverse call, for each of the PEERS that is installed."""
        program = self.dynamics.compile("inverse")
        out = np.empty(len(self.order))
        q, qd, qdd = (np.ascontiguousarray(state[0]) for state in self.states)
        expected = program.evaluate(q, qd, qdd) - self.dynamics.friction(qd)
        for name, make in PEERS.items():
            try:
                theirs = make(self.urdf, q, qd, qdd)
            except ImportError:
                continue
            assert np.abs(theirs() - expected).max() < 1e-6 * np.abs(expected).max(), f"{name} differs"
            yield f"inverse, out=, beside {name}", lambda: program.evaluate(q, qd, qdd, out), theirs, 1

    def fallback(self):
        """(label, call of generated Python, call of the NumPy recursion, samples)."""
        function = python_function(MODELS["inverse"](self.robot))
        sample = [state[0].tolist() for state in self.states]
        arrays = [state[0] for state in self.states]
        yield (
            "inverse in Python, beside the recursion",
            lambda: function(*sample),
            lambda: self.dynamics.inverse(*arrays),
            1,
        )


def thread_scaling_cases():
    """(label, call on two threads, call on one) of work by NumPy: how much a second thread helps on this machine."""
    angles = np.random.default_rng(0).uniform(-1, 1, (2, 2000))
    source = np.ones((2, 2_000_000))
    target = np.empty_like(source)

    def sines(half):
        for _ in range(50):
            np.sin(angles[half])

    def copy(half):
        np.copyto(target[half], source[half])

    def both(work):
        helper = Thread(target=work, args=(1,))
        helper.start()
        work(0)
        helper.join()

    def in_turn(work):
        work(0)
        work(1)

    for label, work in (("sines by NumPy", sines), ("a copy of 32 MB by NumPy", copy)):
        yield f"{label}, two threads beside one", partial(both, work), partial(in_turn, work)


def without_friction(urdf):
    """The URDF without joint friction, which each peer models differently."""
    return re.sub(r"<dynamics[^>]*/>", "", urdf)


def mujoco_inverse(urdf, q, qd, qdd):
    import mujoco

    model = mujoco.MjModel.from_xml_string(without_friction(urdf))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)

    def call():
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, qdd
        mujoco.mj_inverse(model, data)
        return data.qfrc_inverse

    return call


def drake_inverse(urdf, q, qd, qdd):
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import MultibodyForces

    plant = MultibodyPlant(0.0)
    (model,) = Parser(plant).AddModelsFromString(without_friction(urdf), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.get_body(plant.GetBodyIndices(model)[0]).body_frame())
    plant.Finalize()
    context, forces, state = plant.CreateDefaultContext(), MultibodyForces(plant), np.r_[q, qd]

    def call():
        plant.SetPositionsAndVelocities(context, state)
        plant.CalcForceElementsContribution(context, forces)
        return plant.CalcInverseDynamics(context, qdd, forces)

    return call


def casadi_inverse(urdf, q, qd, qdd, compiled=False):
    """The statements of our program run by CasADi, in its virtual machine or compiled by gcc -O3.

    The wheels of CasADi have no robot models, so this compares the execution of one program.
    """
    import casadi

    if compiled and not which("gcc"):
        raise ImportError("CasADi compiles with gcc")
    program = MODELS["inverse"](load_robot(without_friction(urdf)))
    inputs = {name: casadi.SX.sym(name, size) for name, size in program.inputs.items()}
    rules = {"add": operator.add, "subtract": operator.sub, "multiply": operator.mul, "divide": operator.truediv}
    rules |= {name: getattr(casadi, name) for name in ("sin", "cos", "sqrt", "sign")}
    values = {}
    for number, kind, operands in program.leaves:
        values[number] = inputs[operands[0]][operands[1]] if kind == "input" else operands[0]
    for number, operation, operands in program.setup + program.statements:
        values[number] = rules[operation](*(values[operand] for operand in operands))
    results = casadi.vertcat(*(sign * values[node] for node, sign in program.outputs[0].entries))
    with tempfile.TemporaryDirectory() as folder:
        compiler = {"flags": ["-O3", "-march=native"], "directory": folder + "/", "cleanup": False}
        options = {"jit": True, "jit_cleanup": False, "compiler": "shell"}
        options = options | {"jit_options": compiler} if compiled else {}
        function = casadi.Function("inverse", list(inputs.values()), [results], options)
    buffer, call = function.buffer()
    out = np.zeros(len(q))
    arguments = (q, qd, qdd)
    for index, values_of_input in enumerate(arguments):
        buffer.set_arg(index, memoryview(values_of_input))
    buffer.set_res(0, memoryview(out))

    def evaluate(_references=(function, buffer, arguments)):
        call()
        return out

    return evaluate


PEERS = {
    "MuJoCo": mujoco_inverse,
    "Drake": drake_inverse,
    "CasADi": casadi_inverse,
    "CasADi and gcc": partial(casadi_inverse, compiled=True),
}


class FirstUse(NamedTuple):
    """Processor time of the first use of a model [s], the least of several rounds, and its operations.

    compile: trace and machine code. compile_alone: also the code that is the same for all programs, as on a machine
    that has compiled no program yet. load: from the cache.
    """

    compile: float
    compile_alone: float
    load: float
    operations: OperationCount


def first_use(urdf, model, rounds):
    """The FirstUse of a model of a robot, each round with an empty cache."""
    robot = load_robot(urdf)
    times = []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            os.environ["ROBOT_DYNAMICS_CACHE"] = folder
            shared = dict(engine.shared_object_code)
            engine.shared_object_code.clear()
            compile_alone, program = processor_time(lambda: Dynamics(robot).compile(model))
            load, _ = processor_time(lambda: Dynamics(robot).compile(model))
            engine.shared_object_code.update(shared)
            os.environ["ROBOT_DYNAMICS_CACHE"] = ""
            compile_time, _ = processor_time(lambda: Dynamics(robot).compile(model))
            del os.environ["ROBOT_DYNAMICS_CACHE"]
        times.append((compile_time, compile_alone, load))
    return FirstUse(*map(min, zip(*times, strict=True)), program.program.operations)


def processor_time(call):
    """(processor time of a call [s], its result)."""
    started = time.process_time()
    result = call()
    return time.process_time() - started, result


def installed_version(package):
    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return f"{package} missing"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--batch", type=int, default=100_000)
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS))
    options = parser.parse_args()
    versions = ", ".join(map(installed_version, ("numpy", "llvmlite", "pin", "mujoco", "drake", "casadi")))
    print(f"{processor_name()}, {os.cpu_count()} cores; Python {platform.python_version()}, {versions}\n")
    Dynamics(load_robot("ur5e")).compile("gravity")  # imports llvmlite, which is not measured
    print(f"{'processor time':<48} {'compile':>9} {'first one':>9} {'cached':>9}   operations")
    for name in options.robots:
        for model in ("inverse", "direct", "regressor"):
            *times, operations = first_use(ROBOTS[name](), model, options.rounds)
            columns = " ".join(f"{seconds * 1e3:6.0f} ms" for seconds in times)
            print(f"{f'{name}: {model}':<48} {columns}   {operations}")
    print(f"\n{'':<48} {'ours':>12} {'peer':>12} {'ratio':>8}")
    for label, ours, theirs in thread_scaling_cases():
        print_row(label, ours, theirs, 1, options.rounds)
    for name in options.robots:
        case = Case(ROBOTS[name](), options.batch)
        peer_rows = [] if name.startswith("talos") else case.other_peers()
        for label, ours, theirs, samples in [
            *case.model_rows("inverse"),
            *case.model_rows("direct"),
            *case.fallback(),
            *peer_rows,
        ]:
            print_row(f"{name}: {label}", ours, theirs, samples, options.rounds)


def print_row(label, ours, theirs, samples, rounds, width=48):
    """Measure two calls and print a row of the table."""
    our_seconds, peer_seconds, ratio = time_both(ours, theirs, rounds)
    columns = [f"{seconds / samples * 1e9:.0f} ns" for seconds in (our_seconds, peer_seconds)]
    times = f"{1 / ratio:.1f}" if ratio < 1 else f"{1 / ratio:.2g}"
    print(f"{label:<{width}} {columns[0]:>12} {columns[1]:>12} {times:>8}", flush=True)


if __name__ == "__main__":
    main()
