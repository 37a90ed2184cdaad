"""Transitions of efforts, against closed forms of what decays."""

import numpy as np
import pytest

from robot_dynamics.control.bumpless_transfer import BumplessTransfer

STEP, DURATION = 1e-3, 0.1


def make_transfer(start):
    transfer = BumplessTransfer(1, DURATION, [np.inf])
    transfer.depart_from([start])
    return transfer


def test_jump_decays_along_a_line():
    transfer = make_transfer(5.0)
    transfer.start_transition()
    for now in np.arange(1.0, 1.2, STEP):
        remaining = max(1 - (now - 1.0) / DURATION, 0)
        assert transfer.update(now, np.array([2.0])) == pytest.approx(2.0 + 3.0 * remaining)
    assert not transfer.is_in_transition


def test_transition_in_every_step_gives_the_mean_of_what_was_desired():
    """The sum of all jumps: the desired effort of the last 0.1 s in the mean, not the last effort for ever."""
    transfer = make_transfer(0.0)
    times = np.arange(0, 400) * STEP
    desired = np.sin(20 * times)
    for now, effort in zip(times, desired, strict=True):
        transfer.start_transition()
        sent = transfer.update(now, np.array([effort]))[0]
    mean = desired[-100:].mean()
    assert sent == pytest.approx(mean, abs=0.1)  # jumps of an eighth of the duration are one
    assert abs(mean - desired[-1]) > 0.4


def test_fault_in_every_second_step_lets_the_efforts_decay():
    transfer = make_transfer(10.0)
    for number in range(1000):
        now = number * STEP
        is_fault = number % 2 == 0
        transfer.start_transition(now if is_fault else None)
        before = transfer.last_efforts[0]
        sent = transfer.update(now, np.array([0.0 if is_fault else 10.0]))[0]
        assert abs(sent - before) <= 0.0101 * before
    assert 0 < sent < 0.1


def test_fault_ends_at_zero_whatever_transitions_there_were():
    transfer = make_transfer(10.0)
    for number in range(20):
        transfer.start_transition()
        transfer.update(number * STEP, np.array([float(number)]))
    transfer.start_transition(0.0)
    for now in (0.02, 0.05, 0.0999):
        transfer.update(now, np.array([0.0]))
    assert transfer.update(DURATION, np.array([0.0])) == 0.0


def test_clock_that_steps_back_a_little_changes_nothing():
    transfer = make_transfer(5.0)
    transfer.start_transition()
    transfer.update(1.0, np.array([2.0]))
    assert transfer.update(0.999, np.array([2.0])) == pytest.approx(5.0)


def test_clock_that_jumps_far_back_ends_the_transition():
    transfer = make_transfer(5.0)
    transfer.start_transition()
    transfer.update(100.0, np.array([2.0]))
    assert transfer.update(1.0, np.array([2.0])) == 2.0
