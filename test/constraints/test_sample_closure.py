"""Closure at one sample: in machine code it closes the loops where NumPy does, and in the same assembly mode."""

import numpy as np
import pytest
from peers.reachable import reachable

pytest.importorskip("llvmlite")
from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.codegen.jit.procedure_code import compile_procedure
from robot_dynamics.codegen.procedure.kernels import Kernel
from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface
from robot_dynamics.constraints.closure_solver import ClosureSolver
from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.constraints.sample_closure import SampleClosure, determinant_is_positive
from robot_dynamics.procedures import procedure, select, zeros

pytestmark = pytest.mark.slow  # compiles models of all robots that ship

LOOPED = [name for name in shipped_robots() if load_robot(name).loops]
SAMPLES = 40


@pytest.fixture(scope="module", params=LOOPED)
def closure(request):
    return CompiledClosure(load_robot(request.param))


class CompiledClosure:
    """The two procedures of SampleClosure as programs, and the ClosureSolver of the same robot."""

    def __init__(self, robot):
        self.robot = robot
        self.dynamics = Dynamics(robot, compiled=False)
        self.solver = ClosureSolver(robot)
        kernel = Kernel("closure", self.dynamics.compile("closure"))
        sample_closure = SampleClosure(self.solver.topology, kernel)

        @procedure
        def near(q):
            t, status = sample_closure.close_near(q)
            return sample_closure.joint_positions(t), np.array([status])

        @procedure
        def from_motors(q):
            t, status = sample_closure.close_from_reference(q)
            return sample_closure.joint_positions(t), np.array([status])

        joints, motors = len(robot.joints), len(self.solver.independent)
        outputs = {"positions": (joints,), "status": (1,)}
        self.near = compile_procedure("near", near, ProcedureInterface({"q": joints}, outputs), [kernel])
        self.from_motors = compile_procedure(
            "from_motors", from_motors, ProcedureInterface({"q": motors}, outputs), [kernel]
        )

    def residual(self, q):
        """Largest residual of the loop equations, in joint frames."""
        return np.abs(loop_equations(self.robot, q).residual).max()


def test_loops_close_from_the_motors_in_the_mode_of_the_initial_positions(closure):
    rng = np.random.default_rng(0)
    reference = closure.dynamics.initial_joint_positions[closure.solver.independent]
    far = reachable(closure.dynamics, SAMPLES // 2, rng)
    near = reference + 0.1 * (reachable(closure.dynamics, SAMPLES // 2, rng) - reference)
    closed = 0
    for q in (*near, *far):
        positions, status = closure.from_motors.evaluate(q)
        if status[0]:
            assert closure.from_motors.attempt(q) is None
            continue
        closed += 1
        assert closure.residual(positions) < 1e-10
        np.testing.assert_array_equal(positions[closure.solver.independent], q)
        np.testing.assert_allclose(positions, closure.solver.close_loops(q), rtol=0, atol=1e-8)
    assert closed > SAMPLES // 3


def test_loops_close_near_a_seed(closure):
    rng = np.random.default_rng(1)
    start = closure.solver.closed_positions
    for _ in range(SAMPLES):
        seed = start + 0.02 * rng.normal(size=len(start))
        expected, is_closed = closure.solver.try_close_loops(seed)
        positions, status = closure.near.evaluate(seed)
        assert (status[0] == 0) == is_closed
        if is_closed:
            assert closure.residual(positions) < 1e-10
            np.testing.assert_allclose(positions, expected, rtol=0, atol=1e-9)


def test_seeds_far_from_closed_positions_lead_to_the_same_assembly_mode_or_to_a_status(closure):
    """Beyond a pitch of 60 degrees too, where NumPy displaces the platform by rotations."""
    rng = np.random.default_rng(2)
    start = closure.solver.closed_positions
    for _ in range(SAMPLES):
        seed = start + 0.3 * rng.normal(size=len(start))  # from further away rounding decides
        seed[closure.solver.independent] = start[closure.solver.independent]
        expected, is_closed = closure.solver.try_close_loops(seed)
        positions, status = closure.near.evaluate(seed)
        if status[0] == 0:
            assert is_closed
            np.testing.assert_allclose(positions, expected, rtol=0, atol=1e-8)


def test_positions_that_do_not_close_or_are_not_finite_have_a_status(closure):
    q = closure.solver.closed_positions
    motors = q[closure.solver.independent]
    assert closure.from_motors.evaluate(motors)[1][0] == 0
    for value in (np.nan, np.inf):
        bad = motors.copy()
        bad[0] = value
        assert closure.from_motors.attempt(bad) is None
    seed = q.copy()
    seed[closure.solver.dependent] = np.nan
    assert closure.near.attempt(seed) is None


def test_positions_out_of_reach_have_a_status():
    closure = CompiledClosure(load_robot("sr400"))
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(60):
        q = closure.solver.closed_positions[closure.solver.independent] + rng.uniform(
            -3, 3, len(closure.solver.independent)
        )
        _, is_closed = closure.solver.try_close_loops(q)
        positions, status = closure.from_motors.evaluate(q)
        assert status[0] or is_closed
        refused += bool(status[0])
        assert status[0] or closure.residual(positions) < 1e-10
    assert refused


@pytest.mark.parametrize("size", [1, 2, 3, 6, 18])
def test_sign_of_determinants(size):
    @procedure
    def sign(entries):
        matrix = zeros(size, size)
        for row in range(size):
            for column in range(size):
                matrix[row, column] = entries[size * row + column]
        return np.array([select(determinant_is_positive(matrix), 1.0, 0.0)])

    program = compile_procedure("sign", sign, ProcedureInterface({"entries": size**2}, {"sign": (1,)}))
    rng = np.random.default_rng(size)
    for _ in range(50):
        matrix = rng.normal(size=(size, size))
        assert bool(program.evaluate(matrix)) == (np.linalg.det(matrix) > 0)
    assert not program.evaluate(np.zeros((size, size)))
    assert not program.evaluate(np.full((size, size), np.nan))
