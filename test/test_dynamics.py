"""Class Dynamics: laws of mechanics, closed forms, shapes, invalid arguments."""

from dataclasses import replace

import numpy as np
import pytest
from peers.random_robots import random_states, random_urdf
from peers.real_robots import real_urdf
from scipy.spatial.transform import Rotation

from robot_dynamics import Base, Dynamics, Inertia, InvalidInputError, SingularModelError
from robot_dynamics.model.formats.urdf.reader import read_urdf

ROBOTS = {"panda": False, "ur5": False, "tiago": False, "talos": True, "anymal_c": True, "borinot": True}


@pytest.fixture(scope="module")
def panda():
    return Dynamics(read_urdf(real_urdf("panda")))


def tree(seed, moving_base=False, joints=None):
    return Dynamics(read_urdf(random_urdf(seed, joints), moving_base=moving_base))


def states_of(dynamics, count=20, seed=11):
    return random_states(dynamics.robot, len(dynamics.joint_names), count, seed)


@pytest.fixture(params=[*ROBOTS, *range(6)], ids=str)
def any_robot(request):
    if request.param in ROBOTS:
        return Dynamics(read_urdf(real_urdf(request.param), moving_base=ROBOTS[request.param]))
    return tree(request.param, moving_base=request.param % 2 == 1)


def test_direct_model_inverts_the_inverse_model(any_robot):
    states = states_of(any_robot)
    options = {"base": states.base, "external_wrenches": states.wrenches}
    inverse = any_robot.solve(states.q, states.qd, qdd=states.qdd, **options)
    direct = any_robot.solve(states.q, states.qd, efforts=inverse.efforts, **options)
    scale = np.linalg.cond(any_robot.inertia_matrix(states.q)).max()
    np.testing.assert_allclose(direct.accelerations, states.qdd, rtol=0, atol=1e-13 * max(scale, 1e4))
    np.testing.assert_allclose(
        direct.reactions, inverse.reactions, rtol=0, atol=1e-13 * max(scale, 1e4) * np.abs(inverse.reactions).max()
    )
    if states.base is not None:
        np.testing.assert_allclose(direct.base_acceleration, inverse.base_acceleration, rtol=1e-7, atol=1e-7)
        # nothing holds the base
        np.testing.assert_allclose(inverse.reactions[:, 0] / np.abs(inverse.reactions).max(), 0, atol=1e-11)


def test_inertia_matrix_is_symmetric_positive_definite(any_robot):
    A = any_robot.inertia_matrix(states_of(any_robot).q)
    np.testing.assert_allclose(A, np.swapaxes(A, -1, -2), rtol=0, atol=1e-12 * np.abs(A).max())
    assert np.linalg.eigvalsh(A).min() > 0


def test_efforts_are_the_sum_of_their_terms(any_robot):
    """Γ = A q̈ + C q̇ + g + friction - Jᵀ wrenches; here without wrenches, and with a prescribed base acceleration."""
    states = states_of(any_robot)
    base = None
    motion = states.qdd
    if states.base is not None:
        base_acceleration = np.random.default_rng(0).uniform(-2, 2, (len(motion), 6))
        base, motion = (
            Base(states.base.pose, states.base.twist, base_acceleration),
            np.concatenate([base_acceleration, motion], axis=-1),
        )
    terms = (
        (any_robot.inertia_matrix(states.q) @ motion[..., None])[..., 0]
        + any_robot.coriolis(states.q, states.qd, base=states.base)
        + any_robot.gravity(states.q, base=states.base)
    )
    result = any_robot.solve(states.q, states.qd, qdd=states.qdd, base=base)
    efforts = terms[..., -len(any_robot.joint_names) :] + any_robot.friction(states.qd)
    np.testing.assert_allclose(result.efforts, efforts, rtol=0, atol=1e-11 * np.abs(efforts).max())
    if base is not None:
        np.testing.assert_allclose(result.reactions[:, 0], terms[:, :6], rtol=0, atol=1e-11 * np.abs(terms).max())


def matrix_rate(dynamics, q, qd, step=1e-5):
    """Ȧ by central differences of fourth order."""
    A = [dynamics.inertia_matrix(q + k * step * qd) for k in (-2, -1, 1, 2)]
    return (A[0] - 8 * A[1] + 8 * A[2] - A[3]) / (12 * step)


