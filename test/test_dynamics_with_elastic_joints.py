"""Unactuated joints, elastic and passive: inverse and direct model against Pinocchio's A and H with the rows of
these joints solved, small oscillations against closed forms, static equilibria against energy."""

from dataclasses import replace

import numpy as np
import pytest
from peers.pinocchio_model import PinocchioModel
from peers.random_robots import random_states, random_urdf
from peers.real_robots import real_urdf
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

from robot_dynamics import Base, Dynamics, InvalidInputError, Robot, SingularModelError, Spring, load_robot
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.placement import placement
from robot_dynamics.model.robot import Frame, Link

TOLERANCE = 1e-9


def relative_error(actual, expected):
    scale = np.abs(expected).max(initial=0)
    return np.abs(actual - expected).max(initial=0) / (scale if scale > 1e-9 else 1)


def with_random_springs(robot, seed, least=1):
    """Return the robot with random elastic and passive joints, springs beside some motors, frictions and rotors."""
    rng = np.random.default_rng([seed, 2])
    joints = []
    unactuated = set(rng.choice(len(robot.joints), size=rng.integers(least, len(robot.joints) + 1), replace=False))
    for number, joint in enumerate(robot.joints):
        spring = Spring(10 ** rng.uniform(0, 4), rng.uniform(-1, 1), rng.uniform(0, 5)) if rng.random() < 0.8 else None
        actuated = joint.mimic is not None or number not in unactuated
        if actuated and rng.random() < 0.7:
            spring = None
        viscous, coulomb, rotor = rng.uniform(0, 2, 3)
        joints.append(
            replace(
                joint,
                actuated=actuated,
                spring=spring,
                viscous_friction=viscous,
                coulomb_friction=coulomb,
                rotor_inertia=rotor,
            )
        )
    return replace(robot, joints=tuple(joints))


def passive_efforts(robot, q, qd):
    """Return efforts of friction and springs at each joint, from their definition."""
    efforts = []
    for joint, position, velocity in zip(robot.joints, q, qd, strict=True):
        force = joint.viscous_friction * velocity + joint.coulomb_friction * np.sign(velocity)
        if joint.spring:
            force += joint.spring.stiffness * (position - joint.spring.rest) + joint.spring.damping * velocity
        efforts.append(force)
    return np.array(efforts)


def check(urdf, seed, moving_base, prescribed_base=False):
    robot = with_random_springs(read_urdf(urdf, moving_base=moving_base), seed)
    dynamics = Dynamics(robot)
    rotors = [joint.rotor_inertia for joint in robot.joints]
    peer = PinocchioModel(urdf, dynamics.all_joint_names, moving_base, rotors)
    S = np.zeros((len(robot.joints), len(dynamics.joint_names)))
    offset = np.zeros(len(robot.joints))
    for row, joint in enumerate(robot.joints):
        leader = joint.mimic.joint if joint.mimic else joint.name
        S[row, dynamics.joint_names.index(leader)] = joint.mimic.multiplier if joint.mimic else 1
        offset[row] = joint.mimic.offset if joint.mimic else 0
    free = [dynamics.joint_names.index(joint.name) for joint in robot.joints if not joint.actuated]
    assert dynamics.unactuated_joint_names == tuple(dynamics.joint_names[k] for k in free) and free
    actuated_columns = [k for k in range(len(dynamics.joint_names)) if k not in free]
    b = 6 if moving_base else 0
    T = np.eye(b + S.shape[0], b + S.shape[1])
    T[b:, b:] = S

    states = random_states(robot, S.shape[1], 5, seed)
    base = states.base
    if prescribed_base:
        base = Base(base.pose, base.twist, np.random.default_rng(seed).uniform(-3, 3, (5, 6)))
    options = {"base": base, "external_wrenches": states.wrenches}
    qdd = states.qdd.copy()
    qdd[:, free] = np.nan
    inverse = dynamics.solve(states.q, states.qd, qdd=qdd, **options)
    direct = dynamics.solve(states.q, states.qd, efforts=inverse.efforts, **options)
    for k in range(5):
        q, qd = S @ states.q[k] + offset, S @ states.qd[k]
        A = T.T @ peer.inertia_matrix(q) @ T
        H = T.T @ peer.bias(q, qd, *states.base_of(k), states.wrenches_of(k))
        H[b:] += S.T @ passive_efforts(robot, q, qd)
        unknown = [*(range(b) if not prescribed_base else ()), *(b + n for n in free)]
        x = np.r_[base.acceleration[k] if prescribed_base else np.zeros(b), states.qdd[k]]
        x[unknown] = 0
        x[unknown] = np.linalg.solve(A[np.ix_(unknown, unknown)], -(A @ x + H)[unknown])
        rows = A @ x + H
        tolerance = TOLERANCE * max(1, np.linalg.cond(A[np.ix_(unknown, unknown)]) / 1e5)
        assert relative_error(inverse.accelerations[k], x[b:]) < tolerance
        assert relative_error(inverse.efforts[k][actuated_columns], rows[b:][actuated_columns]) < tolerance
        assert not inverse.efforts[k][free].any()
        if prescribed_base:
            assert relative_error(inverse.reactions[k, 0], rows[:6]) < tolerance
        elif moving_base:
            assert relative_error(inverse.base_acceleration[k], x[:b]) < tolerance
        assert relative_error(direct.accelerations[k], x[b:]) < TOLERANCE * max(1, np.linalg.cond(A) / 1e5)


