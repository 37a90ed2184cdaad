"""Rollouts: each simulation is that of a Simulation alone, whatever the number of threads."""

from dataclasses import replace

import numpy as np
import pytest

from robot_dynamics import InvalidInputError, Simulation, load_robot, simulate

STEPS = 120
"""More than two calls of the program, which records 50 steps."""


def states_and_efforts(robot, samples, seed=0):
    simulation = Simulation(robot)
    rng = np.random.default_rng(seed)
    size = len(simulation.joint_names)
    positions = simulation.state.positions + 0.01 * rng.normal(size=(samples, size))
    return positions, 0.2 * rng.normal(size=(samples, size)), rng.normal(size=(samples, STEPS, size))


@pytest.mark.parametrize("name", ["panda", "puma560", "irb460", "gough_stewart"])
def test_rollouts_are_those_of_single_simulations(name):
    robot = load_robot(name)
    positions, velocities, efforts = states_and_efforts(robot, 3)
    rollouts = simulate(robot, positions, velocities, efforts)
    assert rollouts.positions.shape == rollouts.velocities.shape == (3, STEPS + 1, positions.shape[1])
    np.testing.assert_allclose(rollouts.times, 0.001 * np.arange(STEPS + 1), atol=1e-15)
    for sample in range(3):
        simulation = Simulation(robot)
        simulation.start(positions[sample], velocities[sample])
        for k in range(STEPS):
            state = simulation.advance(efforts=efforts[sample, k])
            np.testing.assert_allclose(rollouts.positions[sample, k + 1], state.positions, rtol=0, atol=1e-12)
            np.testing.assert_allclose(rollouts.velocities[sample, k + 1], state.velocities, rtol=0, atol=1e-10)


def test_results_do_not_depend_on_threads_or_other_simulations():
    robot = load_robot("panda")
    positions, velocities, efforts = states_and_efforts(robot, 40)
    single = simulate(robot, positions, velocities, efforts, threads=1)
    several = simulate(robot, positions, velocities, efforts, threads=4)
    alone = simulate(robot, positions[7], velocities[7], efforts[7])
    np.testing.assert_array_equal(single.positions, several.positions)
    np.testing.assert_array_equal(single.velocities, several.velocities)
    np.testing.assert_array_equal(single.velocities[7], alone.velocities[0])


def test_steps_that_need_parts_are_taken_by_simulation():
    robot = load_robot("panda")
    velocities = np.stack([np.full(9, 0.0), np.full(9, 25.0)])[:, : len(Simulation(robot).joint_names)]
    positions = np.tile(Simulation(robot).state.positions, (2, 1))
    efforts = np.zeros((20, positions.shape[1]))
    rollouts = simulate(robot, positions, velocities, efforts, step=0.01)
    simulation = Simulation(robot, step=0.01)
    simulation.start(positions[1], velocities[1])
    simulation.advance(20)
    np.testing.assert_allclose(rollouts.positions[1, -1], simulation.state.positions, atol=1e-9)


def test_mechanism_passes_a_dead_point_of_its_motor():
    """The coordinates change on the way: these steps are taken by Simulation."""
    robot = load_robot("four_bar")
    velocities = np.array([[8.0], [0.1]])
    positions = np.tile(Simulation(robot).state.positions, (2, 1))
    rollouts = simulate(robot, positions, velocities, np.zeros((600, 1)))
    simulation = Simulation(robot)
    simulation.start(positions[0], velocities[0])
    simulation.advance(600)
    np.testing.assert_allclose(rollouts.positions[0, -1], simulation.state.positions, atol=1e-8)


def test_progress_is_called_and_arguments_are_checked():
    robot = load_robot("panda")
    positions, velocities, efforts = states_and_efforts(robot, 2)
    parts = []
    simulate(robot, positions, velocities, efforts, progress=parts.append)
    np.testing.assert_allclose(parts, [50 / 120, 100 / 120, 1])
    with pytest.raises(InvalidInputError, match="efforts"):
        simulate(robot, positions, velocities, efforts[..., :-1])
    with pytest.raises(InvalidInputError, match="shape"):
        simulate(robot, positions, velocities, efforts[0, 0])
    with pytest.raises(InvalidInputError, match="simulations"):
        simulate(robot, positions[:1], np.tile(velocities, (2, 1))[:3], efforts)
    with pytest.raises(InvalidInputError, match="moving base"):
        simulate(replace(robot, moving_base=True), positions, velocities, efforts)
