"""Efforts of the laws in C++ are those of the laws in Python, for all robots that ship and have motors."""

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from player import BUILD, Script, Sent

from robot_dynamics import Dynamics, Inertia, load_robot, shipped_robots
from robot_dynamics.control.control_law import ControlLaw, actuated_joint_names
from robot_dynamics.control.modes import FIXED_MODEL_MODES
from robot_dynamics.control.reference import ReferencePoint
from robot_dynamics.errors import SingularModelError
from robot_dynamics.model.inertia import symmetric_entries
from robot_dynamics.recordings.bags import Bag

CHECKOUT = Path(__file__).parents[2]
MODULES = sorted(path.stem.removeprefix("lib").removesuffix("_module") for path in (BUILD / "modules").iterdir())
ROBOTS = [name for name in MODULES if name in shipped_robots()]
TOLERANCE = 1e-12  # of the largest effort of the joint
STATES = 40
PAYLOAD = Inertia.about_centre_of_mass(2.0, np.diag([0.01, 0.02, 0.03]), np.array([0.1, 0.05, 0.2]))
SWINGS = {"turtlebot3_burger": 5.0, "hexapod_stack": 0.05, "gough_stewart": 0.1, "orthoglide": 0.05}
"""Amplitudes of the motion of robots [rad or m]; default: 0.2."""


def entries(inertia):
    return np.array([inertia.mass, *inertia.first_moments, *symmetric_entries(inertia.second_moments)], dtype=float)


def load(name):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load_robot(CHECKOUT / name if name.endswith(".yaml") else name)


def smooth_motion(law, swing, count=STATES, seed=0):
    """States q, qd (count, n) about the initial positions, which follow each other closely."""
    rng = np.random.default_rng(seed)
    dynamics = law.dynamics
    numbers = [dynamics.all_joint_names.index(name) for name in dynamics.joint_names]
    middle = np.array(dynamics.initial_joint_positions)
    middle = middle[numbers] if len(middle) > len(numbers) else middle
    phases = rng.uniform(0, 2 * np.pi, len(middle)) + np.linspace(0, 1.5 * np.pi, count)[:, None]
    return middle + swing * np.sin(phases), swing * np.cos(phases)


def write_settings(script, law, kp, kd):
    for name, values in (("kp", kp), ("kd", kd), ("limits", np.full(len(law.joints), np.inf))):
        script.add(name, values)
    script.add("ramp_time", 0.0)  # efforts change at once
    script.add("state_timeout", 1e6)
    script.add("reference_timeout", 1e6)
    script.add("joints", *law.joints)
    script.add("configure")


def python_efforts(law, mode, source, time, kp, kd, friction_velocity):
    out = np.empty(len(law.joints))
    if mode == "gravity_compensation":
        law.gravity_compensation(out)
        return out
    reference = np.empty((3, len(law.joints)))
    law.sample_reference(source, time, reference)
    if mode == "feedforward":
        law.feedforward(reference, out)
    elif mode == "pd_gravity":
        law.pd_gravity(reference, kp, kd, out)
    else:
        law.computed_torque(reference, kp, kd, out, friction_velocity)
    return out


