"""Continuation at one sample: in machine code it ends where NumPy ends, on the same branch."""

from functools import partial

import numpy as np
import pytest

pytest.importorskip("llvmlite")
from robot_dynamics import Dynamics, SingularModelError, load_robot, shipped_robots
from robot_dynamics.codegen.jit.procedure_code import compile_procedure
from robot_dynamics.codegen.procedure.kernels import Kernel
from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface
from robot_dynamics.constraints.closure_procedures import CLOSURE_PROCEDURES, closure_procedure

pytestmark = pytest.mark.slow  # compiles models of all robots that ship

LOOPED = [name for name in shipped_robots() if load_robot(name).loops]
SAMPLES = 25


class CompiledContinuation:
    """The procedures of SampleContinuation as programs, and a Dynamics that computes with NumPy alone."""

    def __init__(self, robot):
        self.dynamics = Dynamics(robot, compiled=False)
        self.start = self.dynamics.initial_joint_positions
        self.independent = [robot.joint_numbers[name] for name in self.dynamics.joint_names]
        topology = self.dynamics._closure_solver.topology
        kernel = Kernel("closure", self.dynamics.compile("closure"))
        for name in CLOSURE_PROCEDURES:
            if name.startswith("continue"):
                function, inputs, output, shape = closure_procedure(topology, name, kernel)
                interface = ProcedureInterface(inputs, {output: shape, "status": (1,)})
                setattr(self, name, compile_procedure(name, partial(function), interface, [kernel]).attempt)

    def random_motors(self, rng, size):
        return self.start[self.independent] + size * rng.uniform(-1, 1, len(self.independent))


@pytest.fixture(scope="module", params=LOOPED)
def continuation(request):
    return CompiledContinuation(load_robot(request.param))


def closed_or_none(function, *arguments, **options):
    try:
        return function(*arguments, **options)
    except SingularModelError:
        return None


@pytest.mark.parametrize("size", [0.01, 0.15])
def test_branches_continue_where_numpy_continues_them(continuation, size):
    rng = np.random.default_rng(0)
    expand = continuation.dynamics.expand_positions
    closed = 0
    for _ in range(SAMPLES):
        previous = expand(continuation.random_motors(rng, 0.02))
        q = continuation.random_motors(rng, size)
        rates = q - previous[continuation.independent] + 0.01 * rng.normal(size=len(q))
        velocities = continuation.dynamics.expand_velocities(3 * rates, previous)
        by_tangent = closed_or_none(expand, q, previous=previous)
        by_velocities = closed_or_none(expand, q, previous=previous, velocities=velocities)
        results = (
            (by_tangent, continuation.continue_along_tangent(q, previous)),
            (by_velocities, continuation.continue_with_velocities(q, previous, velocities)),
        )
        for expected, result in results:
            if result is not None:
                closed += 1
                np.testing.assert_allclose(result, expected, rtol=0, atol=1e-8)
                np.testing.assert_array_equal(result[continuation.independent], q)
    assert closed > SAMPLES


def test_sequences_continue_where_numpy_continues_them(continuation):
    rng = np.random.default_rng(1)
    steps = 0.02 * np.sin(np.linspace(0, 3, SAMPLES))[:, None] * rng.uniform(-1, 1, len(continuation.independent))
    q = continuation.start[continuation.independent] + steps + 1e-3 * rng.normal(size=steps.shape)  # bends everywhere
    expected = continuation.dynamics.expand_trajectory(q)
    closed = 0
    for k in range(2, len(q)):
        result = continuation.continue_sequence(q[k], expected[k - 1], expected[k - 2])
        if result is not None:
            closed += 1
            np.testing.assert_allclose(result, expected[k], rtol=0, atol=1e-8)
    assert closed > SAMPLES / 2


def test_arguments_that_are_not_finite_have_a_status(continuation):
    q = continuation.start[continuation.independent]
    velocities = np.zeros(len(continuation.start))
    arguments = {
        "continue_along_tangent": (q, continuation.start),
        "continue_with_velocities": (q, continuation.start, velocities),
        "continue_sequence": (q, continuation.start, continuation.start),
    }
    for name, values in arguments.items():
        attempt = getattr(continuation, name)
        assert attempt(*values) is not None
        for position in range(len(values)):
            for entry in range(len(values[position])):
                bad = [np.array(value) for value in values]
                bad[position][entry] = np.nan
                assert attempt(*bad) is None, (name, position, entry)


def test_branches_far_from_the_reference_positions():
    continuation = CompiledContinuation(load_robot("irb460"))
    rng = np.random.default_rng(3)
    closed = 0
    for _ in range(SAMPLES):
        q = continuation.random_motors(rng, 1.0)
        previous = closed_or_none(continuation.dynamics.expand_positions, q)
        if previous is None:
            continue
        end = q + 0.05 * rng.normal(size=len(q))
        expected = closed_or_none(continuation.dynamics.expand_positions, end, previous=previous)
        result = continuation.continue_along_tangent(end, previous)
        if result is not None:
            closed += 1
            np.testing.assert_allclose(result, expected, rtol=0, atol=1e-8)
    assert closed > SAMPLES / 3
