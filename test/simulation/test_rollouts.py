"""Rollouts: each simulation is that of a Simulation alone, whatever the number of threads."""

import importlib.util
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from peers.frictions import with_random_friction

from robot_dynamics import InvalidInputError, Simulation, SingularModelError, load_robot, simulate
from robot_dynamics.codegen.jit.procedure_code import ProcedureCode
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.simulation.ground import Ground
from robot_dynamics.simulation.rollout_runner import RolloutRunner

STEPS = 120
"""More than two calls of the program, which records 50 steps."""


@cache
def simulation_of(name):
    """A simulation whose programs several tests use."""
    return Simulation(load_robot(name))


def refuse(*_):
    raise AssertionError("not together in machine code")


def states_and_efforts(simulation, samples, seed=0):
    rng = np.random.default_rng(seed)
    size = len(simulation.joint_names)
    positions = simulation.stepping.resting_state().positions + 0.01 * rng.normal(size=(samples, size))
    return positions, 0.2 * rng.normal(size=(samples, size)), rng.normal(size=(samples, STEPS, size))


@pytest.mark.parametrize(
    ("name", "has_friction"),
    [(name, False) for name in ("panda", "puma560", "irb460", "gough_stewart")] + [("panda", True), ("irb460", True)],
)
def test_rollouts_are_those_of_single_simulations(name, has_friction, monkeypatch):
    """They are computed together: no procedure falls back to one sample after the other."""
    monkeypatch.setattr(ProcedureCode, "sample_loop_text", refuse)
    simulation = Simulation(with_random_friction(load_robot(name), 1)) if has_friction else simulation_of(name)
    positions, velocities, efforts = states_and_efforts(simulation, 3)
    rollouts = simulate(simulation, positions, velocities, efforts)
    assert rollouts.positions.shape == rollouts.velocities.shape == (3, STEPS + 1, positions.shape[1])
    np.testing.assert_allclose(rollouts.times, 0.001 * np.arange(STEPS + 1), atol=1e-15)
    for sample in range(3):
        simulation.start(positions[sample], velocities[sample])
        for k in range(STEPS):
            state = simulation.advance(efforts=efforts[sample, k])
            np.testing.assert_allclose(rollouts.positions[sample, k + 1], state.positions, rtol=0, atol=1e-12)
            np.testing.assert_allclose(rollouts.velocities[sample, k + 1], state.velocities, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", ["panda", "puma560", "gough_stewart"])
def test_results_do_not_depend_on_threads_or_other_simulations(name):
    simulation = simulation_of(name)
    positions, velocities, efforts = states_and_efforts(simulation, 43)
    single = simulate(simulation, positions, velocities, efforts, threads=1)
    several = simulate(simulation, positions, velocities, efforts, threads=4)
    part = slice(5, 18)
    some = simulate(simulation, positions[part], velocities[part], efforts[part])
    alone = simulate(simulation, positions[7], velocities[7], efforts[7])
    np.testing.assert_array_equal(single.positions, several.positions)
    np.testing.assert_array_equal(single.velocities, several.velocities)
    np.testing.assert_array_equal(single.positions[part], some.positions)
    np.testing.assert_array_equal(single.velocities[7], alone.velocities[0])


def test_a_simulation_lends_its_programs_and_keeps_its_state():
    simulation = Simulation(load_robot("four_bar"), step=0.002)
    simulation.start(velocities=[8.0])
    before = simulation.advance(3)
    positions = np.tile(simulation.stepping.resting_state().positions, (2, 1))
    velocities = np.array([[8.0], [0.1]])  # passes a dead point: Simulation takes some of the steps
    rollouts = simulate(simulation, positions, velocities, np.zeros((300, 1)))
    assert simulation.state is before
    simulation.reset()
    assert simulation.state.velocities == [8.0]
    expected = simulate(simulation.robot, positions, velocities, np.zeros((300, 1)), step=0.002)
    np.testing.assert_array_equal(rollouts.positions, expected.positions)
    np.testing.assert_array_equal(rollouts.times, expected.times)
    with pytest.raises(InvalidInputError, match=r"steps of 0\.002 s"):
        simulate(simulation, positions, velocities, np.zeros((1, 1)), step=0.001)


def test_starts_that_do_not_close_are_refused():
    simulation = simulation_of("irb460")
    positions = np.tile(simulation.state.positions, (3, 1))
    positions[1] += 5 * np.arange(positions.shape[1])
    with pytest.raises(SingularModelError, match="loop"):
        simulate(simulation, positions, np.zeros(positions.shape[1]), np.zeros((2, positions.shape[1])))


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
    positions, velocities, efforts = states_and_efforts(simulation_of("panda"), 2)
    parts = []
    simulate(robot, positions, velocities, efforts, progress=parts.append)
    np.testing.assert_allclose(parts, [50 / 120, 100 / 120, 1])
    with pytest.raises(InvalidInputError, match="efforts"):
        simulate(robot, positions, velocities, efforts[..., :-1])
    with pytest.raises(InvalidInputError, match="shape"):
        simulate(robot, positions, velocities, efforts[0, 0])
    with pytest.raises(InvalidInputError, match="simulations"):
        simulate(robot, positions[:1], np.tile(velocities, (2, 1))[:3], efforts)
    for wrong in (5, None, "panda", [], [5]):
        with pytest.raises(InvalidInputError, match="it must be a Robot, a Simulation, or several Robots"):
            simulate(wrong, positions, velocities, efforts)
    with pytest.raises(InvalidInputError, match="moving base"):
        simulate(replace(robot, moving_base=True), positions, velocities, efforts)


def robots_with_payloads(robot, samples):
    """Robots with a payload of their own on the last link, and other inertias of the first one."""
    rng = np.random.default_rng(5)
    robots = []
    for _ in range(samples):
        payload = Inertia.about_centre_of_mass(rng.uniform(0, 1.5), 1e-3 * np.eye(3), 0.05 * rng.normal(size=3))
        links = list(robot.links)
        links[1] = replace(links[1], inertia=links[1].inertia + links[1].inertia)
        robots.append(replace(robot, links=tuple(links)).with_payload(robot.frames[-1].name, payload))
    return robots


@pytest.mark.parametrize("name", ["panda", "puma560", "irb460"])
def test_each_simulation_may_have_inertias_of_its_own(name, monkeypatch):
    if importlib.util.find_spec("llvmlite") is not None:  # without it they are simulated one by one
        monkeypatch.setattr(ProcedureCode, "sample_loop_text", refuse)
        monkeypatch.setattr(RolloutRunner, "_advance_alone", refuse)
    robots = robots_with_payloads(load_robot(name), 5)
    positions, velocities, efforts = states_and_efforts(simulation_of(name), 5)
    rollouts = simulate(robots, positions, velocities, efforts[:, :60])
    for sample in (0, 4):
        alone = simulate(robots[sample], positions[sample], velocities[sample], efforts[sample, :60])
        np.testing.assert_allclose(rollouts.positions[sample], alone.positions[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(rollouts.velocities[sample], alone.velocities[0], rtol=0, atol=1e-10)
    assert (
        np.abs(rollouts.velocities[0] - simulate(robots[1], positions[0], velocities[0], efforts[0, :60])[2][0]).max()
        > 1e-4
    )


def test_steps_that_machine_code_leaves_are_taken_with_the_own_robot():
    """The mechanism passes a dead point of its motor, where its coordinates change."""
    robots = [load_robot("four_bar"), robots_with_payloads(load_robot("four_bar"), 1)[0]]
    position = simulation_of("four_bar").stepping.resting_state().positions
    rollouts = simulate(robots, position, np.array([8.0]), np.zeros((300, 1)))
    for robot, positions in zip(robots, rollouts.positions, strict=True):
        simulation = Simulation(robot)
        simulation.start(position, [8.0])
        simulation.advance(300)
        np.testing.assert_allclose(positions[-1], simulation.state.positions, rtol=0, atol=1e-8)
    assert np.abs(rollouts.positions[0] - rollouts.positions[1]).max() > 1e-3


def test_robots_that_differ_in_more_than_inertias_are_refused():
    robot = load_robot("panda")
    positions, velocities, efforts = states_and_efforts(simulation_of("panda"), 2)
    with pytest.raises(InvalidInputError, match="robot 1 differs from robot 0 in more"):
        simulate([robot, replace(robot, gravity=np.zeros(3))], positions, velocities, efforts)
    with pytest.raises(InvalidInputError, match="number of robots, 3"):
        simulate([robot] * 3, positions, velocities, efforts)
    with pytest.raises(InvalidInputError, match="several Robots"):
        simulate([], positions, velocities, efforts)
    same = simulate([robot, load_robot("panda")], positions, velocities, efforts)
    np.testing.assert_array_equal(same.positions, simulate(robot, positions, velocities, efforts).positions)


def test_a_simulation_with_wrenches_lends_its_robot_and_one_with_ground_is_refused():
    robot = load_robot("panda")
    positions, velocities, efforts = states_and_efforts(simulation_of("panda"), 2)
    simulation = Simulation(robot)
    simulation.advance(external_wrenches={robot.links[-1].name: [1, 0, 0, 0, 0, 0]})
    rollouts = simulate(simulation, positions, velocities, efforts)
    np.testing.assert_array_equal(rollouts.positions, simulate(robot, positions, velocities, efforts).positions)
    ground = Ground((robot.links[-1].name,), height=-1.0)
    with pytest.raises(InvalidInputError, match="ground"):
        simulate(Simulation(robot, ground=ground), positions, velocities, efforts)


def test_an_executor_takes_a_simulation():
    positions, velocities, efforts = states_and_efforts(simulation_of("panda"), 2)
    with ThreadPoolExecutor(1) as executor:
        rollouts = simulate(simulation_of("panda"), positions, velocities, efforts, executor=executor)
    expected = simulate(simulation_of("panda"), positions, velocities, efforts)
    np.testing.assert_array_equal(rollouts.velocities, expected.velocities)
