"""Control laws compared with Pinocchio, and for every class of robot with the direct model and the error dynamics."""

import time
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from peers.pinocchio_model import PinocchioModel
from peers.planar_stack import planar_stack
from peers.real_robots import real_urdf

from robot_dynamics import Base, Dynamics, InvalidInputError, load_robot, shipped_robots
from robot_dynamics.codegen.jit import background_compilation
from robot_dynamics.codegen.jit.compiled_models import COMPILE_THRESHOLD
from robot_dynamics.control.control_law import ControlLaw, actuated_joint_names
from robot_dynamics.control.modes import FRICTION_VELOCITIES
from robot_dynamics.control.reference import Trajectory
from robot_dynamics.model.formats.urdf.writer import write_urdf

RNG = np.random.default_rng(11)
RUBBING = {"damping": 0.7, "friction": 0.4}


def panda_with_friction():
    urdf = shipped_robots()["panda"].read_text()
    attributes = " ".join(f'{name}="{value}"' for name, value in RUBBING.items())
    return urdf.replace('<axis xyz="0 0 1"/>', f'<axis xyz="0 0 1"/><dynamics {attributes}/>')


def law_of(robot, joints=None):
    dynamics = Dynamics(robot, compiled=False)
    return ControlLaw(dynamics, joints or actuated_joint_names(dynamics))


@pytest.mark.slow
def test_control_laws_match_their_formulas_in_pinocchio():
    law = law_of(load_robot(panda_with_friction()))
    model = pinocchio.buildModelFromXML(panda_with_friction())
    model.friction[:] = model.damping[:] = 0  # added below
    data = model.createData()
    q, qd = law.q, law.qd
    q[:], qd[:] = RNG.uniform(-1, 1, (2, 7))
    reference, kp, kd, out = RNG.uniform(-1, 1, (3, 7)), RNG.uniform(1, 50, 7), RNG.uniform(1, 9, 7), np.zeros(7)
    q_d, qd_d, qdd_d = reference
    feedback = kp * (q_d - q) + kd * (qd_d - qd)
    friction = RUBBING["damping"] * qd_d + RUBBING["friction"] * np.sign(qd_d)
    rest = np.zeros(7)

    def expect(expected):
        np.testing.assert_allclose(out, expected, rtol=1e-9, atol=1e-9)

    law.gravity_compensation(out)
    expect(pinocchio.computeGeneralizedGravity(model, data, q))
    law.damping(kd, out)
    expect(pinocchio.rnea(model, data, q, rest, -kd * qd))
    law.pd_gravity(reference, kp, kd, out)
    expect(pinocchio.rnea(model, data, q, rest, feedback))
    law.feedforward(reference, out)
    expect(pinocchio.rnea(model, data, q_d, qd_d, qdd_d) + friction)
    law.computed_torque(reference, kp, kd, out)
    expect(pinocchio.rnea(model, data, q, qd, qdd_d + feedback) + friction)


ROBOTS = [name for name in shipped_robots() if name != "manutec_r3"] + [
    "panda with fingers"
]  # see test_series_elastic_actuators


KP, KD = 80.0, 18.0


def unactuated_arm():
    """An arm with a passive second joint and an elastic third joint; all joints have friction."""
    rubs = "viscous_friction: 0.8, coulomb_friction: 0.3, mass: 2, first_moments: [0.4, 0.1, 0], inertia: {zz: 0.2}"
    return load_robot(f"""
        robot: unactuated
        gravity: [0, -9.81, 0]
        joints:
          - {{joint: first, link: one, {rubs}}}
          - {{joint: second, link: two, mdh: {{d: 0.4}}, role: passive, {rubs}}}
          - {{joint: third, link: three, mdh: {{d: 0.4}}, role: elastic, spring: {{stiffness: 30, damping: 2}}, {rubs}}}
          - {{joint: fourth, link: four, mdh: {{d: 0.4}}, {rubs}}}
        """)


def without_friction(joint):
    return replace(joint, viscous_friction=0.0, coulomb_friction=0.0)


def mounts_with_friction():
    """Platforms in series with motors on springs; unactuated joints have friction as well."""
    robot = load_robot(planar_stack("mounts"))
    joints = (
        joint if joint.actuated else replace(joint, viscous_friction=0.3, coulomb_friction=0.2)
        for joint in robot.joints
    )
    return replace(robot, joints=tuple(joints))


