"""Mechanisms with loops at any speed: they stay in their assembly mode and conserve energy, also where branches cross
and at dead points of their motors. `make soak` simulates more of them, for a longer time."""

import os
from dataclasses import replace

import numpy as np
import pytest
from peers.five_bar import FiveBar
from peers.four_bar import FourBar
from peers.large_robots import each_robot
from peers.planar_lagrange import JointProperties, PlanarBody, random_body, random_plane
from peers.reframed import reframed

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.constraints.attitude_angles import axis_rotation
from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.errors import SingularModelError
from robot_dynamics.model.loading import shipped_robots
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.simulation import Simulation

SECONDS = float(os.environ.get("SIMULATED_SECONDS", "1"))
MECHANISMS = int(os.environ.get("SIMULATED_MECHANISMS", "6"))
LOOPED = [name for name in shipped_robots() if load_robot(name).loops]


def frictionless(name):
    robot = load_robot(name)
    joints = (replace(joint, viscous_friction=0.0, coulomb_friction=0.0) for joint in robot.joints)
    return replace(robot, joints=tuple(joints))


def check_energy_and_closure(simulation, seconds, callback=None):
    """Advance, check energy and closure of the loops, and return the relative change of the energy."""
    robot, start, peak, largest_change = simulation.robot, sum(simulation.energy()), 0.0, 0.0
    for _ in range(round(seconds / (10 * simulation.step))):
        state = simulation.advance(10)
        kinetic, potential = simulation.energy()
        peak, largest_change = max(peak, kinetic), max(largest_change, abs(kinetic + potential - start))
        assert np.abs(loop_equations(robot, state.joint_positions).residual).max() < 1e-10
        if callback:
            callback(state)
    assert peak > 0
    assert largest_change < 1e-6 * peak
    return largest_change / peak


def parallelogram(crank=0.2, ground=0.4):
    bars = tuple(
        PlanarBody(1.0, np.array([length / 2, 0.0, 0.0]), length**2 / 12 * np.diag([0.0, 1.0, 1.0]))
        for length in (crank, ground, crank)
    )
    return FourBar(crank, ground, crank, ground, bars, gravity=np.zeros(3))


@pytest.mark.slow
@pytest.mark.parametrize("speed", [6.0, -6.0, 0.7, 60.0])
def test_parallelogram_stays_on_its_branch_through_flat_positions(speed):
    robot = parallelogram().robot(1.0)
    simulation = Simulation(robot)
    simulation.start(velocities=[speed])

    def check_opposite_links(state):
        crank, coupler, rocker, cut = state.joint_positions
        np.testing.assert_allclose([crank + coupler, rocker - crank, cut - crank], 0, atol=1e-7)
        # uniform bars without gravity: the speed never changes
        np.testing.assert_allclose(state.joint_velocities, speed * np.array([1, -1, 1, 1]), rtol=1e-7)

    check_energy_and_closure(simulation, SECONDS * 5, check_opposite_links)
    assert abs(simulation.state.joint_positions[0]) > np.pi  # it has passed the flat position


@pytest.mark.parametrize("distance", [1e-4, 1e-3, 1e-2])
def test_parallelogram_starts_next_to_its_flat_position(distance):
    simulation = Simulation(parallelogram().robot(1.0))
    simulation.start(positions=[np.pi - distance], velocities=[6.0])
    state = simulation.advance(100)
    np.testing.assert_allclose(state.joint_velocities, [6.0, -6.0, 6.0, 6.0], rtol=1e-6)
    simulation.start(positions=[np.pi - distance])  # the same after any other motion; at rest it stays there
    np.testing.assert_array_equal(simulation.advance(100).joint_velocities, 0)


def test_parallelogram_at_rest_in_its_flat_position_is_refused():
    simulation = Simulation(parallelogram().robot(1.0))
    with pytest.raises(SingularModelError, match="'four_bar' is singular"):
        simulation.start(positions=[np.pi], velocities=[6.0])  # the velocity of the crank alone determines no branch
    state = simulation.state
    flat_state = replace(
        state,
        joint_positions=np.array([np.pi, -np.pi, np.pi, np.pi]),
        positions=np.array([np.pi]),
        coordinates=state.coordinates._replace(quality=0.0),
    )
    simulation.reset(flat_state)
    with pytest.raises(SingularModelError, match=r"loop 'four_bar' is singular.*no direction of motion"):
        simulation.advance()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sr400", "irb460"])
