"""Goals that a controller follows: when they end, with which code, and what the controller does then."""

import numpy as np
import pytest
from control.test_controller import LAW, MS, make_controller, run

from robot_dynamics.control.goal_execution import ErrorCode, GoalExecution
from robot_dynamics.control.goal_tolerances import GoalTolerances

GOAL = np.array([0.5, 0.4])  # elbow, shoulder
START = np.array([-0.2, 0.3])  # as of `run`
DURATION = 0.5


def begin(controller, path=0.0, goal=0.0, goal_time=0.0, stopped_velocity=0.0):
    """A goal whose trajectory begins at 0.3 s, after the ramp of the efforts."""
    run(controller, 0, 0.3)
    points = np.array([[START, GOAL], np.zeros((2, 2)), np.zeros((2, 2))])
    controller.follow_trajectory(0.3, 0.3, [0.0, DURATION], points)
    execution = GoalExecution(GoalTolerances.from_defaults([path] * 2, [goal] * 2, stopped_velocity, goal_time))
    execution.begin(controller)
    return execution


def follow(controller, execution, until, since=0.3, positions=None):
    """Steps of a robot that is at its reference, or at positions (2,). Returns efforts (steps, 2) and the last time."""
    sent, reference = [], np.zeros((3, 2))
    for now in np.arange(since, until, MS):
        controller.source.sample(now, reference)
        q = reference[0] if positions is None else positions
        LAW.q[LAW.joint_indices] = q
        LAW.qd[LAW.joint_indices] = reference[1] if positions is None else 0.0
        sent.append(controller.step(now).copy())
        execution.step(controller, now)
        if execution.outcome is not None:
            break
    return np.array(sent), now


def test_robot_at_its_reference_succeeds_at_the_end():
    controller = make_controller()
    execution = begin(controller, path=1e-6, goal=1e-6, stopped_velocity=1e-6)
    _, ended = follow(controller, execution, 2.0)
    assert (execution.outcome.state, execution.outcome.code) == ("succeeded", ErrorCode.SUCCESSFUL)
    assert ended == pytest.approx(0.8, abs=1.5 * MS)
    assert controller.no_reference_reason == ""


def test_progress_is_the_polynomial_and_the_state():
    controller = make_controller()
    execution = begin(controller)
    for now in np.arange(0.3, 0.5, MS):
        LAW.q[LAW.joint_indices], LAW.qd[LAW.joint_indices] = START, 0.1
        controller.step(now)
        progress = execution.step(controller, now)
    s = progress.time / DURATION
    np.testing.assert_allclose(progress.reference[0], START + (GOAL - START) * (10 * s**3 - 15 * s**4 + 6 * s**5))
    np.testing.assert_array_equal(progress.measured, [START, [0.1, 0.1]])


def test_path_violation_holds_the_robot_where_it_is_without_a_jump_of_the_efforts():
    controller = make_controller(limits=np.full(2, np.inf))
    execution = begin(controller, path=0.1)
    sent, ended = follow(controller, execution, 2.0, positions=START)
    assert execution.outcome.code == ErrorCode.PATH_TOLERANCE_VIOLATED
    assert execution.outcome.reason.startswith("Aborted due to path tolerance violation: position of elbow is 0.10")
    after, _ = run_in_place(controller, ended + MS, ended + 0.5)
    np.testing.assert_allclose(controller.reference, [START, [0, 0], [0, 0]], atol=1e-12)
    moved = np.abs(sent[-1] - after[-1]).max()
    assert np.abs(np.diff([sent[-1], *after], axis=0)).max() < 0.05 * moved  # in ramp_time, 100 steps


def run_in_place(controller, since, until):
    return run(controller, since, until, q=(START[1], START[0])), until


def test_first_sample_is_checked_also_where_the_trajectory_has_one_point():
    controller = make_controller()
    run(controller, 0, 0.3)
    controller.follow_trajectory(0.3, 0.3, [0.0], np.array([[GOAL], [[0, 0]], [[0, 0]]]))
    execution = GoalExecution(GoalTolerances.from_defaults([0.1, 0.1], [0.0, 0.0], 0.0, 0.0))
    execution.begin(controller)
    follow(controller, execution, 0.4, positions=START)
    assert execution.outcome.code == ErrorCode.PATH_TOLERANCE_VIOLATED


