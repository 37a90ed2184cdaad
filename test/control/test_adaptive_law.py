"""The adaptive law: its regressor beside Pinocchio, a Lyapunov function that never grows, and wrong models."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from peers.pinocchio_model import PinocchioModel
from peers.random_robots import random_urdf
from peers.real_robots import ROBOTS

from robot_dynamics import Dynamics, InvalidInputError, load_robot, shipped_robots
from robot_dynamics.control.adaptive_law import AdaptiveLaw
from robot_dynamics.control.control_law import ControlLaw
from robot_dynamics.control.controller import Controller
from robot_dynamics.control.controller_settings import Settings
from robot_dynamics.control.natural_adaptation import AdaptationLimits, AdaptationSettings

PANDA = shipped_robots()["panda"].read_text()
UR10 = (ROBOTS / "ur_description" / "urdf" / "ur10_robot.urdf").read_text()
WIDE = AdaptationLimits(max_ratio=100.0, max_rate=1000.0)


def adaptive_law(robot, limits=WIDE):
    dynamics = Dynamics(robot)
    return dynamics, AdaptiveLaw(dynamics, np.arange(len(dynamics.joint_names)), limits)


def law_efforts(law, positions, qd, qd_r, qdd_r, kd=20.0):
    """Efforts (n,) for a reference velocity and acceleration, and s: with Λ = 0 they are those of the reference."""
    out = np.zeros(len(qd))
    reference = np.stack([positions[: len(qd)], qd_r, qdd_r])
    law.efforts(positions, qd, reference, (np.zeros_like(qd), qd_r - qd), np.zeros_like(qd), kd, out)
    return out


def wrong_robot(robot, seed, part=0.3):
    """A robot whose masses, centres of mass and inertias are up to 30 % wrong, and those of bodies that can exist."""
    rng = np.random.default_rng(seed)

    def change(link):
        inertia = link.inertia
        if not inertia.mass:
            return link
        factor, stretch = 1 + rng.choice([-part, part]), np.diag(1 + rng.uniform(-part, part, 3))
        mass, first = inertia.mass * factor, factor * stretch @ inertia.first_moments
        # second moments of mass ∫ r rᵀ dm of the body that is stretched along the axes of the frame
        spread = np.trace(inertia.second_moments) / 2 * np.eye(3) - inertia.second_moments
        spread = factor * stretch @ spread @ stretch
        return replace(link, inertia=type(inertia)(mass, first, np.trace(spread) * np.eye(3) - spread))

    return replace(robot, links=(robot.links[0], *map(change, robot.links[1:])))


@pytest.mark.parametrize("urdf", [PANDA, UR10, *(random_urdf(seed, joints=6) for seed in range(4))])
def test_efforts_are_those_of_the_matrix_of_christoffel_symbols(urdf):
    """Of Pinocchio: A q̈_r + C q̇_r + g + √K_d A √K_d s, where C is not that of the velocities alone."""
    dynamics, law = adaptive_law(load_robot(urdf))
    peer = PinocchioModel(urdf, dynamics.all_joint_names)
    rng = np.random.default_rng(1)
    for _ in range(5):
        q, qd, qd_r, qdd_r = rng.uniform(-1, 1, (4, len(dynamics.joint_names)))
        kd = rng.uniform(5, 50, len(q))
        A = peer.inertia_matrix(q)
        christoffel = christoffel_matrix(peer, q, qd)
        expected = A @ qdd_r + christoffel @ qd_r + peer.gravity(q) + np.sqrt(kd) * (A @ (np.sqrt(kd) * (qd_r - qd)))
        efforts = law_efforts(law, q, qd, qd_r, qdd_r, kd)
        np.testing.assert_allclose(efforts, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())


def christoffel_matrix(peer, q, qd):
    """C (n, n) of the Christoffel symbols of Pinocchio's mass matrix, by its derivatives along each joint."""
    n, h = len(q), 1e-4
    slopes = np.empty((n, n, n))  # of A by joint k in the last index
    for k in range(n):
        steps = np.eye(n)[k] * h
        near = peer.inertia_matrix(q + steps) - peer.inertia_matrix(q - steps)
        far = peer.inertia_matrix(q + 2 * steps) - peer.inertia_matrix(q - 2 * steps)
        slopes[..., k] = (8 * near - far) / (12 * h)
    symbols = (slopes + np.swapaxes(slopes, 1, 2) - np.transpose(slopes, (2, 1, 0))) / 2
    return symbols @ qd


