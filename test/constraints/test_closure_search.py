"""The search for closed positions: the same as one attempt after the other, and bounded in its work."""

from functools import partial

import numpy as np
import pytest
from peers.hostile_descriptions import chain_with_loops, legs, stacked_platforms

from robot_dynamics import DescriptionError, Dynamics, load_robot, shipped_robots
from robot_dynamics.constraints import closure_search
from robot_dynamics.constraints.closure_search import MAX_SEARCH_WORK, SearchWork
from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.model.loading import read_robot
from robot_dynamics.model.robot import Robot

FAR = """\
robot: far
joints:
  - {joint: crank, link: input, mass: 1}
  - {joint: coupling, link: coupler, mdh: {d: 1}, role: passive, mass: 1}
  - {joint: rocker, link: output, antecedent: base_link, mdh: {d: 2.5}, role: passive, initial_position: -1.5, mass: 1}
loops:
  - {joint: knee, moved: {antecedent: coupler, mdh: {d: 2}}, closed_on: {antecedent: output, xyz: [1.2, 0, 0]}}
"""


@pytest.fixture
def spent(monkeypatch):
    """The SearchWork of each search."""
    works = []

    class RecordedWork(SearchWork):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            works.append(self)

    monkeypatch.setattr(closure_search, "SearchWork", RecordedWork)
    return works


@pytest.fixture
def evaluations(monkeypatch):
    """(samples, equations, joints) of each evaluation of the loop equations in the search."""
    counted = []

    def count(robot, q, *others):
        equations = loop_equations(robot, q, *others)
        counted.append((1 if q.ndim == 1 else len(q), equations.residual.shape[-1], q.shape[-1]))
        return equations

    monkeypatch.setattr(closure_search, "loop_equations", count)
    return counted


@pytest.mark.parametrize("text", [legs(20), legs(40), chain_with_loops(30, 40), legs(200), legs(4, joints=100)])
def test_search_without_success_ends_at_the_limit_of_work(text, evaluations, monkeypatch):
    """legs(20), 1.4 KB, took 17 s. Counted here: multiplications of matrices, and calls."""
    limit = MAX_SEARCH_WORK / 20
    monkeypatch.setattr(closure_search, "SearchWork", partial(SearchWork, limit=limit))
    with pytest.raises(
        DescriptionError, match=r"not closed within the limit of work: \d+ loops with \d+ equations"
    ) as refusal:
        Dynamics(read_robot(text, source="text"), compiled=False)
    assert len(str(refusal.value)) < 1000
    assert sum(samples * equations**2 * 60 for samples, equations, _ in evaluations) < limit
    assert len(evaluations) < limit / 1e6
    first = list(evaluations)
    evaluations.clear()
    with pytest.raises(DescriptionError, match="limit of work"):
        Dynamics(read_robot(text, source="text"), compiled=False)
    assert evaluations == first  # nothing depends on time


def test_robots_that_ship_are_far_below_the_limit(spent):
    for name in shipped_robots():
        robot = load_robot(name)
        if robot.loops:
            Dynamics(robot, compiled=False)
            assert 0 < spent[-1].spent < MAX_SEARCH_WORK / 8, name
    assert len(spent) > 10


def test_stack_of_platforms_is_below_the_limit(spent):
    """18 legs, 72 joints: more than a walking machine on a motion platform."""
    dynamics = Dynamics(read_robot(stacked_platforms(3), source="text"), compiled=False)
    assert len(dynamics.joint_names) == 18
    assert spent[-1].spent < MAX_SEARCH_WORK / 2


def test_closed_positions_do_not_depend_on_the_size_of_blocks(monkeypatch):
    """The initial positions of FAR lead nowhere; one attempt after the other finds the same positions as blocks."""
    robot: Robot = read_robot(FAR, source="text")
    results = []
    for sizes in ((1,) * 60, closure_search.BLOCK_SIZES, (58,)):
        monkeypatch.setattr(closure_search, "BLOCK_SIZES", sizes)
        results.append(Dynamics(robot, compiled=False)._closure_solver.topology.reference_positions)
    np.testing.assert_allclose(results[1], results[0], atol=1e-9)
    np.testing.assert_allclose(results[2], results[0], atol=1e-9)
    crank, coupling, rocker, _ = results[0]
    tip = [np.cos(crank) + 2 * np.cos(crank + coupling), np.sin(crank) + 2 * np.sin(crank + coupling)]
    np.testing.assert_allclose(tip, [2.5 + 1.2 * np.cos(rocker), 1.2 * np.sin(rocker)], atol=1e-9)