def compare(law, module, states, dependent=None, payload=None, sanitized=False, turns=0, tolerance=TOLERANCE):
    """Compare the laws in all modes at states q, qd (N, n).

    dependent: (N, k) measured positions; turns: whole turns of the reference from the state; tolerance: of the largest
    effort of the joint.
    """
    rng = np.random.default_rng(1)
    joints = len(law.joints)
    kp, kd = rng.uniform(50, 200, joints), rng.uniform(5, 30, joints)
    lower, upper = law._lower_limits, law._upper_limits
    script = Script()
    write_settings(script, law, kp, kd)
    if payload is not None:
        script.add("payload", payload)
    expected, activities, time = [], [], 0.0
    for number, (q, qd) in enumerate(zip(*states, strict=True)):
        law.q[:], law.qd[:] = q, qd
        script.add("q", q)
        script.add("qd", qd)
        if dependent is not None:
            law.dependent_positions[:] = dependent[number]
            script.add("dependent", dependent[number])
        if law.dynamics.robot.moving_base:
            law.twist[:], law.gravity[:] = rng.normal(size=6), rng.normal(scale=9.81, size=3)
            script.add("twist", law.twist)
            script.add("gravity", law.gravity)
        motion = rng.uniform(-1, 1, (3, joints)) * np.array([[0.02], [0.2], [1.0]])
        reference = motion + np.stack([law.q, law.qd, 0 * law.q])[:, law.joint_indices]
        reference[0] = np.clip(reference[0] + 2 * np.pi * turns, lower, upper)
        script.add("point", time, time, reference)
        for mode in FIXED_MODEL_MODES:
            friction_velocity = ("reference", "measured")[number % 2]
            time += 1e-3
            for command, choice in (("mode", mode), ("friction_velocity", friction_velocity)):
                script.add(command, choice)
            script.add("apply")
            script.add("point", time, time, reference)
            script.add("step", time, time, time)
            source = ReferencePoint(time, reference, 1e6)
            expected.append(python_efforts(law, mode, source, time, kp, kd, friction_velocity))
            activities.append(mode)
    results = script.play(module, sanitized)
    assert results[0] == ["configured"]
    sent = [result for result in results if isinstance(result, Sent)]
    others = [result for result in results[1:] if not isinstance(result, Sent)]
    assert others and all(result in (["point", "0"], ["applied", "1"], ["payload", "1"]) for result in others)
    assert [result.fault for result in sent] == [""] * len(sent)
    assert [result.activity for result in sent] == activities
    expected, efforts = np.array(expected), np.array([result.efforts for result in sent])
    scales = np.abs(expected).max(axis=0)  # of each joint
    error = (np.abs(efforts - expected).max(axis=0) / np.where(scales > 0, scales, 1.0)).max()
    print(
        f"\n{module}: {len(sent)} efforts up to {np.abs(expected).max():.3g}, largest relative difference {error:.1e}"
    )
    assert error < tolerance


def test_all_robots_that_ship_and_have_motors_are_compared():
    with_motors = [name for name in shipped_robots() if actuated_joint_names(Dynamics(load(name), compiled=False))]
    left_to_soak = [] if "EVERY_ROBOT" in os.environ else ["hexapod_stack"]
    assert sorted([*ROBOTS, *left_to_soak]) == sorted(with_motors)


@pytest.mark.parametrize("name", ROBOTS)
def test_efforts_are_equal(name):
    dynamics = Dynamics(load(name))
    law = ControlLaw(dynamics, actuated_joint_names(dynamics))
    states = smooth_motion(law, SWINGS.get(name, 0.2))
    if not dynamics.robot.loops:
        rng = np.random.default_rng(2)
        states = [
            np.concatenate([part, rng.normal(scale=scale, size=part.shape)])
            for part, scale in zip(states, (3, 2), strict=True)
        ]
    compare(law, name, states)


def test_efforts_are_equal_at_recorded_states():
    bag = Bag(CHECKOUT / "test" / "recordings" / "data" / "panda_mcap")
    samples = list(bag.samples(bag.joint_topics()))[::4]
    dynamics = Dynamics(load("panda"))
    law = ControlLaw(dynamics, dynamics.joint_names)
    assert samples[0].names == dynamics.joint_names
    compare(law, "panda", [np.array([getattr(s, field) for s in samples]) for field in ("position", "velocity")])


def test_efforts_are_equal_with_a_payload():
    dynamics = Dynamics(load("panda").with_payload("panda_link8", PAYLOAD))
    law = ControlLaw(dynamics, dynamics.joint_names)
    compare(law, "loaded_panda", smooth_motion(law, 0.5), payload=entries(PAYLOAD))


def test_efforts_are_equal_for_joints_in_another_order_and_for_some_of_them():
    law = ControlLaw(Dynamics(load("ur5e")), ("wrist_3_joint", "elbow_joint", "shoulder_pan_joint"))
    compare(law, "ur5e", smooth_motion(law, 1.0), sanitized=True)