def test_coriolis_term_does_no_work_beyond_the_change_of_inertia(any_robot):
    """q̇ᵀ(Ȧ - 2C)q̇ = 0. With a moving base the velocity is ν = [V0; q̇] and, because accelerations are classical,
    C ν holds A [ω0 × v0; 0] less than in body coordinates."""
    states = states_of(any_robot)
    velocity, inertial = states.qd, 0
    A = any_robot.inertia_matrix(states.q)
    if states.base is not None:
        velocity = np.concatenate([states.base.twist, states.qd], axis=-1)
        inertial = np.zeros_like(velocity)
        inertial[:, :3] = np.cross(states.base.twist[:, 3:], states.base.twist[:, :3])
        inertial = (A @ inertial[..., None])[..., 0]
    coriolis = any_robot.coriolis(states.q, states.qd, base=states.base) + inertial
    rate = matrix_rate(any_robot, states.q, states.qd)
    power = np.einsum("ki,kij,kj->k", velocity, rate, velocity) - 2 * np.einsum("ki,ki->k", velocity, coriolis)
    scale = np.einsum("ki,kij,kj->k", np.abs(velocity), np.abs(rate), np.abs(velocity))
    assert np.abs(power / scale).max() < 1e-8


@pytest.mark.parametrize("seed", range(1, 8, 2))
def test_momentum_of_a_free_robot_without_weight_is_conserved(seed):
    """For any joint motion, ṗ = 0 and L̇ = 0 in the world, by the resulting accelerations."""
    dynamics = tree(seed, moving_base=True)
    dynamics = Dynamics(replace(dynamics.robot, gravity=(0, 0, 0)))
    states = states_of(dynamics)
    efforts = np.random.default_rng(seed).uniform(-10, 10, states.q.shape)
    result = dynamics.solve(states.q, states.qd, efforts=efforts, base=states.base)
    v, w = states.base.twist[:, :3], states.base.twist[:, 3:]
    velocity = np.concatenate([states.base.twist, states.qd], axis=-1)
    change = np.concatenate([result.base_acceleration, result.accelerations], axis=-1)
    change[:, :3] -= np.cross(w, v)  # rate of the components in the turning frame
    A, rate = dynamics.inertia_matrix(states.q), matrix_rate(dynamics, states.q, states.qd, step=1e-6)
    momentum = (A @ velocity[..., None])[:, :6, 0]
    momentum_rate = (A @ change[..., None] + rate @ velocity[..., None])[:, :6, 0]
    p, L = momentum[:, :3], momentum[:, 3:]
    p_world = momentum_rate[:, :3] + np.cross(w, p)
    L_world = momentum_rate[:, 3:] + np.cross(w, L) + np.cross(v, p)
    scale = np.abs(A @ np.abs(change)[..., None]).max()
    assert np.abs(p_world).max() < 1e-7 * scale and np.abs(L_world).max() < 1e-7 * scale


def test_free_robot_falls_with_gravity():
    dynamics = tree(3, moving_base=True)
    states = states_of(dynamics)
    base_at_rest = Base(states.base.pose)
    result = dynamics.solve(states.q, 0 * states.q, efforts=0 * states.q, base=base_at_rest)
    expected = np.swapaxes(states.base.pose[:, :3, :3], -1, -2) @ [0, 0, -9.81]
    np.testing.assert_allclose(result.base_acceleration[:, :3], expected, atol=1e-7)
    np.testing.assert_allclose(result.base_acceleration[:, 3:], 0, atol=1e-7)
    np.testing.assert_allclose(result.accelerations, 0, atol=1e-6)


def test_weight_at_the_tip_raises_the_holding_torque(panda):
    """By m g times the lever where the forearm is level, and as a payload of the same mass in general."""
    q = np.zeros(8)
    q[3] = -np.pi / 2  # the forearm points forward, level; joint 4 carries it
    mass, rest = 3.0, np.zeros(8)
    pose = panda.link_pose("panda_link8", q)
    weight = np.r_[pose[:3, :3].T @ [0, 0, -9.81 * mass], 0, 0, 0]
    empty = panda.inverse(q, rest, rest)
    loaded = panda.inverse(q, rest, rest, external_wrenches={"panda_link8": weight})
    payload = Dynamics(panda.robot.with_payload("panda_link8", Inertia(mass))).inverse(q, rest, rest)
    np.testing.assert_allclose(loaded, payload, atol=1e-12)
    assert abs(loaded[3]) > abs(empty[3])
    elbow = panda.link_pose("panda_link4", q)
    lever = np.cross(pose[:3, 3] - elbow[:3, 3], [0, 0, -9.81 * mass]) @ elbow[:3, 2]
    assert loaded[3] - empty[3] == pytest.approx(-lever)


PENDULUM = """<robot name="pendulum"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.5"/>
  <mass value="2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.05"/></inertial></link>
  <joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
  <dynamics damping="0.3" friction="0.4"/></joint></robot>"""


