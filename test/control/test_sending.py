"""Efforts on their way through a sender that takes long: none that answers a stale state is the last that leaves."""

import numpy as np
import pytest

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.control.control_law import ControlLaw, actuated_joint_names
from robot_dynamics.control.controller import Controller, Settings
from robot_dynamics.control.sending import send_in_time

DYNAMICS = Dynamics(load_robot("panda"), compiled=False)
Q = np.array([0.1, -0.5, 0.2, -1.8, 0.1, 1.4, 0.3])
MS = 1e-3
TIMEOUT, RAMP = 20 * MS, 0.5  # [s]


class Sender:
    """A publisher that blocks for `durations` [s] one call after the other, the last for ever on, by a clock that
    stands still meanwhile; left: [(time, efforts)] of what it sent."""

    def __init__(self, *durations):
        self.durations, self.now, self.left, self.calls = list(durations), 0.0, [], 0
        law = ControlLaw(DYNAMICS, actuated_joint_names(DYNAMICS))
        kp, kd, limits = np.full(7, 100.0), np.full(7, 20.0), np.full(7, np.inf)
        self.controller = Controller(law, Settings("gravity_compensation", kp, kd, limits, ramp_time=RAMP))

    def send(self, efforts, stamp, until):
        self.calls += 1
        assert self.calls <= 3, "efforts are sent again and again, and nothing else is done"
        if self.now > until:
            return False
        self.now += self.durations.pop(0) if len(self.durations) > 1 else self.durations[0]
        self.left.append((self.now, efforts.copy(), stamp))
        return self.now <= until

    def answer_state(self):
        self.controller.law.q[:], self.controller.law.qd[:] = Q, 0.0
        self._send_on(self.controller.step(self.now), stamp="of the state")

    def tick(self):
        efforts = self.controller.tick(self.now)
        if efforts is not None:
            self._send_on(efforts)

    def _send_on(self, efforts, stamp=None):
        self.calls = 0
        send_in_time(self.controller, self.send, lambda: self.now, efforts, stamp, self.now + TIMEOUT, lambda: self.now)

    def settle(self):
        """Send the efforts of states each ms until they hold the robot."""
        usual, self.durations = self.durations, [0.0]
        for _ in range(600):
            self.answer_state()
            self.now += MS
        np.testing.assert_allclose(self.left[-1][1], DYNAMICS.gravity(Q), rtol=1e-9, atol=1e-9)
        self.durations, self.left = usual, []


@pytest.mark.parametrize("duration", [1.001 * TIMEOUT, 0.3, 10.0])
def test_a_sender_that_is_always_too_slow_is_called_three_times_and_zeros_are_last(duration):
    sender = Sender(duration)
    sender.settle()
    for _ in range(20):
        sender.answer_state()
        assert sender.calls == 3 and not sender.left[-1][1].any() and sender.left[-1][2] is None
        assert sender.controller.fault == "it takes longer than state_timeout, 20 ms, to send efforts"
        sender.now += MS
    sender.tick()
    assert not sender.left[-1][1].any()


def test_zeros_stay_until_a_good_state_which_brings_efforts_back_by_a_ramp():
    sender = Sender(2 * TIMEOUT, 2 * TIMEOUT, 0.0)
    sender.settle()
    sender.answer_state()
    assert len(sender.left) == 3 and sender.left[1][1].any(), "the ramp to zero had not ended"
    began = len(sender.left) - 1
    for _ in range(30):
        sender.now += 5 * MS
        sender.tick()
    assert len(sender.left) == began + 31 and not np.any([efforts for _, efforts, _ in sender.left[began:]])
    began = len(sender.left)
    for _ in range(600):
        sender.now += MS
        sender.answer_state()
    back = np.array([efforts for _, efforts, _ in sender.left[began - 1 :]])
    steps = np.abs(np.diff(back, axis=0)).max()
    assert steps < 1.01 * np.abs(DYNAMICS.gravity(Q)).max() * MS / RAMP
    np.testing.assert_allclose(back[-1], DYNAMICS.gravity(Q), rtol=1e-9, atol=1e-9)


def test_efforts_that_are_late_once_are_followed_by_those_on_the_way_to_zero():
    sender = Sender(2 * TIMEOUT, 0.0)
    sender.settle()
    sender.answer_state()
    (_, stale, stamp), (_, sent, without) = sender.left
    assert stamp == "of the state" and without is None
    assert 0 < np.abs(sent).max() < np.abs(stale).max() and sender.controller.fault


def test_efforts_in_time_are_sent_once_as_they_are():
    sender = Sender(0.5 * TIMEOUT)
    sender.settle()
    sender.answer_state()
    ((_, sent, stamp),) = sender.left
    np.testing.assert_allclose(sent, DYNAMICS.gravity(Q), rtol=1e-9, atol=1e-9)
    assert stamp == "of the state" and not sender.controller.fault
