"""Loops are closed by the same steps for one sample and for many, by NumPy and by the compiled program."""

from functools import partial

import numpy as np
import pytest
from peers.loop_states import random_closed_state
from peers.random_loops import random_loops

from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.constraints.closure_solver import ClosureSolver
from robot_dynamics.constraints.newton_iteration import iterate_newton, newton_step
from robot_dynamics.constraints.topology import build_topology

LOOPED = [name for name in shipped_robots() if load_robot(name).loops]
ROBOTS = {**{name: lambda name=name: load_robot(name) for name in LOOPED},
          **{f"random {seed}": lambda seed=seed: random_loops(seed).robot for seed in range(20)}}  # fmt: skip


@pytest.mark.parametrize("seed", range(20))
def test_one_sample_and_many_take_the_same_steps(seed):
    looped = random_loops(seed)
    system, rng = build_topology(looped.robot), np.random.default_rng(seed)
    evaluate = partial(newton_step, system)
    states = [random_closed_state(looped.robot, looped.q, looped.dependents, rng, 0.1)[0] for _ in range(4)]
    t = np.array([*states, *states])[:, system.non_mimic_joints]
    t[4:, system.dependent_columns] += rng.uniform(
        -3, 3, (4, len(system.dependent_columns))
    )  # some of these close nowhere
    longest = np.full(len(system.dependent_columns), 0.5)
    many, found = iterate_newton(evaluate, t, system.dependent_columns, longest, iterations=4)
    for sample in range(len(t)):
        one, alone = iterate_newton(evaluate, t[sample, None], system.dependent_columns, longest, iterations=4)
        np.testing.assert_allclose(one[0], many[sample], rtol=1e-6, atol=1e-8)
        assert [value.shape for value in alone] == [(1, *value.shape[1:]) for value in found]
        np.testing.assert_allclose(alone[0][0], found[0][sample], rtol=1e-6, atol=1e-8)


def test_a_step_that_is_no_number_moves_nothing():
    def evaluate(t):
        step = np.stack([0 * t[..., 0] + np.nan, 0.25 - t[..., 1]], axis=-1)
        return t - [0.0, 0.25], step

    for samples in (1, 3):
        t, (residual, *_) = iterate_newton(
            evaluate, np.full((samples, 2), [0.0, 1.5]), np.array([0, 1]), np.full(2, 0.5)
        )
        np.testing.assert_allclose(t, np.tile([0, 0.25], (samples, 1)))
        np.testing.assert_allclose(residual, 0)


@pytest.mark.parametrize("name", ROBOTS)
def test_assembly_modes_are_told_alike_by_numpy_and_by_the_program(name):
    """The sign of the determinant of `placing`: positive where the loops are known to be closed, and the same with the
    frames in which the program is traced, wherever the joints are."""
    dynamics = Dynamics(ROBOTS[name](), compiled=False)
    system, program = build_topology(dynamics.robot), dynamics.compile("closure")
    assert np.linalg.det(newton_step(system, system.reference_positions)[-1]) > 0
    near = system.reference_positions + np.random.default_rng(0).uniform(-0.1, 0.1, (50, len(system.non_mimic_joints)))
    expected, found = np.linalg.det(newton_step(system, near)[-1]), np.linalg.det(program.batch(near)[-1])
    clear = np.abs(expected) > 1e-2 * np.abs(expected).max(initial=0)
    assert np.array_equal(np.sign(expected)[clear], np.sign(found)[clear])
    assert clear.any()


@pytest.mark.parametrize("name", LOOPED)
def test_batches_longer_than_a_block_are_closed_whole(name, monkeypatch):
    monkeypatch.setattr("robot_dynamics.constraints.closure_solver.BLOCK_SIZE", 7)
    dynamics = Dynamics(load_robot(name), compiled=False)
    known = dynamics.initial_joint_positions[[dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]]
    q = known + np.random.default_rng(1).uniform(-0.05, 0.05, (20, len(known)))
    many = dynamics.expand_positions(q)
    np.testing.assert_allclose(many, [dynamics.expand_positions(one) for one in q], rtol=0, atol=1e-11)
    np.testing.assert_allclose(dynamics.expand_positions(many), many, rtol=0, atol=1e-11)


def test_samples_without_seed_are_refused_in_batches_as_by_themselves():
    """A sample without seed in another assembly mode than the initial one, in a batch with a sample that has a seed."""
    solver = ClosureSolver(load_robot("sr400"))
    q = np.tile(solver.closed_positions, (12, 1))
    q[:, solver.independent] += np.random.default_rng(0).uniform(-3, 3, (12, len(solver.independent)))
    q[1:, solver.dependent] = np.nan
    _, is_closed = solver.try_close_loops(q)
    assert is_closed.tolist() == [bool(solver.try_close_loops(sample)[1]) for sample in q]
    assert is_closed.any() and not is_closed.all()
