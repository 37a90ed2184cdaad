"""Loops that are closed from call to call stay in their assembly mode, also where the joints jump."""

import numpy as np
import pytest

from robot_dynamics import Dynamics, RobotDynamicsError, load_robot
from robot_dynamics.constraints.topology import build_topology
from robot_dynamics.control.program_positions import ProgramPositions


def closed_robot(name):
    """Return a robot, reference positions of its independent joints, and those of all joints."""
    dynamics = Dynamics(load_robot(name))
    topology = build_topology(dynamics.robot)
    independent = topology.reference_positions[topology.independent_columns]
    return dynamics, independent, dynamics.expand_positions(independent)


@pytest.mark.parametrize("name", ["irb460", "five_bar", "sr400", "four_bar"])
def test_state_far_away_and_back_leaves_the_assembly_mode(name):
    rng = np.random.default_rng(0)
    dynamics, independent, start = closed_robot(name)
    size = len(independent)
    dependent = np.full(len(dynamics.dependent_joint_names), np.nan)
    closure = ProgramPositions(dynamics)
    expected = closure.at_state(independent, dependent).copy()
    np.testing.assert_allclose(expected, start, atol=1e-9)
    refused = 0
    for jump in rng.uniform(-1.2, 1.2, (100, size)):
        try:
            closure.at_state(independent + jump, dependent)
        except RobotDynamicsError:
            refused += 1  # the loops do not close there; the seeds stay
        np.testing.assert_allclose(closure.at_state(independent, dependent), expected, atol=1e-9)
    assert refused < 90


def test_measured_dependent_joints_decide_where_the_state_is_far_away():
    """Four-bar linkage: the mirrored position is closed at once where sensors say so."""
    dynamics, independent, start = closed_robot("four_bar")
    closure = ProgramPositions(dynamics)
    closure.at_state(independent, np.full(len(dynamics.dependent_joint_names), np.nan))
    numbers = [dynamics.all_joint_names.index(joint) for joint in dynamics.dependent_joint_names]
    other = dynamics.expand_positions(_seed(start, closure.indices, independent + 0.8))
    np.testing.assert_allclose(closure.at_state(independent + 0.8, other[numbers]), other, atol=1e-9)


def _seed(positions, indices, independent):
    seed = positions.copy()
    seed[indices] = independent
    return seed