def test_refused_point_pushes_the_robot_for_one_sample_and_not_for_ramp_time():
    controller = make_controller(limits=np.full(2, np.inf))
    controller.follow_trajectory(0.0, 0.0, [0.0], np.array([[START], [[0, 0]], [[0, 0]]]))
    run_in_place(controller, 0.0, 0.3)
    before = controller.last_efforts.copy()
    controller.follow_trajectory(0.3, 0.3, [0.0], np.array([[GOAL], [[0, 0]], [[0, 0]]]))
    execution = GoalExecution(GoalTolerances.from_defaults([0.1, 0.1], [0.0, 0.0], 0.0, 0.0))
    execution.begin(controller)
    sent, ended = follow(controller, execution, 0.4, positions=START)
    assert execution.outcome.code == ErrorCode.PATH_TOLERANCE_VIOLATED
    after, _ = run_in_place(controller, ended + MS, ended + 0.3)
    assert np.abs(sent[-1] - before).max() > 1.0
    np.testing.assert_allclose(after, np.tile(before, (len(after), 1)), atol=1e-9)


def test_goal_time_begins_at_the_end_and_zero_is_no_limit():
    controller = make_controller()
    execution = begin(controller, goal=0.1, goal_time=0.2)
    _, ended = follow(controller, execution, 3.0, positions=START)
    assert execution.outcome.code == ErrorCode.GOAL_TOLERANCE_VIOLATED
    assert ended == pytest.approx(1.0, abs=1.5 * MS)
    controller = make_controller()
    execution = begin(controller, goal=0.1)
    follow(controller, execution, 6.0, positions=START)
    assert execution.outcome is None
    follow(controller, execution, 6.1, since=6.0)
    assert execution.outcome.state == "succeeded"


def test_cancelled_goal_decelerates_evenly_to_a_stop_within_the_limits():
    controller = make_controller()
    execution = begin(controller)
    _, now = follow(controller, execution, 0.55)
    position, velocity = controller.reference[:2].copy()
    execution.cancel(controller, now)
    assert execution.outcome.state == "cancelled"
    times, velocities = np.arange(now + MS, now + 0.3, MS), []
    out = np.zeros((3, 2))
    for time in times:
        controller.source.sample(time, out)
        velocities.append(out[1].copy())
    np.testing.assert_allclose(out[0], position + 0.05 * velocity, atol=1e-3)  # ramp_time 0.1 s
    np.testing.assert_allclose(velocities[49], velocity / 2, rtol=1e-6)
    np.testing.assert_array_equal(out[1:], 0)


def test_long_fault_ends_a_goal_and_a_short_one_does_not():
    controller = make_controller()
    execution = begin(controller)
    follow(controller, execution, 0.4)
    for now in np.arange(0.4, 0.45, MS):
        controller.reject_state(now, "the encoder is silent")
        execution.step(controller, now)
    assert execution.outcome is None
    follow(controller, execution, 0.5, since=0.45)
    assert execution.outcome is None
    for now in np.arange(0.5, 0.65, MS):
        controller.reject_state(now, "the encoder is silent")
        execution.check_reference(controller)
    assert (execution.outcome.state, execution.outcome.code) == ("aborted", ErrorCode.INVALID_GOAL)
    assert "the encoder is silent" in execution.outcome.reason


def test_cancel_during_a_fault_ends_the_reference():
    controller = make_controller()
    execution = begin(controller)
    follow(controller, execution, 0.4)
    controller.reject_state(0.401, "the encoder is silent")
    execution.cancel(controller, 0.402)
    assert execution.outcome.state == "cancelled" and controller.no_reference_reason == "the reference was ended"


def test_other_reference_and_other_mode_end_a_goal_but_not_the_reference():
    controller = make_controller()
    execution = begin(controller)
    follow(controller, execution, 0.4)
    controller.track_point(0.4, 0.4, [START, [0, 0], [0, 0]])
    execution.cancel(controller, 0.4)  # comes too late
    assert execution.outcome.state == "aborted" and "preempted" in execution.outcome.reason
    assert controller.source.end == pytest.approx(0.5)
    controller = make_controller()
    execution = begin(controller)
    controller.apply(make_controller(mode="gravity_compensation").settings)
    execution.check_reference(controller)
    assert "mode gravity_compensation" in execution.outcome.reason


@pytest.mark.parametrize("reaction", ["hold", "gravity_compensation"])
def test_reaction_to_a_collision_ends_a_goal_and_is_named(reaction):
    controller = make_controller()
    execution = begin(controller)
    follow(controller, execution, 0.4)
    controller.react_to_collision(0.4, reaction)
    reference = controller.source
    execution.check_reference(controller)
    assert execution.outcome.state == "aborted"
    assert execution.outcome.reason == f"a collision was reported, and the reaction is {reaction}"
    assert controller.source is reference