@pytest.mark.parametrize("name", ["four_bar", "sr400"])
def test_loops_have_a_skew_symmetric_matrix_too(name):
    """xᵀ (Ȧ - 2 C) x is zero for all x, with the derivative of the mass matrix along a motion on the loops."""
    robot = load_robot(name)
    robot = replace(robot, joints=tuple(joint.without_friction() for joint in robot.joints))
    dynamics, law = adaptive_law(robot)
    n, h = len(dynamics.joint_names), 1e-5
    rng = np.random.default_rng(2)
    q = dynamics.initial_joint_positions[[dynamics.all_joint_names.index(joint) for joint in dynamics.joint_names]]
    qd = rng.uniform(-1, 1, n)
    full = dynamics.expand_positions(q)
    still = law_efforts(law, full, qd, np.zeros(n), np.zeros(n), 1e-12)
    C = np.column_stack([law_efforts(law, full, qd, axis, np.zeros(n), 1e-12) - still for axis in np.eye(n)])
    rate = (dynamics.inertia_matrix(q + h * qd) - dynamics.inertia_matrix(q - h * qd)) / (2 * h)
    for x in rng.uniform(-1, 1, (3, n)):
        assert abs(x @ (rate - 2 * C) @ x) < 1e-7 * np.abs(C).max()


@pytest.mark.parametrize("seed", range(2))
def test_lyapunov_function_never_grows(seed):
    """V = ½ sᵀ A s + D / γ of an exact plant, by Pinocchio, and a wrong model."""
    robot = load_robot(UR10)
    robot = replace(robot, joints=tuple(joint.without_friction() for joint in robot.joints))
    dynamics, law = adaptive_law(wrong_robot(robot, seed))
    peer = PinocchioModel(UR10, dynamics.joint_names)
    true = AdaptiveLaw(Dynamics(robot), np.arange(6), WIDE).parameters
    gain, kp, kd, step = 2.0, 100.0, 20.0, 2.5e-4
    settings = AdaptationSettings(gain=gain, dead_zone=0.0, limits=WIDE)
    rng = np.random.default_rng(seed)
    rates, phases = rng.uniform(1, 4, 6), rng.uniform(0, 6, 6)
    q, qd = np.zeros(6), np.zeros(6)
    values, efforts = [], np.zeros(6)
    for number in range(4000):
        t = number * step
        angle = rates * t + phases
        reference = np.stack([0.5 * np.sin(angle), 0.5 * rates * np.cos(angle), -0.5 * rates**2 * np.sin(angle)])
        errors = reference[0] - q, reference[1] - qd
        law.efforts(q, qd, reference, errors, kp, kd, efforts)
        s = errors[1] + kp / kd * errors[0]
        values.append(0.5 * s @ peer.inertia_matrix(q) @ s + law.parameters.distance(true.links, true.numbers) / gain)
        law.adapt(step, settings)
        qdd = pin.aba(peer.model, peer.data, q, qd, efforts)
        q, qd = q + step * qd + step**2 / 2 * qdd, qd + step * qdd
    assert np.diff(values).max() < 1e-4 * values[0] * step / 1e-3  # steps of first order
    assert values[-1] < 0.5 * values[0]


def controller_of(robot, **changes):
    dynamics = Dynamics(robot)
    law = ControlLaw(dynamics, dynamics.joint_names, AdaptationLimits())
    n = len(law.joints)
    values = {"mode": "adaptive_computed_torque", "kp": np.full(n, 100.0), "kd": np.full(n, 20.0), **changes}
    return Controller(law, Settings(**{"limits": np.full(n, np.inf), **values}))


def run_steps(controller, steps, since=0.0, state=None):
    """Step with states (positions, velocities) each ms; the time after it."""
    law = controller.law
    q, qd = np.zeros((2, len(law.q))) if state is None else state
    for number in range(steps):
        law.q[:], law.qd[:] = q, qd
        controller.step(since + number * 1e-3)
    return since + steps * 1e-3


def moving_reference(controller, now):
    n = len(controller.law.joints)
    controller.track_point(now, now, np.stack([np.full(n, 0.2), np.full(n, 0.5), np.zeros(n)]))


def test_parameters_change_while_efforts_are_sent():
    controller = controller_of(load_robot(UR10), reference_timeout=10.0)
    before = controller.law.adaptive.parameters.links.copy()
    moving_reference(controller, 0.0)
    run_steps(controller, 200)
    assert controller.adaptation == "active"
    assert np.abs(controller.law.adaptive.parameters.links - before).max() > 1e-3