MADE = {
    "panda with fingers": lambda: load_robot(real_urdf("panda")),
    "unactuated arm": unactuated_arm,
    "elastic mounts": mounts_with_friction,
}


def law_at_random_state(name):
    """Law and base of a robot in a random state near its initial positions."""
    law = law_of(MADE[name]() if name in MADE else load_robot(name))
    dynamics, n, base = law.dynamics, len(law.q), None
    if dynamics.robot.moving_base:
        law.twist[:] = RNG.uniform(-0.3, 0.3, 6)
        base = Base(np.eye(4), law.twist)
    independent = [dynamics.all_joint_names.index(joint) for joint in dynamics.joint_names]
    law.q[:] = dynamics.initial_joint_positions[independent] + RNG.uniform(-0.02, 0.02, n)
    law.qd[:] = RNG.uniform(-0.3, 0.3, n)
    return law, base


def mass_matrix_of_motors(law):
    """Mass matrix of the controlled joints: a free base and unactuated joints are eliminated."""
    A = law.dynamics.inertia_matrix(law.q)
    base = len(A) - len(law.q)
    motors = base + law.joint_indices
    others = np.setdiff1d(np.arange(len(A)), motors)
    return A[np.ix_(motors, motors)] - A[np.ix_(motors, others)] @ np.linalg.solve(
        A[np.ix_(others, others)], A[np.ix_(others, motors)]
    )


@pytest.mark.slow
@pytest.mark.parametrize("friction_velocity", FRICTION_VELOCITIES)
@pytest.mark.parametrize("name", [*ROBOTS, "unactuated arm", "elastic mounts"])
def test_computed_torque_gives_the_error_dynamics_for_every_robot(name, friction_velocity):
    """ë + K_d ė + K_p e = A⁻¹ (f(q̇) - f(q̇_f)), f without unactuated joints where such are part of the state."""
    law, base = law_at_random_state(name)
    dynamics, rows, n = law.dynamics, law.joint_indices, len(law.q)
    reference, out, efforts = RNG.uniform(-0.3, 0.3, (3, len(rows))), np.zeros(len(rows)), np.zeros(n)
    reference[0] += law.q[rows]
    law.computed_torque(reference, KP, KD, out, friction_velocity)
    efforts[rows] = out
    accelerations = dynamics.direct(law.q, law.qd, efforts, base=base)[rows]
    e, ed, edd = reference - np.stack([law.q[rows], law.qd[rows], accelerations])
    expected, scale = np.zeros(len(rows)), np.abs(reference[2] + KD * ed + KP * e).max()
    if friction_velocity == "reference":
        in_inverse_model = dynamics.unactuated_joint_names  # their friction is that of the measured velocity
        joints = [
            joint if joint.actuated or not in_inverse_model else without_friction(joint)
            for joint in dynamics.robot.joints
        ]
        friction_dynamics = Dynamics(replace(dynamics.robot, joints=tuple(joints)), compiled=False)
        desired = np.zeros(n)
        desired[rows] = reference[1]
        difference = (friction_dynamics.friction(law.qd, law.q) - friction_dynamics.friction(desired, law.q))[rows]
        expected = np.linalg.solve(mass_matrix_of_motors(law), difference)
    np.testing.assert_allclose(edd + KD * ed + KP * e, expected, rtol=0, atol=1e-8 * max(scale, np.abs(expected).max()))


