"""Asymmetric, Stribeck and load-dependent friction in simulations: breakaway, sliding, stopping, lost energy."""

from dataclasses import replace

import numpy as np
import pytest
from peers.frictions import all_friction, with_random_friction, without_friction
from scipy.integrate import solve_ivp

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.simulation import Simulation

MASS = 3.0
WEIGHT = 9.81 * MASS


def lift(**friction):
    """A block that a motor moves up (+) and down (-)."""
    robot = load_robot(f"""
robot: lift
joints:
  - {{joint: lift, link: block, type: prismatic, mass: {MASS}}}
""")
    return replace(robot, joints=(replace(robot.joints[0], **friction),))


DRY = {"coulomb_friction": 2.0, "coulomb_asymmetry": 0.5, "load_friction": 0.1}
STRIBECK = {"stribeck_friction": 1.0, "stribeck_velocity": 0.05}


@pytest.mark.parametrize("stribeck", [{}, STRIBECK])
@pytest.mark.parametrize("direction", [1, -1])
def test_block_sticks_until_the_effort_exceeds_the_dry_friction_of_its_load(direction, stribeck):
    friction = 2.0 + 0.5 * direction + 0.1 * WEIGHT + (1.0 if stribeck else 0.0)
    simulation = Simulation(lift(**DRY, **stribeck))
    for effort in (WEIGHT, WEIGHT + 0.999 * direction * friction):
        state = simulation.advance(500, efforts=[effort])
        assert abs(state.positions[0]) < 1e-14 and abs(state.velocities[0]) < 1e-14
    state = simulation.advance(500, efforts=[WEIGHT + 1.001 * direction * friction])
    assert direction * state.velocities[0] > 1e-4


@pytest.mark.parametrize("effort", [60.0, 5.0, -30.0])
def test_block_accelerates_as_its_load_and_the_friction_of_its_direction_allow(effort):
    simulation = Simulation(lift(**DRY))
    state = simulation.advance(400, efforts=[effort])
    direction = np.sign(state.velocities[0])
    acceleration = state.velocities[0] / state.time
    load = MASS * (acceleration + 9.81)
    assert direction == np.sign(effort - WEIGHT)
    assert load + direction * (2.0 + 0.5 * direction + 0.1 * abs(load)) == pytest.approx(effort, rel=1e-10)


def test_block_that_slides_past_the_stribeck_velocity_moves_as_the_differential_equation_says():
    curve = {"viscous_friction": 4.0, "viscous_asymmetry": -1.5, "coulomb_friction": 2.0, "coulomb_asymmetry": 0.5}
    curve |= {"stribeck_friction": 5.0, "stribeck_velocity": 0.3, "load_friction": 0.1}
    effort = WEIGHT + 4.0

    def acceleration(_, velocity):
        other = 2.5 * velocity + 2.5 + 5.0 / (1 + (velocity / 0.3) ** 2)
        return ((effort - other) / 1.1 - WEIGHT) / MASS

    solution = solve_ivp(acceleration, (0, 0.5), [1.2], rtol=1e-10, atol=1e-12)
    errors = []
    for step in (1e-3, 5e-4):
        simulation = Simulation(lift(**curve), step=step)
        simulation.start(velocities=[1.2])
        errors.append(abs(simulation.advance(round(0.5 / step), efforts=[effort]).velocities[0] - solution.y[0, -1]))
    assert 0.1 < solution.y[0, -1] < 1.0
    assert errors[0] < 1e-3 and errors[1] < 0.6 * errors[0]


def test_sliding_block_stops_and_stays():
    simulation = Simulation(lift(**DRY, **STRIBECK))
    simulation.start(velocities=[0.5])
    state = simulation.advance(1000, efforts=[WEIGHT])
    position = state.positions[0]
    assert position > 0.01 and abs(state.velocities[0]) < 1e-14
    assert simulation.advance(500, efforts=[WEIGHT]).positions[0] == pytest.approx(position, abs=1e-13)


@pytest.mark.parametrize(("effort", "viscous"), [(0.5, 1.4), (-0.5, 0.6)])
def test_asymmetric_viscous_friction_too_strong_for_explicit_steps_still_damps(effort, viscous):
    robot = load_robot("""
robot: wheel
joints:
  - {joint: turn, link: wheel, mass: 1, inertia: {xx: 1, yy: 1, zz: 1e-6}, viscous_friction: 1, viscous_asymmetry: 0.4}
""")
    state = Simulation(robot).advance(100, efforts=[effort])
    assert state.velocities[0] == pytest.approx(effort / viscous, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "sr400"])
def test_work_of_the_efforts_is_energy_and_what_friction_dissipates(name):
    """Friction is that of the definition, at the loads that the frictionless robot needs for the simulated motion."""
    robot = with_random_friction(load_robot(name), 6)
    frictionless = Dynamics(without_friction(robot), compiled=False)
    simulation = Simulation(robot, step=2e-4)
    numbers = [robot.joint_numbers[name] for name in frictionless.joint_names]
    count = len(numbers)
    holding = frictionless.gravity(simulation.state.positions)
    work = lost = scale = 0.0
    before, energy = simulation.state, sum(simulation.energy())
    for _ in range(2000):
        efforts = holding + 12 * np.sin(6 * before.time + np.arange(count))
        after = simulation.advance(efforts=efforts)
        velocities = (after.velocities + before.velocities) / 2
        joint_velocities = (after.joint_velocities + before.joint_velocities) / 2
        q = (after.joint_positions + before.joint_positions) / 2
        loads = np.zeros(len(robot.joints))
        accelerations = (after.velocities - before.velocities) / 2e-4
        loads[numbers] = frictionless.inverse(q if robot.loops else q[numbers], velocities, accelerations)
        dissipated = all_friction(robot, joint_velocities, loads) @ joint_velocities
        assert dissipated >= 0
        lost += 2e-4 * dissipated
        work += 2e-4 * efforts @ velocities
        scale += 2e-4 * abs(efforts @ velocities)
        before = after
    change = sum(simulation.energy()) - energy
    assert lost > 0.2 * scale
    assert work == pytest.approx(change + lost, abs=1e-3 * scale)  # 1e-4 with steps of 1e-4 s