def test_efforts_are_equal_with_all_kinds_of_friction():
    law = ControlLaw(Dynamics(load("robot_dynamics_control/test/load_friction.yaml")), ("elbow", "shoulder"))
    for turns in (0, 3):  # the joints turn endlessly: whole turns are no error
        compare(law, "loads", smooth_motion(law, 1.0), sanitized=True, turns=turns)


@pytest.mark.parametrize("name", ["irb460", "delta"])
def test_measured_positions_of_dependent_joints_seed_the_closure(name):
    dynamics = Dynamics(load(name))
    law = ControlLaw(dynamics, actuated_joint_names(dynamics))
    q, qd = smooth_motion(law, 0.2, count=10)
    numbers = [dynamics.all_joint_names.index(joint) for joint in dynamics.dependent_joint_names]
    closed = dynamics.expand_trajectory(q)[:, numbers]
    noise = np.random.default_rng(0).normal(scale=1e-3, size=closed.shape)
    compare(law, name, (q, qd), closed + noise, sanitized=True)


def efforts_along_a_path(dynamics, q):
    """Gravity at q, by continuation of the reference positions along a straight path; None: the path ends before."""
    topology = dynamics._closure_solver.topology
    reference = topology.joint_positions(topology.reference_positions)[topology.independent]
    target = q - 2 * np.pi * np.rint((q - reference) / (2 * np.pi)) * topology.is_periodic
    try:
        return dynamics.gravity(dynamics.expand_trajectory(np.linspace(reference, target, 300))[-1])
    except SingularModelError:
        return None


