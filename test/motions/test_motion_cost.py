"""Costs of motions: closed forms of a mass, energy balance of an arm with friction, motors behind gears."""

import re

import numpy as np
import pytest
from motions.planned import joint_mass, model_of, quintic

from robot_dynamics import Dynamics, InvalidInputError, RecordingError, load_robot
from robot_dynamics.errors import DescriptionError
from robot_dynamics.motions.effort_model import EffortModel
from robot_dynamics.motions.motion_cost import compute_motion_cost
from robot_dynamics.motions.retiming import retime
from robot_dynamics.motions.sampled_motion import (
    SampledMotion,
    describe_contradictions,
    planned_motion,
    trapezoid_weights,
)
from robot_dynamics.motions.time_scaling import find_time_scale
from robot_dynamics.recordings.drives import direct_drives, load_drives, write_drives
from robot_dynamics.simulation.energy import kinetic_energy, potential_energy

ARM = """
robot: arm
joints:
  - {joint: a, link: la, mdh: {alpha: pi/2}, mass: 2, centre_of_mass: [0.2, 0, 0], central_inertia: {zz: 0.02},
     viscous_friction: 1.5, coulomb_friction: 0.7, limits: {lower: -4, upper: 4, velocity: 8, effort: 30}}
  - {joint: b, link: lb, mdh: {d: 0.4}, mass: 1, centre_of_mass: [0.2, 0, 0], central_inertia: {zz: 0.02},
     viscous_friction: 0.5, limits: {lower: -4, upper: 4, velocity: 8, effort: 8}}
"""
DRIVES = """
format: 1
motors:
  one: {a: -50}
  two: {a: 20, b: 40}
limits:
  one: {torque_speed: [[0, 1.2], [100, 1], [300, 0]], velocity: 290}
  two: {effort: 0.5}
"""


def sine(amplitude, rate, periods, count=4001):
    times = np.linspace(0, periods * 2 * np.pi / rate, count)[:, None]
    q = amplitude * np.sin(rate * times)
    qd = amplitude * rate * np.cos(rate * times)
    return SampledMotion(times[:, 0], q, qd, -(rate**2) * q, trapezoid_weights(times[:, 0]))


def test_swinging_mass_has_the_efforts_and_energies_of_its_equation():
    model, limits = model_of(load_robot(joint_mass(4)))
    cost = compute_motion_cost(model, limits, sine(0.5, 3.0, 2))
    (actuator,), (joint,) = cost.actuators, cost.joints
    force, speed = 2 * 0.5 * 9, 1.5
    assert actuator.rms_effort == pytest.approx(force / np.sqrt(2), rel=1e-6)
    assert abs(actuator.peak_effort) == pytest.approx(force) and actuator.effort_usage == pytest.approx(force / 10)
    assert actuator.peak_speed == pytest.approx(speed) and actuator.speed_usage == pytest.approx(speed / 4)
    # the kinetic energy goes up and down twice in each period
    assert joint.supplied == pytest.approx(4 * 0.5 * 2 * speed**2, rel=1e-5)
    assert joint.regenerated == pytest.approx(joint.supplied, rel=1e-5) and abs(joint.friction) < 1e-9
    assert joint.peak_power == pytest.approx(force * speed / 2, rel=1e-5)
    assert joint.position_margin == pytest.approx(4.5) and actuator.is_prismatic
    assert cost.is_within_limits and cost.time_scale.scale == pytest.approx(np.sqrt(force / 10))


def test_energy_of_actuators_is_that_of_the_bodies_and_of_friction():
    robot = load_robot(ARM)
    model, limits = model_of(robot)
    motion = quintic(0.8, [-0.5, 0.2], [1.0, -0.8], 4001)
    half = SampledMotion(*(values[:2001] for values in (motion.times, motion.q, motion.qd, motion.qdd)), None)
    half = SampledMotion(half.times, half.q, half.qd, half.qdd, trapezoid_weights(half.times))
    cost = compute_motion_cost(model, limits, half)
    dynamics = Dynamics(robot)
    before, after = (
        kinetic_energy(dynamics.inertia_matrix(q), qd) + potential_energy(robot, np.eye(4), q)
        for q, qd in ((half.q[0], half.qd[0]), (half.q[-1], half.qd[-1]))
    )
    lost = half.weights @ (1.5 * half.qd[:, 0] ** 2 + 0.7 * np.abs(half.qd[:, 0]) + 0.5 * half.qd[:, 1] ** 2)
    work = sum(joint.supplied - joint.regenerated for joint in cost.joints)
    assert sum(joint.friction for joint in cost.joints) == pytest.approx(lost)
    assert work == pytest.approx(after - before + lost, rel=1e-5)
    assert abs(after - before) > 1  # J


@pytest.mark.parametrize(
    ("friction", "expected"),
    [
        ("", np.sqrt(2 * 4 / (10 - 6))),  # a mass of 2 kg, 4 m/s², and a weight of 6 N
        (", coulomb_friction: 1", np.sqrt(2 * 4 / (10 - 6 - 1))),
        (", viscous_friction: 1", (2 + np.sqrt(4 + 4 * 8 * 4)) / 8),  # 4 s² - 2 s - 8 = 0
    ],
)
def test_time_scale_is_the_root_of_the_equation_of_motion(friction, expected):
    text = joint_mass(100, friction).replace("gravity: [0, 0, 0]", "gravity: [0, 0, -3]")
    model, limits = model_of(load_robot(text))
    q, qd, qdd = np.zeros((2, 1)), np.array([[2.0], [2.0]]), np.array([[4.0], [0.0]])
    scale = find_time_scale(model, limits, q, qd, qdd)
    assert scale.scale == pytest.approx(expected, rel=1e-8)
    assert (scale.actuator, scale.quantity, scale.sample) == ("j", "effort", 0)


