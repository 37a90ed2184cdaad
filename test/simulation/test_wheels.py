"""Wheels that roll without slipping: motion by textbook equations, driven bases, invalid wheels."""

import numpy as np
import pytest
from peers.real_robots import ROBOTS
from peers.wheeled_robots import DifferentialDrive, mecanum, tricycle
from scipy.integrate import solve_ivp

from robot_dynamics import Base, DescriptionError, InvalidInputError, load_robot
from robot_dynamics.simulation import Simulation, Wheel

PAIR = (Wheel("left", 0.1), Wheel("right", 0.1))
TRICYCLE = (Wheel("rear_left", 0.12), Wheel("rear_right", 0.12), Wheel("front", 0.1))


def test_differential_drive_follows_its_textbook_equations():
    robot, (left, right) = DifferentialDrive(), (0.8, 1.1)
    simulation = Simulation(load_robot(robot.urdf), wheels=PAIR)
    simulation.start(base=Base(twist=[0.3, 0, 0, 0, 0, -0.4]))
    state = simulation.advance(1000, efforts=[left, right])

    def derivative(_, y):
        v, omega, heading = y[:3]
        return [*robot.accelerations(v, omega, left, right), omega, v * np.cos(heading), v * np.sin(heading)]

    v, omega, heading, x, y = solve_ivp(
        derivative, (0, 1), [0.3, -0.4, 0, 0, 0], method="DOP853", rtol=1e-12, atol=1e-12
    ).y[:, -1]
    np.testing.assert_allclose(state.twist, [v, 0, 0, 0, 0, omega], atol=1e-9)
    np.testing.assert_allclose(state.pose[:2, 3], [x, y], atol=1e-9)
    np.testing.assert_allclose(state.pose[:2, 0], [np.cos(heading), np.sin(heading)], atol=1e-9)
    expected = (v - robot.b * omega) / robot.r, (v + robot.b * omega) / robot.r
    np.testing.assert_allclose(state.velocities, expected, atol=1e-9)
    assert np.abs(simulation.rolling_residual()).max() < 1e-12
    assert np.abs(state.pose[2]).tolist() == [0, 0, 1, 0]  # it never leaves the plane


def contact_velocities(simulation):
    """Velocities (wheels, 2) in the plane of the contact points of the wheels, by differences of poses."""
    state, h, displaced = simulation.state, 1e-6, []
    for sign in (-1, 1):
        angle = sign * h * state.twist[5]
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        pose = state.pose.copy()
        pose[:2, :2] = pose[:2, :2] @ turn
        pose[:3, 3] += state.pose[:3, :3] @ (sign * h * state.twist[:3])
        displaced.append((pose, state.positions + sign * h * state.velocities))
    wheel_velocities = []
    for wheel in TRICYCLE:
        link = f"{wheel.joint}_wheel"
        wheel_pose = simulation.dynamics.link_pose(link, state.positions, base=Base(state.pose))
        contact = np.linalg.inv(wheel_pose) @ np.append(wheel_pose[:3, 3] - [0, 0, wheel.radius], 1)
        before, after = (simulation.dynamics.link_pose(link, q, base=Base(pose)) @ contact for pose, q in displaced)
        wheel_velocities.append((after - before)[:2] / (2 * h))
    return np.array(wheel_velocities)


@pytest.mark.slow
def test_steered_wheel_does_not_slip_and_conserves_energy():
    simulation = Simulation(load_robot(tricycle()), wheels=TRICYCLE, step=0.004)
    names = simulation.joint_names
    rates = dict.fromkeys(names, 0.0) | {"steer": 0.3, "shoulder": 2.0}
    simulation.start(
        [0.4 if name == "steer" else 0.0 for name in names], list(rates.values()), Base(twist=[1.0, 0, 0, 0, 0, 0])
    )
    assert np.abs(simulation.rolling_residual()).max() < 1e-12  # rates that the wheels forbid are removed
    start, peak, largest_change = sum(simulation.energy()), simulation.energy()[0], 0.0
    for _ in range(20):
        state = simulation.advance(25)
        assert np.abs(simulation.rolling_residual()).max() < 1e-9
        assert np.abs(contact_velocities(simulation)).max() < 1e-8
        largest_change = max(largest_change, abs(sum(simulation.energy()) - start))
        peak = max(peak, simulation.energy()[0])
    assert np.linalg.norm(state.pose[:2, 3]) > 0.5 and np.abs(state.pose[1, 0]) > 0.3  # it has turned
    assert largest_change < 1e-8 * peak
    np.testing.assert_allclose(state.pose[2], [0, 0, 1, 0], atol=1e-15)


