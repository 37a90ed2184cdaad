"""Simulation: repeatability, reset, continuation, accelerations, invalid arguments."""

import numpy as np
import pytest
from peers.flying_arm import TWIST, VELOCITIES

from robot_dynamics import Base, InvalidInputError, RobotDynamicsError, load_robot
from robot_dynamics.errors import SimulationError
from robot_dynamics.simulation import Simulation

EFFORTS = np.array([3.0, -2.0, 1.0, 0.1, -0.1, 0.01])


def run(simulation):
    wrenches = {"arm_tool0": [1.0, 2.0, 0.5, 0.1, 0.0, 0.2]}
    simulation.advance(50, efforts=EFFORTS)
    return simulation.advance(50, efforts=-EFFORTS, external_wrenches=wrenches)


def assert_same(first, second):
    assert (first.steps, first.time) == (second.steps, second.time)
    for name in ("pose", "twist", "positions", "velocities", "joint_positions"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name), err_msg=name)


def test_simulation_repeats_bit_for_bit_and_resets_exactly():
    ends = []
    for _ in range(2):
        simulation = Simulation(load_robot("free_flying_arm"))
        simulation.start(velocities=VELOCITIES, base=Base(twist=TWIST))
        start = simulation.state
        ends.append(run(simulation))
        simulation.reset()
        assert_same(simulation.state, start)
        ends.append(run(simulation))
    for end in ends[1:]:
        assert_same(ends[0], end)


def test_continue_from_takes_over_the_state_of_another_simulation():
    first, second = Simulation(load_robot("free_flying_arm")), Simulation(load_robot("free_flying_arm"), step=5e-4)
    first.start(velocities=VELOCITIES, base=Base(twist=TWIST))
    first_state = first.advance(50, efforts=EFFORTS)
    second_start = second.state
    second.continue_from(first)
    assert second.state.time == 0 and first.state is first_state
    np.testing.assert_array_equal(second.state.rates, first_state.rates)
    first.advance(50, efforts=EFFORTS)
    second.advance(100, efforts=EFFORTS)
    np.testing.assert_allclose(second.state.positions, first.state.positions, atol=1e-9)
    np.testing.assert_allclose(second.state.pose, first.state.pose, atol=1e-9)
    second.reset()
    assert_same(second.state, second_start)
    with pytest.raises(InvalidInputError, match=r"cannot continue from .* on a free base"):
        Simulation(load_robot("ur5e")).continue_from(first)


def test_external_wrench_acts_as_in_the_direct_model():
    simulation = Simulation(load_robot("ur5e"))
    q, qd, wrench = np.full(6, 0.3), np.full(6, 0.2), np.array([5.0, -3.0, 2.0, 0.3, 0.2, -0.1])
    simulation.start(q, qd)
    base, qdd = simulation.accelerations(efforts=EFFORTS, external_wrenches={"tool0": wrench})
    expected = simulation.dynamics.direct(q, qd, EFFORTS, external_wrenches={"tool0": wrench})
    np.testing.assert_allclose(qdd, expected, rtol=1e-10)
    np.testing.assert_array_equal(base, 0)


def test_acceleration_of_the_base_is_the_derivative_of_its_velocity():
    simulation = Simulation(load_robot("free_flying_arm"), step=1e-4)
    simulation.start(velocities=VELOCITIES, base=Base(twist=[0.3, -0.5, 0.2, 0.4, 0.6, -0.3]))
    samples = []
    for _ in range(3):
        state = simulation.state
        samples.append((state.pose[:3, :3] @ state.twist[:3], state.pose[:3, :3], simulation.accelerations()[0]))
        simulation.advance()
    (before, _, _), (_, R, acceleration), (after, _, _) = samples
    np.testing.assert_allclose(R @ acceleration[:3], (after - before) / 2e-4, atol=1e-6)


def test_diverging_simulation_raises_and_keeps_the_last_good_state():
    simulation = Simulation(load_robot("ur5e"), step=0.01)
    simulation.start(velocities=np.full(6, 3000.0))
    with pytest.raises(SimulationError, match="step is too long"):
        simulation.advance(200)
    assert np.isfinite(simulation.state.velocities).all()
    simulation.reset()
    assert simulation.state.time == 0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: s.advance(efforts=[1.0]), r"efforts has shape \(1,\)"),
        (lambda s: s.advance(efforts=[np.nan] * 6), r"efforts\[0\] is nan"),
        (lambda s: s.advance(external_wrenches={"hand": np.zeros(6)}), "unknown link 'hand'"),
        (lambda s: s.start(positions=[0.0]), "positions has shape"),
        (lambda s: s.start(base=Base(twist=[1, 0, 0, 0, 0, 0])), "the base is fixed"),
        (lambda s: Simulation("ur5e"), "takes a Robot"),
        (lambda s: Simulation(s.robot, step=-1), "step is -1"),
        (lambda s: s.momentum(), "no momentum of its own"),
    ],
)
def test_invalid_arguments_are_refused(call, message):
    simulation = Simulation(load_robot("ur5e"))
    with pytest.raises(RobotDynamicsError, match=message) as caught:
        call(simulation)
    assert isinstance(caught.value, InvalidInputError)
    assert simulation.state.steps == 0


def test_state_arrays_are_read_only():
    state = Simulation(load_robot("ur5e")).state
    with pytest.raises(ValueError, match="read-only"):
        state.positions[0] = 1.0


@pytest.mark.parametrize("steps", [1.5, -5, "3", None, np.nan])
def test_invalid_numbers_of_steps_are_refused(steps):
    simulation = Simulation(load_robot("free_flying_arm"))
    message = r"cannot advance by .* steps: a non-negative integer is needed.*a step is 0.001 s"
    with pytest.raises(InvalidInputError, match=message):
        simulation.advance(steps)
    assert simulation.advance(0).steps == 0 and simulation.advance(np.int64(2)).steps == 2


def test_steps_in_python_are_counted():
    """Those with prescribed motion are taken in Python, all others of this arm in machine code."""
    pytest.importorskip("llvmlite")
    simulation = Simulation(load_robot("ur5e"))
    simulation.advance(20, efforts=EFFORTS)
    assert simulation.python_steps == 0
    simulation.advance(3, motion=lambda time: (np.zeros(6), np.zeros(6), np.zeros(6)))
    assert simulation.python_steps == 3
    simulation.start()
    simulation.advance(2)
    assert simulation.python_steps == 3


def test_a_motion_that_is_no_function_is_refused():
    simulation = Simulation(load_robot("ur5e"))
    with pytest.raises(InvalidInputError, match=r"motion is .*: it must be a function of the time"):
        simulation.advance(motion=np.zeros(6))
    assert repr(simulation) == "Simulation(Robot('ur5e', 6 joints, fixed base), step=0.001, base='fixed')"