def test_time_scale_of_a_speed_and_none_at_all():
    model, limits = model_of(load_robot(joint_mass(1)))
    one = np.ones((1, 1))
    scale = find_time_scale(model, limits, one, 3 * one, 0 * one)
    assert scale.scale == pytest.approx(3) and scale.quantity == "velocity"
    model, limits = model_of(load_robot(joint_mass(1)), effort=np.inf, velocity=np.inf)
    assert find_time_scale(model, limits, one, one, one) is None
    text = joint_mass(1).replace("gravity: [0, 0, 0]", "gravity: [0, 0, -9.81]")
    cost = compute_motion_cost(*model_of(load_robot(text)), quintic(1.0, [0.0], [0.5]))
    assert cost.is_too_heavy and cost.time_scale is None and not cost.is_within_limits


def test_motors_behind_gears_have_limits_that_depend_on_their_speed(tmp_path):
    (tmp_path / "drives.yaml").write_text(DRIVES)
    robot = load_robot(ARM)
    drives = load_drives(tmp_path / "drives.yaml", ("a", "b"))
    (tmp_path / "again.yaml").write_text(write_drives(drives))
    assert load_drives(tmp_path / "again.yaml", ("a", "b")).limits == drives.limits
    model, limits = model_of(robot, drives)
    motion = quintic(0.8, [-0.5, 0.2], [1.0, -0.8])
    cost = compute_motion_cost(model, limits, motion)
    assert [actuator.name for actuator in cost.actuators] == ["a", "b", "one", "two"]
    joint_efforts = Dynamics(robot).inverse(motion.q, motion.qd, motion.qdd)
    # a = -50 one + 20 two, b = 40 two
    two = joint_efforts[:, 1] / 40
    one = (joint_efforts[:, 0] - 20 * two) / -50
    limit = np.interp(50 * np.abs(motion.qd[:, 0]), [0, 100, 300], [1.2, 1, 0])
    np.testing.assert_allclose(cost.effort_usages[:, 2], np.abs(one) / limit)
    np.testing.assert_allclose(cost.effort_usages[:, 3], np.abs(two) / 0.5)
    retimed = retime(model, limits, motion).motion
    usages = limits.usage(model.efforts(retimed.q, retimed.qd, retimed.qdd), retimed.qd)
    both = np.maximum(usages[0].max(axis=1), usages[1].max(axis=1))
    assert both.max() == pytest.approx(1, abs=1e-4) and np.mean(both > 0.97) > 0.95


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("one: {effort: 0}", "effort 0: a number above 0"),
        ("one: {torque_speed: [[1, 2], [3, 0]]}", "ascend from 0"),
        ("one: {torque_speed: [[0, 2], [3, 0]], effort: 3}", "beside torque_speed"),
        ("three: {effort: 1}", "unknown motor 'three'"),
    ],
)
def test_wrong_limits_of_motors_are_refused(change, message, tmp_path):
    (tmp_path / "drives.yaml").write_text(DRIVES.partition("limits:")[0] + f"limits:\n  {change}\n")
    with pytest.raises(DescriptionError, match=message):
        load_drives(tmp_path / "drives.yaml", ("a", "b"))


def test_planned_motion_is_read_as_it_is(tmp_path):
    path = tmp_path / "plan.csv"
    path.write_text("time,j.acceleration,j.position,j.velocity\n0,1,2,3\n0.5,4,5,6\n")
    motion = planned_motion(path, ["j"])
    np.testing.assert_array_equal(np.hstack([motion.q, motion.qd, motion.qdd]), [[2, 3, 1], [5, 6, 4]])
    assert planned_motion(path, ["j", "k"]) is None
    for rows, message in (
        ("0,1,2,3\n", "has 1 rows of numbers: two or more are needed"),
        ("", "has 0 rows"),
        ("0,1,2,3\n0,4,5,6\n", "row 2: time is 0 s after 0 s in the row before: ascending times are needed"),
        ("0,1,2,3\n1,nan,5,6\n", "line 3: j.acceleration is 'nan': a finite number is needed"),
        ("0,1,2,3\n1,4,five,6\n", "line 3: j.position is 'five': a finite number is needed"),
        ("0,1,2,3\n1,2,3\n", "line 3: 3 cells, but the header has 4 names"),
    ):
        path.write_text(f"time,j.acceleration,j.position,j.velocity\n{rows}")
        with pytest.raises(RecordingError, match=re.escape(message)):
            planned_motion(path, ["j"])


def test_rates_that_are_no_derivatives_are_named():
    times = np.linspace(0, 2, 101)
    sine, cosine = np.sin(3 * times), np.cos(3 * times)
    q, qd, qdd = (np.column_stack([part, part]) for part in (sine, 3 * cosine, -9 * sine))

    def describe(q, qd, qdd):
        return describe_contradictions(SampledMotion(times, q, qd, qdd, trapezoid_weights(times)), ["a", "b"])

    assert describe(q, qd, qdd) == []
    wrong = qd.copy()
    wrong[:, 1] = 9.9
    velocity, acceleration = describe(q, wrong, qdd)
    assert velocity.startswith("the velocity of b is not the derivative of the position")
    assert acceleration.startswith("the acceleration of b is not the derivative of the velocity")
    assert describe(0 * q, 0 * qd, 0 * qdd) == []


@pytest.mark.parametrize(("robot", "message"), [("free_flying_arm", "base of"), ("manutec_r3", "no motor drives")])
def test_robots_whose_motion_does_not_determine_efforts_are_refused(robot, message):
    dynamics = Dynamics(load_robot(robot))
    with pytest.raises(InvalidInputError, match=message):
        EffortModel(dynamics, direct_drives(dynamics.joint_names))