@pytest.mark.slow
def test_driven_real_robot_reaches_the_reference_twist():
    urdf = (ROBOTS / "tiago_description/robots/tiago_no_hand.urdf").read_text()
    robot = load_robot(urdf, gravity=[0, 0, 0])  # nothing holds its arms up
    wheels = (Wheel("wheel_left_joint", 0.0985), Wheel("wheel_right_joint", 0.0985))
    simulation = Simulation(robot, wheels=wheels, drive_time=0.05, step=0.005)
    command = [0.4, 0.7, 0, 0, 0, 0.5]  # it cannot move sideways
    state = simulation.advance(150, drive=command)
    np.testing.assert_allclose(state.twist, [0.4, 0, 0, 0, 0, 0.5], atol=1e-5)
    left, right = (state.velocities[simulation.joint_names.index(wheel.joint)] for wheel in wheels)
    track = 2 * simulation.dynamics.link_pose("wheel_left_link", state.positions, base=Base())[1, 3]
    assert (right - left) * 0.0985 == pytest.approx(track * 0.5, rel=1e-4)
    # by 1 - exp(-t/T) at the beginning
    simulation.reset()
    early = simulation.advance(10, drive=command)
    np.testing.assert_allclose(early.twist[[0, 5]], (1 - np.exp(-1)) * np.array([0.4, 0.5]), rtol=1e-6)
    assert np.abs(simulation.rolling_residual()).max() < 1e-12


def test_driven_differential_drive_approaches_the_reference_twist_exponentially():
    simulation = Simulation(load_robot(DifferentialDrive.urdf), wheels=PAIR, drive_time=0.05)
    state = simulation.advance(50, drive=[0.5, 0, 0, 0, 0, 0.8])  # its wheels leave it nothing else to move
    np.testing.assert_allclose(state.twist[[0, 5]], (1 - np.exp(-1)) * np.array([0.5, 0.8]), rtol=1e-6)


def test_mecanum_wheels_move_sideways():
    urdf, angles = mecanum()
    simulation = Simulation(load_robot(urdf), wheels=[Wheel(name, 0.1, angle) for name, angle in angles.items()])
    state = simulation.advance(600, drive=[0.2, -0.3, 0, 0, 0, 0.1])
    np.testing.assert_allclose(state.twist, [0.2, -0.3, 0, 0, 0, 0.1], atol=1e-5)
    v, u, w = state.twist[[0, 1, 5]]
    # textbook: ω_i r = v ∓ u - (a + b) w ... for rollers that stand like an X seen from above
    expected = {"fl": v - u - 0.55 * w, "fr": v + u + 0.55 * w, "rl": v + u - 0.55 * w, "rr": v - u + 0.55 * w}
    wheel_velocities = dict(zip(simulation.joint_names, 0.1 * state.velocities, strict=True))
    assert wheel_velocities == pytest.approx(expected, abs=1e-12)


def test_planar_base_glides_in_its_plane():
    simulation = Simulation(load_robot("ur5e", gravity=[0, 0, 0]), base="planar")
    simulation.start(velocities=[0, 1.0, -0.5, 0.3, 0.2, 0.1], base=Base(twist=[0.1, 0.2, 0.5, 0.3, 0.2, 0.1]))
    start = simulation.energy()[0]
    momenta = simulation.momentum().linear[:2]
    state = simulation.advance(2000)
    assert simulation.energy()[0] == pytest.approx(start, rel=1e-9)
    np.testing.assert_allclose(state.twist[2:5], 0, atol=1e-15)
    np.testing.assert_allclose(simulation.momentum().linear[:2], momenta, atol=1e-9)  # nothing pushes along the plane


def test_wheels_with_prescribed_motion_move_the_base():
    simulation = Simulation(load_robot(DifferentialDrive.urdf), wheels=PAIR)

    def motion(time):
        return np.array([2.0, 3.0]) * time**2, np.array([4.0, 6.0]) * time, np.array([4.0, 6.0])

    state = simulation.advance(500, motion=motion)
    np.testing.assert_allclose(state.twist[[0, 5]], [0.1 * 2.5, 0.1 * 1.0 / 0.5], atol=1e-12)
    heading = (0.1 / 0.5) * (3 - 2) * 0.5**2
    assert np.arctan2(state.pose[1, 0], state.pose[0, 0]) == pytest.approx(heading, abs=1e-12)


@pytest.mark.parametrize(
    ("wheels", "message"),
    [
        ([Wheel("lift", 0.1)], "unknown joint 'lift'"),
        ([Wheel("left", 0.1), Wheel("left", 0.1)], "one wheel at most"),
    ],
)
def test_wheels_that_do_not_fit_the_robot_are_refused(wheels, message):
    with pytest.raises(DescriptionError, match=message):
        Simulation(load_robot(DifferentialDrive.urdf), wheels=wheels)


def test_invalid_wheels_and_bases_are_refused():
    with pytest.raises(DescriptionError, match="radius is -1"):
        Wheel("left", -1)
    with pytest.raises(InvalidInputError, match="axle points out"):
        Simulation(load_robot("ur5e"), wheels=[Wheel("shoulder_pan_joint", 0.1)])
    with pytest.raises(InvalidInputError, match="not a free one"):
        Simulation(load_robot(DifferentialDrive.urdf), base="free", wheels=PAIR)
    with pytest.raises(InvalidInputError, match="fixed, free, planar"):
        Simulation(load_robot("ur5e"), base="flying")
    with pytest.raises(InvalidInputError, match="this one is fixed"):
        Simulation(load_robot("ur5e")).advance(drive=np.zeros(6))