@pytest.mark.parametrize("moving_base", [False, True], ids=["fixed", "moving"])
@pytest.mark.parametrize("seed", range(100))
def test_random_tree_with_random_elastic_and_passive_joints_agrees_with_pinocchio(seed, moving_base):
    check(random_urdf(seed), seed, moving_base)


@pytest.mark.parametrize("name", ["panda", "talos", "tiago_pro"])
@pytest.mark.parametrize("base", ["fixed", "moving", "prescribed_base"])
def test_elastic_joints_beside_mimic_joints_agree_with_pinocchio(name, base):
    check(real_urdf(name), 4, base != "fixed", prescribed_base=base == "prescribed_base")


@pytest.mark.parametrize("seed", range(10))
def test_elastic_joints_on_a_prescribed_base_agree_with_pinocchio(seed):
    check(random_urdf(seed), seed, True, prescribed_base=True)


# A planar arm of two links: lengths, centres of mass [m], masses [kg], moments about the centres [kg m²]
L1, C1, C2, M1, M2, J1, J2 = 0.4, 0.25, 0.15, 3.0, 1.2, 0.03, 0.008
K1, K2 = 250.0, 90.0


SPRINGS = Spring(K1), Spring(K2, rest=0.7)


def planar_arm(gravity=(0, 0, 0), actuated=(False, False), springs=SPRINGS):
    links = [Link("ground", Inertia())]
    joints, frames = [], [Frame("ground", 0, np.eye(4))]
    for k, (mass, centre, moment) in enumerate([(M1, C1, J1), (M2, C2, J2)]):
        body = Inertia.about_centre_of_mass(mass, np.diag([0.0, moment, moment]), placement(translation=[centre, 0, 0]))
        links.append(Link(f"link_{k + 1}", body))
        placed = placement(translation=[L1 * k, 0, 0])
        joints.append(Joint(f"joint_{k + 1}", k, False, placed, actuated=actuated[k], spring=springs[k]))
        frames.append(Frame(f"link_{k + 1}", k + 1, np.eye(4)))
    return Robot("planar", tuple(links), tuple(joints), tuple(frames), gravity=gravity)


def closed_form_modes(q2):
    """Frequencies ω [rad/s] and shapes of the modes, from the textbook's 2×2 mass matrix and the quadratic formula."""
    a = J1 + J2 + M1 * C1**2 + M2 * (L1**2 + C2**2 + 2 * L1 * C2 * np.cos(q2))
    b = J2 + M2 * (C2**2 + L1 * C2 * np.cos(q2))
    c = J2 + M2 * C2**2
    # det(K - ω² M) = 0
    p, half, r = a * c - b**2, (a * K2 + c * K1) / 2, K1 * K2
    squares = np.array([half - np.sqrt(half**2 - p * r), half + np.sqrt(half**2 - p * r)]) / p
    shapes = np.array([[b * w, K1 - a * w] for w in squares])
    return np.sqrt(squares), shapes / np.linalg.norm(shapes, axis=1, keepdims=True)


