"""Newton's method for loops: single samples and batches, NumPy and the compiled program, take the same steps."""

from functools import partial

import numpy as np
import pytest
from peers.loop_states import random_closed_state
from peers.random_loops import random_loops

from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.constraints.closure_solver import ClosureSolver
from robot_dynamics.constraints.closure_step import newton_step
from robot_dynamics.constraints.newton_iteration import iterate_newton
from robot_dynamics.constraints.topology import build_topology

LOOPED = [name for name in shipped_robots() if load_robot(name).loops]
ROBOTS = {**{name: lambda name=name: load_robot(name) for name in LOOPED},
          **{f"random {seed}": lambda seed=seed: random_loops(seed).robot for seed in range(20)}}  # fmt: skip


@pytest.mark.parametrize("seed", range(20))
def test_newton_steps_of_one_sample_and_of_batches_agree(seed):
    looped = random_loops(seed)
    topology, rng = build_topology(looped.robot), np.random.default_rng(seed)
    evaluate = partial(newton_step, topology)
    states = [random_closed_state(looped.robot, looped.q, looped.dependents, rng, 0.1)[0] for _ in range(4)]
    t = np.array([*states, *states])[:, topology.non_mimic_joints]
    t[4:, topology.dependent_columns] += rng.uniform(
        -3, 3, (4, len(topology.dependent_columns))
    )  # some of these close nowhere
    longest = np.full(len(topology.dependent_columns), 0.5)
    batch_t, computed = iterate_newton(evaluate, t, topology.dependent_columns, longest, iterations=4)
    for sample in range(len(t)):
        single, evaluation = iterate_newton(
            evaluate, t[sample, None], topology.dependent_columns, longest, iterations=4
        )
        np.testing.assert_allclose(single[0], batch_t[sample], rtol=1e-6, atol=1e-8)
        assert [value.shape for value in evaluation] == [(1, *value.shape[1:]) for value in computed]
        np.testing.assert_allclose(evaluation[0][0], computed[0][sample], rtol=1e-6, atol=1e-8)


def test_newton_step_that_is_not_finite_is_not_taken():
    def evaluate(t):
        step = np.stack([0 * t[..., 0] + np.nan, 0.25 - t[..., 1]], axis=-1)
        return t - [0.0, 0.25], step

    for samples in (1, 3):
        t, (residual, *_) = iterate_newton(
            evaluate, np.full((samples, 2), [0.0, 1.5]), np.array([0, 1]), np.full(2, 0.5)
        )
        np.testing.assert_allclose(t, np.tile([0, 0.25], (samples, 1)))
        np.testing.assert_allclose(residual, 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_determinant_sign_of_numpy_and_of_the_program_agree(name):
    """Of `determinant_matrix`: positive at the reference positions, and of the same sign in the minimal frames of the
    program."""
    dynamics = Dynamics(ROBOTS[name](), compiled=False)
    topology, program = build_topology(dynamics.robot), dynamics.compile("closure")
    assert np.linalg.det(newton_step(topology, topology.reference_positions)[-1]) > 0
    near = topology.reference_positions + np.random.default_rng(0).uniform(
        -0.1, 0.1, (50, len(topology.non_mimic_joints))
    )
    expected, computed = np.linalg.det(newton_step(topology, near)[-1]), np.linalg.det(program.batch(near)[-1])
    clear = np.abs(expected) > 1e-2 * np.abs(expected).max(initial=0)
    assert np.array_equal(np.sign(expected)[clear], np.sign(computed)[clear])
    assert clear.any()


@pytest.mark.slow
@pytest.mark.parametrize("name", LOOPED)
def test_closure_solver_closes_batches_longer_than_a_block(name, monkeypatch):
    monkeypatch.setattr("robot_dynamics.constraints.closure_solver.BLOCK_SIZE", 7)
    dynamics = Dynamics(load_robot(name), compiled=False)
    reference = dynamics.initial_joint_positions[[dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]]
    q = reference + np.random.default_rng(1).uniform(-0.05, 0.05, (20, len(reference)))
    batch_t = dynamics.expand_positions(q)
    np.testing.assert_allclose(batch_t, [dynamics.expand_positions(single) for single in q], rtol=0, atol=1e-11)
    np.testing.assert_allclose(dynamics.expand_positions(batch_t), batch_t, rtol=0, atol=1e-11)


def test_closure_solver_refuses_samples_in_batches_as_alone():
    """A sample without seed in another assembly mode than the initial one, in a batch with a sample that has a seed."""
    solver = ClosureSolver(load_robot("sr400"))
    q = np.tile(solver.closed_positions, (12, 1))
    q[:, solver.independent] += np.random.default_rng(0).uniform(-3, 3, (12, len(solver.independent)))
    q[1:, solver.dependent] = np.nan
    _, is_closed = solver.try_close_loops(q)
    assert is_closed.tolist() == [bool(solver.try_close_loops(sample)[1]) for sample in q]
    assert is_closed.any() and not is_closed.all()