def test_pendulum_in_closed_form():
    """Γ = (I + m l²) q̈ + m g l sin q + Fv q̇ + Fs sign q̇."""
    q, qd, qdd = np.random.default_rng(2).uniform(-3, 3, (3, 50, 1))
    expected = (0.2 + 2 * 0.25) * qdd + 2 * 9.81 * 0.5 * np.sin(q) + 0.3 * qd + 0.4 * np.sign(qd)
    dynamics = Dynamics(read_urdf(PENDULUM))
    np.testing.assert_allclose(dynamics.inverse(q, qd, qdd), expected, rtol=1e-13)
    np.testing.assert_allclose(dynamics.direct(q, qd, expected), qdd, rtol=1e-12)


def test_rotor_inertia_adds_to_its_own_joint_alone(panda):
    Ia = np.arange(1.0, 10.0)
    joints = [replace(joint, rotor_inertia=inertia) for joint, inertia in zip(panda.robot.joints, Ia, strict=True)]
    geared = Dynamics(replace(panda.robot, joints=tuple(joints)))
    states = states_of(panda)
    added = geared.inertia_matrix(states.q) - panda.inertia_matrix(states.q)
    # the last two joints are the fingers, which move as one
    np.testing.assert_allclose(added, np.broadcast_to(np.diag([*Ia[:7], Ia[7] + Ia[8]]), added.shape), atol=1e-12)
    torque = geared.inverse(states.q, states.qd, states.qdd)
    np.testing.assert_allclose(geared.direct(states.q, states.qd, torque), states.qdd, atol=1e-9)


def test_reactions_at_rest_carry_the_weight_beyond_the_joint(panda):
    """The ground carries the whole weight, and each joint the weight beyond it."""
    q, rest = states_of(panda, 1).q[0], np.zeros(8)
    result = panda.solve(q, rest, qdd=rest)
    masses = [link.inertia.mass for link in panda.robot.links]
    np.testing.assert_allclose(result.reactions[0, :3], [0, 0, 9.81 * sum(masses)], atol=1e-10)
    for number in range(1, 10):
        link = panda.robot.links[number].name
        R = panda.link_pose(link, q)[:3, :3]
        beyond = masses[number:] if number <= 7 else masses[number : number + 1]
        np.testing.assert_allclose(R @ result.reactions[number, :3], [0, 0, 9.81 * sum(beyond)], atol=1e-10)
        axis = R @ np.array([0, 0, 1.0]) if number <= 7 else None
        if axis is not None:
            assert (R @ result.reactions[number, 3:]) @ axis == pytest.approx(result.efforts[number - 1], abs=1e-10)


def test_wrench_on_a_fixed_frame_acts_at_its_own_origin_and_axes(panda):
    """The hand is lumped into link 7: a wrench on it does the work of its own velocity."""
    states = states_of(panda, 5)
    step = 1e-6
    for q in states.q:
        wrench = np.array([1.0, -2, 3, 0.5, 0.7, -0.2])
        effort_change = panda.inverse(q, 0 * q, 0 * q) - panda.inverse(
            q, 0 * q, 0 * q, external_wrenches={"panda_hand": wrench}
        )
        pose = panda.link_pose("panda_hand", q)
        for k in range(7):
            dq = np.eye(8)[k] * step
            ahead, behind = panda.link_pose("panda_hand", q + dq), panda.link_pose("panda_hand", q - dq)
            v = pose[:3, :3].T @ (ahead[:3, 3] - behind[:3, 3]) / (2 * step)
            turn = Rotation.from_matrix(behind[:3, :3].T @ ahead[:3, :3]).as_rotvec() / (2 * step)
            w = pose[:3, :3].T @ behind[:3, :3] @ turn
            assert effort_change[k] == pytest.approx(wrench @ np.r_[v, w], abs=1e-7)


