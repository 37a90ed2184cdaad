"""Free robots: conservation of momentum and energy, and motion by Pinocchio's aba."""

import numpy as np
import pytest
from peers.flying_arm import TWIST, VELOCITIES, flying, peer_of
from peers.pinocchio_motion import energy, integrated, momentum

from robot_dynamics import Base, load_robot
from robot_dynamics.simulation import Simulation

AMPLITUDES = np.array([20.0, 25.0, -12.0, 0.2, -0.1, 0.002])  # [N m]
STIFFNESS = np.array([400.0, 400.0, 150.0, 4.0, 2.0, 0.05])  # [N m/rad]


def efforts(state):
    """Efforts of a servo that makes the arm swing by a radian or two about each axis."""
    reference = 1.5 * np.sin(np.array([1.1, 0.9, 1.3, 1.7, 2.1, 1.5]) * state.time)
    return STIFFNESS * (reference - state.positions) - 0.3 * STIFFNESS * state.velocities


@pytest.mark.slow
def test_momentum_is_conserved_through_a_minute_of_motion():
    simulation, peer = flying(step=0.002)
    simulation.start(velocities=VELOCITIES, base=Base(twist=TWIST))

    def current_momentum():
        state = simulation.state
        return momentum(peer, state.positions, state.velocities, state.pose, state.twist)

    start, largest_change, travelled = current_momentum(), 0.0, 0.0
    scale = np.repeat([np.linalg.norm(start[:3]), np.linalg.norm(start[3:])], 3)
    for _ in range(60):
        before = simulation.state.positions
        for _ in range(500):
            simulation.advance(efforts=efforts(simulation.state))
        largest_change = max(largest_change, np.abs((current_momentum() - start) / scale).max())
        travelled += np.abs(simulation.state.positions - before).sum()
    print(f"momentum: largest change in 60 s {largest_change:.1e} of it")
    assert simulation.state.time == pytest.approx(60) and travelled > 100
    assert largest_change < 1e-9
    R = simulation.state.pose[:3, :3]
    assert np.abs(R @ R.T - np.eye(3)).max() < 1e-14


def test_momentum_changes_by_the_weight_alone_in_gravity():
    simulation, peer = flying(gravity=(0.3, 0.0, -9.81))
    simulation.start(velocities=VELOCITIES, base=Base(twist=TWIST))
    start = momentum(peer, simulation.state.positions, simulation.state.velocities, np.eye(4), TWIST)
    simulation.advance(300, efforts=AMPLITUDES / 10)
    state = simulation.state
    end = momentum(peer, state.positions, state.velocities, state.pose, state.twist)
    mass = sum(link.inertia.mass for link in simulation.robot.links)
    np.testing.assert_allclose(end[:3] - start[:3], 0.3 * mass * simulation.robot.gravity, atol=1e-11 * mass)
    # the momentum about the centre of mass has not changed
    assert np.abs(simulation.momentum().angular).max() > 10
    simulation.reset()
    angular_momentum = simulation.momentum().angular
    simulation.advance(300, efforts=AMPLITUDES / 10)
    np.testing.assert_allclose(simulation.momentum().angular, angular_momentum, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (0.0, 0.5, -1.0)])
def test_base_motion_is_that_of_pinocchio(gravity):
    simulation, peer = flying(gravity, step=0.0025)
    pose = np.eye(4)
    pose[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    pose[:3, 3] = 1.0, -2.0, 0.5
    simulation.start(velocities=VELOCITIES, base=Base(pose, TWIST))
    constant_efforts = AMPLITUDES / 100  # for all ten seconds: jumps of the forces would lower the order of the peer
    simulation.advance(4000, efforts=constant_efforts)
    solution = integrated(peer, np.zeros(6), VELOCITIES, lambda time: constant_efforts, 10.0, pose, TWIST)
    state = simulation.state
    for name, actual, expected in zip(
        ("pose", "twist", "q", "qd"),
        (state.pose, state.twist, state.positions, state.velocities),
        solution,
        strict=True,
    ):
        print(name, np.abs(actual - expected).max())
        np.testing.assert_allclose(actual, expected, atol=1e-6, err_msg=name)


@pytest.mark.slow
def test_energy_of_an_unforced_arm_is_conserved_for_a_minute():
    simulation = Simulation(load_robot("panda"))
    peer = peer_of("panda", simulation.joint_names)
    simulation.start(positions=[0.0, -0.3, 0.0, -2.2, 0.0, 1.9, 0.8])

    def current_energy():
        return energy(peer, simulation.state.positions, simulation.state.velocities)

    start, peak, largest_change = sum(current_energy()), 0.0, 0.0
    for _ in range(600):
        simulation.advance(100)
        kinetic, potential = current_energy()
        peak, largest_change = max(peak, kinetic), max(largest_change, abs(kinetic + potential - start))
    print(f"energy: largest change in 60 s {largest_change / peak:.1e} of the peak kinetic energy, {peak:.0f} J")
    assert simulation.state.time == pytest.approx(60) and peak > 50
    assert largest_change < 1e-6 * peak


def test_energy_and_momentum_are_those_of_pinocchio():
    simulation, peer = flying((0.1, -0.2, -9.0))
    pose = np.eye(4)
    pose[:3, 3] = 1.0, 2.0, 3.0
    simulation.start([0.1, -1.0, 0.5, 0.3, 0.2, 0.1], VELOCITIES, Base(pose, TWIST))
    state = simulation.state
    pinocchio_state = state.positions, state.velocities, state.pose, state.twist
    np.testing.assert_allclose(simulation.energy(), energy(peer, *pinocchio_state), rtol=1e-12)
    actual, expected = simulation.momentum(), momentum(peer, *pinocchio_state)
    np.testing.assert_allclose(actual.linear, expected[:3], rtol=1e-11, atol=1e-10)
    np.testing.assert_allclose(
        actual.angular, expected[3:] - np.cross(peer.data.com[0], expected[:3]), rtol=1e-10, atol=1e-9
    )
