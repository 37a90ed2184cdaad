"""The laws against Pinocchio, and for every class of robot against the direct model: it accelerates as wanted, and
where friction is compensated at another velocity than that of the robot, off by what the error dynamics say."""

from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from peers.pinocchio_model import PinocchioModel
from peers.planar_stack import planar_stack
from peers.real_robots import real_urdf

from robot_dynamics import Base, Dynamics, InvalidInputError, load_robot, shipped_robots
from robot_dynamics.control.control_law import FRICTION_VELOCITIES, ControlLaw, actuated_joint_names
from robot_dynamics.control.reference import Trajectory
from robot_dynamics.model.formats.urdf.writer import write_urdf

RNG = np.random.default_rng(11)
RUBBING = {"damping": 0.7, "friction": 0.4}


def panda_with_friction():
    urdf = shipped_robots()["panda"].read_text()
    told = " ".join(f'{name}="{value}"' for name, value in RUBBING.items())
    return urdf.replace('<axis xyz="0 0 1"/>', f'<axis xyz="0 0 1"/><dynamics {told}/>')


def law_of(robot, joints=None):
    dynamics = Dynamics(robot, compiled=False)
    return ControlLaw(dynamics, joints or actuated_joint_names(dynamics))


def test_laws_are_their_formulas_by_pinocchio():
    law = law_of(load_robot(panda_with_friction()))
    model = pinocchio.buildModelFromXML(panda_with_friction())
    model.friction[:] = model.damping[:] = 0  # counted below
    data = model.createData()
    q, qd = law.q, law.qd
    q[:], qd[:] = RNG.uniform(-1, 1, (2, 7))
    reference, kp, kd, out = RNG.uniform(-1, 1, (3, 7)), RNG.uniform(1, 50, 7), RNG.uniform(1, 9, 7), np.zeros(7)
    q_d, qd_d, qdd_d = reference
    corrected = kp * (q_d - q) + kd * (qd_d - qd)
    rubbing = RUBBING["damping"] * qd_d + RUBBING["friction"] * np.sign(qd_d)
    rest = np.zeros(7)

    def expect(expected):
        np.testing.assert_allclose(out, expected, rtol=1e-9, atol=1e-9)

    law.gravity_compensation(out)
    expect(pinocchio.computeGeneralizedGravity(model, data, q))
    law.damping(kd, out)
    expect(pinocchio.rnea(model, data, q, rest, -kd * qd))
    law.pd_gravity(reference, kp, kd, out)
    expect(pinocchio.rnea(model, data, q, rest, corrected))
    law.feedforward(reference, out)
    expect(pinocchio.rnea(model, data, q_d, qd_d, qdd_d) + rubbing)
    law.computed_torque(reference, kp, kd, out)
    expect(pinocchio.rnea(model, data, q, qd, qdd_d + corrected) + rubbing)


ROBOTS = [name for name in shipped_robots() if name != "manutec_r3"] + ["panda with fingers"]  # elastic: test_elastic


KP, KD = 80.0, 18.0


def unactuated_arm():
    """An arm of which the second joint is passive and the third one on a spring without a motor, all with friction."""
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


def mounts_with_friction():
    """Platforms in series, whose motors stand on springs; joints that are not actuated have friction too."""
    robot = load_robot(planar_stack("mounts"))
    return replace(robot, joints=tuple(replace(joint, viscous_friction=0.3, coulomb_friction=0.2) if not joint.actuated
                                       else joint for joint in robot.joints))  # fmt: skip


MADE = {
    "panda with fingers": lambda: load_robot(real_urdf("panda")),
    "unactuated arm": unactuated_arm,
    "elastic mounts": mounts_with_friction,
}


def at_a_state(name):
    """(law, base) of a robot, in a state near where its loops are closed first."""
    law = law_of(MADE[name]() if name in MADE else load_robot(name))
    dynamics, n, base = law.dynamics, len(law.q), None
    if dynamics.robot.moving_base:
        law.twist[:] = RNG.uniform(-0.3, 0.3, 6)
        base = Base(np.eye(4), law.twist)
    given = [dynamics.all_joint_names.index(joint) for joint in dynamics.joint_names]
    law.q[:] = dynamics.initial_joint_positions[given] + RNG.uniform(-0.02, 0.02, n)
    law.qd[:] = RNG.uniform(-0.3, 0.3, n)
    return law, base


def mass_matrix_of_motors(law):
    """Of the controlled joints: a free base and unactuated joints are eliminated."""
    A = law.dynamics.inertia_matrix(law.q)
    base = len(A) - len(law.q)
    motors = base + law.joint_indices
    others = np.setdiff1d(np.arange(len(A)), motors)
    return A[np.ix_(motors, motors)] - A[np.ix_(motors, others)] @ np.linalg.solve(
        A[np.ix_(others, others)], A[np.ix_(others, motors)]
    )