@pytest.mark.parametrize("mode", [0, 1])
def test_small_oscillations_of_an_elastic_arm_have_the_closed_form_frequencies(mode):
    """Released in a mode shape, the arm swings as cos ωt for ten periods."""
    dynamics = Dynamics(planar_arm())
    frequencies, shapes = closed_form_modes(0.7)
    amplitude, rest = 1e-6, np.array([0.0, 0.7])
    times = np.linspace(0, 10 * 2 * np.pi / frequencies[mode], 101)

    def rates(_, state):
        return np.r_[state[2:], dynamics.direct(rest + state[:2], state[2:], np.zeros(2))]

    start = np.r_[amplitude * shapes[mode], 0, 0]
    swing = solve_ivp(rates, times[[0, -1]], start, t_eval=times, method="DOP853", rtol=1e-10, atol=1e-16).y[:2].T
    expected = amplitude * np.cos(frequencies[mode] * times)[:, None] * shapes[mode]
    assert np.abs(swing - expected).max() < 1e-4 * amplitude


def test_frequencies_of_the_linearised_direct_model_are_those_of_the_closed_form():
    dynamics, rest, h = Dynamics(planar_arm()), np.array([0.0, 0.7]), 1e-6
    steps = rest + h * np.r_[np.eye(2), -np.eye(2)]
    accelerations = dynamics.direct(steps, np.zeros(2), np.zeros(2))
    squares = np.linalg.eigvals(-((accelerations[:2] - accelerations[2:]) / (2 * h)).T)
    np.testing.assert_allclose(np.sort(np.sqrt(squares)), closed_form_modes(0.7)[0], rtol=1e-7)


def test_dampers_dissipate_the_energy_that_the_arm_loses():
    """Kinetic, spring and gravity energy fall by the work of the dampers."""
    springs = (Spring(K1, damping=0.8), Spring(K2, rest=0.7, damping=0.3))
    dynamics = Dynamics(planar_arm((0, -9.81, 0), springs=springs))

    def energy(q, qd):
        kinetic = 0.5 * qd @ dynamics.inertia_matrix(q) @ qd
        return kinetic + 0.5 * K1 * q[0] ** 2 + 0.5 * K2 * (q[1] - 0.7) ** 2 + weight_energy(q)

    def rates(_, state):
        qd = state[2:4]
        return np.r_[qd, dynamics.direct(state[:2], qd, np.zeros(2)), 0.8 * qd[0] ** 2 + 0.3 * qd[1] ** 2]

    state = solve_ivp(rates, (0, 1), [0.5, -0.4, 1, -2, 0], method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    dissipated = energy(np.array([0.5, -0.4]), np.array([1.0, -2.0])) - energy(state[:2], state[2:4])
    assert state[4] > 1 and abs(dissipated - state[4]) < 1e-8


def weight_energy(q, g=9.81):
    return g * (M1 * C1 * np.sin(q[0]) + M2 * (L1 * np.sin(q[0]) + C2 * np.sin(q[0] + q[1])))


def test_equilibrium_of_an_elastic_arm_minimises_its_energy():
    dynamics = Dynamics(planar_arm((0, -9.81, 0)))
    equilibrium = dynamics.equilibrium(np.array([[0.0, 0.7], [0.3, 0.2]]))
    least = minimize(
        lambda q: 0.5 * K1 * q[0] ** 2 + 0.5 * K2 * (q[1] - 0.7) ** 2 + weight_energy(q), [0, 0.7], tol=1e-14
    ).x
    assert equilibrium.stable.all() and not equilibrium.efforts.any()
    np.testing.assert_allclose(equilibrium.positions, [least, least], atol=1e-6)
    weight = 9.81 * (M1 + M2)
    np.testing.assert_allclose(equilibrium.reactions[:, 0, :3], [[0, weight, 0]] * 2, atol=1e-9)


@pytest.mark.slow
def test_equilibrium_with_a_wrench_has_zero_acceleration():
    """The direct model with the efforts of the equilibrium stays at rest: with motors, wrenches, batches."""
    for seed in range(20):
        robot = with_random_springs(read_urdf(random_urdf(seed)), seed)
        springs = [
            replace(joint, spring=joint.spring or Spring(0.0 if joint.actuated else 3e4), coulomb_friction=0.0)
            for joint in robot.joints
        ]
        springs = [
            joint if joint.actuated else replace(joint, spring=replace(joint.spring, stiffness=3e4))
            for joint in springs
        ]
        robot = replace(robot, joints=tuple(springs))
        dynamics = Dynamics(robot)
        states = random_states(robot, len(robot.joints), 3, seed)
        equilibrium = dynamics.equilibrium(states.q, external_wrenches=states.wrenches)
        rest = np.zeros_like(states.q)
        accelerations = dynamics.direct(
            equilibrium.positions, rest, equilibrium.efforts, external_wrenches=states.wrenches
        )
        actuated_columns = [k for k, joint in enumerate(robot.joints) if joint.actuated]
        assert np.array_equal(equilibrium.positions[:, actuated_columns], states.q[:, actuated_columns])
        scale = np.abs(dynamics.direct(states.q, rest, rest, external_wrenches=states.wrenches)).max()
        assert np.abs(accelerations).max() < 1e-7 * max(scale, 1)


def test_stability_of_a_pendulum():
    dynamics = Dynamics(planar_arm((0, -9.81, 0), springs=(None, None)))
    standing = [np.pi / 2, 0]
    equilibrium = dynamics.equilibrium([[-1.5, 0.1], [1.5, 0.05], [0.0, 0.0], standing])
    hanging = [-np.pi / 2, 0]
    # from a start on the left it moves down there to the hanging position
    np.testing.assert_allclose(equilibrium.positions, [hanging, hanging, hanging, standing], atol=1e-9)
    assert equilibrium.stable.tolist() == [True, True, True, False]


@pytest.mark.parametrize("stiffness", [0.0, 0.01, 1.0, 2.0, 3.0, 9.0, 100.0])
@pytest.mark.parametrize("start", [0.01, 0.0, 0.5, -1.2, 2.0])
def test_equilibrium_of_an_elastic_pendulum_is_below_its_start(stiffness, start):
    """With a straight elbow the energy falls monotonically from the start to a minimum on the same side."""
    robot = planar_arm((0, -9.81, 0), actuated=(False, True), springs=(Spring(stiffness), None))
    dynamics, weight = Dynamics(robot), 9.81 * (M1 * C1 + M2 * (L1 + C2))

    def energy(q):
        return 0.5 * stiffness * q**2 + weight * np.sin(q)

    equilibrium = dynamics.equilibrium([start, 0.0])
    q = equilibrium.positions[0]
    assert equilibrium.stable and abs(stiffness * q + weight * np.cos(q)) < 1e-6 * weight
    path = energy(np.linspace(start, q, 1000))
    assert np.diff(path).max() < 1e-9 * weight


def test_moving_base_in_equilibrium_is_held_or_keeps_its_acceleration():
    """An inverted arm hangs from its base; in free fall its springs are at rest."""
    robot = replace(planar_arm((0, -9.81, 0)), moving_base=True)
    dynamics, fixed = Dynamics(robot), Dynamics(planar_arm((0, 9.81, 0)))
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])
    equilibrium = dynamics.equilibrium([0, 0.7], base=Base(turned))
    np.testing.assert_allclose(equilibrium.positions, fixed.equilibrium([0, 0.7]).positions, atol=1e-9)
    falling = dynamics.equilibrium([0.3, 0.2], base=Base(acceleration=[0, -9.81, 0, 0, 0, 0]))
    np.testing.assert_allclose(falling.positions, [0, 0.7], atol=1e-9)


