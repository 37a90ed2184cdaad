"""Reactions to a collision: the robot stops, goes back on its path, or yields; references are refused meanwhile."""

import numpy as np
import pytest

from robot_dynamics import Dynamics, InvalidInputError, load_robot
from robot_dynamics.control.control_law import ControlLaw
from robot_dynamics.control.controller import Controller
from robot_dynamics.control.controller_settings import Settings
from robot_dynamics.control.path_history import PathHistory

MS = 1e-3
START = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.8, 0.3])
SPEED = 0.3 * np.array([1.0, -0.5, 0.8, 0.6, -1.0, 0.7, 1.0])


class MovingPanda:
    """A Panda under a controller; it is integrated by its direct model."""

    def __init__(self, mode="computed_torque"):
        self.dynamics = Dynamics(load_robot("panda"))
        self.law = ControlLaw(self.dynamics, self.dynamics.joint_names)
        gains = {"kp": np.full(7, 400.0), "kd": np.full(7, 40.0), "limits": np.full(7, 500.0)}
        self.controller = Controller(self.law, Settings(mode=mode, without_reference="gravity", **gains))
        self.q, self.qd, self.now = START.copy(), np.zeros(7), 0.0
        self.positions, self.efforts = [], []

    def run(self, seconds):
        for _ in range(round(seconds / MS)):
            self.law.q[:], self.law.qd[:] = self.q, self.qd
            efforts = self.controller.step(self.now)
            self.efforts.append(efforts.copy())
            self.qd = self.qd + MS * self.dynamics.direct(self.q, self.qd, efforts)
            self.q = self.q + MS * self.qd
            self.now += MS
            self.positions.append(self.q)

    def move(self):
        """Move at SPEED for a second, of a motion that would take longer."""
        times = np.array([0.0, 0.2, 3.0, 3.2])
        positions = np.stack([START, START + 0.1 * SPEED, START + 2.9 * SPEED, START + 3.0 * SPEED])
        velocities = np.stack([0 * SPEED, SPEED, SPEED, 0 * SPEED])
        self.controller.follow_trajectory(
            0.0, 0.0, times, np.stack([positions, velocities, np.full_like(positions, np.nan)])
        )
        self.run(1.0)


@pytest.fixture
def moving():
    panda = MovingPanda()
    panda.move()
    np.testing.assert_allclose(panda.qd, SPEED, atol=0.02)
    return panda


def test_robot_stops_within_the_ramp_time_and_stays(moving):
    where = moving.q
    moving.controller.react_to_collision(moving.now, "hold")
    moving.run(1.0)
    assert np.abs(moving.qd).max() < 1e-3
    assert np.abs(moving.q - where).max() < 0.1 * np.abs(SPEED).max()  # no farther than half a ramp, and its overshoot
    jumps = np.abs(np.diff(moving.efforts, axis=0)).max(axis=1)
    assert jumps[1000:1005].max() < 3.0  # the efforts begin where they were


def test_robot_goes_back_on_its_path_and_stays(moving):
    path = np.array(moving.positions)
    moving.controller.react_to_collision(moving.now, "retract")
    moving.run(1.5)
    half_a_second_before = path[-500]
    np.testing.assert_allclose(moving.q, half_a_second_before, atol=0.02)
    assert np.abs(moving.qd).max() < 2e-3
    distances = np.linalg.norm(np.array(moving.positions[1000:])[:, None] - path[None, ::10], axis=-1).min(axis=1)
    assert distances.max() < 0.05  # of the way back from the way there


def test_robot_yields(moving):
    moving.controller.react_to_collision(moving.now, "gravity_compensation")
    moving.run(0.3)
    expected = moving.dynamics.gravity(moving.law.q)
    np.testing.assert_allclose(moving.efforts[-1], expected, rtol=1e-9, atol=1e-9)
    assert moving.controller.no_reference_reason == "it ended with a collision"


@pytest.mark.parametrize("action", ["hold", "retract", "gravity_compensation"])
def test_references_are_refused_until_the_end(moving, action):
    controller = moving.controller
    controller.react_to_collision(moving.now, action)
    moving.run(0.01)
    with pytest.raises(InvalidInputError, match=f"a collision was reported, and the reaction is {action}"):
        controller.track_point(moving.now, moving.now, np.zeros((3, 7)))
    with pytest.raises(InvalidInputError, match="references are refused until it ends"):
        controller.follow_trajectory(moving.now, moving.now, [0.0], np.stack([START[None], *np.zeros((2, 1, 7))]))
    controller.end_collision()
    controller.track_point(moving.now, moving.now, np.stack([moving.q, moving.qd, 0 * SPEED]))
    assert controller.collision == "none"


def test_robot_without_a_path_stops():
    panda = MovingPanda()
    panda.run(0.001)
    panda.controller.react_to_collision(panda.now, "retract")
    panda.run(0.3)
    np.testing.assert_allclose(panda.q, START, atol=0.05)
    assert panda.controller.collision == "retract" and panda.controller.no_reference_reason == ""


def test_collision_in_a_fault_brings_no_efforts_back(moving):
    moving.controller.reject_state(moving.now, "a joint is missing")
    moving.controller.react_to_collision(moving.now, "hold")
    for tick in range(60):
        efforts = moving.controller.tick(moving.now + 5 * MS * tick)
    assert not efforts.any() and moving.controller.fault


def test_restart_ends_a_reaction(moving):
    moving.controller.react_to_collision(moving.now, "hold")
    moving.controller.restart()
    assert moving.controller.collision == "none"


def test_way_back_is_the_path_at_half_the_speed():
    history = PathHistory(0.5)
    for now in 0.021 * np.arange(95):
        assert history.is_due(now)
        history.record(now, np.array([[now**2], [2 * now]]))
    times, points = history.way_back(0.1)
    newest, oldest = 0.021 * 94, 0.021 * 94 - 0.5
    assert times[0] == pytest.approx(0.1) and times[-1] == pytest.approx(0.1 + 0.5 / 0.5, abs=0.041)
    np.testing.assert_allclose(points[0, [0, -1], 0], [newest**2, oldest**2], atol=0.07)
    slopes = np.gradient(points[0, :, 0], times)
    np.testing.assert_allclose(points[1, 1:-1, 0], slopes[1:-1], rtol=1e-6)
    assert points[1, -1, 0] == 0
    assert history.is_due(0.0) and history.way_back(0.1) is None  # the clock jumped back
