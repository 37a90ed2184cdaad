"""Joints without motor, elastic and passive: inverse and direct model against Pinocchio's A and H with the rows of
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


def relative_error(found, expected):
    scale = np.abs(expected).max(initial=0)
    return np.abs(found - expected).max(initial=0) / (scale if scale > 1e-9 else 1)


def with_random_springs(robot, seed, least=1):
    """The robot with random joints elastic or passive, springs beside some motors, frictions and rotors."""
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


def demands(robot, q, qd):
    """What friction and springs ask of a motor at each joint, from their definition."""
    found = []
    for joint, position, velocity in zip(robot.joints, q, qd, strict=True):
        force = joint.viscous_friction * velocity + joint.coulomb_friction * np.sign(velocity)
        if joint.spring:
            force += joint.spring.stiffness * (position - joint.spring.rest) + joint.spring.damping * velocity
        found.append(force)
    return np.array(found)


def check(urdf, seed, moving_base, told=False):
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
    driven = [k for k in range(len(dynamics.joint_names)) if k not in free]
    b = 6 if moving_base else 0
    T = np.eye(b + S.shape[0], b + S.shape[1])
    T[b:, b:] = S

    states = random_states(robot, S.shape[1], 5, seed)
    base = states.base
    if told:
        base = Base(base.pose, base.twist, np.random.default_rng(seed).uniform(-3, 3, (5, 6)))
    question = {"base": base, "external_wrenches": states.wrenches}
    qdd = states.qdd.copy()
    qdd[:, free] = np.nan
    inverse = dynamics.solve(states.q, states.qd, qdd=qdd, **question)
    direct = dynamics.solve(states.q, states.qd, efforts=inverse.efforts, **question)
    for k in range(5):
        q, qd = S @ states.q[k] + offset, S @ states.qd[k]
        A = T.T @ peer.inertia_matrix(q) @ T
        H = T.T @ peer.bias(q, qd, *states.base_of(k), states.wrenches_of(k))
        H[b:] += S.T @ demands(robot, q, qd)
        unknown = [*(range(b) if not told else ()), *(b + n for n in free)]
        x = np.r_[base.acceleration[k] if told else np.zeros(b), states.qdd[k]]
        x[unknown] = 0
        x[unknown] = np.linalg.solve(A[np.ix_(unknown, unknown)], -(A @ x + H)[unknown])
        rows = A @ x + H
        tolerance = TOLERANCE * max(1, np.linalg.cond(A[np.ix_(unknown, unknown)]) / 1e5)
        assert relative_error(inverse.accelerations[k], x[b:]) < tolerance
        assert relative_error(inverse.efforts[k][driven], rows[b:][driven]) < tolerance
        assert not inverse.efforts[k][free].any()
        if told:
            assert relative_error(inverse.reactions[k, 0], rows[:6]) < tolerance
        elif moving_base:
            assert relative_error(inverse.base_acceleration[k], x[:b]) < tolerance
        assert relative_error(direct.accelerations[k], x[b:]) < TOLERANCE * max(1, np.linalg.cond(A) / 1e5)


@pytest.mark.parametrize("moving_base", [False, True], ids=["fixed", "moving"])
@pytest.mark.parametrize("seed", range(100))
def test_random_tree_with_random_elastic_and_passive_joints_agrees_with_pinocchio(seed, moving_base):
    check(random_urdf(seed), seed, moving_base)


@pytest.mark.parametrize("name", ["panda", "talos", "tiago_pro"])
@pytest.mark.parametrize("base", ["fixed", "moving", "told"])
def test_elastic_joints_beside_joints_that_follow_others_agree_with_pinocchio(name, base):
    check(real_urdf(name), 4, base != "fixed", told=base == "told")


@pytest.mark.parametrize("seed", range(10))
def test_elastic_joints_on_a_base_moved_as_told_agree_with_pinocchio(seed):
    check(random_urdf(seed), seed, True, told=True)


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
    """Let go from a mode shape, the arm swings as cos ωt for ten periods."""
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
    pushed = dynamics.direct(steps, np.zeros(2), np.zeros(2))
    squares = np.linalg.eigvals(-((pushed[:2] - pushed[2:]) / (2 * h)).T)
    np.testing.assert_allclose(np.sort(np.sqrt(squares)), closed_form_modes(0.7)[0], rtol=1e-7)


def test_damping_takes_the_energy_that_leaves_the_arm():
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
    lost = energy(np.array([0.5, -0.4]), np.array([1.0, -2.0])) - energy(state[:2], state[2:4])
    assert state[4] > 1 and abs(lost - state[4]) < 1e-8


def weight_energy(q, g=9.81):
    return g * (M1 * C1 * np.sin(q[0]) + M2 * (L1 * np.sin(q[0]) + C2 * np.sin(q[0] + q[1])))


def test_equilibrium_of_an_elastic_arm_is_where_its_energy_is_least():
    dynamics = Dynamics(planar_arm((0, -9.81, 0)))
    found = dynamics.equilibrium(np.array([[0.0, 0.7], [0.3, 0.2]]))
    least = minimize(
        lambda q: 0.5 * K1 * q[0] ** 2 + 0.5 * K2 * (q[1] - 0.7) ** 2 + weight_energy(q), [0, 0.7], tol=1e-14
    ).x
    assert found.stable.all() and not found.efforts.any()
    np.testing.assert_allclose(found.positions, [least, least], atol=1e-6)
    weight = 9.81 * (M1 + M2)
    np.testing.assert_allclose(found.reactions[:, 0, :3], [[0, weight, 0]] * 2, atol=1e-9)


def test_equilibrium_with_a_wrench_leaves_no_acceleration():
    """The direct model, fed with the efforts of the equilibrium, stays where it is: with motors, wrenches, batches."""
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
        found = dynamics.equilibrium(states.q, external_wrenches=states.wrenches)
        rest = np.zeros_like(states.q)
        moved = dynamics.direct(found.positions, rest, found.efforts, external_wrenches=states.wrenches)
        driven = [k for k, joint in enumerate(robot.joints) if joint.actuated]
        assert np.array_equal(found.positions[:, driven], states.q[:, driven])
        scale = np.abs(dynamics.direct(states.q, rest, rest, external_wrenches=states.wrenches)).max()
        assert np.abs(moved).max() < 1e-7 * max(scale, 1)


def test_pendulum_hangs_stable_and_stands_unstable():
    dynamics = Dynamics(planar_arm((0, -9.81, 0), springs=(None, None)))
    standing = [np.pi / 2, 0]
    found = dynamics.equilibrium([[-1.5, 0.1], [1.5, 0.05], [0.0, 0.0], standing])
    hanging = [-np.pi / 2, 0]
    # pushed off to the left it goes down there, and comes to rest where a pendulum hangs
    np.testing.assert_allclose(found.positions, [hanging, hanging, hanging, standing], atol=1e-9)
    assert found.stable.tolist() == [True, True, True, False]


@pytest.mark.parametrize("stiffness", [0.0, 0.01, 1.0, 2.0, 3.0, 9.0, 100.0])
@pytest.mark.parametrize("start", [0.01, 0.0, 0.5, -1.2, 2.0])
def test_elastic_pendulum_comes_to_rest_below_where_it_is_let_go(stiffness, start):
    """The elbow held straight: from where it is let go the energy only falls, to a minimum on the same side."""
    robot = planar_arm((0, -9.81, 0), actuated=(False, True), springs=(Spring(stiffness), None))
    dynamics, weight = Dynamics(robot), 9.81 * (M1 * C1 + M2 * (L1 + C2))

    def energy(q):
        return 0.5 * stiffness * q**2 + weight * np.sin(q)

    found = dynamics.equilibrium([start, 0.0])
    q = found.positions[0]
    assert found.stable and abs(stiffness * q + weight * np.cos(q)) < 1e-6 * weight
    path = energy(np.linspace(start, q, 1000))
    assert np.diff(path).max() < 1e-9 * weight


def test_base_that_moves_is_held_at_its_pose_in_equilibrium_or_moved_on_as_told():
    """Turned upside down the arm hangs from its base; in free fall its springs are at rest."""
    robot = replace(planar_arm((0, -9.81, 0)), moving_base=True)
    dynamics, fixed = Dynamics(robot), Dynamics(planar_arm((0, 9.81, 0)))
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])
    found = dynamics.equilibrium([0, 0.7], base=Base(turned))
    np.testing.assert_allclose(found.positions, fixed.equilibrium([0, 0.7]).positions, atol=1e-9)
    falling = dynamics.equilibrium([0.3, 0.2], base=Base(acceleration=[0, -9.81, 0, 0, 0, 0]))
    np.testing.assert_allclose(falling.positions, [0, 0.7], atol=1e-9)


def test_what_cannot_be_balanced_is_refused():
    slides = Joint("slide", 0, True, np.eye(4), actuated=False)
    frames = (Frame("ground", 0, np.eye(4)), Frame("mass", 1, np.eye(4)))
    links = (Link("ground", Inertia()), Link("mass", Inertia(1.0)))
    dynamics = Dynamics(Robot("falling", links, (slides,), frames))
    with pytest.raises(SingularModelError, match=r"positions of sample 0: a force of 9.81 .* remains at joint 'slide'"):
        dynamics.equilibrium([0.0])
    np.testing.assert_allclose(dynamics.inverse([0.0], [0.0], [0.0]), [0])
    np.testing.assert_allclose(dynamics.direct([0.0], [0.0], [0.0]), [-9.81])


def chain(*links):
    """A chain of links, each {name of a Joint's field: value} and its inertia, placed as told."""
    made, joints, frames = [Link("ground", Inertia())], [], [Frame("ground", 0, np.eye(4))]
    for k, (inertia, fields) in enumerate(links, start=1):
        placed = fields.pop("placed", np.eye(4))
        joints.append(Joint(f"joint_{k}", k - 1, fields.pop("prismatic", False), placed, **fields))
        made.append(Link(f"link_{k}", inertia))
        frames.append(Frame(f"link_{k}", k, np.eye(4)))
    return Robot("chain", tuple(made), tuple(joints), tuple(frames), gravity=(0, -9.81, 0))


UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # z up along y


@pytest.mark.parametrize(("stiffness", "mass"), [(1e8, 1.0), (1e7, 0.1), (1e6, 0.01)])
def test_soft_joint_beside_a_very_stiff_one_finds_its_rest(stiffness, mass):
    """A pendulum on a stiff spring: it hangs, and the spring gives by its weight."""
    rod = Inertia(mass, [0.1 * mass, 0, 0], np.diag([0, 0.01, 0.01]) * mass)
    slide = {"prismatic": True, "actuated": False, "spring": Spring(stiffness), "placed": UP}
    robot = chain((Inertia(), slide), (rod, {"actuated": False, "placed": np.linalg.inv(UP)}))
    found = Dynamics(robot).equilibrium([0, -1.2])
    np.testing.assert_allclose(found.positions, [-9.81 * mass / stiffness, -np.pi / 2], rtol=1e-9)
    assert found.stable


def test_light_mass_that_falls_beside_a_heavy_one_is_no_equilibrium_in_any_sample_of_a_batch():
    fall = {"prismatic": True, "actuated": False, "placed": UP}
    heavy, light = Inertia(1e6, [0, 0, 0], np.eye(3)), Inertia(1e-3)
    dynamics = Dynamics(chain((heavy, {}), (light, fall)))
    with pytest.raises(SingularModelError, match=r"sample 0: a force of 0.00981 .* joint 'joint_2'"):
        dynamics.equilibrium([0, 0])
    level = {"prismatic": True, "actuated": False}  # along z it may rest anywhere: neutral
    found = Dynamics(chain((heavy, {}), (light, level))).equilibrium([0, 0.3])
    assert found.positions[1] == 0.3 and not found.stable
    turned = [[0, 0.1], [0, 0.2], [np.pi / 2, 0.1]]  # the slide is level where joint 1 is at a right angle
    with pytest.raises(SingularModelError, match="sample 0"):
        dynamics.equilibrium(turned)
    with pytest.raises(SingularModelError, match="sample 2"):
        dynamics.equilibrium([[np.pi / 2, 0.1], [np.pi / 2, 0.2], [0, 0.1]])


def test_wrench_that_overflows_is_refused():
    dynamics = Dynamics(planar_arm((0, -9.81, 0)))
    with pytest.raises(InvalidInputError, match="is not a finite number"):
        dynamics.equilibrium([0, 0], external_wrenches={"link_2": [0, 0, 0, 0, 0, 1e155]})


def test_slide_on_a_soft_spring_goes_as_far_as_it_takes():
    far = {"prismatic": True, "actuated": False, "spring": Spring(1000.0, rest=100.0)}
    np.testing.assert_allclose(Dynamics(chain((Inertia(1.0), far))).equilibrium([0.0]).positions, [100], rtol=1e-12)


def test_terms_add_up_to_the_efforts():
    robot = with_random_springs(load_robot("ur5e"), 3)
    dynamics = Dynamics(robot)
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 7, 6))
    qdd[:, [k for k, joint in enumerate(robot.joints) if not joint.actuated]] = 0
    answer = dynamics.solve(q, qd, qdd=qdd)
    terms = dynamics.gravity(q) + dynamics.coriolis(q, qd) + dynamics.friction(qd) + dynamics.elasticity(q, qd)
    inertia = (dynamics.inertia_matrix(q) @ answer.accelerations[..., None])[..., 0]
    np.testing.assert_allclose(inertia + terms, answer.efforts, atol=1e-9)


@pytest.mark.parametrize("what", ["accelerations", "efforts"])
def test_nothing_can_be_given_for_a_joint_without_motor(what):
    dynamics = Dynamics(planar_arm(actuated=(True, False)))
    question = {"qdd" if what == "accelerations" else "efforts": [[1.0, 0.0], [1.0, 2.0]]}
    with pytest.raises(InvalidInputError, match=rf"{what}\[1\] is 2: joint 'joint_2': no motor drives it.*0 or nan"):
        dynamics.solve([0, 0], [0, 0], **question)
    with pytest.raises(InvalidInputError, match=r"accelerations\[0\] at sample 0 is nan"):
        dynamics.inverse([[0, 0]], [0, 0], [[np.nan, np.nan]])
