"""The controller over time: its efforts never jump, never exceed their limits, and decay to zero after faults."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_dynamics import Dynamics, Inertia, InvalidInputError, load_robot
from robot_dynamics.control.control_law import ControlLaw, actuated_joint_names
from robot_dynamics.control.controller import Controller
from robot_dynamics.control.controller_settings import Settings
from robot_dynamics.control.modes import MODES
from robot_dynamics.control.natural_adaptation import AdaptationLimits

ARM = """
robot: two_links
joints:
  - {joint: shoulder, link: upper_arm, mdh: {alpha: pi/2}, mass: 3, first_moments: [0.6, 0, 0], inertia: {zz: 0.16}}
  - {joint: elbow, link: forearm, mdh: {d: 0.4}, mass: 1, first_moments: [0.15, 0, 0], inertia: {zz: 0.03}}
"""
LAW = ControlLaw(Dynamics(load_robot(ARM)), ("elbow", "shoulder"), AdaptationLimits())
LIMITS = np.array([8.0, 30.0])
MS = 1e-3


def make_controller(**changes):
    LAW.q[:] = LAW.qd[:] = 0.0
    values = {"mode": "computed_torque", "kp": np.full(2, 100.0), "kd": np.full(2, 20.0), "limits": LIMITS, **changes}
    return Controller(LAW, Settings(**values))


def run(controller, since, until, q=(0.3, -0.2), qd=(0.0, 0.0)):
    """Efforts (steps, 2) for states each ms."""
    sent = []
    for now in np.arange(since, until, MS):
        LAW.q[:], LAW.qd[:] = q, qd
        sent.append(controller.step(now).copy())
    return np.array(sent)


def gravity():
    return LAW.dynamics.gravity(LAW.q)[LAW.joint_indices]


def test_efforts_start_with_a_ramp_and_hold_the_robot_without_a_reference():
    controller = make_controller(mode="gravity_compensation")
    sent = run(controller, 0, 0.2)
    assert np.abs(sent[0]).max() < 1e-12
    np.testing.assert_allclose(sent[50], gravity() / 2, rtol=1e-9)
    np.testing.assert_allclose(sent[150], gravity(), rtol=1e-12)
    assert np.abs(np.diff(sent, axis=0)).max() < np.abs(gravity()).max() * MS / 0.1 * 1.01


@pytest.mark.parametrize("action", ["gravity", "damp", "zero"])
def test_missing_reference_causes_the_action_of_the_settings(action):
    controller = make_controller(without_reference=action)
    controller.track_point(0.0, 0.0, [[0.2, 0.5], [0, 0], [0, 0]])
    run(controller, 0, 0.09)
    assert controller.no_reference_reason == "" and controller.activity == "computed_torque"
    sent = run(controller, 0.101, 0.3, qd=(0.5, -0.5))
    assert (
        "no point of the stream for more than 100 ms" in controller.no_reference_reason
        and controller.activity.endswith(action)
    )
    expected = {
        "gravity": gravity(),
        "damp": gravity() + (LAW.dynamics.inertia_matrix(LAW.q) @ (-20 * LAW.qd))[LAW.joint_indices],
        "zero": np.zeros(2),
    }
    np.testing.assert_allclose(sent[-1], np.clip(expected[action], -LIMITS, LIMITS), atol=1e-9)


def test_reason_of_a_fault_is_silence_when_refused_states_stop():
    controller = make_controller(mode="gravity_compensation")
    run(controller, 0, 0.2)
    refusal = "joint_states has no 'elbow'"
    controller.reject_state(0.2, refusal)
    assert controller.fault == refusal
    controller.tick(0.219)
    assert controller.fault == refusal
    controller.tick(0.221)
    assert controller.fault == f"no joint_states for more than 20 ms; the last ones could not be used: {refusal}"
    controller.reject_state(0.23, refusal)
    assert controller.fault == refusal
    run(controller, 0.231, 0.24)
    assert controller.fault == ""
    controller.tick(0.25)
    controller.tick(0.265)
    assert controller.fault == "no joint_states for more than 20 ms"


@pytest.mark.parametrize("cause", ["silence", "nan", "refused"])
def test_efforts_without_a_state_decay_to_zero_in_the_ramp_time(cause):
    controller = make_controller(mode="gravity_compensation", ramp_time=0.05)
    initial_efforts = run(controller, 0, 0.2)[-1]
    assert controller.tick(0.2) is None and controller.tick(0.219) is None
    start, sent = {"silence": 0.22, "nan": 0.2, "refused": 0.2}[cause], []
    for now in np.arange(start, start + 0.1, MS):
        if cause == "silence":
            efforts = controller.tick(now)
        elif cause == "nan":
            LAW.q[:] = 0.3, np.nan
            efforts = controller.step(now)
        else:
            efforts = controller.reject_state(now, "a joint is missing")
        sent.append(efforts.copy())
    messages = {
        "silence": "no joint_states for more than 20 ms",
        "nan": "'elbow' is nan",
        "refused": "a joint is missing",
    }
    assert messages[cause] in controller.fault
    # the efforts decay from then on, also where the fault is detected later
    stale = {"silence": 0.199 + 0.02, "nan": 0.2, "refused": 0.2}[cause]
    remaining = np.clip(1 - (start + np.arange(len(sent)) * MS - stale) / 0.05, 0, 1)[:, None]
    np.testing.assert_allclose(sent, remaining * initial_efforts, atol=1e-6)
    assert np.abs(sent[-1]).max() == 0


def test_efforts_return_by_a_ramp_after_a_fault():
    controller = make_controller(mode="gravity_compensation")
    run(controller, 0, 0.2)
    for now in np.arange(0.2, 0.5, MS):
        controller.reject_state(now, "wrong")
    sent = run(controller, 0.5, 0.65)
    assert controller.fault == "" and np.abs(np.diff(np.vstack([[0, 0], sent]), axis=0)).max() < 0.2
    np.testing.assert_allclose(sent[-1], gravity(), rtol=1e-9)


def test_long_fault_drops_the_reference_and_a_single_bad_state_does_not():
    controller = make_controller()
    controller.follow_trajectory(
        0.0, 0.0, [0.0, 5.0], np.array([[[0, 0], [1, 1]], [[0, 0], [0, 0]], [[0, 0], [0, 0]]], dtype=float)
    )
    before = run(controller, 0, 0.2)[-1]
    after = controller.reject_state(0.2, "wrong").copy()
    assert np.abs(after - before).max() < 0.02 * LIMITS.max()
    run(controller, 0.201, 0.3)
    assert controller.no_reference_reason == ""
    for now in np.arange(0.3, 0.45, MS):
        controller.reject_state(now, "wrong")
    run(controller, 0.45, 0.6)
    assert (
        "dropped when efforts went to zero: wrong" in controller.no_reference_reason
        and controller.activity == "no reference: damp"
    )


HOLD = np.array([[[0.3, 0.2]], [[0, 0]], [[0, 0]]])  # a trajectory of one point


@pytest.mark.parametrize("detection", ["tick", "good state", "old state"])
@pytest.mark.parametrize(
    ("duration", "keeps_reference"), [(0.015, True), (0.06, True), (0.119, True), (0.121, False), (0.9, False)]
)
def test_stalled_process_acts_as_one_that_ran(detection, duration, keeps_reference):
    controller = make_controller()
    controller.follow_trajectory(0.0, 0.0, [0.0], HOLD)
    initial_efforts = run(controller, 0, 0.3005)[-1]
    now = 0.3 + duration
    if detection == "tick":
        efforts = controller.tick(now)
    elif detection == "good state":
        efforts = controller.step(now)
    else:
        efforts = controller.reject_state(now, "joint_states are old by their stamp")
    if detection != "old state" and duration < 0.02:
        assert controller.fault == ""
    else:
        since = min(0.02, duration)
        np.testing.assert_allclose(efforts, np.clip(1 - (duration - since) / 0.1, 0, 1) * initial_efforts, atol=1e-9)
        if duration > 0.02:
            assert f"stalled, or its clock jumped ahead, by {duration:.3f} s" in controller.fault
        first = np.abs(efforts).max()
        np.testing.assert_array_less(
            np.abs(run(controller, now + MS, now + 3 * MS)), first + 0.05 * np.abs(initial_efforts).max()
        )
    run(controller, now + 3 * MS, now + 0.2)
    assert controller.fault == "" and (controller.no_reference_reason == "") == keeps_reference
    if not keeps_reference:
        assert "it was dropped when efforts went to zero: this node stalled" in controller.no_reference_reason


def test_state_with_a_long_transit_time_is_stale_earlier():
    controller = make_controller(mode="gravity_compensation")
    run(controller, 0, 0.2)
    controller.step(0.2, published=0.185)
    assert controller.tick(0.2049) is None
    assert controller.tick(0.2051) is not None and "no joint_states" in controller.fault


def test_reference_that_comes_during_a_fault_lasts_a_ramp_time():
    controller = make_controller()
    run(controller, 0, 0.2)
    for now in np.arange(0.2, 0.5, MS):
        controller.reject_state(now, "wrong")
    controller.follow_trajectory(0.5, 0.5, [0.0], HOLD)
    for now in np.arange(0.5, 0.6, MS):
        controller.reject_state(now, "wrong")
        assert controller.no_reference_reason == ""
    controller.reject_state(0.602, "wrong")
    assert "dropped when efforts went to zero: wrong" in controller.no_reference_reason


@pytest.mark.parametrize(("seconds", "is_followed"), [(0.09, True), (0.2, False)])
@pytest.mark.parametrize("received", [0.2, 0.35])
def test_trajectory_that_was_read_during_a_fault_is_followed_as_one_that_came_at_once(seconds, is_followed, received):
    controller = make_controller()
    run(controller, 0, 0.3)
    trajectory = controller.prepare_trajectory([0.0], HOLD)
    for now in np.arange(0.3, max(received, 0.3) + seconds, MS):
        controller.reject_state(now, "wrong")
    run(controller, now + MS, now + 0.5)
    if is_followed:
        controller.follow(now + 0.5, now + 0.5, trajectory, received)
    else:
        with pytest.raises(InvalidInputError, match="efforts went to zero while the trajectory was read"):
            controller.follow(now + 0.5, now + 0.5, trajectory, received)
    assert (controller.no_reference_reason == "") == is_followed


def test_trajectory_that_was_received_before_the_clock_jumped_back_is_refused():
    controller = make_controller()
    run(controller, 5.0, 5.3)
    trajectory = controller.prepare_trajectory([0.0], HOLD)
    run(controller, 1.0, 1.2)
    with pytest.raises(InvalidInputError, match="the clock jumped back while"):
        controller.follow(1.2, 1.2, trajectory, 5.25)
    assert "clock jumped back" in controller.fault


def test_clock_that_jumps_back_is_a_fault_until_a_new_reference():
    controller = make_controller()
    controller.follow_trajectory(5.0, 5.0, [0.0, 1.0], np.zeros((3, 2, 2)))
    run(controller, 5, 5.3)
    run(controller, 1.0, 1.2)
    assert "clock jumped back by 4.299 s" in controller.fault and np.abs(controller.last_efforts).max() == 0
    run(controller, 1.2, 2.0)
    assert controller.fault
    controller.follow_trajectory(2.0, 2.0, [0.0, 1.0], np.zeros((3, 2, 2)))
    run(controller, 2.0, 2.2)
    assert controller.fault == "" and np.abs(controller.last_efforts).max() > 1


def test_late_efforts_in_a_row_are_a_fault_until_one_is_in_time():
    controller = make_controller(mode="gravity_compensation", deadline_misses=3)
    for k, latency in enumerate([0.006, 0.006, 0.001, 0.006, 0.006, 0.006]):
        assert controller.fault == ""
        run(controller, k * MS, k * MS + MS / 2)
        controller.watchdog.record_latency(latency)
    run(controller, 6 * MS, 6.5 * MS)
    assert "efforts for the last 3 states were later than 5 ms" in controller.fault
    controller.watchdog.record_latency(0.001)
    run(controller, 7 * MS, 7.5 * MS)
    assert controller.fault == ""


def test_modes_and_gains_change_without_a_jump_of_the_efforts():
    controller = make_controller(mode="gravity_compensation", limits=np.full(2, np.inf))
    controller.follow_trajectory(0.0, 0.0, [0.0, 1.0], np.zeros((3, 2, 2)))
    sent = [run(controller, 0, 0.2)]
    for k, mode in enumerate([*MODES[1:], MODES[0]], start=1):
        controller.apply(Settings(mode, np.full(2, 100.0 * k), np.full(2, 20.0 * k), np.full(2, np.inf)))
        sent.append(run(controller, 0.2 * k, 0.2 * k + 0.2))
    levels = np.array([part[-1] for part in sent])
    steps = np.abs(np.diff(np.concatenate(sent), axis=0)).max(axis=0)
    level_changes = np.abs(np.diff(levels, axis=0)).max(axis=0)
    assert (level_changes > 0.5).all() and (steps < 0.011 * np.maximum(level_changes, levels[0])).all()


@pytest.mark.parametrize("measured", [False, True], ids=["motors measured", "springs too"])
def test_trajectory_starts_at_the_links_beyond_elastic_gears(measured):
    """The robot is at rest and its springs bear its weight: the first reference of the motors is their position."""
    dynamics = Dynamics(load_robot("manutec_r3"), compiled=False)
    law = ControlLaw(dynamics, actuated_joint_names(dynamics))
    equilibrium = dynamics.equilibrium(np.array([0.1, 0, 0.5, 0, 0.4, 0, 0.2, -0.3, 0.1]))
    measured_joints = np.arange(9) if measured else law.joint_indices
    law.q[measured_joints] = equilibrium.positions[measured_joints]
    assert np.abs(equilibrium.positions[law.elastic_actuators.springs][1:]).min() > 1e-4
    controller = Controller(law, Settings("computed_torque", np.full(6, 400.0), np.full(6, 40.0), np.full(6, np.inf)))
    controller.step(0.0)
    points = np.full((3, 1, 6), np.nan)
    points[0, 0], points[1:] = 0.0, 0.0
    controller.follow_trajectory(0.0, 0.0, [1.0], points)
    controller.step(0.001)
    np.testing.assert_allclose(controller.reference[0], equilibrium.positions[law.joint_indices], atol=1e-5)


def test_friction_is_compensated_at_the_velocity_of_the_settings():
    dynamics = Dynamics(load_robot(ARM.replace("mass:", "viscous_friction: 2, coulomb_friction: 0.5, mass:")))
    sent = {}
    for velocity in ("reference", "measured"):
        law = ControlLaw(dynamics, LAW.joints)
        kp, kd, unlimited = np.full(2, 100.0), np.full(2, 20.0), np.full(2, np.inf)
        controller = Controller(law, Settings("computed_torque", kp, kd, unlimited, friction_velocity=velocity))
        controller.track_point(0.0, 0.0, [[0.3, -0.2], [0.4, -0.6], [0.0, 0.0]])
        for now in np.arange(0, 0.05, MS):  # longer than the transition
            law.q[:], law.qd[:] = (0.3, -0.2), (-0.1, 0.7)
            controller.step(now)
        reference = np.zeros((3, 2))
        law.sample_reference(controller._source, now, reference)
        e, ed, edd = reference - [law.q[law.joint_indices], law.qd[law.joint_indices], np.zeros(2)]
        accelerations = np.zeros(2)
        accelerations[law.joint_indices] = edd + 20 * ed + 100 * e
        frictionless = dynamics.inverse(law.q, law.qd, accelerations) - dynamics.friction(law.qd)
        velocities = law.qd.copy()
        if velocity == "reference":
            velocities[law.joint_indices] = reference[1]
        sent[velocity] = controller._desired_efforts.copy()
        np.testing.assert_allclose(
            sent[velocity], (frictionless + dynamics.friction(velocities))[law.joint_indices], rtol=1e-9
        )
    assert np.abs(sent["reference"] - sent["measured"]).min() > 0.5


def test_payload_changes_without_a_jump_of_the_efforts():
    controller = make_controller(mode="gravity_compensation", limits=np.full(2, np.inf))
    empty = run(controller, 0, 0.2)[-1]
    loaded = Dynamics(LAW.dynamics.robot.with_payload("forearm", Inertia(2.0, [0.6, 0, 0])))
    controller.replace_law(ControlLaw(loaded, LAW.joints))
    np.testing.assert_array_equal(controller.law.q, LAW.q)
    sent = np.array([controller.step(now).copy() for now in np.arange(0.2, 0.4, MS)])
    expected = loaded.gravity(LAW.q)[LAW.joint_indices]
    np.testing.assert_allclose(sent[-1], expected, rtol=1e-9)
    assert np.abs(expected - empty).min() > 5
    assert np.abs(np.diff(np.vstack([empty, sent]), axis=0)).max() < 0.0101 * np.abs(expected - empty).max()


@pytest.mark.parametrize("robot", ["irb460", "sr400"])
def test_loops_keep_their_seeds_when_the_law_is_replaced(robot):
    dynamics = Dynamics(load_robot(robot))
    law = ControlLaw(dynamics, actuated_joint_names(dynamics))
    controller = Controller(
        law, Settings("gravity_compensation", np.ones(1), np.ones(1), np.full(len(law.joints), np.inf))
    )
    start = dynamics.initial_joint_positions[[dynamics.all_joint_names.index(name) for name in dynamics.joint_names]]
    for k in range(200):
        law.q[:] = start + 0.0005 * k * np.resize([1, -1], len(start))
        efforts = controller.step(k * MS).copy()
    assert controller.fault == ""
    controller.replace_law(ControlLaw(Dynamics(load_robot(robot)), law.joints))
    np.testing.assert_array_equal(controller.law._positions.measured, law._positions.measured)
    np.testing.assert_allclose(controller.step(0.2), efforts, rtol=1e-9, atol=1e-9)


def test_references_beyond_joint_limits_are_refused_and_the_previous_one_remains():
    limited = ARM.replace("link: forearm,", "link: forearm, limits: {lower: -2, upper: 1.5, velocity: 3, effort: 8},")
    controller = Controller(
        ControlLaw(Dynamics(load_robot(limited)), ("elbow", "shoulder")), make_controller().settings
    )
    points = np.zeros((3, 2, 2))
    points[0] = [[1.5, 7.0], [-2.0, -7.0]]  # at the limits of one, the other has none
    controller.follow_trajectory(0.0, 0.0, [0.0, 1.0], points)
    for position in (1.51, -2.01):
        points[0, 1, 0] = position
        message = rf"points\[1\].positions has {position} for 'elbow': .* limits it to -2 to 1.5"
        with pytest.raises(InvalidInputError, match=message):
            controller.follow_trajectory(0.0, 0.0, [0.0, 1.0], points)
        with pytest.raises(InvalidInputError, match=rf"points\[0\].positions has {position}"):
            controller.track_point(0.0, 0.0, points[:, 1])
    assert controller.no_reference_reason == ""


def test_trajectory_that_starts_later_is_reached_from_the_present_position():
    controller = make_controller()
    with pytest.raises(InvalidInputError, match="no state yet"):
        controller.follow_trajectory(0.0, 0.0, [1.0], np.ones((3, 1, 2)) * [[[1.0]], [[0]], [[0]]])
    run(controller, 0, 0.1, q=(0.3, -0.2), qd=(0.1, 0.0))
    points = np.full((3, 1, 2), np.nan)
    points[0], points[1] = 1.0, 0.0
    controller.follow_trajectory(0.1, 0.1, [1.0], points)
    run(controller, 0.1, 0.102)
    np.testing.assert_allclose(controller.reference[0], [-0.2, 0.3], atol=1e-3)
    np.testing.assert_allclose(controller.reference[1], [0.0, 0.1], atol=1e-2)
    run(controller, 0.102, 1.3)
    np.testing.assert_array_equal(controller.reference, [[1, 1], [0, 0], [0, 0]])
    with pytest.raises(InvalidInputError, match=r"ended 0.300 s ago"):
        controller.follow_trajectory(1.3, 0.0, [0.0, 1.0], np.zeros((3, 2, 2)))
    with pytest.raises(InvalidInputError, match=r"0.500 s old"):
        controller.track_point(1.5, 1.0, np.zeros((3, 2)))
    for ahead in (0.11, 3600.0, np.inf):
        with pytest.raises(InvalidInputError, match=r"ahead of the clock, but a point is valid for 0\.1 s"):
            controller.track_point(1.5, 1.5 + ahead, np.zeros((3, 2)))
    assert controller.no_reference_reason == ""
    controller.follow_trajectory(1.3, 1.3, [], np.zeros((3, 0, 2)))
    assert controller.no_reference_reason == "the reference was ended"


NUMBERS = st.one_of(st.floats(-3, 3), st.sampled_from([np.nan, np.inf, -np.inf, 1e300, -1e12]))
EVENTS = st.one_of(
    st.tuples(st.just("step"), st.lists(NUMBERS, min_size=4, max_size=4)),
    st.tuples(st.just("tick"), st.floats(0, 0.2)),
    st.tuples(st.just("refuse"), st.just(0.0)),
    st.tuples(st.just("back"), st.floats(0, 3)),
    st.tuples(st.just("mode"), st.sampled_from(MODES)),
    st.tuples(st.just("gains"), st.floats(0, 1e9)),
    st.tuples(st.just("track"), st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=6)),
    st.tuples(st.just("follow"), st.floats(-1, 2)),
)


@settings(max_examples=100)
@given(st.lists(EVENTS, max_size=60))
def test_efforts_are_finite_and_within_limits_for_any_events(events):
    controller, now = make_controller(), 10.0
    settings = controller.settings
    for kind, value in events:
        now += MS
        efforts = controller.last_efforts
        if kind == "step":
            LAW.q[:], LAW.qd[:] = value[:2], value[2:]
            efforts = controller.step(now)
        elif kind == "tick":
            now += value
            efforts = controller.tick(now)
        elif kind == "refuse":
            efforts = controller.reject_state(now, "wrong")
        elif kind == "back":
            now -= value
        elif kind in ("mode", "gains"):
            values = {"mode": value} if kind == "mode" else {"kp": np.full(2, value)}
            settings = Settings(**{**vars(settings), **values})
            controller.apply(settings)
        else:
            try:
                if kind == "track":
                    controller.track_point(now, now, np.reshape(value, (3, 2)))
                else:
                    controller.follow_trajectory(now, now + value, [0.0, 0.5], np.zeros((3, 2, 2)))
            except InvalidInputError:
                continue
        if efforts is not None:
            assert np.isfinite(efforts).all() and (np.abs(efforts) <= LIMITS).all()
