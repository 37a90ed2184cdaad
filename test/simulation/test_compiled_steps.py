"""Steps in machine code are those of Python, and end where a step must be divided."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from peers.large_robots import each_robot

pytest.importorskip("llvmlite")
from peers.frictions import with_random_friction
from peers.wheeled_robots import tricycle

from robot_dynamics import Base, Inertia, InvalidInputError, Simulation, load_robot, shipped_robots
from robot_dynamics.simulation import Ground, Wheel, step_programs

pytestmark = pytest.mark.slow  # compiles models of all robots that ship

TRICYCLE = (Wheel("rear_left", 0.12), Wheel("rear_right", 0.12), Wheel("front", 0.1))
WRENCH = np.array([10.0, 20.0, 30.0, 1.0, 2.0, 3.0])
ROBOTS = [name for name in shipped_robots() if not load_robot(name).moving_base]


def step_in_python(simulation, steps, **inputs):
    """Advance by single steps that do not use the program."""
    programs = simulation.stepping._programs
    simulation.stepping._programs = None
    for _ in range(steps):
        simulation.advance(**inputs)
    simulation.stepping._programs = programs


def assert_steps_agree(robot, options=None, inputs=None, base=None, calls=3):
    """Steps of machine code and of Python from one state; every call of the former must be machine code."""
    options, inputs = options or {}, inputs or {}
    compiled, python = Simulation(robot, **options), Simulation(robot, **options)
    rng = np.random.default_rng(0)
    size = len(compiled.joint_names)
    velocities = rng.uniform(-0.5, 0.5, size)
    for simulation in (compiled, python):
        simulation.start(velocities=velocities, base=base)
    compiled.stepping.step = None  # the step of Python
    for _ in range(calls):
        efforts = rng.uniform(-1, 1, size)
        compiled.advance(30, efforts=efforts, **inputs)
        step_in_python(python, 30, efforts=efforts, **inputs)
        assert compiled.state.steps == python.state.steps
        assert compiled.state.time == python.state.time
        scale = 1 + np.abs(python.state.velocities).max()
        for field in ("positions", "velocities", "joint_velocities", "pose", "twist"):
            values, expected = getattr(compiled.state, field), getattr(python.state, field)
            np.testing.assert_allclose(values, expected, rtol=0, atol=1e-9 * scale, err_msg=field)
    assert np.abs(python.state.velocities).max() > 0
    return compiled


def with_heavy_base(robot):
    """The robot with a base that has an inertia, for robots that are described on a fixed one."""
    base, *links = robot.links
    inertia = Inertia.about_centre_of_mass(50.0, np.diag([3.0, 4, 5]), np.eye(4))
    return replace(robot, links=(replace(base, inertia=inertia), *links))


@pytest.mark.parametrize("name", each_robot(ROBOTS))
def test_steps_in_machine_code_and_in_python_agree(name):
    assert_steps_agree(load_robot(name))


@pytest.mark.parametrize("name", ["panda", "puma560", "rx90", "irb460", "four_bar"])
def test_friction_of_all_kinds_is_that_of_python(name):
    assert_steps_agree(with_random_friction(load_robot(name), 1))


@pytest.mark.parametrize("name", ["ur5e", "irb460"])
def test_external_wrenches_are_those_of_python(name):
    robot = load_robot(name)
    simulation = assert_steps_agree(robot, inputs={"external_wrenches": {robot.links[-1].name: WRENCH}})
    velocities = simulation.state.velocities
    assert np.abs(assert_steps_agree(robot).state.velocities - velocities).max() > 1e-3


@pytest.mark.parametrize(
    "robot",
    [
        load_robot("free_flying_arm"),
        with_random_friction(load_robot("free_flying_arm"), 2),
        with_heavy_base(load_robot("irb460")),
    ],
)
def test_free_bases_move_as_in_python(robot):
    base = Base(twist=np.array([0.1, 0.2, -0.1, 0.3, 0.2, 0.5]))
    simulation = assert_steps_agree(robot, {"base": "free"}, base=base)
    momentum = simulation.momentum()
    simulation.advance(200)  # gravity alone changes the momentum
    mass = sum(link.inertia.mass for link in robot.links)
    change = 0.2 * mass * robot.gravity
    np.testing.assert_allclose(simulation.momentum().linear - momentum.linear, change, atol=1e-11 * mass)
    np.testing.assert_allclose(simulation.momentum().angular, momentum.angular, atol=1e-9)


def test_momentum_is_not_kept_while_a_wrench_acts():
    robot = load_robot("free_flying_arm", gravity=[0, 0, 0])
    assert_steps_agree(robot, inputs={"external_wrenches": {robot.links[0].name: WRENCH}})
    simulation = Simulation(robot)
    simulation.advance(90, external_wrenches={robot.links[0].name: WRENCH})
    pushed = simulation.momentum().linear
    np.testing.assert_allclose(pushed, 0.09 * WRENCH[:3], rtol=0.02)  # the base turns a little
    simulation.advance(50)
    np.testing.assert_allclose(simulation.momentum().linear, pushed, atol=1e-12)


@pytest.mark.parametrize("inputs", [{}, {"drive": [0.1, 0, 0, 0, 0, 0.5]}])
@pytest.mark.parametrize("has_friction", [False, True])
def test_wheels_roll_as_in_python(inputs, has_friction):
    robot = load_robot("turtlebot3_burger")
    robot = with_random_friction(robot, 3) if has_friction else robot
    wheels = [Wheel("wheel_left_joint", 0.033), Wheel("wheel_right_joint", 0.033)]
    simulation = assert_steps_agree(robot, {"wheels": wheels}, inputs)
    np.testing.assert_allclose(simulation.rolling_residual(), 0, atol=1e-12)


@pytest.mark.parametrize("name", ["ur5e", "irb460"])
def test_bases_that_slide_in_a_plane_move_as_in_python(name):
    assert_steps_agree(with_heavy_base(load_robot(name)), {"base": "planar"})
    assert_steps_agree(with_heavy_base(load_robot(name)), {"base": "planar"}, {"drive": [0.1, 0.2, 0, 0, 0, 0.3]})


@pytest.mark.parametrize("base", ["fixed", "free"])
def test_ground_pushes_as_in_python(base):
    """The tip begins above the ground and falls into it: the step in which it does so is divided."""
    robot = with_heavy_base(load_robot("ur5e"))
    height = Simulation(robot).dynamics.link_pose("tool0", np.zeros(6))[2, 3]
    ground = Ground(("tool0",), height=height - 1e-4, slip_velocity=0.1)
    simulation = assert_steps_agree(robot, {"base": base, "ground": ground})
    free = Simulation(robot, base=base)
    free.start(velocities=np.random.default_rng(0).uniform(-0.5, 0.5, 6))
    free.advance(90)
    assert np.abs(simulation.state.velocities - free.state.velocities).max() > 1e-2


def test_steered_wheels_take_the_steps_of_python():
    simulation = Simulation(load_robot(tricycle()), wheels=TRICYCLE, step=0.004)
    assert simulation.stepping._programs.program("advance", None) is None


@pytest.mark.parametrize(
    ("name", "options"), [("irb460", {}), ("puma560", {}), ("free_flying_arm", {}), ("ur5e", {"base": "planar"})]
)
def test_no_step_waits_for_a_compiler(name, options, monkeypatch):
    simulation = Simulation(with_heavy_base(load_robot(name)), **options)
    monkeypatch.setattr(step_programs, "compile_procedure", lambda *_: pytest.fail("a step compiles"))
    simulation.advance(3)
    if simulation.base == "planar":
        simulation.advance(3, drive=[0.1, 0, 0, 0, 0, 0])


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


def test_steps_that_are_too_long_are_divided(caplog):
    """At 30 rad/s a step of 10 ms needs parts: machine code takes them as Python does, and warns once."""
    simulation, python = (Simulation(load_robot("panda"), step=0.01) for _ in range(2))
    size = len(simulation.joint_names)
    for divided in (simulation, python):
        divided.start(velocities=np.full(size, 30.0))
    step_in_python(python, 5)
    simulation.stepping.step = None
    with caplog.at_level(logging.WARNING):
        simulation.advance(5)
    assert simulation.state.steps == 5
    assert [record.getMessage() for record in caplog.records if "are too long" in record.getMessage()]
    np.testing.assert_allclose(simulation.state.positions, python.state.positions, atol=1e-9)
    fine = Simulation(load_robot("panda"), step=0.0005)
    fine.start(velocities=np.full(size, 30.0))
    fine.advance(100)
    np.testing.assert_allclose(simulation.state.positions, fine.state.positions, atol=1e-4)


def test_wrenches_and_prescribed_motion_move_the_robot():
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
