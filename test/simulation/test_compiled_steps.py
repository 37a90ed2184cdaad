"""Steps in machine code are those of Python, and end where a step must be divided."""

import numpy as np
import pytest

pytest.importorskip("llvmlite")
from robot_dynamics import InvalidInputError, Simulation, load_robot, shipped_robots
from robot_dynamics.codegen.jit.compiled_program import CompiledProgram

pytestmark = pytest.mark.slow  # compiles models of all robots that ship

ROBOTS = [name for name in shipped_robots() if not load_robot(name).moving_base]


def step_in_python(simulation, steps, efforts):
    """Advance by single steps that do not use the program."""
    programs = simulation.stepping._programs
    simulation.stepping._programs = None
    for _ in range(steps):
        simulation.advance(efforts=efforts)
    simulation.stepping._programs = programs


@pytest.mark.parametrize("name", ROBOTS)
def test_steps_in_machine_code_and_in_python_agree(name):
    robot = load_robot(name)
    compiled, python = Simulation(robot), Simulation(robot)
    rng = np.random.default_rng(0)
    size = len(compiled.joint_names)
    velocities = rng.uniform(-0.5, 0.5, size)
    for simulation in (compiled, python):
        simulation.start(velocities=velocities)
    for _ in range(3):
        efforts = rng.uniform(-1, 1, size)
        compiled.advance(30, efforts=efforts)
        step_in_python(python, 30, efforts)
        (program,) = compiled.stepping._programs._programs.values()
        assert isinstance(program, CompiledProgram)
        assert compiled.state.steps == python.state.steps
        assert compiled.state.time == python.state.time
        scale = 1 + np.abs(python.state.velocities).max()
        np.testing.assert_allclose(compiled.state.positions, python.state.positions, rtol=0, atol=1e-9 * scale)
        np.testing.assert_allclose(compiled.state.velocities, python.state.velocities, rtol=0, atol=1e-9 * scale)
        np.testing.assert_allclose(
            compiled.state.joint_velocities, python.state.joint_velocities, rtol=0, atol=1e-9 * scale
        )


def test_many_steps_equal_single_steps_exactly():
    many, single = Simulation(load_robot("puma560")), Simulation(load_robot("puma560"))
    many.advance(50)
    for _ in range(50):
        single.advance()
    np.testing.assert_array_equal(many.state.positions, single.state.positions)
    np.testing.assert_array_equal(many.state.velocities, single.state.velocities)


def test_dry_friction_holds_a_joint_at_rest_exactly():
    simulation = Simulation(load_robot("puma560"))
    start = simulation.state
    weights = simulation.dynamics.gravity(simulation.state.positions)
    simulation.advance(200, efforts=weights)
    np.testing.assert_allclose(simulation.state.velocities, 0, atol=1e-15)
    np.testing.assert_allclose(simulation.state.positions, start.positions, atol=1e-15)


def test_steps_that_are_too_long_are_divided():
    """At 100 rad/s a step of 10 ms needs parts: the program leaves it to Python, and goes on where it can."""
    simulation = Simulation(load_robot("panda"), step=0.01)
    size = len(simulation.joint_names)
    simulation.start(velocities=np.full(size, 30.0))
    q, rates = simulation.state.positions, simulation.state.velocities
    assert simulation.stepping._programs.advance(5, q, rates, np.zeros(size), None) is None
    simulation.advance(5)
    assert simulation.state.steps == 5
    fine = Simulation(load_robot("panda"), step=0.0005)
    fine.start(velocities=np.full(size, 30.0))
    fine.advance(100)
    np.testing.assert_allclose(simulation.state.positions, fine.state.positions, atol=1e-4)


def test_wrenches_and_prescribed_motion_take_the_other_way():
    simulation = Simulation(load_robot("panda"))
    link = simulation.robot.links[-1].name
    size = len(simulation.joint_names)
    simulation.advance(2, external_wrenches={link: np.array([10.0, 0, 0, 0, 0, 0])})
    pushed = simulation.state.velocities
    simulation.start()
    simulation.advance(2)
    assert np.abs(simulation.state.velocities - pushed).max() > 1e-4
    simulation.advance(3, motion=lambda time: (np.full(size, time), np.ones(size), np.zeros(size)))
    np.testing.assert_allclose(simulation.state.positions, simulation.state.time)


def test_efforts_that_are_not_finite_are_refused():
    simulation = Simulation(load_robot("panda"))
    with pytest.raises(InvalidInputError, match="efforts"):
        simulation.advance(3, efforts=np.full(len(simulation.joint_names), np.nan))
    assert simulation.state.steps == 0
