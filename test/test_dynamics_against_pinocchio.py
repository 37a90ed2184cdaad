"""Inverse and direct model, A, gravity, Coriolis and base acceleration agree with Pinocchio to 1e-9 (relative,
max-norm), on real robots and on random trees, base fixed and moving, with wrenches on random links and with rotor
inertia."""

from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from peers.pinocchio_model import PinocchioModel
from peers.random_robots import random_states, random_urdf
from peers.real_robots import REAL_ROBOTS, real_urdf

from robot_dynamics import Base, Dynamics
from robot_dynamics.model.formats.urdf.reader import read_urdf

STATES = 20
TOLERANCE = 1e-9


def relative_error(actual, expected):
    scale = np.abs(expected).max(initial=0)
    return np.abs(actual - expected).max(initial=0) / (scale if scale > 1e-9 else 1)


def independent_joints(urdf, joints):
    """S of q_all = S q + offset from the <mimic> elements of the text, for one level of mimicry."""
    mimics = {
        joint.get("name"): joint.find("mimic").attrib
        for joint in ElementTree.fromstring(urdf).findall("joint")
        if joint.find("mimic") is not None and joint.get("type") != "fixed"
    }
    free = [name for name in joints if name not in mimics]
    S, offset = np.zeros((len(joints), len(free))), np.zeros(len(joints))
    for row, name in enumerate(joints):
        mimic = mimics.get(name, {"joint": name})
        S[row, free.index(mimic["joint"])] = float(mimic.get("multiplier", 1))
        offset[row] = float(mimic.get("offset", 0))
    return S, offset


def check_against_pinocchio(urdf, moving_base, seed, rotor_inertias=None):
    robot = read_urdf(urdf, moving_base=moving_base)
    if rotor_inertias is not None:
        joints = [replace(joint, rotor_inertia=Ia) for joint, Ia in zip(robot.joints, rotor_inertias, strict=True)]
        robot = replace(robot, joints=tuple(joints))
    dynamics = Dynamics(robot)
    peer = PinocchioModel(urdf, dynamics.all_joint_names, moving_base, rotor_inertias)
    S, offset = independent_joints(urdf, dynamics.all_joint_names)
    b = 6 if moving_base else 0
    T = np.eye(b + S.shape[0], b + S.shape[1])  # rows of all joints from rows of the independent ones
    T[b:, b:] = S

    states = random_states(robot, len(dynamics.joint_names), STATES, seed)
    options = {"base": states.base, "external_wrenches": states.wrenches}
    friction = dynamics.friction(states.qd)
    inverse = dynamics.solve(states.q, states.qd, qdd=states.qdd, **options)
    A = dynamics.inertia_matrix(states.q)
    gravity = dynamics.gravity(states.q, base=states.base)
    coriolis = dynamics.coriolis(states.q, states.qd, base=states.base)
    efforts = inverse.efforts + np.random.default_rng(seed).uniform(-1, 1, inverse.efforts.shape)
    direct = dynamics.solve(states.q, states.qd, efforts=efforts, **options)

    for k in range(STATES):
        q, qd, (pose, twist), wrenches = (
            S @ states.q[k] + offset,
            S @ states.qd[k],
            states.base_of(k),
            states.wrenches_of(k),
        )
        expected = SimpleNamespace(
            A=T.T @ peer.inertia_matrix(q) @ T,
            H=T.T @ peer.bias(q, qd, pose, twist, wrenches),
            gravity=T.T @ peer.gravity(q, pose),
            coriolis=T.T @ peer.coriolis(q, qd, twist),
        )
        assert relative_error(A[k], expected.A) < TOLERANCE
        assert relative_error(gravity[k], expected.gravity) < TOLERANCE
        assert relative_error(coriolis[k], expected.coriolis) < TOLERANCE

        # inverse model: the rows of a free base are zero, which gives its acceleration
        A_k, H_k, qdd = expected.A, expected.H, states.qdd[k]
        base_acceleration = -np.linalg.solve(A_k[:b, :b], H_k[:b] + A_k[:b, b:] @ qdd)
        forces = A_k[b:, :b] @ base_acceleration + A_k[b:, b:] @ qdd + H_k[b:]
        assert relative_error(inverse.efforts[k] - friction[k], forces) < TOLERANCE
        if moving_base:
            assert relative_error(inverse.base_acceleration[k], base_acceleration) < TOLERANCE

        # direct model: the articulated-body algorithm, or the projected matrix where joints depend on others
        condition = np.linalg.cond(A_k) if A_k.size else 1
        net_efforts = efforts[k] - friction[k]
        if S.shape[0] == S.shape[1]:
            qdd, base_acceleration = peer.direct(q, qd, net_efforts, pose, twist, wrenches)
        else:
            solution = np.linalg.solve(A_k, np.r_[np.zeros(b), net_efforts] - H_k)
            base_acceleration, qdd = solution[:b], solution[b:]
        tolerance = TOLERANCE * max(1, condition / 1e5)
        assert relative_error(direct.accelerations[k], qdd) < tolerance
        if moving_base:
            assert relative_error(direct.base_acceleration[k], base_acceleration) < tolerance


@pytest.mark.parametrize("moving_base", [False, True], ids=["fixed", "moving"])
@pytest.mark.parametrize("name", REAL_ROBOTS)
def test_real_robot_agrees_with_pinocchio(name, moving_base):
    check_against_pinocchio(real_urdf(name), moving_base, seed=7)