@pytest.mark.parametrize(("name", "seed"), [("five_bar", 0), ("irb460", 0), ("delta", 0), ("gough_stewart", 1)])
def test_first_closures_are_in_the_assembly_mode_of_the_description(name, seed):
    """States far from the reference positions: those that C++ closes, Python closes too, or reaches along a path."""
    dynamics = Dynamics(load(name))
    law = ControlLaw(dynamics, actuated_joint_names(dynamics))
    rng = np.random.default_rng(seed)
    joints = [dynamics.robot.joints[dynamics.robot.joint_numbers[joint]] for joint in law.joints]
    scales = [0.6 if joint.prismatic else np.pi / (1 + (len(joints) > 3)) for joint in joints]
    states = smooth_motion(law, 0.0, count=1)[0] + rng.uniform(-1, 1, (24, len(joints))) * scales
    script = Script()
    write_settings(script, law, np.zeros(len(joints)), np.zeros(len(joints)))
    for number, q in enumerate(states):
        script.add("restart")
        script.add("q", q)
        script.add("step", *[float(number)] * 3)
    sent = script.play(name, sanitized=True)[1:]
    closed, refused = 0, 0
    for q, result in zip(states, sent, strict=True):
        try:
            expected = dynamics.gravity(q)
        except SingularModelError:
            expected = None
        if result.fault:
            refused += expected is not None
            continue
        expected = efforts_along_a_path(dynamics, q) if expected is None else expected
        assert expected is not None, f"{q} closes in C++ only"
        np.testing.assert_allclose(result.efforts, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        closed += 1
    print(f"\n{name}: {closed} of {len(states)} closed, {refused} refused that Python closes")
    assert closed >= 6 and refused <= closed / 5


@pytest.mark.parametrize("name", ["five_bar", "irb460", "sr400", "four_bar"])
def test_state_far_away_and_back_leaves_the_assembly_mode(name):
    """One wrong sample of an encoder: the efforts at the state before it are the same afterwards."""
    dynamics = Dynamics(load(name))
    law = ControlLaw(dynamics, actuated_joint_names(dynamics))
    start = smooth_motion(law, 0.0, count=1)[0][0]
    script = Script()
    write_settings(script, law, np.zeros(len(law.joints)), np.zeros(len(law.joints)))
    for number, jump in enumerate(np.random.default_rng(0).uniform(-1.2, 1.2, (60, len(start)))):
        for time, q in ((number, start + jump), (number + 0.5, start)):
            script.add("q", q)
            script.add("step", *[float(time)] * 3)
    sent = script.play(name, sanitized=True)[1:]
    assert sum(not result.fault for result in sent[::2]) >= 6
    expected = dynamics.gravity(start)
    sent_again = [result.efforts for result in sent[1::2] if not result.fault]
    assert len(sent_again) == 60
    np.testing.assert_allclose(sent_again, np.tile(expected, (60, 1)), rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["manutec_r3", "slow_springs", "loaded_springs"])
@pytest.mark.parametrize("is_measured", [True, False])
def test_efforts_through_springs_are_equal(name, is_measured):
    """References of the links, with dampers that remember, and loads that depend on the deflections."""
    path = f"robot_dynamics_control/test/{name}.yaml"
    robot = load(name) if name in shipped_robots() else load_robot(CHECKOUT / path, moving_base="loaded" in name)
    law = ControlLaw(Dynamics(robot), actuated_joint_names(Dynamics(robot)))
    q, qd = smooth_motion(law, 0.3)
    springs = law.elastic_actuators.springs
    q[:, springs] = law.elastic_actuators.rest + 0.02 * q[:, springs] if is_measured else law._unmeasured
    assert len(springs) > 1
    # where loads depend on deflections, the last digit of a reference changes the efforts in Python by 2e-10
    compare(law, name, (q, qd), sanitized=True, tolerance=1e-9 if name == "loaded_springs" else TOLERANCE)


def test_dampers_remember_between_points_and_forget_at_a_restart():
    """One point, and steps at uneven times after it: some less than a period of the solver, some many."""
    law = ControlLaw(Dynamics(load("robot_dynamics_control/test/slow_springs.yaml")), ("shoulder", "wrist", "finger"))
    times = np.cumsum([0.0, 1e-3, 2e-3, 9e-3, 0.05, 0.2, 0.9])
    script = Script()
    write_settings(script, law, np.zeros(3), np.zeros(3))
    for command, choice in (("mode", "feedforward"), ("apply", "")):
        script.add(command, choice)
    points = [np.array([[0.3, -0.2, 0.1], [0.4, 0.3, -0.2], [0.3, -2.0, 4.0]])]
    points.append(points[0] * np.array([[1.1], [-1.0], [0.5]]))
    expected = []
    for start, point in zip((10.0, 11.0), points, strict=True):
        script.add("point", start, start, point)
        for time in start + times:
            script.add("step", time, time, time)
            source = ReferencePoint(start, point, 1e6)
            expected.append(python_efforts(law, "feedforward", source, time, 0.0, 0.0, "reference"))
    script.add("restart")
    script.add("point", time, time, points[0])
    script.add("step", time, time, time)
    *sent, after = [result for result in script.play("slow_springs", sanitized=True) if isinstance(result, Sent)]
    efforts = np.array([result.efforts for result in sent])
    np.testing.assert_allclose(efforts, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    assert np.array_equal(after.efforts, efforts[0]) and not np.array_equal(efforts[0], efforts[len(times)])


def test_motors_of_springs_must_get_efforts():
    script = Script()
    script.add("joints", "shoulder", "wrist")
    script.add("configure")
    (refused,) = script.play("slow_springs")
    assert "'finger' drives its link through the spring 'finger_spring'" in " ".join(refused)


def test_loops_that_do_not_close_are_a_fault_and_efforts_return():
    dynamics = Dynamics(load("gough_stewart"))
    law = ControlLaw(dynamics, actuated_joint_names(dynamics))
    q = smooth_motion(law, 0.0, count=1)[0][0]
    script = Script()
    write_settings(script, law, np.zeros(6), np.zeros(6))
    for step, positions in enumerate((q, q + 5.0 * np.eye(6)[0], q)):  # one leg is 5 m too long
        script.add("q", positions)
        script.add("step", *[step * 1e-3] * 3)
    held, failed, returned = script.play("gough_stewart", sanitized=True)[1:]
    assert "do not close" in failed.fault and not failed.efforts.any() and held.efforts.any()
    assert returned.fault == "" and np.array_equal(returned.efforts, held.efforts)
