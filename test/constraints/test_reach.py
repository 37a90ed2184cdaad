"""Positions at which no loop can close: the bound never forbids a closed position, and is exact for two legs."""

import numpy as np
import pytest
from peers.loop_states import coupling, loop_gaps, random_closed_state
from peers.random_loops import random_loops
from scipy.optimize import least_squares

from robot_dynamics import Dynamics, SingularModelError, load_robot
from robot_dynamics.constraints import closure_solver
from robot_dynamics.constraints.loop_equations import equations_per_loop
from robot_dynamics.constraints.reach import Reach
from robot_dynamics.constraints.topology import build_topology


def columns_of(looped, q):
    """Reach of a robot with loops, and its independent positions among those of all joints (..., joints)."""
    topology = build_topology(looped.robot)
    return Reach(topology), np.atleast_2d(q)[:, topology.independent]


@pytest.mark.parametrize("seed", range(40))
def test_closed_positions_have_no_gaps(seed):
    looped = random_loops(seed)
    rng = np.random.default_rng(seed)
    states = [looped.q] + [random_closed_state(looped.robot, looped.q, looped.dependents, rng)[0] for _ in range(5)]
    reach, q = columns_of(looped, np.array(states))
    assert not reach.gaps(q).any()


def test_gaps_are_lower_bounds_wherever_the_dependent_joints_are():
    """Sliding joints far away: also where an optimization of the dependent joints leaves the least gaps."""
    bounds = 0
    for seed in range(60):
        looped = random_loops(seed, elastic=False)
        reach, q = columns_of(looped, looped.q)
        S, offset = coupling(looped.robot)
        topology = build_topology(looped.robot)
        rng = np.random.default_rng(seed)
        far = q + 30.0 * rng.uniform(-1, 1, (20, q.shape[1]))
        for sample in far[reach.is_far(far)][:2]:
            t = np.zeros(S.shape[1])
            t[topology.independent_columns] = sample

            def distances(dependent, t=t, topology=topology, robot=looped.robot, S=S, offset=offset):
                t[topology.dependent_columns] = dependent
                gaps = loop_gaps(robot, S @ t + offset)
                rows = np.cumsum([0, *equations_per_loop(robot)])[:-1]
                return np.concatenate([gaps[row : row + 3] for row in rows])

            start = rng.uniform(-3, 3, len(topology.dependent_columns))
            nearest = least_squares(distances, start, max_nfev=50).x
            gap = reach.gaps(sample[None]).max()
            for dependent in (start, nearest):
                assert np.linalg.norm(distances(dependent).reshape(-1, 3), axis=-1).sum() >= gap * (1 - 1e-9)
            bounds += 1
    assert bounds >= 10


@pytest.fixture(scope="module")
def platform():
    return Dynamics(load_robot("gough_stewart"), compiled=False)


@pytest.mark.parametrize("first", range(6))
def test_two_legs_differ_at_most_by_the_distances_between_their_ends(platform, first):
    """The four ends of two legs are a polygon, the legs two of its sides; ends from the table of the description."""
    robot, q = platform.robot, platform.expand_positions([3.2] * 6)
    legs = [robot.joint_numbers[f"leg_{k + 1}"] for k in range(6)]
    lower = np.array([robot.joints[robot.joint_numbers[f"hip_{k + 1}"]].placement[:3, 3] for k in range(6)])
    upper = np.array([loop.closed_on.placement[:3, 3] for loop in robot.loops])
    most = min(
        np.linalg.norm(lower[first] - lower[k]) + np.linalg.norm(upper[first] - upper[k])
        for k in range(6)
        if k != first
    )
    reach = Reach(build_topology(robot))
    lengths = np.tile(q[legs], (2, 1))
    lengths[:, first] += most * np.array([1 - 1e-6, 1 + 1e-6])
    assert reach.gaps(lengths)[0].max() == 0
    assert reach.gaps(lengths)[1].max() == pytest.approx(1e-6 * most, rel=1e-3)


@pytest.mark.parametrize("length", [10.0, 1e9, 1e200, -1e308])
def test_legs_that_cannot_close_are_refused_without_a_search(platform, length, monkeypatch):
    """Searches took more than a second of CPU time."""
    q = np.full((3, 6), 3.2)
    q[1, 2] = length
    searched = []
    search = closure_solver.solve_closure
    monkeypatch.setattr(closure_solver, "solve_closure", lambda *arguments: searched.append(1) or search(*arguments))
    with pytest.raises(SingularModelError, match=r"at sample 1: its links leave a gap of at least .* m") as refusal:
        platform.direct(q, np.zeros((3, 6)), np.zeros((3, 6)))
    assert not searched
    assert "'ball_3'" in str(refusal.value)
    platform.direct(q[::2], np.zeros((2, 6)), np.zeros((2, 6)))
    assert searched


def test_samples_far_out_of_reach_are_told_from_others_in_batches(platform):
    solver = closure_solver.ClosureSolver(platform.robot)
    q = np.full((2100, 6), 3.2)
    q[[3, 1500, 2050], [0, 1, 2]] = 1e9
    far = Reach(solver.topology).is_far(q)
    assert np.flatnonzero(far).tolist() == [3, 1500, 2050]
    few = [0, 3, 5, 1500]
    positions, is_closed = solver.try_close_loops(q[few])
    assert is_closed.tolist() == [True, False, True, False]
    assert np.abs(loop_gaps(platform.robot, positions[2])).max() < 1e-9
    with pytest.raises(SingularModelError, match="at sample 1: its links leave"):
        solver.close_loops(q[few])
    with pytest.raises(SingularModelError, match="at sample 1: its links leave"):
        solver.close_trajectory(q[few])
    with pytest.raises(SingularModelError, match="at sample 1: its links leave"):
        solver.continue_branch(q[few], positions[0])
