"""The fastest motion along a path: closed forms of single joints, and limits by the inverse model between points."""

import numpy as np
import pytest
from motions.planned import joint_mass, model_of, quintic
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from robot_dynamics import InvalidInputError, load_robot
from robot_dynamics.motions.retiming import retime
from robot_dynamics.motions.sampled_motion import SampledMotion, trapezoid_weights

MASS, FORCE = 2.0, 10.0


def largest_usages(model, limits, motion):
    efforts = model.efforts(model.close_loops(motion.q), motion.qd, motion.qdd)
    return [usage.max() for usage in limits.usage(efforts, motion.qd)]


def viscous_time(distance, viscous):
    """Least time of a mass with viscous friction: full force, then full force back, to rest."""
    rate, speed = viscous / MASS, FORCE / viscous

    def positions(time):
        """Where the mass is after `time` of full force, and the further way until it rests, and its time."""
        v = speed * (1 - np.exp(-rate * time))
        way = speed * (time - (1 - np.exp(-rate * time)) / rate)
        stop = np.log(1 + v / speed) / rate
        further = (v + speed) / rate * (1 - np.exp(-rate * stop)) - speed * stop
        return way, further, stop

    switch = brentq(lambda time: sum(positions(time)[:2]) - distance, 1e-6, 100.0)
    return switch + positions(switch)[2]


@pytest.mark.parametrize(
    ("friction", "velocity", "expected"),
    [
        ("", 100, 2 * np.sqrt(MASS / FORCE)),
        ("", 1, 1 + MASS / FORCE),  # acceleration, cruise, deceleration
        (", coulomb_friction: 2", 100, np.sqrt(2 * (1 / 4 + 1 / 6))),  # (10 ∓ 2) / 2 in both phases
        (", viscous_friction: 4", 100, viscous_time(1.0, 4.0)),
    ],
)
def test_mass_moves_in_the_least_time(friction, velocity, expected):
    model, limits = model_of(load_robot(joint_mass(velocity, friction)))
    retimed = retime(model, limits, quintic(3.0, [0.0], [1.0]))
    assert retimed.motion.duration == pytest.approx(expected, rel=1e-3)
    assert retimed.motion.duration >= expected * (1 - 1e-6)
    efforts, speeds = largest_usages(model, limits, retimed.motion)
    assert max(efforts, speeds) <= 1 and max(efforts, speeds) > 1 - 1e-4
    np.testing.assert_allclose(retimed.motion.q[[0, -1]], [[0.0], [1.0]], atol=1e-12)


def test_pendulum_is_as_fast_as_the_integral_of_its_energy():
    text = """
robot: pendulum
joints:
  - {joint: j, link: l, mdh: {alpha: pi/2}, mass: 1, centre_of_mass: [0.5, 0, 0], central_inertia: {zz: 0.05},
     limits: {lower: -4, upper: 4, velocity: 100, effort: 8}}
"""
    model, limits = model_of(load_robot(text))
    inertia, weight, end = 0.3, 9.81 * 0.5, 2.0

    def square(angle):
        """Square of the largest speed: from the beginning, and to the end at rest."""
        forward = 2 / inertia * (8 * angle - weight * np.sin(angle))
        backward = 2 / inertia * (8 * (end - angle) + weight * (np.sin(end) - np.sin(angle)))
        return min(forward, backward)

    switch = brentq(lambda a: 16 * a - 8 * end - weight * np.sin(end), 0, end)
    parts = [quad(lambda a: square(a) ** -0.5, *ends, epsabs=1e-9)[0] for ends in ((0, switch), (switch, end))]
    retimed = retime(model, limits, quintic(3.0, [0.0], [end]))
    assert retimed.motion.duration == pytest.approx(sum(parts), rel=1e-3)


def test_retimed_arm_touches_a_limit_and_passes_none_between_the_points():
    """At 10 times the resolution of the result, from its positions, velocities and accelerations alone."""
    model, limits = model_of(load_robot("ur5e"))
    way = np.random.default_rng(0).uniform(-1, 1, (4, 6))
    path = CubicSpline(np.arange(4.0), way, bc_type="clamped")
    times = np.linspace(0, 3, 301)
    motion = SampledMotion(times, path(times), path(times, 1), path(times, 2), trapezoid_weights(times))
    retimed = retime(model, limits, motion)
    assert max(largest_usages(model, limits, retimed.motion)) == pytest.approx(1, abs=1e-4)
    fine = retimed.resample(10 * len(retimed.motion.times) / retimed.motion.duration)
    assert 1 - 1e-3 < max(largest_usages(model, limits, fine)) <= 1
    usages = np.maximum(*(u.max(axis=1) for u in limits.usage(model.efforts(fine.q, fine.qd, fine.qdd), fine.qd)))
    assert np.mean(usages > 0.98) > 0.95  # time-optimal: some limit is reached nearly always
    step = fine.times[1]
    np.testing.assert_allclose(np.diff(fine.q, axis=0) / step, (fine.qd[1:] + fine.qd[:-1]) / 2, atol=1e-2)
    np.testing.assert_allclose(np.diff(fine.qd, axis=0).sum(axis=0), 0, atol=1e-12)
    distances = [np.abs(fine.q - position).max(axis=1).min() for position in path(np.linspace(0, 3, 40))]
    assert max(distances) < 2e-3
    assert retimed.motion.duration < 0.8 * motion.duration