@pytest.mark.parametrize(
    ("cause", "reason"),
    [
        ("nan", "fault"),
        ("stale", "fault"),
        ("rejected", "fault"),
        ("saturated", "an effort is at its limit"),
        ("dead zone", "the error is in the dead zone"),
        ("transition", "efforts are in a transition"),
        ("no reference", ""),
        ("other mode", ""),
    ],
)
def test_adaptation_freezes(cause, reason):
    """Not one bit of the parameters changes, and the reason is stated."""
    controller = controller_of(load_robot(UR10), reference_timeout=0.5 if cause == "no reference" else 10.0)
    moving_reference(controller, 0.0)
    now = run_steps(controller, 200)
    if cause == "saturated":
        controller.apply(replace(controller.settings, limits=np.full(6, 0.1)))
        now = run_steps(controller, 1, now)
    elif cause == "dead zone":
        controller.settings = replace(controller.settings, adaptation=AdaptationSettings(dead_zone=100.0))
    elif cause == "transition":
        controller.apply(replace(controller.settings, ramp_time=0.11))
    elif cause == "no reference":
        now = run_steps(controller, 400, now)
    elif cause == "other mode":
        controller.apply(replace(controller.settings, mode="computed_torque"))
    before = controller.law.adaptive.parameters.links.copy(), controller.law.adaptive.parameters.numbers.copy()
    n = len(controller.law.q)
    if cause == "nan":
        run_steps(controller, 50, now, (np.full(n, np.nan), np.zeros(n)))
    elif cause == "stale":
        for tick in range(50):
            controller.tick(now + 0.02 + tick * 5e-3)
    elif cause == "rejected":
        for tick in range(50):
            controller.reject_state(now + tick * 1e-3, "a joint is missing")
    else:
        run_steps(controller, 50, now)
    assert controller.adaptation == (f"frozen: {reason}" if reason else "")
    after = controller.law.adaptive.parameters
    np.testing.assert_array_equal(after.links, before[0])
    np.testing.assert_array_equal(after.numbers, before[1])


def test_state_after_a_pause_adapts_nothing():
    """The time of a fault is no time of adaptation."""
    controller = controller_of(load_robot(UR10), reference_timeout=10.0, ramp_time=0.0)
    moving_reference(controller, 0.0)
    now = run_steps(controller, 100)
    for tick in range(20):
        controller.tick(now + 0.02 + tick * 5e-3)
    moving_reference(controller, now + 0.125)
    before = controller.law.adaptive.parameters.links.copy()
    run_steps(controller, 1, now + 0.125)
    np.testing.assert_array_equal(controller.law.adaptive.parameters.links, before)


def test_adapted_robot_has_the_parameters_of_the_law():
    controller = controller_of(load_robot(UR10), reference_timeout=10.0)
    moving_reference(controller, 0.0)
    run_steps(controller, 300)
    adaptive = controller.law.adaptive
    adapted = adaptive.adapted_robot()
    q, qd, qdd = np.random.default_rng(3).uniform(-1, 1, (3, 6))
    efforts = law_efforts(adaptive, q, qd, qd, qdd)
    frictionless = replace(adapted, joints=tuple(joint.without_friction() for joint in adapted.joints))
    np.testing.assert_allclose(Dynamics(frictionless).inverse(q, qd, qdd), efforts, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("robot", "message"),
    [
        ("free_flying_arm", "adaptation needs a fixed base"),
        ("five_bar", None),
    ],
)
def test_robots_that_cannot_be_adapted_are_refused(robot, message):
    dynamics = Dynamics(load_robot(robot))
    joints = [name for name in dynamics.joint_names if name not in dynamics.unactuated_joint_names]
    if message is None:
        assert ControlLaw(dynamics, joints, AdaptationLimits()).adaptive is not None
        return
    with pytest.raises(InvalidInputError, match=message):
        ControlLaw(dynamics, joints, AdaptationLimits())


def test_spring_is_refused():
    text = """
robot: spring
joints:
  - {joint: motor, link: rotor, mass: 1, inertia: {zz: 0.1}}
  - {joint: spring, link: pole, role: elastic, spring: {stiffness: 100}, mass: 1, first_moments: [0.3, 0, 0]}
"""
    with pytest.raises(InvalidInputError, match="a motor at each joint, and spring of 'spring' have none"):
        ControlLaw(Dynamics(load_robot(text)), ["motor"], AdaptationLimits())


def test_links_that_no_body_has_are_named_and_stay_as_they_are():
    text = """
robot: sticks
joints:
  - {joint: waist, link: turntable, inertia: {zz: 0.3}}
  - {joint: shoulder, link: rod, mdh: {alpha: pi/2}, mass: 1, first_moments: [0.3, 0, 0], inertia: {yy: 0.1, zz: 0.1}}
  - {joint: elbow, link: bar, mdh: {d: 0.5}, mass: 1, first_moments: [0.3, 0, 0],
     inertia: {xx: 0.01, yy: 0.12, zz: 0.12}}
  - {joint: wrist, link: dummy, mdh: {d: 0.4}}
  - {joint: twist, link: weight, mass: 0.2}
"""
    dynamics = Dynamics(load_robot(text), compiled=False)
    adaptive = ControlLaw(dynamics, dynamics.joint_names, AdaptationLimits()).adaptive
    assert adaptive.constant_links == ("turntable", "rod", "weight")
    before = adaptive.parameters.links.copy()
    adaptive.parameters.update(1.0, 10.0, np.ones_like(before), np.ones(15))
    changed = np.any(adaptive.parameters.links != before, axis=1)
    assert changed.tolist() == [False, False, True, False, False]
