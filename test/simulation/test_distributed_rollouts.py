"""Rollouts in other processes and on a Dask cluster are those of this process, bit for bit."""

from concurrent.futures import Executor, Future

import numpy as np
import pytest
from peers.cluster import cluster_executor

from robot_dynamics import Inertia, InvalidInputError, Simulation, SimulationError, load_robot, simulate
from robot_dynamics.simulation import distributed_rollouts

SAMPLES = 21
STEPS = 60


@pytest.fixture(scope="module")
def executor():
    with cluster_executor() as opened:
        yield opened


class ThisProcess(Executor):
    """Runs each task at once, and counts them."""

    def __init__(self):
        self.tasks = 0

    def submit(self, function, /, *arguments, **options):
        self.tasks += 1
        future = Future()
        try:
            future.set_result(function(*arguments, **options))
        except Exception as error:
            future.set_exception(error)
        return future


def states_and_efforts(robot):
    simulation = Simulation(robot)
    rng = np.random.default_rng(5)
    size = len(simulation.joint_names)
    positions = simulation.state.positions + 0.01 * rng.normal(size=(SAMPLES, size))
    return positions, 0.2 * rng.normal(size=(SAMPLES, size)), rng.normal(size=(SAMPLES, STEPS, size))


@pytest.mark.slow
@pytest.mark.timeout(120)
@pytest.mark.parametrize("name", ["panda", "four_bar"])
def test_rollouts_of_a_cluster_are_those_of_one_process(name, executor, monkeypatch):
    monkeypatch.setattr(distributed_rollouts, "TASK_STEPS", 8 * STEPS)
    robot = load_robot(name)
    positions, velocities, efforts = states_and_efforts(robot)
    parts = []
    local = simulate(robot, positions, velocities, efforts)
    remote = simulate(robot, positions, velocities, efforts, executor=executor, progress=parts.append)
    for ours, theirs in zip(remote, local, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_allclose(parts, [8 / SAMPLES, 16 / SAMPLES, 1])


def test_ranges_of_simulations_are_in_order_whatever_the_shapes(monkeypatch):
    monkeypatch.setattr(distributed_rollouts, "TASK_STEPS", 8 * STEPS)
    robot = load_robot("puma560")
    positions, velocities, efforts = states_and_efforts(robot)
    for arguments, tasks in (
        ((positions, velocities, efforts), 3),
        ((positions, velocities[0], efforts[0]), 3),
        ((positions, velocities[0], efforts[:1]), 3),
        ((positions[0], velocities[0], efforts[0]), 1),
        ((positions[0], velocities[0], efforts[0, :0]), 1),
    ):
        executor = ThisProcess()
        local = simulate(robot, *arguments)
        remote = simulate(robot, *arguments, executor=executor)
        assert executor.tasks == tasks
        np.testing.assert_array_equal(remote.positions, local.positions)
        np.testing.assert_array_equal(remote.velocities, local.velocities)


def test_errors_of_tasks_are_raised():
    robot = load_robot("puma560")
    positions, velocities, efforts = states_and_efforts(robot)
    efforts[11] = 1e300
    for executor in (None, ThisProcess()):
        with pytest.raises(SimulationError, match=r"^simulation 11: at 0 s"):
            simulate(robot, positions, velocities, efforts, executor=executor)


def test_robots_of_their_own_are_those_of_one_process(monkeypatch):
    """Some ranges have robots that differ in fewer links than all of them, and one has equal robots."""
    monkeypatch.setattr(distributed_rollouts, "TASK_STEPS", 8 * STEPS)
    robot = load_robot("puma560")
    positions, velocities, efforts = states_and_efforts(robot)
    robots = [robot] * 8
    for mass in np.linspace(0, 2, SAMPLES - 8):
        payload = Inertia.about_centre_of_mass(mass, np.zeros((3, 3)), [0, 0, 0.1])
        robots.append(robot.with_payload(robot.links[-1 if mass > 1 else -2].name, payload))
    executor = ThisProcess()
    local = simulate(robots, positions, velocities, efforts)
    remote = simulate(robots, positions, velocities, efforts, executor=executor)
    assert executor.tasks == 3
    np.testing.assert_array_equal(remote.positions, local.positions)
    np.testing.assert_array_equal(remote.velocities, local.velocities)


def test_what_is_no_executor_is_refused():
    robot = load_robot("puma560")
    positions, velocities, efforts = states_and_efforts(robot)
    for wrong in ("tcp://localhost:8786", map, object()):
        with pytest.raises(InvalidInputError, match=r"client.get_executor\(pure=False\)"):
            simulate(robot, positions, velocities, efforts, executor=wrong)