@pytest.mark.parametrize("friction_velocity", FRICTION_VELOCITIES)
@pytest.mark.parametrize("name", [*ROBOTS, "unactuated arm", "elastic mounts"])
def test_every_robot_accelerates_as_the_error_dynamics_say(name, friction_velocity):
    """ë + K_d ė + K_p e = A⁻¹ (f(q̇) - f(q̇_f)), f without unactuated joints where such are part of the state."""
    law, base = at_a_state(name)
    dynamics, rows, n = law.dynamics, law.joint_indices, len(law.q)
    reference, out, efforts = RNG.uniform(-0.3, 0.3, (3, len(rows))), np.zeros(len(rows)), np.zeros(n)
    reference[0] += law.q[rows]
    law.computed_torque(reference, KP, KD, out, friction_velocity)
    efforts[rows] = out
    accelerations = dynamics.direct(law.q, law.qd, efforts, base=base)[rows]
    e, ed, edd = reference - np.stack([law.q[rows], law.qd[rows], accelerations])
    expected, scale = np.zeros(len(rows)), np.abs(reference[2] + KD * ed + KP * e).max()
    if friction_velocity == "reference":
        kept = dynamics.unactuated_joint_names  # their friction is that of the measured velocity
        joints = [joint if joint.actuated or not kept else replace(joint, viscous_friction=0.0, coulomb_friction=0.0)
                  for joint in dynamics.robot.joints]  # fmt: skip
        rubbing = Dynamics(replace(dynamics.robot, joints=tuple(joints)), compiled=False)
        wanted = np.zeros(n)
        wanted[rows] = reference[1]
        difference = (rubbing.friction(law.qd, law.q) - rubbing.friction(wanted, law.q))[rows]
        expected = np.linalg.solve(mass_matrix_of_motors(law), difference)
    np.testing.assert_allclose(edd + KD * ed + KP * e, expected, rtol=0, atol=1e-8 * max(scale, np.abs(expected).max()))


@pytest.mark.parametrize("friction_velocity", FRICTION_VELOCITIES)
def test_error_dynamics_of_the_puma_in_pinocchio(friction_velocity):
    """The robot is Pinocchio's, with friction as the description has it; errors and their rates are of any sign."""
    robot = load_robot("puma560")
    law = law_of(robot)
    peer = PinocchioModel(write_urdf(robot, lossy=True), law.joints, False, [j.rotor_inertia for j in robot.joints])
    viscous = np.array([joint.viscous_friction for joint in robot.joints])
    dry = np.array([joint.coulomb_friction for joint in robot.joints])
    assert viscous.any() and dry.any()
    out, left_by_friction = np.zeros(6), []
    for _ in range(50):
        law.q[:], law.qd[:] = RNG.uniform(-1, 1, (2, 6))
        reference = RNG.uniform(-1, 1, (3, 6))
        law.computed_torque(reference, KP, KD, out, friction_velocity)
        A, rubs = peer.inertia_matrix(law.q), viscous * law.qd + dry * np.sign(law.qd)
        accelerations = np.linalg.solve(A, out - peer.bias(law.q, law.qd) - rubs)
        e, ed, edd = reference - np.stack([law.q, law.qd, accelerations])
        e -= 2 * np.pi * np.rint(e / (2 * np.pi)) * np.isinf([joint.limits.lower for joint in robot.joints])
        residual, scale = edd + KD * ed + KP * e, np.abs(reference[2] + KD * ed + KP * e).max()
        left_by_friction.append(np.abs(residual).max() / scale)
        compensated = viscous * reference[1] + dry * np.sign(reference[1])
        expected = np.linalg.solve(A, rubs - compensated) * (friction_velocity == "reference")
        np.testing.assert_allclose(residual, expected, rtol=0, atol=1e-10 * scale)
    assert (np.max(left_by_friction) > 0.1) == (friction_velocity == "reference")


def test_noise_of_velocities_at_rest_shakes_the_robot_where_friction_is_that_of_the_measured_velocity():
    """By the full size of Coulomb friction, which is why the velocity of the reference is the default."""
    law = law_of(load_robot("puma560"))
    dry = np.array([joint.coulomb_friction for joint in law.dynamics.robot.joints])
    law.q[:] = np.linspace(-0.5, 0.5, 6)
    reference, out, span = np.stack([law.q, np.zeros(6), np.zeros(6)]), np.zeros(6), {}
    for friction_velocity in FRICTION_VELOCITIES:
        sent = []
        for _ in range(200):
            law.qd[:] = RNG.normal(0, 1e-5, 6)
            law.computed_torque(reference, KP, KD, out, friction_velocity)
            sent.append(out.copy())
        span[friction_velocity] = np.ptp(sent, axis=0)
    assert (span["measured"] > 1.99 * dry).all() and (span["reference"] < 0.01 * dry).all()


