"""The controller in time: what it sends never jumps, never exceeds its limits, and goes to zero when it should."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_dynamics import Dynamics, Inertia, InvalidInputError, load_robot
from robot_dynamics.control.control_law import MODES, ControlLaw, actuated_joint_names
from robot_dynamics.control.controller import Controller, Settings

ARM = """
robot: two_links
joints:
  - {joint: shoulder, link: upper_arm, mdh: {alpha: pi/2}, mass: 3, first_moments: [0.6, 0, 0], inertia: {zz: 0.16}}
  - {joint: elbow, link: forearm, mdh: {d: 0.4}, mass: 1, first_moments: [0.15, 0, 0], inertia: {zz: 0.03}}
"""
LAW = ControlLaw(Dynamics(load_robot(ARM)), ("elbow", "shoulder"))
LIMITS = np.array([8.0, 30.0])
MS = 1e-3


def controller(**changes):
    LAW.q[:] = LAW.qd[:] = 0.0
    told = {"mode": "computed_torque", "kp": np.full(2, 100.0), "kd": np.full(2, 20.0), "limits": LIMITS, **changes}
    return Controller(LAW, Settings(**told))


def run(made, since, until, q=(0.3, -0.2), qd=(0.0, 0.0)):
    """Efforts of states each ms."""
    sent = []
    for now in np.arange(since, until, MS):
        LAW.q[:], LAW.qd[:] = q, qd
        sent.append(made.step(now).copy())
    return np.array(sent)


def gravity():
    return LAW.dynamics.gravity(LAW.q)[LAW.joint_indices]


def test_efforts_come_in_by_a_ramp_and_hold_the_robot_without_a_reference():
    made = controller(mode="gravity_compensation")
    sent = run(made, 0, 0.2)
    assert np.abs(sent[0]).max() < 1e-12
    np.testing.assert_allclose(sent[50], gravity() / 2, rtol=1e-9)
    np.testing.assert_allclose(sent[150], gravity(), rtol=1e-12)
    assert np.abs(np.diff(sent, axis=0)).max() < np.abs(gravity()).max() * MS / 0.1 * 1.01


@pytest.mark.parametrize("what", ["gravity", "damp", "zero"])
def test_a_lost_reference_is_answered_as_the_parameter_says(what):
    made = controller(without_reference=what)
    made.track_point(0.0, 0.0, [[0.2, 0.5], [0, 0], [0, 0]])
    run(made, 0, 0.09)
    assert made.no_reference_reason == "" and made.activity == "computed_torque"
    sent = run(made, 0.101, 0.3, qd=(0.5, -0.5))
    assert "no point of the stream for more than 100 ms" in made.no_reference_reason and made.activity.endswith(what)
    expected = {
        "gravity": gravity(),
        "damp": gravity() + (LAW.dynamics.inertia_matrix(LAW.q) @ (-20 * LAW.qd))[LAW.joint_indices],
        "zero": np.zeros(2),
    }
    np.testing.assert_allclose(sent[-1], np.clip(expected[what], -LIMITS, LIMITS), atol=1e-9)


@pytest.mark.parametrize("how", ["silence", "nan", "refused"])
def test_without_a_state_efforts_go_to_zero_in_a_stated_time_and_zeros_are_sent_on(how):
    made = controller(mode="gravity_compensation", ramp_time=0.05)
    held = run(made, 0, 0.2)[-1]
    assert made.tick(0.2) is None and made.tick(0.219) is None
    began, sent = {"silence": 0.22, "nan": 0.2, "refused": 0.2}[how], []
    for now in np.arange(began, began + 0.1, MS):
        if how == "silence":
            efforts = made.tick(now)
        elif how == "nan":
            LAW.q[:] = 0.3, np.nan
            efforts = made.step(now)
        else:
            efforts = made.reject_state(now, "a joint is missing")
        sent.append(efforts.copy())
    said = {"silence": "no joint_states for more than 20 ms", "nan": "'elbow' is nan", "refused": "a joint is missing"}
    assert said[how] in made.fault
    stale = {"silence": 0.199 + 0.02, "nan": 0.2, "refused": 0.2}[how]  # from then on, noticed or not
    left = np.clip(1 - (began + np.arange(len(sent)) * MS - stale) / 0.05, 0, 1)[:, None]
    np.testing.assert_allclose(sent, left * held, atol=1e-6)
    assert np.abs(sent[-1]).max() == 0


def test_good_states_bring_efforts_back_by_a_ramp():
    made = controller(mode="gravity_compensation")
    run(made, 0, 0.2)
    for now in np.arange(0.2, 0.5, MS):
        made.reject_state(now, "wrong")
    sent = run(made, 0.5, 0.65)
    assert made.fault == "" and np.abs(np.diff(np.vstack([[0, 0], sent]), axis=0)).max() < 0.2
    np.testing.assert_allclose(sent[-1], gravity(), rtol=1e-9)


def test_one_bad_state_hardly_shows_and_a_long_fault_drops_the_reference():
    made = controller()
    made.follow_trajectory(
        0.0, 0.0, [0.0, 5.0], np.array([[[0, 0], [1, 1]], [[0, 0], [0, 0]], [[0, 0], [0, 0]]], dtype=float)
    )
    before = run(made, 0, 0.2)[-1]
    after = made.reject_state(0.2, "wrong").copy()
    assert np.abs(after - before).max() < 0.02 * LIMITS.max()
    run(made, 0.201, 0.3)
    assert made.no_reference_reason == ""
    for now in np.arange(0.3, 0.45, MS):
        made.reject_state(now, "wrong")
    run(made, 0.45, 0.6)
    assert (
        "dropped when efforts went to zero: wrong" in made.no_reference_reason and made.activity == "no reference: damp"
    )


HOLD = np.array([[[0.3, 0.2]], [[0, 0]], [[0, 0]]])  # a trajectory of one point


@pytest.mark.parametrize("noticed", ["tick", "good state", "old state"])
@pytest.mark.parametrize(("lasts", "kept"), [(0.015, True), (0.06, True), (0.119, True), (0.121, False), (0.9, False)])
def test_a_process_that_stood_still_acts_as_if_it_had_gone_on(noticed, lasts, kept):
    made = controller()
    made.follow_trajectory(0.0, 0.0, [0.0], HOLD)
    held = run(made, 0, 0.3005)[-1]
    now = 0.3 + lasts
    if noticed == "tick":
        efforts = made.tick(now)
    elif noticed == "good state":
        efforts = made.step(now)
    else:
        efforts = made.reject_state(now, "joint_states are old by their stamp")
    if noticed != "old state" and lasts < 0.02:
        assert made.fault == ""
    else:
        since = min(0.02, lasts)
        np.testing.assert_allclose(efforts, np.clip(1 - (lasts - since) / 0.1, 0, 1) * held, atol=1e-9)
        if lasts > 0.02:
            assert f"stalled, or its clock jumped ahead, by {lasts:.3f} s" in made.fault
        first = np.abs(efforts).max()
        np.testing.assert_array_less(np.abs(run(made, now + MS, now + 3 * MS)), first + 0.05 * np.abs(held).max())
    run(made, now + 3 * MS, now + 0.2)
    assert made.fault == "" and (made.no_reference_reason == "") == kept
    if not kept:
        assert "it was dropped when efforts went to zero: this node stalled" in made.no_reference_reason


def test_a_state_that_was_under_way_for_long_is_stale_sooner():
    made = controller(mode="gravity_compensation")
    run(made, 0, 0.2)
    made.step(0.2, published=0.185)
    assert made.tick(0.2049) is None
    assert made.tick(0.2051) is not None and "no joint_states" in made.fault


def test_a_reference_that_comes_during_a_fault_has_its_own_ramp_time():
    made = controller()
    run(made, 0, 0.2)
    for now in np.arange(0.2, 0.5, MS):
        made.reject_state(now, "wrong")
    made.follow_trajectory(0.5, 0.5, [0.0], HOLD)
    for now in np.arange(0.5, 0.6, MS):
        made.reject_state(now, "wrong")
        assert made.no_reference_reason == ""
    made.reject_state(0.602, "wrong")
    assert "dropped when efforts went to zero: wrong" in made.no_reference_reason


def test_a_clock_that_jumps_back_stops_all_until_a_new_reference():
    made = controller()
    made.follow_trajectory(5.0, 5.0, [0.0, 1.0], np.zeros((3, 2, 2)))
    run(made, 5, 5.3)
    run(made, 1.0, 1.2)
    assert "clock jumped back by 4.299 s" in made.fault and np.abs(made.last_efforts).max() == 0
    run(made, 1.2, 2.0)
    assert made.fault
    made.follow_trajectory(2.0, 2.0, [0.0, 1.0], np.zeros((3, 2, 2)))
    run(made, 2.0, 2.2)
    assert made.fault == "" and np.abs(made.last_efforts).max() > 1


def test_late_answers_in_a_row_are_a_fault_until_one_is_in_time():
    made = controller(mode="gravity_compensation", deadline_misses=3)
    for k, latency in enumerate([0.006, 0.006, 0.001, 0.006, 0.006, 0.006]):
        assert made.fault == ""
        run(made, k * MS, k * MS + MS / 2)
        made.watchdog.record_latency(latency)
    run(made, 6 * MS, 6.5 * MS)
    assert "efforts for the last 3 states were later than 5 ms" in made.fault
    made.watchdog.record_latency(0.001)
    run(made, 7 * MS, 7.5 * MS)
    assert made.fault == ""


def test_modes_and_gains_change_without_a_jump():
    made = controller(mode="gravity_compensation", limits=np.full(2, np.inf))
    made.follow_trajectory(0.0, 0.0, [0.0, 1.0], np.zeros((3, 2, 2)))
    sent = [run(made, 0, 0.2)]
    for k, mode in enumerate([*MODES[1:], MODES[0]], start=1):
        made.apply(Settings(mode, np.full(2, 100.0 * k), np.full(2, 20.0 * k), np.full(2, np.inf)))
        sent.append(run(made, 0.2 * k, 0.2 * k + 0.2))
    levels = np.array([part[-1] for part in sent])
    steps = np.abs(np.diff(np.concatenate(sent), axis=0)).max(axis=0)
    jumps = np.abs(np.diff(levels, axis=0)).max(axis=0)
    assert (jumps > 0.5).all() and (steps < 0.011 * np.maximum(jumps, levels[0])).all()


@pytest.mark.parametrize("measured", [False, True], ids=["motors measured", "springs too"])
def test_a_trajectory_begins_where_the_links_beyond_elastic_gears_are(measured):
    """Of a robot at rest, whose springs bear its weight: its motors are not wanted elsewhere at first."""
    dynamics = Dynamics(load_robot("manutec_r3"), compiled=False)
    law = ControlLaw(dynamics, actuated_joint_names(dynamics))
    rest = dynamics.equilibrium(np.array([0.1, 0, 0.5, 0, 0.4, 0, 0.2, -0.3, 0.1]))
    known = np.arange(9) if measured else law.joint_indices
    law.q[known] = rest.positions[known]
    assert np.abs(rest.positions[law.elastic_actuators.springs][1:]).min() > 1e-4
    made = Controller(law, Settings("computed_torque", np.full(6, 400.0), np.full(6, 40.0), np.full(6, np.inf)))
    made.step(0.0)
    points = np.full((3, 1, 6), np.nan)
    points[0, 0], points[1:] = 0.0, 0.0
    made.follow_trajectory(0.0, 0.0, [1.0], points)
    made.step(0.001)
    np.testing.assert_allclose(made.reference[0], rest.positions[law.joint_indices], atol=1e-5)  # it is 1 ms on its way


def test_friction_is_compensated_at_the_velocity_that_the_settings_name():
    rubbing = Dynamics(load_robot(ARM.replace("mass:", "viscous_friction: 2, coulomb_friction: 0.5, mass:")))
    sent = {}
    for velocity in ("reference", "measured"):
        law = ControlLaw(rubbing, LAW.joints)
        kp, kd, unlimited = np.full(2, 100.0), np.full(2, 20.0), np.full(2, np.inf)
        made = Controller(law, Settings("computed_torque", kp, kd, unlimited, friction_velocity=velocity))
        made.track_point(0.0, 0.0, [[0.3, -0.2], [0.4, -0.6], [0.0, 0.0]])
        for now in np.arange(0, 0.05, MS):  # no blend is left where efforts never were others
            law.q[:], law.qd[:] = (0.3, -0.2), (-0.1, 0.7)
            made.step(now)
        reference = np.zeros((3, 2))
        law.sample_reference(made._source, now, reference)
        e, ed, edd = reference - [law.q[law.joint_indices], law.qd[law.joint_indices], np.zeros(2)]
        wanted = np.zeros(2)
        wanted[law.joint_indices] = edd + 20 * ed + 100 * e
        frictionless = rubbing.inverse(law.q, law.qd, wanted) - rubbing.friction(law.qd)
        at = law.qd.copy()
        if velocity == "reference":
            at[law.joint_indices] = reference[1]
        sent[velocity] = made._desired_efforts.copy()
        np.testing.assert_allclose(sent[velocity], (frictionless + rubbing.friction(at))[law.joint_indices], rtol=1e-9)
    assert np.abs(sent["reference"] - sent["measured"]).min() > 0.5


def test_another_payload_is_taken_over_without_a_jump():
    made = controller(mode="gravity_compensation", limits=np.full(2, np.inf))
    empty = run(made, 0, 0.2)[-1]
    loaded = Dynamics(LAW.dynamics.robot.with_payload("forearm", Inertia(2.0, [0.6, 0, 0])))
    made.replace_law(ControlLaw(loaded, LAW.joints))
    np.testing.assert_array_equal(made.law.q, LAW.q)
    sent = np.array([made.step(now).copy() for now in np.arange(0.2, 0.4, MS)])
    expected = loaded.gravity(LAW.q)[LAW.joint_indices]
    np.testing.assert_allclose(sent[-1], expected, rtol=1e-9)
    assert np.abs(expected - empty).min() > 5
    assert np.abs(np.diff(np.vstack([empty, sent]), axis=0)).max() < 0.0101 * np.abs(expected - empty).max()


@pytest.mark.parametrize("robot", ["irb460", "sr400"])
def test_loops_are_closed_from_where_they_were_when_the_robot_is_another(robot):
    dynamics = Dynamics(load_robot(robot))
    law = ControlLaw(dynamics, actuated_joint_names(dynamics))
    made = Controller(law, Settings("gravity_compensation", np.ones(1), np.ones(1), np.full(len(law.joints), np.inf)))
    start = dynamics.initial_joint_positions[[dynamics.all_joint_names.index(name) for name in dynamics.joint_names]]
    for k in range(200):
        law.q[:] = start + 0.0005 * k * np.resize([1, -1], len(start))
        efforts = made.step(k * MS).copy()
    assert made.fault == ""
    made.replace_law(ControlLaw(Dynamics(load_robot(robot)), law.joints))
    np.testing.assert_array_equal(made.law._positions.measured, law._positions.measured)
    np.testing.assert_allclose(made.step(0.2), efforts, rtol=1e-9, atol=1e-9)


def test_references_beyond_the_limits_of_joints_are_refused_and_the_one_before_stays():
    limited = ARM.replace("link: forearm,", "link: forearm, limits: {lower: -2, upper: 1.5, velocity: 3, effort: 8},")
    made = Controller(ControlLaw(Dynamics(load_robot(limited)), ("elbow", "shoulder")), controller().settings)
    points = np.zeros((3, 2, 2))
    points[0] = [[1.5, 7.0], [-2.0, -7.0]]  # at the limits of one, the other has none
    made.follow_trajectory(0.0, 0.0, [0.0, 1.0], points)
    for beyond in (1.51, -2.01):
        points[0, 1, 0] = beyond
        told = rf"points\[1\].positions has {beyond} for 'elbow': .* limits it to -2 to 1.5"
        with pytest.raises(InvalidInputError, match=told):
            made.follow_trajectory(0.0, 0.0, [0.0, 1.0], points)
        with pytest.raises(InvalidInputError, match=rf"points\[0\].positions has {beyond}"):
            made.track_point(0.0, 0.0, points[:, 1])
    assert made.no_reference_reason == ""


def test_a_trajectory_that_begins_later_is_reached_from_where_the_robot_is():
    made = controller()
    with pytest.raises(InvalidInputError, match="no state yet"):
        made.follow_trajectory(0.0, 0.0, [1.0], np.ones((3, 1, 2)) * [[[1.0]], [[0]], [[0]]])
    run(made, 0, 0.1, q=(0.3, -0.2), qd=(0.1, 0.0))
    points = np.full((3, 1, 2), np.nan)
    points[0], points[1] = 1.0, 0.0
    made.follow_trajectory(0.1, 0.1, [1.0], points)
    run(made, 0.1, 0.102)
    np.testing.assert_allclose(made.reference[0], [-0.2, 0.3], atol=1e-3)
    np.testing.assert_allclose(made.reference[1], [0.0, 0.1], atol=1e-2)
    run(made, 0.102, 1.3)
    np.testing.assert_array_equal(made.reference, [[1, 1], [0, 0], [0, 0]])
    with pytest.raises(InvalidInputError, match=r"ended 0.300 s ago"):
        made.follow_trajectory(1.3, 0.0, [0.0, 1.0], np.zeros((3, 2, 2)))
    with pytest.raises(InvalidInputError, match=r"0.500 s old"):
        made.track_point(1.5, 1.0, np.zeros((3, 2)))
    assert made.no_reference_reason == ""
    made.follow_trajectory(1.3, 1.3, [], np.zeros((3, 0, 2)))
    assert made.no_reference_reason == "the reference was ended"


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
def test_whatever_happens_efforts_are_finite_and_within_their_limits(events):
    made, now = controller(), 10.0
    settings = made.settings
    for kind, value in events:
        now += MS
        efforts = made.last_efforts
        if kind == "step":
            LAW.q[:], LAW.qd[:] = value[:2], value[2:]
            efforts = made.step(now)
        elif kind == "tick":
            now += value
            efforts = made.tick(now)
        elif kind == "refuse":
            efforts = made.reject_state(now, "wrong")
        elif kind == "back":
            now -= value
        elif kind in ("mode", "gains"):
            told = {"mode": value} if kind == "mode" else {"kp": np.full(2, value)}
            settings = Settings(**{**vars(settings), **told})
            made.apply(settings)
        else:
            try:
                if kind == "track":
                    made.track_point(now, now, np.reshape(value, (3, 2)))
                else:
                    made.follow_trajectory(now, now + value, [0.0, 0.5], np.zeros((3, 2, 2)))
            except InvalidInputError:
                continue
        if efforts is not None:
            assert np.isfinite(efforts).all() and (np.abs(efforts) <= LIMITS).all()
