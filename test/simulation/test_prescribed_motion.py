"""Base motion for prescribed joint motion (Khalil, section 7.2), by conservation of momentum."""

import numpy as np
import pytest
from peers.flying_arm import TWIST, flying
from peers.pinocchio_motion import momentum
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from robot_dynamics import Base, load_robot
from robot_dynamics.simulation import Simulation

RATES = np.array([0.7, 0.9, 1.1, 1.3, 0.8, 1.2])


def swing(time):
    """Positions, velocities, accelerations (6,) of a motion that begins at rest."""
    angle = RATES * time
    return 0.8 * (1 - np.cos(angle)), 0.8 * RATES * np.sin(angle), 0.8 * RATES**2 * np.cos(angle)


def base_of_momentum(peer, start, seconds):
    """(position (3,), Rotation) of the base, integrated from P = 0 and L = 0 alone, with Pinocchio's matrices."""

    def derivative(time, y):
        q, qd, _ = swing(time)
        A = peer.inertia_matrix(q)
        twist = -np.linalg.solve(A[:6, :6], A[:6, 6:] @ qd)
        R = Rotation.from_quat(y[3:])
        x, y_, z, w = y[3:]
        a, b, c = twist[3:]
        turning = [w * a + y_ * c - z * b, w * b + z * a - x * c, w * c + x * b - y_ * a, -x * a - y_ * b - z * c]
        return np.concatenate([R.apply(twist[:3]), 0.5 * np.array(turning)])

    solution = solve_ivp(derivative, (0, seconds), [0, 0, 0, 0, 0, 0, 1], method="DOP853", rtol=1e-12, atol=1e-13)
    return solution.y[:3, -1], Rotation.from_quat(solution.y[3:, -1])


def test_base_reaction_conserves_momentum():
    simulation, peer = flying(step=0.005)
    simulation.start()
    state = simulation.advance(1000, motion=swing)
    position, rotation = base_of_momentum(peer, simulation.state, 5.0)
    print("base", state.pose[:3, 3], "differs by", np.abs(state.pose[:3, 3] - position).max())
    assert np.linalg.norm(position) > 1e-3
    np.testing.assert_allclose(state.pose[:3, 3], position, atol=1e-8)
    np.testing.assert_allclose(state.pose[:3, :3], rotation.as_matrix(), atol=1e-8)
    np.testing.assert_allclose(momentum(peer, *swing(5.0)[:2], state.pose, state.twist), 0, atol=1e-9)
    np.testing.assert_array_equal(state.positions, swing(5.0)[0])


def test_jump_to_the_motion_conserves_momentum():
    simulation, peer = flying()
    simulation.start(velocities=[0.5, 0, 0, 0, 0, 0], base=Base(twist=TWIST))
    before = momentum(peer, np.zeros(6), simulation.state.velocities, np.eye(4), TWIST)
    state = simulation.advance(100, motion=swing)
    after = momentum(peer, state.positions, state.velocities, state.pose, state.twist)
    np.testing.assert_allclose(after, before, atol=1e-9)
    assert np.abs(state.twist - TWIST).max() > 1e-6


def test_fixed_base_does_not_move():
    simulation = Simulation(load_robot("ur5e"))
    state = simulation.advance(10, motion=swing)
    np.testing.assert_array_equal(state.pose, np.eye(4))
    np.testing.assert_array_equal(state.velocities, swing(0.01)[1])
    assert state.time == pytest.approx(0.01)