def test_batch_agrees_with_single_samples(any_robot):
    states = states_of(any_robot, 4)
    batch = any_robot.solve(states.q, states.qd, qdd=states.qdd, base=states.base, external_wrenches=states.wrenches)
    shaped = any_robot.inverse(
        *(a.reshape(2, 2, -1) for a in (states.q, states.qd, states.qdd)), base=_reshaped(states)
    )
    for k in range(4):
        base = None if states.base is None else Base(states.base.pose[k], states.base.twist[k])
        single = any_robot.solve(
            states.q[k], states.qd[k], qdd=states.qdd[k], base=base, external_wrenches=states.wrenches_of(k)
        )
        np.testing.assert_allclose(single.efforts, batch.efforts[k], rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(single.reactions, batch.reactions[k], rtol=1e-9, atol=1e-8)
        plain = any_robot.inverse(states.q[k], states.qd[k], states.qdd[k], base=base)
        np.testing.assert_allclose(shaped[k // 2, k % 2], plain, rtol=1e-10, atol=1e-10)


def _reshaped(states):
    if states.base is None:
        return None
    return Base(states.base.pose.reshape(2, 2, 4, 4), states.base.twist.reshape(2, 2, 6))


def test_single_sample_broadcasts_to_a_batch(panda):
    q, qd = np.zeros((5, 8)), np.ones(8)
    result = panda.solve(q, qd, qdd=np.zeros(8), external_wrenches={"panda_link8": np.ones((5, 6))})
    assert (
        result.efforts.shape == (5, 8) and result.accelerations.shape == (5, 8) and result.reactions.shape == (5, 10, 6)
    )
    assert panda.gravity(np.zeros(8)).shape == (8,) and panda.inertia_matrix(q).shape == (5, 8, 8)
    empty = panda.inverse(np.zeros((0, 8)), np.zeros((0, 8)), np.zeros((0, 8)))
    assert empty.shape == (0, 8)


def test_arguments_are_not_changed_and_results_share_no_memory(panda):
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 4, 8))
    originals = q.copy(), qd.copy(), qdd.copy()
    result = panda.solve(q, qd, qdd=qdd)
    result.accelerations[:] = 0
    result.efforts[:] = 0
    assert all(np.array_equal(a, b) for a, b in zip((q, qd, qdd), originals, strict=True))


def test_robot_without_joints_is_a_free_rigid_body():
    dynamics = Dynamics(read_urdf(real_urdf("hector"), moving_base=True))
    empty = np.zeros((3, 0))
    base = Base(np.eye(4), np.zeros((3, 6)))
    result = dynamics.solve(
        empty, empty, efforts=empty, base=base, external_wrenches={"base_link": [0, 0, 50, 0, 0, 0]}
    )
    assert result.accelerations.shape == (3, 0)
    mass = dynamics.robot.links[0].inertia.mass
    offset = dynamics.robot.links[0].inertia.first_moments[:2] / mass
    assert np.abs(offset).max() < 1e-9, "the push goes through the centre of mass"
    np.testing.assert_allclose(result.base_acceleration, [[0, 0, 50 / mass - 9.81, 0, 0, 0]] * 3, atol=1e-12)


HOLLOW = """<robot name="hollow"><link name="base"/><link name="a">{}</link><link name="b">{}</link>
  <joint name="first" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
  <joint name="second" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>"""
SOLID = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


@pytest.mark.parametrize(("a", "b", "joint"), [(SOLID, "", "second"), ("", SOLID, "first")], ids=["leaf", "collinear"])
def test_direct_model_is_refused_where_nothing_resists_a_joint(a, b, joint):
    dynamics = Dynamics(read_urdf(HOLLOW.format(a, b)))
    assert np.isfinite(dynamics.inverse([0.3, 0.2], [1, 1], [1, 1])).all()
    with pytest.raises(SingularModelError, match=f"'{joint}'"):
        dynamics.direct([0.3, 0.2], [1, 1], [1, 1])
    with pytest.raises(SingularModelError, match=f"'{joint}'"):
        dynamics.direct(np.zeros((7, 2)), [1, 1], [1, 1])


def test_direct_model_of_coupled_joints_without_inertia_is_refused():
    text = HOLLOW.format("", "").replace("</joint></robot>", '<mimic joint="first"/></joint></robot>')
    with pytest.raises(SingularModelError, match="first"):
        Dynamics(read_urdf(text)).direct([0.0], [0.0], [1.0])


def test_moving_base_without_mass_is_refused():
    dynamics = Dynamics(read_urdf(HOLLOW.format("", ""), moving_base=True))
    with pytest.raises(SingularModelError, match=r"base\.linear|first|second"):
        dynamics.direct([0, 0], [0, 0], [0, 0], base=Base())
    with pytest.raises(SingularModelError, match=r"base\.linear"):
        dynamics.inverse([0, 0], [0, 0], [0, 0], base=Base())


Q = np.zeros(8)


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        (lambda d: d.inverse(Q[:6], Q, Q), r"positions has shape \(6,\): \(\.\.\., 8\) is needed.*panda_joint1"),
        (lambda d: d.inverse(Q, 3.0, Q), "velocities has shape"),
        (lambda d: d.inverse(Q, Q, ["a"] * 8), "accelerations: an array of numbers"),
        (lambda d: d.inverse(Q, Q, [[1], [1, 2]]), "accelerations: an array of numbers"),
        (lambda d: d.inverse(np.where(np.arange(8) == 3, np.nan, 0), Q, Q), r"positions\[3\] is nan"),
        (lambda d: d.direct(Q, Q, np.full((2, 8), np.inf)), r"efforts\[0\] at sample 0 is inf"),
        (lambda d: d.inverse(np.zeros((3, 8)), np.zeros((2, 8)), Q), "batches of"),
        (lambda d: d.inverse(Q, Q, Q, external_wrenches={"panda_link9": np.zeros(6)}), "unknown link 'panda_link9'"),
        (lambda d: d.inverse(Q, Q, Q, external_wrenches={"panda_link8": np.zeros(3)}), "'panda_link8' has shape"),
        (lambda d: d.inverse(Q, Q, Q, external_wrenches={"panda_link8": [np.nan] * 6}), "'panda_link8'.* is nan"),
        (lambda d: d.inverse(Q, Q, Q, base=Base()), "base .* is fixed"),
        (lambda d: d.solve(Q, Q), "one of the two"),
        (lambda d: d.solve(Q, Q, qdd=Q, efforts=Q), "one of the two"),
        (lambda d: d.gravity(Q[:3]), "positions has shape"),
        (lambda d: d.coriolis(Q, Q[:3]), "velocities has shape"),
        (lambda d: d.inertia_matrix([np.nan] * 8), "positions"),
        (lambda d: d.friction(Q[:1]), "velocities"),
        (lambda d: Dynamics("panda"), "takes a Robot, as load_robot returns it, not 'panda'"),
        (lambda d: d.link_pose("nowhere", Q), "unknown link 'nowhere'"),
        (lambda d: d.link_pose("panda_hand", Q, base=Base()), "is fixed"),
        (lambda d: d.expand_positions(Q[:5]), "positions has shape"),
        (lambda d: d.embed_efforts(Q[:5]), "efforts has shape"),
        (lambda d: d.project_efforts(Q), r"efforts has shape \(8,\): \(\.\.\., 9\)"),
        (lambda d: d.inverse([10**400, *Q[1:]], Q, Q), "positions: an array of numbers"),
        (lambda d: d.inverse(Q + 1j, Q, Q), "positions: an array of numbers"),
        (lambda d: d.inverse(["1"] * 8, Q, Q), "positions: an array of numbers"),
        (lambda d: d.inverse(np.ma.masked_equal(np.arange(8.0), 3), Q, Q), r"positions\[3\] is nan"),
        (lambda d: d.inverse(Q, Q, Q, external_wrenches=[("panda_link8", np.ones(6))]), "a mapping"),
        (lambda d: d.inverse(Q, Q + 1e200, Q), "the result is not a finite number"),
        (lambda d: d.direct(np.zeros((2, 8)), Q, [[0] * 8, [1e308] * 8]), "the result.* is not a finite number"),
        (lambda d: d.coriolis(np.zeros((2, 8)), [[0] * 8, [1e200] * 8]), "result at sample 1 is not a finite"),
    ],
)
def test_invalid_argument_is_refused_with_a_reason(panda, call, reason):
    with pytest.raises(InvalidInputError, match=reason):
        call(panda)