def test_friction_of_all_kinds_counts():
    friction = "viscous_friction: 1, coulomb_friction: 1, stribeck_friction: 0.5, stribeck_velocity: 0.1"
    text = f"""
robot: arm
joints:
  - {{joint: a, link: la, mdh: {{alpha: pi/2}}, mass: 2, centre_of_mass: [0.2, 0, 0], central_inertia: {{zz: 0.02}},
     {friction}, limits: {{lower: -4, upper: 4, velocity: 8, effort: 30}}}}
  - {{joint: b, link: lb, mdh: {{d: 0.4}}, mass: 1, centre_of_mass: [0.2, 0, 0], central_inertia: {{zz: 0.02}},
     {friction}, load_friction: 0.1, limits: {{lower: -4, upper: 4, velocity: 8, effort: 8}}}}
"""
    model, limits = model_of(load_robot(text))
    path = CubicSpline(np.arange(3.0), [[0, 0], [1, 1], [1.5, -0.5]], bc_type="clamped")  # b turns
    times = np.linspace(0, 2, 201)
    motion = SampledMotion(times, path(times), path(times, 1), path(times, 2), trapezoid_weights(times))
    retimed = retime(model, limits, motion)
    usages = limits.usage(model.efforts(retimed.motion.q, retimed.motion.qd, retimed.motion.qdd), retimed.motion.qd)
    both = np.maximum(usages[0].max(axis=1), usages[1].max(axis=1))
    assert both.max() == pytest.approx(1, abs=1e-4) and np.mean(both > 0.98) > 0.9


def test_loops_stay_closed():
    robot = load_robot("four_bar")
    crank = robot.joints[0].initial_position
    model, limits = model_of(robot, effort=60.0, velocity=30.0)
    retimed = retime(model, limits, quintic(1.0, [crank], [crank + 0.4], 51))
    assert max(largest_usages(model, limits, retimed.motion)) == pytest.approx(1, abs=1e-4)


def test_motion_stops_where_it_turns_and_keeps_its_pauses():
    model, limits = model_of(load_robot(joint_mass(100)))
    there, back = quintic(1.0, [0.0], [1.0]), quintic(1.0, [1.0], [0.0])
    pause = quintic(0.5, [0.0], [0.0])
    pieces = [there, back, pause, there]
    begins = np.cumsum([0, *(piece.times[-1] for piece in pieces[:-1])])
    times = np.concatenate([begin + p.times[k > 0 :] for k, (begin, p) in enumerate(zip(begins, pieces, strict=True))])
    q, qd, qdd = (
        np.concatenate([getattr(piece, key)[k > 0 :] for k, piece in enumerate(pieces)]) for key in ("q", "qd", "qdd")
    )
    retimed = retime(model, limits, SampledMotion(times, q, qd, qdd, trapezoid_weights(times)))
    single = 2 * np.sqrt(MASS / FORCE)
    assert retimed.motion.duration == pytest.approx(3 * single + 0.5, abs=0.06)
    resampled = retimed.resample(200.0)
    is_resting = (resampled.qd == 0).all(axis=1)
    assert 90 <= is_resting.sum() <= 115 and resampled.q[-1] == pytest.approx(1)
    assert np.abs(resampled.q[np.argmin(np.abs(resampled.times - single))] - 1) < 1e-2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"effort": np.inf, "velocity": np.inf}, "nothing limits the speed"),
        ({"effort": 1.0}, f"effort limit of 'j' .* however slow .* takes {MASS * 9.81:.0%} of it"),
        ({"effort": 0.0}, "effort limit of 'j' .* however slow .*: it is zero"),
    ],
)
def test_paths_without_a_fastest_motion_are_refused(change, message):
    text = joint_mass(100).replace("gravity: [0, 0, 0]", "gravity: [0, 0, -9.81]")
    model, limits = model_of(load_robot(text), **change)
    with pytest.raises(InvalidInputError, match=message):
        retime(model, limits, quintic(1.0, [0.0], [1.0]))


def test_motions_with_gaps_or_at_rest_are_refused():
    model, limits = model_of(load_robot(joint_mass(100)))
    motion = quintic(1.0, [0.0], [1.0])
    weights = motion.weights.copy()
    weights[100] = 0
    with pytest.raises(InvalidInputError, match="has gaps"):
        retime(model, limits, SampledMotion(motion.times, motion.q, motion.qd, motion.qdd, weights))
    with pytest.raises(InvalidInputError, match="nothing moves"):
        retime(model, limits, quintic(1.0, [1.0], [1.0]))
