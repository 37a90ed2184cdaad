"""The completion of states without a node: jumps, passive positions that are nan, and positions that are singular."""

import numpy as np
import pytest
from peers.loop_states import loop_gaps
from sensor_msgs.msg import JointState

from robot_dynamics import Dynamics, SingularModelError, load_robot
from robot_dynamics.nodes.joint_state_completer.completion import StateCompletion


def completion_of(name):
    dynamics = Dynamics(load_robot(name), compiled=False)
    numbers = [dynamics.robot.joint_numbers[joint] for joint in dynamics.joint_names]
    return StateCompletion(dynamics, "/"), dynamics.initial_joint_positions[numbers]


def message_of(dynamics, q, passive=None, velocity=None):
    names = [*dynamics.joint_names, *(dynamics.dependent_joint_names if passive is not None else ())]
    positions = [*q, *(passive if passive is not None else ())]
    message = JointState(name=names, position=[float(value) for value in positions])
    if velocity is not None:
        message.velocity = [float(velocity)] * len(names)
    return message


def largest_gap(dynamics, state):
    return np.abs(loop_gaps(dynamics.robot, state.positions)).max()


def test_jump_that_no_motion_explains_is_closed_anew_and_counted():
    completion, q = completion_of("gough_stewart")
    dynamics = completion.dynamics
    assert largest_gap(dynamics, completion.complete(message_of(dynamics, q), True)) < 1e-10
    jump = q + 0.7 * np.cos(3 * np.arange(len(q)))
    with pytest.raises(SingularModelError):
        dynamics.expand_positions(jump, previous=dynamics.initial_joint_positions)
    assert completion.new_modes == 0
    state = completion.complete(message_of(dynamics, jump), True)
    assert largest_gap(dynamics, state) < 1e-10 and completion.new_modes == 1
    np.testing.assert_array_equal(
        state.positions[[dynamics.robot.joint_numbers[n] for n in dynamics.joint_names]], jump
    )


def test_refused_state_leaves_the_last_one_as_it_was():
    completion, q = completion_of("five_bar")
    dynamics = completion.dynamics
    before = completion.complete(message_of(dynamics, q + 0.1), True)
    for bad in (np.full_like(q, np.nan), np.array([np.inf, q[1]])):
        with pytest.raises(Exception, match="a finite number is needed"):
            completion.complete(message_of(dynamics, bad), True)
    after = completion.complete(message_of(dynamics, q + 0.1), True)
    np.testing.assert_allclose(after.positions, before.positions, atol=1e-12)


def test_passive_positions_that_are_nan_are_unknown():
    """joint_state_broadcaster publishes nan where a joint has no sensor."""
    completion, q = completion_of("delta")
    dynamics = completion.dynamics
    expected = completion.complete(message_of(dynamics, q + 0.05), True).positions
    passive = np.full(len(dynamics.dependent_joint_names), np.nan)
    state = completion.complete(message_of(dynamics, q + 0.05, passive), True)
    np.testing.assert_allclose(state.positions, expected, atol=1e-12)
    passive[3] = np.inf
    state = completion.complete(message_of(dynamics, q + 0.05, passive), True)
    np.testing.assert_allclose(state.positions, expected, atol=1e-12)


def test_velocities_are_left_out_where_they_are_nan():
    completion, q = completion_of("delta")
    dynamics = completion.dynamics
    assert completion.complete(message_of(dynamics, q, velocity=1.0), True).velocities is not None
    assert completion.complete(message_of(dynamics, q, velocity=np.nan), True).velocities is None
    assert completion.complete(message_of(dynamics, q), True).velocities is None


def test_names_with_the_namespace_and_of_other_robots():
    dynamics = Dynamics(load_robot("four_bar"), compiled=False)
    completion = StateCompletion(dynamics, "/left")
    state = completion.complete(JointState(name=["left/crank", "finger"], position=[1.0, 2.0]), True)
    assert state.positions[0] == 1.0 and completion.unknown_names == ["finger"]
    assert completion.complete(JointState(name=["finger"], position=[2.0]), True) is None
    passive = JointState(name=["rocker"], position=[1.9])  # of another publisher: a seed of the next state
    assert completion.complete(passive, True) is None
    assert largest_gap(dynamics, completion.complete(JointState(name=["crank"], position=[1.0]), True)) < 1e-10
