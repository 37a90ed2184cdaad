"""Motion of robots with closed loops and with elastic joints: closure, energy, direct model."""

from dataclasses import replace

import numpy as np
import pytest
from peers.link_motion import link_motion
from scipy.integrate import solve_ivp

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.simulation import Simulation


def without_friction(name):
    robot = load_robot(name)
    joints = (replace(joint, viscous_friction=0.0, coulomb_friction=0.0) for joint in robot.joints)
    return replace(robot, joints=tuple(joints))


def energy(robot, q, qd):
    """Kinetic and potential energy [J], summed over links and rotors."""
    motion, kinetic, potential = link_motion(robot, q, qd), 0.0, 0.0
    for link, pose, velocity in zip(robot.links, motion.poses, motion.velocities, strict=True):
        R, inertia = pose[:3, :3], link.inertia
        twist = np.concatenate([R.T @ velocity[:3], R.T @ velocity[3:]])
        kinetic += 0.5 * twist @ inertia.spatial @ twist
        potential -= robot.gravity @ (R @ inertia.first_moments + inertia.mass * pose[:3, 3])
    rotors = np.array([joint.rotor_inertia for joint in robot.joints])
    return kinetic + 0.5 * rotors @ qd**2, potential


@pytest.mark.parametrize(("name", "speed"), [("four_bar", 2.0), ("five_bar", 0.5)])
def test_loops_stay_closed_and_conserve_energy(name, speed):
    robot = without_friction(name)
    simulation = Simulation(robot)
    simulation.start(velocities=np.full(len(simulation.joint_names), speed))
    dynamics = simulation.dynamics

    def check_loops_and_compute_energy():
        state = simulation.state
        assert np.abs(loop_equations(robot, state.joint_positions).residual).max() < 1e-9
        return energy(robot, state.joint_positions, dynamics.expand_velocities(state.velocities, state.joint_positions))

    start, largest_change, peak = sum(check_loops_and_compute_energy()), 0.0, 0.0
    np.testing.assert_allclose(simulation.energy(), check_loops_and_compute_energy(), rtol=1e-10)
    for _ in range(12):
        simulation.advance(25)
        kinetic, potential = check_loops_and_compute_energy()
        largest_change, peak = max(largest_change, abs(kinetic + potential - start)), max(peak, kinetic)
    assert largest_change < 1e-8 * peak


def test_four_bar_motion_is_that_of_its_direct_model():
    robot = without_friction("four_bar")
    simulation, dynamics = Simulation(robot), Dynamics(robot)
    simulation.start()
    start = simulation.state
    state = simulation.advance(200, efforts=[0.3])

    def derivative(_, y):
        seed = start.joint_positions.copy()
        seed[robot.joint_numbers[dynamics.joint_names[0]]] = y[0]
        return [y[1], dynamics.direct(y[:1], y[1:], [0.3])[0]]

    end = solve_ivp(derivative, (0, 0.2), [start.positions[0], 0], method="DOP853", rtol=1e-10, atol=1e-10).y[:, -1]
    np.testing.assert_allclose([state.positions[0], state.velocities[0]], end, atol=1e-7)


def test_elastic_joint_motion_is_that_of_the_direct_model():
    robot = without_friction("manutec_r3")
    simulation = Simulation(robot, step=0.0005)
    dynamics = Dynamics(robot)
    efforts = np.where([name.startswith("motor") for name in simulation.joint_names], 5.0, 0.0)
    state = simulation.advance(100, efforts=efforts)
    n = len(efforts)

    def derivative(_, y):
        return np.concatenate([y[n:], dynamics.direct(y[:n], y[n:], efforts)])

    y = solve_ivp(derivative, (0, 0.05), np.zeros(2 * n), method="DOP853", rtol=1e-9, atol=1e-11).y[:, -1]
    assert np.abs(y[:n]).max() > 1e-4
    np.testing.assert_allclose(state.positions, y[:n], atol=1e-8)