def test_robots_with_parallelograms_that_fall_from_rest_conserve_energy(name):
    simulation = Simulation(frictionless(name))
    check_energy_and_closure(simulation, max(1.0, SECONDS / 2))


def random_four_bar(rng):
    """A random FourBar, and an angle of its crank at which it closes well."""
    while True:
        lengths = rng.uniform(0.15, 0.6, 4)
        crank, coupler, rocker, ground = lengths
        angle = rng.uniform(-np.pi, np.pi)
        span = np.hypot(crank * np.cos(angle) - ground, crank * np.sin(angle))
        if abs(coupler - rocker) + 0.02 < span < coupler + rocker - 0.02:
            bodies = tuple(random_body(rng, length) for length in lengths[:3])
            plane, gravity = random_plane(rng), rng.normal(size=3) * 5
            return FourBar(*lengths, bodies, mode=int(rng.choice([1, -1])), plane=plane, gravity=gravity), angle


@pytest.mark.parametrize("seed", range(MECHANISMS))
def test_random_four_bars_conserve_energy(seed):
    rng = np.random.default_rng([seed, 77])
    mechanism, angle = random_four_bar(rng)
    simulation = Simulation(mechanism.robot(angle))
    simulation.start(velocities=[rng.uniform(-8, 8)])
    check_energy_and_closure(simulation, SECONDS)


@pytest.mark.parametrize("seed", range(MECHANISMS // 2))
def test_random_five_bars_conserve_energy(seed):
    rng = np.random.default_rng([seed, 78])
    while True:
        cranks, rods, ground = rng.uniform(0.15, 0.4, 2), rng.uniform(0.3, 0.7, 2), rng.uniform(0.2, 0.6)
        angles = rng.uniform(-np.pi, np.pi, 2)
        ends = cranks * np.exp(1j * angles) + [0, ground]
        if abs(rods[0] - rods[1]) + 0.02 < abs(ends[1] - ends[0]) < rods.sum() - 0.02:
            break
    bodies = tuple(random_body(rng, length) for length in (cranks[0], rods[0], cranks[1], rods[1]))
    mechanism = FiveBar(
        tuple(cranks), tuple(rods), ground, bodies, mode=1, plane=random_plane(rng), gravity=rng.normal(size=3) * 5
    )
    simulation = Simulation(mechanism.robot(angles))
    simulation.start(velocities=rng.uniform(-5, 5, 2))
    check_energy_and_closure(simulation, SECONDS)


@pytest.mark.slow
@pytest.mark.parametrize("name", each_robot(LOOPED))
def test_shipped_robots_with_loops_conserve_energy(name):
    rng = np.random.default_rng([len(name), 79])
    simulation = Simulation(frictionless(name))
    max_speed = 1.0 if len(simulation.joint_names) < 6 else 0.2
    simulation.start(velocities=rng.uniform(-max_speed, max_speed, len(simulation.joint_names)))
    seconds = SECONDS / 8 if simulation.robot.platforms else SECONDS  # platforms take longest
    print(f"{name}: {check_energy_and_closure(simulation, seconds):.2g} of the largest kinetic energy")


@pytest.mark.slow
@pytest.mark.parametrize(
    "friction", [JointProperties(), JointProperties(coulomb_friction=0.02, viscous_friction=0.003)]
)
def test_four_bar_passes_dead_points_of_its_motor(friction):
    """Compare with a linkage of the same bodies whose coordinates are never singular.

    The motor of the linkage under test is at the long link, which only swings. That of the other linkage is at the
    short link, which makes full turns.
    """
    short, coupler, long, ground = 0.15, 0.5, 0.4, 0.45
    rng = np.random.default_rng(5)
    bodies = [random_body(rng, length) for length in (short, coupler, long)]
    free = FourBar(short, coupler, long, ground, tuple(bodies), (friction,) * 4, gravity=np.zeros(3), mode=1)
    reference = Simulation(free.robot(0.4), step=1e-3)
    reference.start(velocities=[5.0])
    # in the frame of the other end x is reversed: the plane is turned by half a turn about its normal
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])
    turned[0, 3] = ground
    swapped = [bodies[2], reversed_body(bodies[1], coupler), bodies[0]]
    rocker = np.real(free.link_angles(np.array([0.4]))[2])
    rocker_driven = [
        FourBar(
            long, coupler, short, ground, tuple(swapped), (friction,) * 4, mode=mode, plane=turned, gravity=np.zeros(3)
        )
        for mode in (1, -1)
    ]
    crank_angle = np.array([rocker - np.pi])
    rocker_driven.sort(key=lambda bar: abs(np.sin((np.real(bar.link_angles(crank_angle)[2]) - 0.4 + np.pi) / 2)))
    simulation = Simulation(rocker_driven[0].robot(crank_angle))
    simulation.start(velocities=[5.0 * np.real(free.link_rates(np.array([0.4]))[2, 0])])
    np.testing.assert_allclose(sum(simulation.energy()), sum(reference.energy()), rtol=1e-12)
    dead_points, sign = 0, np.sign(simulation.state.velocities[0])
    for _ in range(300):
        expected, state = reference.advance(10), simulation.advance(10)
        # joint positions: crank, coupler, rocker, cut
        assert state.joint_velocities[0] == pytest.approx(expected.joint_velocities[2], abs=1e-6)
        assert state.joint_velocities[2] == pytest.approx(expected.joint_velocities[0], abs=1e-6)
        dead_points += np.sign(state.velocities[0]) != sign
        sign = np.sign(state.velocities[0])
    assert dead_points >= 4


