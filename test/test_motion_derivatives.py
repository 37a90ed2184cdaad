"""Derivatives of the dynamic models agree with Pinocchio, and with differences of the recursions."""

import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from peers.frictions import without_friction
from peers.pinocchio_model import PinocchioModel
from peers.random_loops import random_loops
from peers.random_robots import random_states, random_urdf
from peers.real_robots import real_urdf
from scipy.linalg import expm

from robot_dynamics import Base, Dynamics, InvalidInputError, SingularModelError, load_robot, shipped_robots
from robot_dynamics.model.formats.urdf.reader import read_urdf

TREES = {
    "panda": lambda: shipped_robots()["panda"].read_text(),
    "ur5e": lambda: shipped_robots()["ur5e"].read_text(),
    "random, 8 joints": lambda: random_urdf(5, joints=8),
    "solo12": lambda: real_urdf("solo12"),
    "talos_reduced": lambda: real_urdf("talos_reduced"),
}


def relative_error(actual, expected):
    return np.abs(actual - expected).max(initial=0) / max(np.abs(expected).max(initial=0), 1e-9)


@pytest.mark.reference
@pytest.mark.parametrize(
    ("name", "moving_base"),
    [
        ("panda", False),
        ("ur5e", True),
        ("random, 8 joints", False),
        pytest.param("solo12", True, marks=pytest.mark.slow),
        pytest.param("talos_reduced", False, marks=pytest.mark.slow),
    ],
)
def test_trees_agree_with_pinocchio(name, moving_base):
    urdf = TREES[name]()
    dynamics = Dynamics(without_friction(read_urdf(urdf, moving_base=moving_base)), compiled=False)
    peer = PinocchioModel(urdf, dynamics.all_joint_names, moving_base)
    states = random_states(dynamics.robot, len(dynamics.joint_names), 2, 0)
    motion = states.q[0], states.qd[0], states.qdd[0]
    base, twist, a0, pose = None, (), (), None
    if moving_base:
        pose, twist = states.base_of(0)
        a0 = np.random.default_rng(0).uniform(-1, 1, 6)
        base = Base(pose, twist, a0)
    inverse = dynamics.inverse_derivatives(*motion, base=base)
    expected = peer.inverse_derivatives(*motion, pose, twist, a0)
    for actual, matrix in zip((inverse.positions, inverse.velocities, inverse.accelerations), expected, strict=True):
        assert relative_error(actual, matrix) < 1e-10
    base = Base(pose, twist) if moving_base else None
    direct = dynamics.direct_derivatives(*motion, base=base)
    by_q, by_qd, by_efforts = peer.direct_derivatives(*motion, pose, twist)
    b = 6 if moving_base else 0
    assert relative_error(direct.positions, by_q) < 1e-10
    assert relative_error(direct.velocities, by_qd) < 1e-10
    assert relative_error(direct.efforts, by_efforts[:, b:]) < 1e-10


def differences(function, size, step=1e-3):
    """Derivatives (..., size) of a function of displacements (N, size): central differences, extrapolated twice."""
    steps = [step, step / 2, step / 4]
    displacements = np.concatenate([sign * h * np.eye(size) for h in steps for sign in (1, -1)])
    values = np.split(function(displacements), 6)
    estimates = [(above - below) / (2 * h) for h, above, below in zip(steps, values[::2], values[1::2], strict=True)]
    first, second = ((4 * b - a) / 3 for a, b in pairwise(estimates))
    return np.moveaxis((16 * second - first) / 15, 0, -1)


@pytest.mark.parametrize("name", ["four_bar", "sr400", "manutec_r3", pytest.param("delta", marks=pytest.mark.slow)])
def test_recursions_with_loops_closed_again(name):
    """Of all joints the motors alone are displaced; the closure solver moves the others."""
    dynamics = Dynamics(load_robot(name), compiled=False)
    n = len(dynamics.joint_names)
    rng = np.random.default_rng(1)
    start = dynamics.initial_joint_positions[[dynamics.robot.joint_numbers[joint] for joint in dynamics.joint_names]]
    q = start + 0.05 * rng.uniform(-1, 1, n)
    qd, qdd, efforts = rng.uniform(0.2, 1, (3, n))
    for joint in dynamics.unactuated_joint_names:
        qdd[dynamics.joint_names.index(joint)] = efforts[dynamics.joint_names.index(joint)] = 0
    inverse = dynamics.inverse_derivatives(q, qd, qdd)
    direct = dynamics.direct_derivatives(q, qd, efforts)
    cases = [
        (inverse.positions, lambda d: dynamics.inverse(q + d, qd, qdd)),
        (inverse.velocities, lambda d: dynamics.inverse(q, qd + d, qdd)),
        (direct.positions, lambda d: dynamics.direct(q + d, qd, efforts)),
        (direct.velocities, lambda d: dynamics.direct(q, qd + d, efforts)),
    ]
    for actual, function in cases:
        assert relative_error(actual, differences(function, n)) < 1e-8


