"""Articulated-body recursion with mixed prescribed accelerations and forces, against A and H from Pinocchio."""

import numpy as np
import pytest
from peers.pinocchio_model import PinocchioModel
from peers.random_robots import random_states, random_urdf

from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.newton_euler import articulated_body
from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.kinematics import run_forward_pass


@pytest.mark.parametrize("moving_base", [False, True], ids=["fixed", "moving"])
@pytest.mark.parametrize("seed", range(30))
def test_mixed_dynamics_agrees_with_pinocchio(seed, moving_base):
    """Γ = A q̈ + H, with q̈ known in some rows and Γ in the others, the base's wrench being zero where it moves."""
    urdf = random_urdf(seed)
    robot = read_urdf(urdf, moving_base=moving_base)
    joints = [joint.name for joint in robot.joints]
    n, b = len(joints), 6 if moving_base else 0
    peer = PinocchioModel(urdf, joints, moving_base)
    states = random_states(robot, n, 1, seed)
    q, qd, (pose, twist) = states.q[0], states.qd[0], states.base_of(0)
    rng = np.random.default_rng(seed)
    has_force = rng.random(n) < 0.5  # joints with prescribed force
    values = rng.uniform(-2, 2, n)

    gravity = np.array([0, 0, -9.81]) if pose is None else pose[:3, :3].T @ [0, 0, -9.81]
    forward_pass = run_forward_pass(robot, q, qd, np.zeros(6) if pose is None else twist, {})
    accelerations = [None if p else np.array([v]) for p, v in zip(has_force, values, strict=True)]
    forces = [np.array([v]) if p else None for p, v in zip(has_force, values, strict=True)]
    base = None if moving_base else np.r_[-gravity, 0, 0, 0]
    solution = articulated_body.solve(robot, forward_pass, accelerations, forces, base)

    A, H = peer.inertia_matrix(q), peer.bias(q, qd, pose, twist)
    unknown = np.r_[np.ones(b, bool), has_force]
    known_forces = np.r_[np.zeros(b), np.where(has_force, values, 0)]
    motion = np.r_[np.zeros(b), np.where(has_force, 0, values)]
    motion[unknown] = np.linalg.solve(A[np.ix_(unknown, unknown)], (known_forces - H - A @ motion)[unknown])
    expected_forces = A @ motion + H
    condition = np.linalg.cond(A)
    tolerance = 1e-9 * max(1, condition / 1e5)
    np.testing.assert_allclose(solution.accelerations, motion[b:], rtol=0, atol=tolerance * np.abs(motion).max())
    scale = np.abs(expected_forces).max() + np.abs(H).max()
    np.testing.assert_allclose(solution.forces, expected_forces[b:], rtol=0, atol=tolerance * scale)
    if moving_base:
        true_acceleration = solution.base_acceleration + np.r_[gravity, 0, 0, 0]
        np.testing.assert_allclose(true_acceleration, motion[:6], rtol=0, atol=tolerance * np.abs(motion).max())


@pytest.mark.parametrize("seed", range(10))
def test_three_passes_and_two_agree_on_forces_and_wrenches(seed):
    robot = read_urdf(random_urdf(seed))
    states = random_states(robot, len(robot.joints), 3, seed)
    acceleration = np.random.default_rng(seed).uniform(-1, 1, (3, 6))
    forward_pass = run_forward_pass(robot, states.q, states.qd, np.ones(6), {1: np.arange(6.0)})
    forces, wrenches = inverse_dynamics(robot, forward_pass, states.qdd, acceleration)
    solution = articulated_body.solve(
        robot, forward_pass, list(states.qdd.T[..., None]), [None] * len(robot.joints), acceleration
    )
    scale = np.abs(wrenches).max()
    np.testing.assert_allclose(solution.forces, forces, rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(solution.wrenches, wrenches, rtol=0, atol=1e-11 * scale)