def test_equilibrium_is_refused_where_forces_cannot_balance():
    slide_joint = Joint("slide", 0, True, np.eye(4), actuated=False)
    frames = (Frame("ground", 0, np.eye(4)), Frame("mass", 1, np.eye(4)))
    links = (Link("ground", Inertia()), Link("mass", Inertia(1.0)))
    dynamics = Dynamics(Robot("falling", links, (slide_joint,), frames))
    with pytest.raises(SingularModelError, match=r"positions of sample 0: a force of 9.81 .* remains at joint 'slide'"):
        dynamics.equilibrium([0.0])
    np.testing.assert_allclose(dynamics.inverse([0.0], [0.0], [0.0]), [0])
    np.testing.assert_allclose(dynamics.direct([0.0], [0.0], [0.0]), [-9.81])


def chain(*links):
    """Return a chain of links, each an inertia and {field of its Joint: value}."""
    built_links, joints, frames = [Link("ground", Inertia())], [], [Frame("ground", 0, np.eye(4))]
    for k, (inertia, fields) in enumerate(links, start=1):
        placed = fields.pop("placed", np.eye(4))
        joints.append(Joint(f"joint_{k}", k - 1, fields.pop("prismatic", False), placed, **fields))
        built_links.append(Link(f"link_{k}", inertia))
        frames.append(Frame(f"link_{k}", k, np.eye(4)))
    return Robot("chain", tuple(built_links), tuple(joints), tuple(frames), gravity=(0, -9.81, 0))


UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # z up along y


@pytest.mark.parametrize(("stiffness", "mass"), [(1e8, 1.0), (1e7, 0.1), (1e6, 0.01)])
def test_equilibrium_of_a_soft_joint_beside_a_very_stiff_joint(stiffness, mass):
    """A pendulum on a stiff spring hangs, and its weight compresses the spring."""
    rod = Inertia(mass, [0.1 * mass, 0, 0], np.diag([0, 0.01, 0.01]) * mass)
    slide = {"prismatic": True, "actuated": False, "spring": Spring(stiffness), "placed": UP}
    robot = chain((Inertia(), slide), (rod, {"actuated": False, "placed": np.linalg.inv(UP)}))
    equilibrium = Dynamics(robot).equilibrium([0, -1.2])
    np.testing.assert_allclose(equilibrium.positions, [-9.81 * mass / stiffness, -np.pi / 2], rtol=1e-9)
    assert equilibrium.stable


@pytest.mark.slow
def test_falling_light_mass_beside_a_heavy_mass_is_refused_in_each_sample():
    fall = {"prismatic": True, "actuated": False, "placed": UP}
    heavy, light = Inertia(1e6, [0, 0, 0], np.eye(3)), Inertia(1e-3)
    dynamics = Dynamics(chain((heavy, {}), (light, fall)))
    with pytest.raises(SingularModelError, match=r"sample 0: a force of 0.00981 .* joint 'joint_2'"):
        dynamics.equilibrium([0, 0])
    level = {"prismatic": True, "actuated": False}  # along z it may rest anywhere: neutral
    equilibrium = Dynamics(chain((heavy, {}), (light, level))).equilibrium([0, 0.3])
    assert equilibrium.positions[1] == 0.3 and not equilibrium.stable
    turned = [[0, 0.1], [0, 0.2], [np.pi / 2, 0.1]]  # the slide is level where joint 1 is at a right angle
    with pytest.raises(SingularModelError, match="sample 0"):
        dynamics.equilibrium(turned)
    with pytest.raises(SingularModelError, match="sample 2"):
        dynamics.equilibrium([[np.pi / 2, 0.1], [np.pi / 2, 0.2], [0, 0.1]])


def test_wrench_that_overflows_is_refused():
    dynamics = Dynamics(planar_arm((0, -9.81, 0)))
    with pytest.raises(InvalidInputError, match="is not a finite number"):
        dynamics.equilibrium([0, 0], external_wrenches={"link_2": [0, 0, 0, 0, 0, 1e155]})


def test_equilibrium_of_a_slide_on_a_soft_spring_may_be_far():
    far = {"prismatic": True, "actuated": False, "spring": Spring(1000.0, rest=100.0)}
    np.testing.assert_allclose(Dynamics(chain((Inertia(1.0), far))).equilibrium([0.0]).positions, [100], rtol=1e-12)


def test_terms_add_up_to_the_efforts():
    robot = with_random_springs(load_robot("ur5e"), 3)
    dynamics = Dynamics(robot)
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 7, 6))
    qdd[:, [k for k, joint in enumerate(robot.joints) if not joint.actuated]] = 0
    result = dynamics.solve(q, qd, qdd=qdd)
    terms = dynamics.gravity(q) + dynamics.coriolis(q, qd) + dynamics.friction(qd) + dynamics.elasticity(q, qd)
    inertia = (dynamics.inertia_matrix(q) @ result.accelerations[..., None])[..., 0]
    np.testing.assert_allclose(inertia + terms, result.efforts, atol=1e-9)


@pytest.mark.parametrize("label", ["accelerations", "efforts"])
def test_acceleration_or_effort_of_an_unactuated_joint_is_refused(label):
    dynamics = Dynamics(planar_arm(actuated=(True, False)))
    options = {"qdd" if label == "accelerations" else "efforts": [[1.0, 0.0], [1.0, 2.0]]}
    with pytest.raises(InvalidInputError, match=rf"{label}\[1\] is 2: joint 'joint_2': no motor drives it.*0 or nan"):
        dynamics.solve([0, 0], [0, 0], **options)
    with pytest.raises(InvalidInputError, match=r"accelerations\[0\] at sample 0 is nan"):
        dynamics.inverse([[0, 0]], [0, 0], [[np.nan, np.nan]])