def reversed_body(body, length):
    """The body in the frame at the other end of its link."""
    half_turn = np.diag([-1.0, -1.0, 1.0])
    return PlanarBody(
        body.mass, np.array([length, 0.0, 0.0]) + half_turn @ body.centre, half_turn @ body.inertia @ half_turn
    )


def test_simulation_of_loops_repeats_bit_for_bit():
    simulation = Simulation(frictionless("irb460"))
    first = simulation.advance(900)
    assert first.coordinates.independent != Simulation(frictionless("irb460")).state.coordinates.independent
    simulation.reset()
    second = simulation.advance(900)
    np.testing.assert_array_equal(first.joint_positions, second.joint_positions)
    np.testing.assert_array_equal(first.joint_velocities, second.joint_velocities)
    assert first.coordinates == second.coordinates


def test_accelerations_in_other_coordinates_are_those_of_the_direct_model():
    robot = frictionless("sr400")
    simulation = Simulation(robot)
    while simulation.state.coordinates.independent == Simulation(robot).state.coordinates.independent:
        simulation.advance(50)
        assert simulation.state.time < 20
    simulation.advance(100)
    state, efforts = simulation.state, np.linspace(-20, 30, len(simulation.joint_names))
    _, joints = simulation.accelerations(efforts=efforts)
    expected = Dynamics(robot).direct(state.joint_positions, state.velocities, efforts)
    np.testing.assert_allclose(joints, expected, rtol=1e-9, atol=1e-7)


@pytest.mark.slow
def test_platform_tumbles_through_pitch_90_degrees():
    """Rates of yaw and roll do not exist there; the legs pass singular positions as well."""
    robot = replace(frictionless("gough_stewart"), gravity=np.zeros(3))
    simulation = Simulation(robot)
    platform, dynamics = list(robot.platforms[0].joints), simulation.dynamics
    G = dynamics.expand_velocities(np.eye(6), dynamics.initial_joint_positions).T
    simulation.start(velocities=np.linalg.solve(G[platform], [0, 0, 0.2, 0, 6.0, 0.6]))  # x, y, z, yaw, pitch, roll
    pitches = []
    check_energy_and_closure(simulation, 0.7, lambda state: pitches.append(abs(state.joint_positions[platform[4]])))
    assert max(pitches) > np.radians(80)
    axis = np.cos(simulation.state.joint_positions[platform[3]])
    assert axis < 0  # it has tumbled over: yaw and roll have jumped by nearly half a turn


@pytest.mark.slow
def test_platform_at_pitch_90_degrees_moves_as_in_another_frame():
    robot = replace(frictionless("gough_stewart"), gravity=np.zeros(3))
    turned = np.eye(4)
    turned[:3, :3] = axis_rotation(1, np.pi / 2)
    reframed_robot = reframed(robot, np.eye(4), turned, COORDINATES)
    velocities = np.array([0.3, -0.2, 0.1, 0.4, -0.3, 0.2])
    simulations = [Simulation(variant) for variant in (robot, reframed_robot)]
    for simulation in simulations:
        simulation.start(velocities=velocities)
    for _ in range(20):
        expected, state = (simulation.advance(10) for simulation in simulations)
        np.testing.assert_allclose(state.positions, expected.positions, atol=1e-9)
        np.testing.assert_allclose(state.velocities, expected.velocities, atol=1e-9)
        np.testing.assert_allclose(simulations[1].energy()[0], simulations[0].energy()[0], rtol=1e-9)