def test_wrench_that_holds_a_moving_base_with_loops():
    """Rows of the base are derivatives of the wrench of the ground on it."""
    looped = random_loops(3, loops=1, moving_base=True, elastic=False)
    dynamics = Dynamics(looped.robot, compiled=False)
    n = len(dynamics.joint_names)
    rng = np.random.default_rng(3)
    columns = [dynamics.all_joint_names.index(joint) for joint in dynamics.joint_names]
    qd, qdd = rng.uniform(0.2, 1, (2, n))
    twist, acceleration = rng.uniform(-1, 1, (2, 6))
    derivatives = dynamics.inverse_derivatives(looped.q, qd, qdd, base=Base(twist=twist, acceleration=acceleration))

    def wrenches(dq, dqd, dqdd, dtwist, dacceleration):
        seeds = np.array(np.broadcast_to(looped.q, (len(dq), len(looped.q))))
        seeds[:, columns] += dq
        base = Base(twist=twist + dtwist, acceleration=acceleration + dacceleration)
        return dynamics.solve(seeds, qd + dqd, qdd=qdd + dqdd, base=base).reactions[:, 0]

    size = [n, n, n, 6, 6]
    by_all = differences(lambda d: wrenches(*np.split(d, np.cumsum(size)[:-1], axis=1)), sum(size), 2e-3)
    by_q, by_qd, by_qdd, by_twist, by_acceleration = np.split(by_all, np.cumsum(size)[:-1], axis=1)
    assert relative_error(derivatives.positions[:6, 6:], by_q) < 1e-7
    assert relative_error(derivatives.velocities[:6], np.hstack([by_twist, by_qd])) < 1e-8
    assert relative_error(derivatives.accelerations[:6], np.hstack([by_acceleration, by_qdd])) < 1e-8


def state_rates(dynamics, pose, twist, q, qd, efforts):
    """Rates of the components of the twist of the base, and accelerations of the joints."""
    result = dynamics.solve(q, qd, efforts=efforts, base=Base(pose, twist))
    v, omega = twist[:3], twist[3:]
    acceleration = result.base_acceleration - np.r_[np.cross(omega, v), 0, 0, 0]
    return np.concatenate([acceleration, result.accelerations])


def se3(xi):
    """4 x 4 matrix of a twist [linear; angular]."""
    x, y, z = xi[3:]
    return np.array([[0, -z, y, xi[0]], [z, 0, -x, xi[1]], [-y, x, 0, xi[2]], [0, 0, 0, 0]])


def test_linear_state_space_of_a_moving_base():
    """A and B are derivatives of the rates of the state; the pose is displaced by exponentials in the base frame."""
    dynamics = Dynamics(load_robot("free_flying_arm"), compiled=False)
    rng = np.random.default_rng(4)
    q, qd, efforts = rng.uniform(-1, 1, (3, 6))
    twist = rng.uniform(-1, 1, 6)
    pose = expm(se3(rng.uniform(-2, 2, 6)))
    linear = dynamics.linearize(q, qd, efforts, base=Base(pose, twist))
    assert linear.A.shape == (24, 24) and linear.B.shape == (24, 6)
    assert linear.state_names[0] == "position of base.linear.x" and linear.state_names[-1].startswith("velocity of arm")

    def rates(dx):
        xi, dq, dv, dqd = np.split(dx, [6, 12, 18])
        moved = state_rates(dynamics, pose @ expm(se3(xi)), twist + dv, q + dq, qd + dqd, efforts)
        # ξ̇ of T exp(ξ) against T with twists V + dV and V: to first order, by short motions along both
        h = 1e-5
        ends = [
            np.linalg.inv(pose @ expm(se3(t * twist))) @ pose @ expm(se3(xi)) @ expm(se3(t * (twist + dv)))
            for t in (h, -h)
        ]
        base_rate = (logarithm(ends[0]) - logarithm(ends[1])) / (2 * h)
        return np.concatenate([base_rate, qd + dqd, moved])

    A = differences(lambda dx: np.array([rates(row) for row in dx]), 24)
    assert relative_error(linear.A[6:], A[6:]) < 1e-8
    assert relative_error(linear.A[:6], A[:6]) < 1e-6
    B = differences(lambda du: np.array([state_rates(dynamics, pose, twist, q, qd, efforts + row) for row in du]), 6)
    assert relative_error(linear.B[12:], B) < 1e-9 and not linear.B[:12].any()


def logarithm(T):
    """[linear; angular] (6,) of a homogeneous matrix near 1, to second order."""
    R = T[:3, :3]
    phi = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    return np.concatenate([T[:3, 3] - np.cross(phi, T[:3, 3]) / 2, phi])