def test_acceleration_of_the_base_is_refused_in_the_terms():
    dynamics = tree(1, moving_base=True)
    zero = np.zeros(len(dynamics.joint_names))
    for term in (lambda base: dynamics.gravity(zero, base=base), lambda base: dynamics.coriolis(zero, zero, base=base)):
        with pytest.raises(InvalidInputError, match="has no part in this term"):
            term(Base(acceleration=np.zeros(6)))


@pytest.mark.parametrize(
    ("base", "reason"),
    [
        (None, "the base of .* moves: give its state"),
        (Base(twist=[0, 0, 0]), "twist of the base has shape"),
        (Base(pose=np.eye(3)), "pose of the base has shape"),
        (Base(pose=np.diag([2, 1, 1, 1])), "not a homogeneous matrix"),
        (Base(pose=np.diag([1, 1, -1, 1])), "not a homogeneous matrix"),
        (Base(pose=np.diag([1, 1, 1, 2])), "not a homogeneous matrix"),
        (np.eye(4), "not ndarray"),
        (Base(pose=np.full((4, 4), np.nan)), "pose of the base"),
        (Base(acceleration=[np.nan] * 6), "acceleration of the base"),
    ],
)
def test_invalid_state_of_the_base_is_refused(base, reason):
    dynamics = tree(1, moving_base=True)
    zero = np.zeros(len(dynamics.joint_names))
    with pytest.raises(InvalidInputError, match=reason):
        dynamics.inverse(zero, zero, zero, base=base)
