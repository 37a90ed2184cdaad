"""Feedforward through elastic gears: the links of independent plants follow the reference, also with dampers, bodies
between motors and springs, and loops."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from numpy.polynomial import Polynomial
from peers.elastic_3rps import elastic_3rps
from peers.maximal_coordinates import MaximalCoordinates
from peers.planar_stack import planar_stack

from robot_dynamics import Base, Dynamics, InvalidInputError, RobotDynamicsError, load_robot
from robot_dynamics.control.control_law import ControlLaw, actuated_joint_names
from robot_dynamics.control.modes import FRICTION_VELOCITIES
from robot_dynamics.control.reference import ReferencePoint, Trajectory

# One elastic joint: link [kg m²] and [N m] of weight, rotor and gear [kg m²]
LINK, WEIGHT, ROTOR = 0.2, 2 * 9.81 * 0.3, 0.5
ONE_ACTUATOR = """
robot: one
gravity: [0, -9.81, 0]
joints:
  - {{joint: motor, link: gear, rotor_inertia: 0.3, mass: 1, inertia: {{xx: 0.2, yy: 0.2, zz: 0.2}}}}
  - {{joint: spring, link: link, role: elastic, spring: {{stiffness: {stiffness}, damping: {damping}, rest: 0.2}},
     viscous_friction: {viscous}, mass: 2, first_moments: [0.6, 0, 0], inertia: {{yy: 0.2, zz: 0.2}}}}