@pytest.mark.parametrize("friction_velocity", FRICTION_VELOCITIES)
def test_computed_torque_of_the_puma_gives_the_error_dynamics_in_pinocchio(friction_velocity):
    """The plant is Pinocchio with the friction of the description; errors and their rates have any sign."""
    robot = load_robot("puma560")
    law = law_of(robot)
    peer = PinocchioModel(write_urdf(robot, lossy=True), law.joints, False, [j.rotor_inertia for j in robot.joints])
    viscous = np.array([joint.viscous_friction for joint in robot.joints])
    dry = np.array([joint.coulomb_friction for joint in robot.joints])
    assert viscous.any() and dry.any()
    out, relative_residuals = np.zeros(6), []
    for _ in range(50):
        law.q[:], law.qd[:] = RNG.uniform(-1, 1, (2, 6))
        reference = RNG.uniform(-1, 1, (3, 6))
        law.computed_torque(reference, KP, KD, out, friction_velocity)
        A, friction_efforts = peer.inertia_matrix(law.q), viscous * law.qd + dry * np.sign(law.qd)
        accelerations = np.linalg.solve(A, out - peer.bias(law.q, law.qd) - friction_efforts)
        e, ed, edd = reference - np.stack([law.q, law.qd, accelerations])
        e -= 2 * np.pi * np.rint(e / (2 * np.pi)) * np.isinf([joint.limits.lower for joint in robot.joints])
        residual, scale = edd + KD * ed + KP * e, np.abs(reference[2] + KD * ed + KP * e).max()
        relative_residuals.append(np.abs(residual).max() / scale)
        compensated = viscous * reference[1] + dry * np.sign(reference[1])
        expected = np.linalg.solve(A, friction_efforts - compensated) * (friction_velocity == "reference")
        np.testing.assert_allclose(residual, expected, rtol=0, atol=1e-10 * scale)
    assert (np.max(relative_residuals) > 0.1) == (friction_velocity == "reference")


def test_friction_at_the_measured_velocity_chatters_with_noise_at_rest():
    """It chatters by the full Coulomb friction; therefore the velocity of the reference is the default."""
    law = law_of(load_robot("puma560"))
    dry = np.array([joint.coulomb_friction for joint in law.dynamics.robot.joints])
    law.q[:] = np.linspace(-0.5, 0.5, 6)
    reference, out, span = np.stack([law.q, np.zeros(6), np.zeros(6)]), np.zeros(6), {}
    for friction_velocity in FRICTION_VELOCITIES:
        samples = []
        for _ in range(200):
            law.qd[:] = RNG.normal(0, 1e-5, 6)
            law.computed_torque(reference, KP, KD, out, friction_velocity)
            samples.append(out.copy())
        span[friction_velocity] = np.ptp(samples, axis=0)
    assert (span["measured"] > 1.99 * dry).all() and (span["reference"] < 0.01 * dry).all()


@pytest.fixture(scope="module")
def manutec():
    """The Manutec r3 without dry friction: robot and direct program."""
    robot = load_robot("manutec_r3")
    robot = replace(robot, joints=tuple(replace(joint, coulomb_friction=0.0) for joint in robot.joints))
    return robot, Dynamics(robot).compile("direct")


def link_errors(manutec, law, seconds=1.5, dt=5e-4):
    """Errors (steps, 3) of the links beyond the elastic gears under computed torque, by a Runge-Kutta method."""
    _, direct = manutec
    joints, n = len(law.joints), len(law.q)
    links = [(law.joints.index(f"motor_{k}"), law.dynamics.joint_names.index(f"spring_{k}")) for k in (1, 2, 3)]
    start, goal = np.array([0.1, 0.5, 0.4, 0.2, -0.3, 0.1]), np.array([0.9, 1.1, -0.3, -0.4, 0.4, 0.6])
    trajectory = Trajectory([0.0, 1.2], [start, goal], np.zeros((2, joints)), np.zeros((2, joints)))
    reference, out, efforts, state = np.zeros((3, joints)), np.zeros(joints), np.zeros(n), np.zeros((2, n))
    law.sample_reference(trajectory, 0.0, reference)
    state[0, law.joint_indices] = reference[0]
    for motor, spring in links:
        state[0, spring] = start[motor] - reference[0, motor]  # the initial deflection bears the load
    errors, desired = [], np.zeros((3, joints))

    def rate(x):
        return np.stack([x[1], direct.evaluate(x[0].copy(), x[1].copy(), efforts)])

    for now in np.arange(0.0, seconds, dt):
        law.q[law.joint_indices], law.qd[law.joint_indices] = state[:, law.joint_indices]  # only motors have encoders
        law.sample_reference(trajectory, now, reference)
        law.computed_torque(reference, 400.0, 40.0, out)
        efforts[law.joint_indices] = out
        trajectory.sample(now, desired)
        errors.append(
            [desired[0, motor] - state[0, law.joint_indices[motor]] - state[0, spring] for motor, spring in links]
        )
        k1 = rate(state)
        k2 = rate(state + dt / 2 * k1)
        k3 = rate(state + dt / 2 * k2)
        k4 = rate(state + dt * k3)
        state = state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(errors)