@pytest.mark.parametrize("moving_base", [False, True], ids=["fixed", "moving"])
@pytest.mark.parametrize("seed", range(200))
def test_random_tree_agrees_with_pinocchio(seed, moving_base):
    check_against_pinocchio(random_urdf(seed), moving_base, seed)


@pytest.mark.parametrize("name", ["ur5", "talos_reduced"])
def test_rotor_inertia_agrees_with_pinocchio_armature(name):
    urdf = real_urdf(name)
    joints = len(read_urdf(urdf).joints)
    check_against_pinocchio(urdf, False, seed=3, rotor_inertias=np.random.default_rng(3).uniform(0.01, 2, joints))


@pytest.mark.parametrize("moving_base", [False, True], ids=["fixed", "moving"])
@pytest.mark.parametrize("robot", ["panda", "talos", "anymal_c", *range(20)])
def test_reactions_and_link_poses_agree_with_pinocchio(robot, moving_base):
    urdf = random_urdf(robot) if isinstance(robot, int) else real_urdf(robot)
    model = read_urdf(urdf, moving_base=moving_base)
    dynamics = Dynamics(model)
    peer = PinocchioModel(urdf, dynamics.all_joint_names, moving_base)
    S, offset = independent_joints(urdf, dynamics.all_joint_names)
    states = random_states(model, S.shape[1], 5, seed=9)
    result = dynamics.solve(states.q, states.qd, qdd=states.qdd, base=states.base, external_wrenches=states.wrenches)
    links = [link.name for link in model.links[1:]]
    poses = {frame.name: dynamics.link_pose(frame.name, states.q, base=states.base) for frame in model.frames}
    for k in range(5):
        q, qd, qdd, (pose, twist) = S @ states.q[k] + offset, S @ states.qd[k], S @ states.qdd[k], states.base_of(k)
        base = () if result.base_acceleration is None else result.base_acceleration[k]
        expected = peer.reactions(q, qd, qdd, links, pose, twist, base, states.wrenches_of(k))
        assert relative_error(result.reactions[k, 1:], expected) < TOLERANCE
        for name, actual_poses in poses.items():
            np.testing.assert_allclose(actual_poses[k], peer.link_pose(name, q, pose), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["panda", "talos"])
def test_dependent_joints_on_a_prescribed_base_agree_with_pinocchio(name):
    urdf = real_urdf(name)
    robot = read_urdf(urdf, moving_base=True)
    dynamics = Dynamics(robot)
    peer = PinocchioModel(urdf, dynamics.all_joint_names, True)
    S, offset = independent_joints(urdf, dynamics.all_joint_names)
    states = random_states(robot, S.shape[1], STATES, seed=6)
    base_accelerations = np.random.default_rng(6).uniform(-3, 3, (STATES, 6))
    base = Base(states.base.pose, states.base.twist, base_accelerations)
    result = dynamics.solve(states.q, states.qd, qdd=states.qdd, base=base, external_wrenches=states.wrenches)
    direct = dynamics.direct(states.q, states.qd, result.efforts, base=base, external_wrenches=states.wrenches)
    for k in range(STATES):
        q, qd = S @ states.q[k] + offset, S @ states.qd[k]
        A, H = peer.inertia_matrix(q), peer.bias(q, qd, *states.base_of(k), states.wrenches_of(k))
        rows = A @ np.r_[base_accelerations[k], S @ states.qdd[k]] + H
        assert relative_error(result.reactions[k, 0], rows[:6]) < TOLERANCE
        assert relative_error(result.efforts[k] - dynamics.friction(states.qd[k]), S.T @ rows[6:]) < TOLERANCE
        assert relative_error(direct[k], states.qdd[k]) < TOLERANCE * max(1, np.linalg.cond(A) / 1e5)


def test_prescribed_base_acceleration_is_kept_and_its_wrench_is_the_first_reaction():
    """The wrench on a prescribed base agrees with the first six rows of Pinocchio's rnea."""
    urdf = real_urdf("anymal_c")
    robot = read_urdf(urdf, moving_base=True)
    dynamics, states = Dynamics(robot), random_states(robot, len(robot.joints), STATES, seed=5)
    base_accelerations = np.random.default_rng(5).uniform(-3, 3, (STATES, 6))
    base = Base(states.base.pose, states.base.twist, base_accelerations)
    result = dynamics.solve(states.q, states.qd, qdd=states.qdd, base=base, external_wrenches=states.wrenches)
    direct = dynamics.solve(states.q, states.qd, efforts=result.efforts, base=base, external_wrenches=states.wrenches)
    peer = PinocchioModel(urdf, dynamics.joint_names, True)
    for k in range(STATES):
        A = peer.inertia_matrix(states.q[k])
        H = peer.bias(states.q[k], states.qd[k], *states.base_of(k), states.wrenches_of(k))
        rows = A @ np.r_[base_accelerations[k], states.qdd[k]] + H
        assert relative_error(result.reactions[k, 0], rows[:6]) < TOLERANCE
        assert relative_error(result.efforts[k] - dynamics.friction(states.qd[k]), rows[6:]) < TOLERANCE
        assert relative_error(direct.accelerations[k], states.qdd[k]) < TOLERANCE
        assert relative_error(direct.reactions[k, 0], rows[:6]) < TOLERANCE
    assert np.allclose(result.base_acceleration, base_accelerations, rtol=0, atol=1e-13)
