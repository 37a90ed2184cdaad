"""The motion of the simulated system is that of the direct dynamic model of the library."""

import subprocess

import numpy as np
import pytest
from player import BUILD

from robot_dynamics import Dynamics, load_robot


def simulate(robot, duration, states):
    """Positions and velocities (N, 2 n) after one step from states (N, 3 n): q, qd, efforts."""
    command = [str(BUILD / "simulate"), str(BUILD / "modules" / f"lib{robot}_module.so"), repr(duration)]
    text = "\n".join(" ".join(map(repr, row.tolist())) for row in states)
    done = subprocess.run(command, input=text, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return np.array([line.split() for line in done.stdout.splitlines()], dtype=float)


@pytest.mark.parametrize("robot", ["panda", "ur5e", "puma560", "rx90"])
def test_one_step_is_that_of_the_library(robot):
    """Runge-Kutta's method with the direct model of the library, which is another algorithm for the accelerations."""
    dynamics = Dynamics(load_robot(robot))
    n = len(dynamics.joint_names)
    states = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3 * n))
    states[:, 2 * n :] *= 20.0
    h = 1e-3
    moved = simulate(robot, h, states)

    def slope(state, efforts):
        return np.concatenate([state[n:], dynamics.direct(state[:n], state[n:], efforts)])

    for row, after in zip(states, moved, strict=True):
        state, efforts = row[: 2 * n], row[2 * n :]
        k1 = slope(state, efforts)
        k2 = slope(state + 0.5 * h * k1, efforts)
        k3 = slope(state + 0.5 * h * k2, efforts)
        k4 = slope(state + h * k3, efforts)
        expected = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        assert np.abs(after - expected).max() < 1e-9 * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("robot", ["four_bar", "free_flying_arm"])
def test_robots_that_cannot_be_simulated_are_refused(robot):
    command = [str(BUILD / "simulate"), str(BUILD / "modules" / f"lib{robot}_module.so"), "0.001"]
    done = subprocess.run(command, input="", capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and "trees on a fixed base" in done.stderr
