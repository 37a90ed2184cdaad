"""The laws against Pinocchio, and for every class of robot against the direct model: it accelerates as wanted."""

from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from peers.real_robots import real_urdf

from robot_dynamics import Base, Dynamics, QuestionError, load_robot, shipped_robots
from robot_dynamics.control.law import Law, driven_joints
from robot_dynamics.control.reference import Trajectory

RNG = np.random.default_rng(11)
RUBBING = {"damping": 0.7, "friction": 0.4}


def panda_with_friction():
    urdf = shipped_robots()["panda"].read_text()
    told = " ".join(f'{name}="{value}"' for name, value in RUBBING.items())
    return urdf.replace('<axis xyz="0 0 1"/>', f'<axis xyz="0 0 1"/><dynamics {told}/>')


def law_of(robot, joints=None):
    dynamics = Dynamics(robot, compiled=False)
    return Law(dynamics, joints or driven_joints(dynamics))


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


ROBOTS = [name for name in shipped_robots() if name != "manutec_r3"] + ["panda with fingers"]  # elastic: see below


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_accelerates_as_the_law_wants(name):
    robot = load_robot(real_urdf("panda") if name == "panda with fingers" else name)
    law = law_of(robot)
    dynamics, n = law.dynamics, len(law.q)
    base = None
    if robot.moving_base:
        law.twist[:] = RNG.uniform(-0.3, 0.3, 6)
        base = Base(np.eye(4), law.twist)
    given = [dynamics.all_joint_names.index(joint) for joint in dynamics.joint_names]
    q = dynamics.closed_positions[given] + RNG.uniform(-0.02, 0.02, n)
    law.q[:], law.qd[:] = q, RNG.uniform(-0.3, 0.3, n)
    size = len(law.joints)
    reference, out = RNG.uniform(-0.3, 0.3, (3, size)), np.zeros(size)
    reference[0] += q[law.rows]
    reference[1] = law.qd[law.rows]  # as friction is that of the wanted velocity, and of the real one in the robot
    law.computed_torque(reference, 80.0, 18.0, out)
    efforts = np.zeros(n)
    efforts[law.rows] = out
    accelerations = dynamics.direct(law.q, law.qd, efforts, base=base)[law.rows]
    wanted = reference[2] + 80.0 * (reference[0] - law.q[law.rows])
    np.testing.assert_allclose(accelerations, wanted, rtol=1e-6, atol=1e-6)


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
    law.refer(way, 0.0, reference)
    state[0, law.rows] = reference[0]
    for motor, spring in links:
        state[0, spring] = start[motor] - reference[0, motor]  # loaded as it should be
    errors, wanted = [], np.zeros((3, joints))

    def rate(x):
        return np.stack([x[1], direct.evaluate(x[0].copy(), x[1].copy(), efforts)])

    for now in np.arange(0.0, seconds, dt):
        law.q[law.rows], law.qd[law.rows] = state[:, law.rows]  # encoders are at the motors
        law.refer(way, now, reference)
        law.computed_torque(reference, 400.0, 40.0, out)
        efforts[law.rows] = out
        way.sample(now, wanted)
        errors.append([wanted[0, motor] - state[0, law.rows[motor]] - state[0, spring] for motor, spring in links])
        k1 = rate(state)
        k2 = rate(state + dt / 2 * k1)
        k3 = rate(state + dt / 2 * k2)
        k4 = rate(state + dt * k3)
        state = state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(errors)


def test_links_beyond_elastic_gears_follow_the_reference(manutec, monkeypatch):
    law = law_of(manutec[0])
    assert list(law.gears.motors) == [0, 1, 2] and list(law.gears.springs) == [1, 3, 5]
    followed = np.abs(link_errors(manutec, law)).max(axis=0)
    monkeypatch.setattr(law, "refer", lambda way, now, reference: way.sample(now, reference))
    law._deflections.motion[:] = 0
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
    qdd[law.rows] = reference[2] + 10 * (reference[0] - law.q[law.rows]) + 5 * (reference[1] - law.qd[law.rows])
    frictionless = dynamics.inverse(law.q, law.qd, qdd) - dynamics.friction(law.qd)
    expected = frictionless + dynamics.friction(np.insert(reference[1][[1, 2, 0, 3, 4, 6, 5]], 7, 0.0))
    np.testing.assert_allclose(out, expected[law.rows], atol=1e-9)


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
        ("manutec_r3", ["spring_1"], "no motor drives 'spring_1'"),
        ("irb460", ["elbow"], "'elbow' depends on other joints"),
    ],
)
def test_joints_that_cannot_be_driven_are_refused(robot, joints, said):
    with pytest.raises(QuestionError, match=said):
        law_of(load_robot(robot), joints)