@pytest.fixture(scope="module")
def manutec():
    """The Manutec r3 without what its dry friction adds, as a robot and as its direct program."""
    robot = load_robot("manutec_r3")
    robot = replace(robot, joints=tuple(replace(joint, coulomb_friction=0.0) for joint in robot.joints))
    return robot, Dynamics(robot).compile("direct")


def link_errors(manutec, law, seconds=1.5, dt=5e-4):
    """(steps, 3) errors of the links beyond the elastic gears, under computed torque, integrated by Runge and Kutta."""
    _, direct = manutec
    joints, n = len(law.joints), len(law.q)
    links = [(law.joints.index(f"motor_{k}"), law.dynamics.joint_names.index(f"spring_{k}")) for k in (1, 2, 3)]
    start, goal = np.array([0.1, 0.5, 0.4, 0.2, -0.3, 0.1]), np.array([0.9, 1.1, -0.3, -0.4, 0.4, 0.6])
    way = Trajectory([0.0, 1.2], [start, goal], np.zeros((2, joints)), np.zeros((2, joints)))
    reference, out, efforts, state = np.zeros((3, joints)), np.zeros(joints), np.zeros(n), np.zeros((2, n))
    law.sample_reference(way, 0.0, reference)
    state[0, law.joint_indices] = reference[0]
    for motor, spring in links:
        state[0, spring] = start[motor] - reference[0, motor]  # loaded as it should be
    errors, wanted = [], np.zeros((3, joints))

    def rate(x):
        return np.stack([x[1], direct.evaluate(x[0].copy(), x[1].copy(), efforts)])

    for now in np.arange(0.0, seconds, dt):
        law.q[law.joint_indices], law.qd[law.joint_indices] = state[:, law.joint_indices]  # encoders are at the motors
        law.sample_reference(way, now, reference)
        law.computed_torque(reference, 400.0, 40.0, out)
        efforts[law.joint_indices] = out
        way.sample(now, wanted)
        errors.append(
            [wanted[0, motor] - state[0, law.joint_indices[motor]] - state[0, spring] for motor, spring in links]
        )
        k1 = rate(state)
        k2 = rate(state + dt / 2 * k1)
        k3 = rate(state + dt / 2 * k2)
        k4 = rate(state + dt * k3)
        state = state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(errors)


def test_links_beyond_elastic_gears_follow_the_reference(manutec, monkeypatch):
    law = law_of(manutec[0])
    assert list(law.elastic_actuators.motors) == [0, 1, 2] and list(law.elastic_actuators.springs) == [1, 3, 5]
    followed = np.abs(link_errors(manutec, law)).max(axis=0)
    monkeypatch.setattr(law, "sample_reference", lambda way, now, reference: way.sample(now, reference))
    law._link_side.solver.motion[:] = 0
    plain = np.abs(link_errors(manutec, law)).max(axis=0)
    print(f"links {1e6 * followed} urad, with the reference given to the motors {1e6 * plain} urad")
    assert (followed < plain / 10).all()


def test_joints_that_are_left_out_are_held_by_someone_else():
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


def test_joints_without_limits_do_not_turn_back_a_whole_turn():
    law = law_of(load_robot("puma560"))
    turning = np.flatnonzero([np.isinf(joint.limits.lower) for joint in law.dynamics.robot.joints])
    assert len(turning)
    reference, out = np.zeros((3, 6)), np.zeros(6)
    reference[0] = 0.1
    law.computed_torque(reference, 10.0, 1.0, out)
    once = out.copy()
    reference[0, turning] += 4 * np.pi
    law.computed_torque(reference, 10.0, 1.0, out)
    np.testing.assert_allclose(out, once, atol=1e-9)


@pytest.mark.parametrize(
    ("robot", "joints", "said"),
    [
        ("panda", ["panda_joint1", "panda_joint9"], "unknown joint 'panda_joint9'"),
        ("panda", ["panda_joint1", "panda_joint1"], "more than once"),
        ("manutec_r3", ["spring_1"], "'spring_1' has no motor"),
        ("irb460", ["elbow"], "'elbow' depends on other joints"),
    ],
)
def test_joints_that_cannot_be_driven_are_refused(robot, joints, said):
    with pytest.raises(InvalidInputError, match=said):
        law_of(load_robot(robot), joints)