def test_computed_torque_makes_links_beyond_elastic_gears_follow_the_reference(manutec, monkeypatch):
    law = law_of(manutec[0])
    assert list(law.elastic_actuators.motors) == [0, 1, 2] and list(law.elastic_actuators.springs) == [1, 3, 5]
    with_reference_of_links = np.abs(link_errors(manutec, law)).max(axis=0)
    monkeypatch.setattr(law, "sample_reference", lambda trajectory, now, reference: trajectory.sample(now, reference))
    law._link_side.solver.motion[:] = 0
    with_reference_of_motors = np.abs(link_errors(manutec, law)).max(axis=0)
    print(f"link errors {1e6 * with_reference_of_links} urad, {1e6 * with_reference_of_motors} urad without springs")
    assert (with_reference_of_links < with_reference_of_motors / 10).all()


def test_joints_without_efforts_do_not_accelerate():
    arm = [f"panda_joint{k}" for k in (3, 1, 2, 4, 5, 7, 6)]
    law = law_of(load_robot(real_urdf("panda")), arm)
    dynamics = law.dynamics
    law.q[:], law.qd[:] = RNG.uniform(0, 0.04, 8), RNG.uniform(-0.1, 0.1, 8)
    reference, out = RNG.uniform(-0.3, 0.3, (3, 7)), np.zeros(7)
    law.computed_torque(reference, 10.0, 5.0, out)
    qdd = np.zeros(8)
    qdd[law.joint_indices] = (
        reference[2] + 10 * (reference[0] - law.q[law.joint_indices]) + 5 * (reference[1] - law.qd[law.joint_indices])
    )
    frictionless = dynamics.inverse(law.q, law.qd, qdd) - dynamics.friction(law.qd)
    expected = frictionless + dynamics.friction(np.insert(reference[1][[1, 2, 0, 3, 4, 6, 5]], 7, 0.0))
    np.testing.assert_allclose(out, expected[law.joint_indices], atol=1e-9)


def test_joints_without_limits_do_not_turn_back_whole_turns():
    law = law_of(load_robot("puma560"))
    endless_joints = np.flatnonzero([np.isinf(joint.limits.lower) for joint in law.dynamics.robot.joints])
    assert len(endless_joints)
    reference, out = np.zeros((3, 6)), np.zeros(6)
    reference[0] = 0.1
    law.computed_torque(reference, 10.0, 1.0, out)
    efforts = out.copy()
    reference[0, endless_joints] += 4 * np.pi
    law.computed_torque(reference, 10.0, 1.0, out)
    np.testing.assert_allclose(out, efforts, atol=1e-9)


@pytest.mark.parametrize(
    ("robot", "joints", "message"),
    [
        ("panda", ["panda_joint1", "panda_joint9"], "unknown joint 'panda_joint9'"),
        ("panda", ["panda_joint1", "panda_joint1"], "more than once"),
        ("manutec_r3", ["spring_1"], "'spring_1' has no motor"),
        ("irb460", ["elbow"], "'elbow' depends on other joints"),
    ],
)
def test_joints_that_cannot_get_efforts_are_refused(robot, joints, message):
    with pytest.raises(InvalidInputError, match=message):
        law_of(load_robot(robot), joints)


@pytest.mark.parametrize("name", ["gough_stewart", "four_bar", "panda"])
def test_nothing_is_compiled_while_efforts_are_computed(name, monkeypatch):
    """The compiler shares the processor and Python's lock with the stream: efforts would be late for seconds."""
    started = []
    monkeypatch.setattr(background_compilation, "run_in_background", lambda *arguments: started.append(arguments))
    dynamics = Dynamics(load_robot(name))
    law = ControlLaw(dynamics, actuated_joint_names(dynamics))
    numbers = [dynamics.robot.joint_numbers[joint] for joint in dynamics.joint_names]
    home = dynamics.initial_joint_positions[numbers]
    indices = law.joint_indices
    reference = np.zeros((3, len(law.joints)))
    efforts = np.empty(len(law.joints))
    began = time.perf_counter()
    step = 0
    while time.perf_counter() - began < 10 * COMPILE_THRESHOLD:
        step += 1
        law.q[:] = home + 0.01 * np.sin(0.01 * step)
        reference[0] = home[indices]
        law.computed_torque(reference, 100.0, 20.0, efforts)
        law.feedforward(reference, efforts)
        law.gravity_compensation(efforts)
    assert np.isfinite(efforts).all()
    assert started == []
