"""The compiled rates of all joints: those of velocity loops of the test's own Jacobian, and of NumPy."""

import threading
import time

import numpy as np
import pytest

pytest.importorskip("llvmlite")
from peers.loop_states import closed_rates

from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.codegen.jit.background import THREAD_NAME

pytestmark = pytest.mark.slow  # compiles models of all robots that ship

LOOPED = [name for name in shipped_robots() if load_robot(name).loops]


def wait_for_programs():
    end = time.monotonic() + 120
    while any(thread.name == THREAD_NAME for thread in threading.enumerate()):
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.fixture(scope="module", params=LOOPED)
def dynamics(request):
    compiled = Dynamics(load_robot(request.param))
    compiled.compile("closure")
    compiled.expand_velocities(np.zeros(len(compiled.joint_names)), compiled.initial_joint_positions)
    wait_for_programs()
    return compiled


def positions(dynamics):
    start = dynamics.initial_joint_positions
    motors = start[[dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]]
    return dynamics.expand_positions(motors + 0.02 * np.sin(np.arange(len(motors))), previous=start)


def test_velocities_keep_the_loops_closed(dynamics):
    q = positions(dynamics)
    qd = np.linspace(-1.0, 2.0, len(dynamics.joint_names))
    rates = np.zeros(len(q))
    rates[[dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]] = qd
    dependent = [dynamics.robot.joint_numbers[name] for name in dynamics.dependent_joint_names]
    dependent = [number for number in dependent if dynamics.robot.joints[number].mimic is None]
    assert dynamics._closure_solver.procedures._programs.get_ready_program("joint_rates", None) is not None
    expected = closed_rates(dynamics.robot, q, rates, dependent)
    np.testing.assert_allclose(dynamics.expand_velocities(qd, q), expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_program_and_numpy_agree_also_at_rest_and_for_other_arguments(dynamics):
    q = positions(dynamics)
    others = Dynamics(dynamics.robot, compiled=False)
    motors = q[[dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]]
    for qd in (np.zeros(len(motors)), np.cos(np.arange(len(motors)))):
        expected = others.expand_velocities(qd, q)
        actual = dynamics.expand_velocities(np.repeat(qd, 2)[::2], list(q))
        np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-11 * (1 + np.abs(expected).max()))
        batch = dynamics.expand_velocities(np.tile(qd, (2, 1)), q)
        np.testing.assert_allclose(batch, np.tile(expected, (2, 1)), rtol=0, atol=1e-11 * (1 + np.abs(expected).max()))