"""


class Swing:
    """positions, velocities and accelerations of home + amplitude sin(rate t), at any time."""

    def __init__(self, initial_positions, amplitude, rates):
        self.home, self.amplitude, self.rates = initial_positions, amplitude, np.asarray(rates)

    def sample(self, time, out):
        s, c = np.sin(self.rates * time), np.cos(self.rates * time)
        out[:] = s, self.rates * c, -(self.rates**2) * s
        out *= self.amplitude
        out[0] += self.home


class FromRest:
    """One joint from 0 to 1 in 1.2 s, five derivatives of the position continuous, at rest before and after."""

    start, lasts = 0.0, 1.2

    def __init__(self):
        shape = (Polynomial([0, 1]) ** 5 * Polynomial([1, -1]) ** 5).integ()
        self.derivatives = [(shape / shape(1)).deriv(order) for order in range(3)]

    def sample(self, time, out):
        u = min(max(time / self.lasts, 0.0), 1.0)
        out[:] = [[part(u) / self.lasts**order] for order, part in enumerate(self.derivatives)]


def law_of(robot):
    dynamics = Dynamics(robot, compiled=False)
    return ControlLaw(dynamics, actuated_joint_names(dynamics))


def two_inertias(law, stiffness, damping, source, *, seconds=1.3, step=2e-4):
    """Accelerations (steps, 2) of the link of ONE_ACTUATOR under feedforward alone, and of the reference.

    The plant is two inertias with a spring and a damper between them and the weight of the link. It is integrated by a
    Runge-Kutta method, with the effort of each stage at its time.
    """
    reference, out, desired, samples = np.zeros((3, 1)), np.zeros(1), np.zeros((3, 1)), []

    def effort(time):
        law.sample_reference(source, time, reference)
        law.feedforward(reference, out)
        return out[0]

    def link(x):
        return (-stiffness * (x[1] - x[0]) - damping * (x[3] - x[2]) - WEIGHT * np.cos(x[1] + 0.2)) / LINK

    def rates(x, motor_effort):
        spring_torque = stiffness * (x[1] - x[0]) + damping * (x[3] - x[2])
        return np.array([x[2], x[3], (motor_effort + spring_torque) / ROTOR, link(x)])

    motor_effort = effort(0.0)
    x = np.array([reference[0, 0], reference[0, 0] + law._link_side.solver.motion[0, 0] - 0.2, 0, 0])
    for time in np.arange(0, seconds, step):
        source.sample(time, desired)
        samples.append((link(x), desired[2, 0]))
        middle, after = effort(time + step / 2), effort(time + step)
        k1 = rates(x, motor_effort)
        k2 = rates(x + step / 2 * k1, middle)
        k3 = rates(x + step / 2 * k2, middle)
        k4 = rates(x + step * k3, after)
        x, motor_effort = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4), after
    return np.array(samples)


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.0, 2.0, 20.0, 200.0], ids=lambda damping: f"d/k of {damping / 2:g} ms")
def test_feedforward_gives_the_desired_link_acceleration_with_any_damper(damping):
    """d / k is 0, 1, 10 and 100 ms, with the viscous friction of the joint of the spring. There is no feedback."""
    law = law_of(load_robot(ONE_ACTUATOR.format(stiffness=2e3, damping=0.75 * damping, viscous=0.25 * damping)))
    actual, desired = two_inertias(law, 2e3, damping, FromRest()).T
    error = np.abs(actual - desired).max() / np.abs(desired).max()
    print(f"largest error of the acceleration of the link: {error:.1e} of the largest acceleration")
    assert error < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.0, 2.0, 20.0, 200.0], ids=lambda damping: f"d/k of {damping / 2:g} ms")
def test_feedforward_spreads_jumps_of_the_jerk(damping):
    """The jerk jumps at both ends of a quintic; no finite effort can follow it through a spring without damper."""
    quintic = Trajectory([0.0, 1.2], [[0.0], [1.0]], np.zeros((2, 1)), np.zeros((2, 1)))
    law = law_of(load_robot(ONE_ACTUATOR.format(stiffness=2e3, damping=damping, viscous=0)))
    actual, desired = two_inertias(law, 2e3, damping, quintic, step=5e-4).T
    error = np.abs(actual - desired).max() / np.abs(desired).max()
    print(f"largest error of the acceleration of the link: {error:.1e} of the largest acceleration")
    assert error < (0.006 if damping >= 20 else 0.05)


def feedforward_motion(law, source, time):
    """Motion (3, n) of all joints that the feedforward assumes at a time, and its efforts (n,)."""
    n, out = len(law.q), np.zeros(len(law.joints))
    reference, full_motion = np.zeros((3, len(law.joints))), np.zeros((3, n))
    law.sample_reference(source, time, reference)
    full_motion[:, law.joint_indices], full_motion[:, law.elastic_actuators.springs] = (
        reference,
        law._link_side.solver.motion,
    )
    law.feedforward(reference, out)
    efforts = np.zeros(n)
    efforts[law.joint_indices] = out
    return full_motion, efforts


def assert_moves(law, source, time, accelerations, full_motion, rates=1e-5):
    """Accelerations (n,) of a plant in the state `full_motion` are those of the reference at links and motors.

    rates: part of the largest rate by which those of `full_motion` may differ from the slopes of its positions.
    """
    desired = np.zeros((3, len(law.joints)))
    source.sample(time, desired)
    link_values = accelerations[law.joint_indices]
    link_values[law.elastic_actuators.motors] += accelerations[law.elastic_actuators.springs]
    scale = np.abs(accelerations).max()
    np.testing.assert_allclose(link_values, desired[2], rtol=0, atol=1e-6 * np.abs(desired[2]).max())
    np.testing.assert_allclose(
        accelerations[law.joint_indices], full_motion[2, law.joint_indices], rtol=0, atol=1e-6 * scale
    )
    # the motion is consistent: its rates are the slopes of its positions
    steps = 1e-4 * np.array([-2, -1, 1, 2])
    near = np.array([feedforward_motion(law, source, time + step)[0][:2] for step in steps])
    for order in (0, 1):
        slope = np.array([1, -8, 8, -1]) @ near[:, order] / 12e-4
        np.testing.assert_allclose(
            slope, full_motion[order + 1], rtol=0, atol=rates * np.abs(full_motion[order + 1]).max()
        )


BODIES = {  # mass, centre, moments about the centre, axes as those of the frame
    "gear_1": (3.0, (0.02, -0.05, 0.01), (0.02, 0.03, 0.04)),
    "link_1": (5.0, (0.25, 0.02, 0.03), (0.05, 0.2, 0.2)),
    "gear_2": (2.0, (-0.03, 0.04, 0.02), (0.01, 0.02, 0.02)),
    "link_2": (2.5, (0.2, -0.02, 0.01), (0.02, 0.06, 0.06)),
}
SPRINGS = {"spring_1": (2500.0, 3.0, 0.05), "spring_2": (600.0, 2.4, -0.1)}  # stiffness, damping, position at rest
ROTORS = {"motor_1": 0.6, "spring_1": 0.02, "motor_2": 0.2, "spring_2": 0.01}


def arm_yaml():
    def body(name):
        mass, centre, moments = BODIES[name]
        inertia = ", ".join(f"{axis}: {value}" for axis, value in zip(("xx", "yy", "zz"), moments, strict=True))
        return f"link: {name}, mass: {mass}, centre_of_mass: {list(centre)}, central_inertia: {{{inertia}}}"

    def spring(name):
        stiffness, damping, rest = SPRINGS[name]
        return f"role: elastic, spring: {{stiffness: {stiffness}, damping: {damping}, rest: {rest}}}"

    samples = [
        f"joint: motor_1, {body('gear_1')}",
        f"joint: spring_1, {spring('spring_1')}, {body('link_1')}",
        f"joint: motor_2, mdh: {{alpha: pi/2, d: 0.5}}, {body('gear_2')}",
        f"joint: spring_2, {spring('spring_2')}, {body('link_2')}",
    ]
    joints = [f"  - {{{row}, rotor_inertia: {rotor}}}" for row, rotor in zip(samples, ROTORS.values(), strict=True)]
    return "\n".join(["robot: arm", "gravity: [0, -9.81, 2]", "joints:", *joints])


def arm_mujoco():
    def body(name, joint, attributes=""):
        mass, centre, moments = BODIES[name]
        stiffness, damping, rest = SPRINGS.get(joint, (0, 0, 0))
        return (
            f'<body name="{name}" {attributes}><inertial mass="{mass}" pos="{" ".join(map(str, centre))}" '
            f'diaginertia="{" ".join(map(str, moments))}"/><joint name="{joint}" axis="0 0 1" damping="{damping}" '
            f'stiffness="{stiffness}" springref="{rest}" armature="{ROTORS[joint]}"/>'
        )

    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian"/><option gravity="0 -9.81 2"/><worldbody>'
        + body("gear_1", "motor_1")
        + body("link_1", "spring_1")
        + body("gear_2", "motor_2", f'pos="0.5 0 0" euler="{np.pi / 2} 0 0"')
        + body("link_2", "spring_2")
        + "</body>" * 4
        + "</worldbody></mujoco>"
    )


def test_feedforward_gives_the_desired_link_accelerations_in_mujoco():
    """With bodies at the motors and rotors at the springs the torque of a spring depends on the springs beyond it."""
    law, model = law_of(load_robot(arm_yaml())), arm_mujoco()
    assert [model.joint(k).name for k in range(4)] == list(
        law.dynamics.joint_names
    ) and not law.elastic_actuators.is_decoupled
    data, swing = mujoco.MjData(model), Swing([0.3, -0.4], [0.5, 0.8], [4.0, 5.5])
    for time in np.linspace(0.1, 3, 12):
        full_motion, efforts = feedforward_motion(law, swing, time)
        data.qpos, data.qvel, data.qfrc_applied = full_motion[0], full_motion[1], efforts
        mujoco.mj_forward(model, data)
        assert_moves(law, swing, time, data.qacc.copy(), full_motion)


def test_feedforward_gives_the_desired_link_accelerations_of_the_manutec():
    """The plant is the direct model; the springs have dampers."""
    law = law_of(load_robot("manutec_r3"))
    assert law.elastic_actuators.damping.all() and law.elastic_actuators.is_decoupled
    assert list(law.elastic_actuators.motors) == [0, 1, 2] and list(law.elastic_actuators.springs) == [1, 3, 5]
    swing = Swing(np.linspace(0.2, 0.8, 6), 0.3, np.linspace(3, 6, 6))
    for time in np.linspace(0.1, 2, 20):
        full_motion, efforts = feedforward_motion(law, swing, time)
        assert_moves(law, swing, time, law.dynamics.direct(*full_motion[:2], efforts), full_motion)


def test_feedforward_gives_the_desired_link_accelerations_with_a_mimic_joint():
    """The mimic joint follows the motor and not the link: its motion depends on the deflection."""
    text = (
        arm_yaml()
        + """
  - {joint: geared, link: flywheel, antecedent: link_1, mdh: {d: 0.3}, mimic: {joint: motor_2, multiplier: -2},
     mass: 1, centre_of_mass: [0.1, 0, 0], central_inertia: {xx: 0.01, yy: 0.01, zz: 0.01}}"""
    )
    law, swing = law_of(load_robot(text)), Swing([0.3, -0.4], [0.5, 0.8], [4.0, 5.5])
    assert not law.elastic_actuators.has_unbranched_motor_links
    for time in np.linspace(0.1, 3, 6):
        full_motion, efforts = feedforward_motion(law, swing, time)
        assert_moves(law, swing, time, law.dynamics.direct(*full_motion[:2], efforts), full_motion)


def test_feedforward_gives_the_desired_link_accelerations_on_a_free_base():
    """The base reacts to motors and links. Motors are not checked, because the motion of the base is not predicted."""
    text = arm_yaml().replace("joints:", "base: {link: hull, mass: 20, inertia: {xx: 2, yy: 3, zz: 2}}\njoints:", 1)
    law = law_of(load_robot(text, moving_base=True))
    law.twist[:], law.gravity[:] = [0.1, -0.2, 0.1, 0.3, 0.2, -0.1], [0, -9.81, 2]
    swing, desired = Swing([0.3, -0.4], [0.5, 0.8], [4.0, 5.5]), np.zeros((3, 2))
    for time in np.linspace(0.1, 3, 6):
        full_motion, efforts = feedforward_motion(law, swing, time)
        accelerations = law.dynamics.direct(*full_motion[:2], efforts, base=Base(np.eye(4), law.twist))
        swing.sample(time, desired)
        link_values = accelerations[law.joint_indices] + accelerations[law.elastic_actuators.springs]
        np.testing.assert_allclose(link_values, desired[2], rtol=0, atol=1e-6 * np.abs(desired[2]).max())


@pytest.mark.parametrize("friction_velocity", FRICTION_VELOCITIES)
def test_spring_vibration_disturbs_motors_by_the_error_dynamics(friction_velocity):
    """A (ë + K_d ė + K_p e) = f(q̇) - f(q̇_f) + A_s (q̈_s - q̈_sd), away from the reference, all joints measured."""
    law, rng = law_of(load_robot("manutec_r3")), np.random.default_rng(8)
    dynamics, samples, springs = law.dynamics, law.joint_indices, law.elastic_actuators.springs
    full_motion, _ = feedforward_motion(law, Swing(np.linspace(0.2, 0.8, 6), 0.3, np.linspace(3, 6, 6)), 0.7)
    law.q[:], law.qd[:] = full_motion[:2] + rng.uniform(-0.01, 0.01, (2, 9))
    out, efforts = np.zeros(6), np.zeros(9)
    law.computed_torque(full_motion[:, samples], 100.0, 20.0, out, friction_velocity)
    efforts[samples] = out
    accelerations = dynamics.direct(law.q, law.qd, efforts)
    e, ed, edd = full_motion - [law.q, law.qd, accelerations]
    A, desired = dynamics.inertia_matrix(law.q), law.qd if friction_velocity == "measured" else full_motion[1]
    friction_difference = dynamics.friction(law.qd) - dynamics.friction(desired)
    left_side = A[np.ix_(samples, samples)] @ (edd + 20 * ed + 100 * e)[samples]
    right_side = friction_difference[samples] - A[np.ix_(samples, springs)] @ edd[springs]
    np.testing.assert_allclose(left_side, right_side, rtol=0, atol=1e-9 * np.abs(left_side).max())


ROBOTS_WITH_LOOPS = {
    "3-RPS, 20 N/mm": lambda: load_robot(elastic_3rps(2e4)),
    "3-RPS, 20 N/mm and a damper": lambda: load_robot(elastic_3rps(2e4, 60.0)),
    "3-RPS, 5 N/mm": lambda: load_robot(elastic_3rps(5e3)),
    "two platforms in series": lambda: load_robot(planar_stack("gears")),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS_WITH_LOOPS)
def test_feedforward_gives_the_desired_link_accelerations_in_loops(name):
    """The plant has maximal coordinates and multipliers: bodies at the motors, friction of passive joints, rotors."""
    robot = ROBOTS_WITH_LOOPS[name]()
    law, peer = law_of(robot), MaximalCoordinates(robot)
    dynamics, elastic_actuators = law.dynamics, law.elastic_actuators
    independent = [robot.joint_numbers[joint] for joint in dynamics.joint_names]
    initial_positions = dynamics.initial_joint_positions[independent]
    law.q[:] = initial_positions
    link_values = initial_positions[law.joint_indices]
    link_values[elastic_actuators.motors] += initial_positions[elastic_actuators.springs] - elastic_actuators.rest
    swing = Swing(link_values, 0.03, np.linspace(7, 11, len(link_values)))
    for time in (0.2, 0.5, 0.9):
        full_motion, efforts = feedforward_motion(law, swing, time)
        q = dynamics.initial_joint_positions.copy()
        q[independent] = full_motion[0]
        q = dynamics.expand_positions(q)
        joint_efforts = np.zeros(len(q))
        joint_efforts[independent] = efforts
        solution = peer.direct(q, dynamics.expand_velocities(full_motion[1], q), joint_efforts)
        assert solution.residual < 1e-6
        has_soft_springs = name == "two platforms in series"  # bodies behind springs of 120 N m/rad, with d / k of 4 ms
        assert_moves(
            law, swing, time, solution.accelerations[independent], full_motion, rates=1e-4 if has_soft_springs else 1e-5
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["manutec_r3", "3-RPS, 20 N/mm and a damper"])
def test_motor_rates_are_exactly_zero_where_the_links_rest(name):
    """Exactly zero: noise of rates would make Coulomb friction jump."""
    law = law_of(ROBOTS_WITH_LOOPS[name]() if name in ROBOTS_WITH_LOOPS else load_robot(name))
    independent = [law.dynamics.all_joint_names.index(joint) for joint in law.dynamics.joint_names]
    law.q[:] = law.dynamics.initial_joint_positions[independent]
    start, size = law.q[law.joint_indices].copy(), len(law.joints)
    source = Trajectory([0.0, 0.3], [start, start + 0.02], np.zeros((2, size)), np.zeros((2, size)))
    reference = np.zeros((3, size))
    for time in np.arange(-0.02, 0.6, 0.007):
        law.sample_reference(source, time, reference)
        if not -0.007 < time < 0.4:
            assert not reference[1:].any() and not law._link_side.solver.motion[1:].any(), time
        elif 0.1 < time < 0.2:
            assert law._link_side.solver.motion[1:].all()


def test_unmeasured_springs_are_those_of_the_reference():
    """On the reference computed torque is the feedforward, with springs measured or not, also after continue_from."""
    law = law_of(load_robot("manutec_r3"))
    swing = Swing(np.linspace(0.2, 0.8, 6), 0.3, np.linspace(3, 6, 6))
    full_motion, efforts = feedforward_motion(law, swing, 0.4)
    joints = (
        joint if joint.spring is None else replace(joint, spring=replace(joint.spring, rest=joint.spring.rest + 0.1))
        for joint in law.dynamics.robot.joints
    )
    other = replace(law.dynamics.robot, joints=tuple(joints))
    before = law_of(other)  # its springs have other rest positions, and are not measured
    before.q[law.joint_indices], before.qd[law.joint_indices] = full_motion[:2, law.joint_indices]
    law.continue_from(before)
    for measured in (False, True):
        if measured:
            law.q[:], law.qd[:] = full_motion[:2]
        out = np.zeros(6)
        law.computed_torque(full_motion[:, law.joint_indices], 100.0, 20.0, out)
        np.testing.assert_allclose(out, efforts[law.joint_indices], rtol=1e-12)


def test_deflections_do_not_jump_when_reference_or_law_is_replaced():
    """A damper with d / k of 50 ms prevents jumps of the spring; another law continues without a jump."""
    robot = load_robot(ONE_ACTUATOR.format(stiffness=2e3, damping=100.0, viscous=0))
    law, reference, positions = law_of(robot), np.zeros((3, 1)), []
    moving = Trajectory([0.0, 0.4], [[0.0], [1.0]], np.zeros((2, 1)), np.zeros((2, 1)))
    braking = Trajectory([0.2, 0.5], [[0.5], [0.7]], [[4.0], [0.0]], [[0.0], [0.0]])
    for time in np.arange(0.0, 0.6, 0.001):
        if abs(time - 0.3) < 1e-9:
            before, law = law, law_of(robot)
            law.continue_from(before)
        law.sample_reference(moving if time < 0.2 else braking, time, reference)
        positions.append(law._link_side.solver.motion[0, 0])
    steps = np.abs(np.diff(positions))
    assert steps[198:202].max() < 2 * steps[195:198].max() and steps[298:302].max() < 1.5 * steps[295:298].max()
    equilibrium = (-WEIGHT * np.cos(0.7 + 0.2)) / 2e3 + 0.2
    np.testing.assert_allclose(
        positions[-1], equilibrium, atol=0.2 * np.ptp(positions)
    )  # 0.1 s after the end, two times d / k


def test_stream_of_points_moves_the_motor_as_a_trajectory_without_jerk():
    """Points have no jerk: accelerations of springs lack its part, and so do their rates without damper."""
    robot = load_robot(ONE_ACTUATOR.format(stiffness=2e3, damping=60.0, viscous=0))
    laws, swing, pair = [law_of(robot), law_of(robot)], Swing([0.3], [0.4], [4.0]), np.zeros((2, 3, 1))
    samples, values = [], np.zeros((3, 1))
    for time in np.arange(0.0, 1.5, 0.001):
        swing.sample(time, values)
        for law, source, reference in zip(laws, (swing, ReferencePoint(time, values, time + 0.1)), pair, strict=True):
            law.sample_reference(source, time, reference)
        samples.append([law._link_side.solver.motion[:, 0].copy() for law in laws])
    samples = np.array(samples[400:])
    scale, error = np.abs(samples[:, 0]).max(axis=0), np.abs(samples[:, 1] - samples[:, 0]).max(axis=0)
    assert error[0] < 1e-3 * scale[0] and error[1] < 0.02 * scale[1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("viscous_friction: 0", "coulomb_friction: 1"), "'spring' has Coulomb friction beside its spring: the motor"),
        (
            ("viscous_friction: 0", "stribeck_friction: 1, stribeck_velocity: 0.1"),
            "'spring' has Coulomb friction beside",
        ),
        (("viscous_friction: 0", "viscous_friction: 1, viscous_asymmetry: 0.1"), "'spring' has asymmetric viscous"),
        ((), "more than one spring is behind the motor 'motor'"),
        (
            ("link: link", "link: link, rotor_inertia: 0.1"),
            "'spring' has a damper with d / k of 0.015 s: .* 0.005 s at most",
        ),
    ],
)
def test_actuators_that_cannot_be_compensated_are_refused(change, message):
    text = ONE_ACTUATOR.format(stiffness=2e3, damping=30, viscous=0)
    assert not change or change[0] in text
    if change:
        text = text.replace(*change)
    else:
        text += "  - {joint: other, link: beside, antecedent: gear, role: elastic, spring: {stiffness: 5}, mass: 1,\n"
        text += "     first_moments: [0.1, 0, 0], inertia: {yy: 0.1, zz: 0.1}}\n"
    robot = load_robot(text)
    with pytest.raises(InvalidInputError, match=message):
        law_of(robot)


def test_springs_too_soft_for_the_bodies_behind_them_are_refused():
    law = law_of(load_robot(elastic_3rps(30.0)))
    motors = [law.dynamics.all_joint_names.index(name) for name in law.joints]
    swing = Swing(law.dynamics.initial_joint_positions[motors], 0.03, np.array([9, 10, 11]))
    with pytest.raises(RobotDynamicsError, match=r"too soft \(stiffness 30, 30, 30\)"):
        for time in np.linspace(0, 1, 20):
            law.sample_reference(swing, time, np.zeros((3, 3)))