def test_elastic_joints_are_part_of_the_state():
    dynamics = Dynamics(load_robot("manutec_r3"))
    linear = dynamics.linearize(np.zeros(9), np.zeros(9), np.zeros(9))
    assert linear.A.shape == (18, 18) and linear.B.shape == (18, 6)
    assert linear.input_names == tuple(
        name for name in dynamics.joint_names if name not in dynamics.unactuated_joint_names
    )
    direct = dynamics.direct_derivatives(np.zeros(9), np.zeros(9), np.zeros(9))
    np.testing.assert_allclose(direct.efforts, np.linalg.inv(dynamics.inertia_matrix(np.zeros(9))), atol=1e-12)
    np.testing.assert_array_equal(linear.A[9:, :9], direct.positions)


def test_derivatives_by_friction_and_rotor_inertia_are_columns_of_the_regressor():
    robot = load_robot("puma560")
    rng = np.random.default_rng(0)
    state = rng.uniform(-1, 1, (3, 6))
    dynamics = Dynamics(robot, compiled=False)
    Y = dynamics.regressor(*state)
    for field, label in (("rotor_inertia", "Ia"), ("viscous_friction", "Fv"), ("coulomb_friction", "Fs")):
        joint = robot.joints[2]
        changed = replace(joint, **{field: getattr(joint, field) + 1.0})
        other = Dynamics(replace(robot, joints=(*robot.joints[:2], changed, *robot.joints[3:])), compiled=False)
        difference = other.inverse(*state) - dynamics.inverse(*state)
        column = dynamics.parameter_names.index(f"{label}.{joint.name}")
        np.testing.assert_allclose(Y[:, column], difference, atol=1e-12)


def test_batches_and_programs_in_python():
    """A batch has the derivatives of its samples; programs run as Python give the same."""
    compiled, plain = Dynamics(load_robot("four_bar")), Dynamics(load_robot("four_bar"), compiled=False)
    q = compiled.initial_joint_positions[0] + np.linspace(-0.1, 0.1, 6).reshape(3, 2, 1)
    batch = compiled.direct_derivatives(q, [0.3], [1.0])
    assert batch.positions.shape == (3, 2, 1, 1) and batch.base_acceleration is None
    other = plain.direct_derivatives(q, [0.3], [1.0])
    one = plain.direct_derivatives(q[2, 1], [0.3], [1.0])
    for name in ("positions", "velocities", "efforts"):
        np.testing.assert_allclose(getattr(batch, name), getattr(other, name), rtol=1e-11)
        np.testing.assert_allclose(getattr(batch, name)[2, 1], getattr(one, name), rtol=1e-11)
    closed = compiled.expand_positions(q[0, 0])
    np.testing.assert_allclose(
        compiled.direct_derivatives(closed, [0.3], [1.0]).positions, batch.positions[0, 0], rtol=1e-9
    )
    assert compiled.linearize(np.zeros((0, 1)), [0.3], [1.0]).A.shape == (0, 2, 2)


@pytest.mark.parametrize("name", ["four_bar", "ur5e"])
def test_calls_of_one_sample_change_to_checks_in_machine_code(name):
    pytest.importorskip("llvmlite")
    dynamics = Dynamics(load_robot(name))
    n = len(dynamics.joint_names)
    state = dynamics.initial_joint_positions[:n] + 0.1, np.full(n, 0.2), np.full(n, 0.3)
    results = {}
    for model in ("inverse_derivatives", "direct_derivatives"):
        results[model] = getattr(dynamics, model)(*state)
    deadline = time.monotonic() + 120
    while len(dynamics._attempts) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    for model, before in results.items():
        assert dynamics._attempt(model, *state) is not None
        after = getattr(dynamics, model)(*state)
        for key, values in vars(before).items():
            if values is not None:
                np.testing.assert_allclose(getattr(after, key), values, rtol=1e-9, atol=1e-12)
        with pytest.raises(InvalidInputError, match="velocities"):
            getattr(dynamics, model)(state[0], state[1] * np.nan, state[2])


def test_arguments_are_checked_and_singular_states_refused():
    dynamics = Dynamics(load_robot("ur5e"), compiled=False)
    zeros = np.zeros(6)
    with pytest.raises(InvalidInputError, match="velocities has shape"):
        dynamics.inverse_derivatives(zeros, np.zeros(5), zeros)
    with pytest.raises(InvalidInputError, match="is fixed"):
        dynamics.linearize(zeros, zeros, zeros, base=Base())
    with pytest.raises(InvalidInputError, match="unknown link"):
        dynamics.direct_derivatives(zeros, zeros, zeros, external_wrenches={"nowhere": zeros})
    with pytest.raises(InvalidInputError, match="mapping"):
        dynamics.direct_derivatives(zeros, zeros, zeros, external_wrenches=[zeros])
    flying = Dynamics(load_robot("free_flying_arm"), compiled=False)
    with pytest.raises(InvalidInputError, match="acceleration of the base"):
        flying.linearize(zeros, zeros, zeros, base=Base(acceleration=zeros))
    robot = load_robot("ur5e")
    massless = replace(robot.links[-1], inertia=type(robot.links[-1].inertia)())
    with pytest.raises(SingularModelError):
        Dynamics(replace(robot, links=(*robot.links[:-1], massless)), compiled=False).direct_derivatives(
            zeros, zeros, zeros
        )
