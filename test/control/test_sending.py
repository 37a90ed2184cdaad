"""Efforts and slow senders: efforts for a stale state are not the last that are sent."""

import numpy as np
import pytest

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.control.control_law import ControlLaw, actuated_joint_names
from robot_dynamics.control.controller import Controller
from robot_dynamics.control.controller_settings import Settings
from robot_dynamics.control.sending import send_in_time

DYNAMICS = Dynamics(load_robot("panda"), compiled=False)
Q = np.array([0.1, -0.5, 0.2, -1.8, 0.1, 1.4, 0.3])
MS = 1e-3
TIMEOUT, RAMP = 20 * MS, 0.5  # [s]


class Sender:
    """A publisher of which each call blocks for one of the `durations` [s], the last of them repeatedly.

    Its clock advances by these durations only. sent: list of (time, efforts, stamp).
    """

    def __init__(self, *durations):
        self.durations, self.now, self.sent, self.calls = list(durations), 0.0, [], 0
        law = ControlLaw(DYNAMICS, actuated_joint_names(DYNAMICS))
        kp, kd, limits = np.full(7, 100.0), np.full(7, 20.0), np.full(7, np.inf)
        self.controller = Controller(law, Settings("gravity_compensation", kp, kd, limits, ramp_time=RAMP))

    def send(self, efforts, stamp, until):
        self.calls += 1
        assert self.calls <= 3, "efforts are sent again and again"
        if self.now > until:
            return False
        self.now += self.durations.pop(0) if len(self.durations) > 1 else self.durations[0]
        self.sent.append((self.now, efforts.copy(), stamp))
        return self.now <= until

    def send_for_state(self):
        self.controller.law.q[:], self.controller.law.qd[:] = Q, 0.0
        self._send(self.controller.step(self.now), stamp="of the state")

    def tick(self):
        efforts = self.controller.tick(self.now)
        if efforts is not None:
            self._send(efforts)

    def _send(self, efforts, stamp=None):
        self.calls = 0
        send_in_time(self.controller, self.send, lambda: self.now, efforts, stamp, self.now + TIMEOUT, lambda: self.now)

    def settle(self):
        """Send the efforts of states each ms until they hold the robot."""
        durations, self.durations = self.durations, [0.0]
        for _ in range(600):
            self.send_for_state()
            self.now += MS
        np.testing.assert_allclose(self.sent[-1][1], DYNAMICS.gravity(Q), rtol=1e-9, atol=1e-9)
        self.durations, self.sent = durations, []


@pytest.mark.parametrize("duration", [1.001 * TIMEOUT, 0.3, 10.0])
def test_slow_sender_is_called_three_times_and_sends_zeros_last(duration):
    sender = Sender(duration)
    sender.settle()
    for _ in range(20):
        sender.send_for_state()
        assert sender.calls == 3 and not sender.sent[-1][1].any() and sender.sent[-1][2] is None
        assert sender.controller.fault == "it takes longer than state_timeout, 20 ms, to send efforts"
        sender.now += MS
    sender.tick()
    assert not sender.sent[-1][1].any()


def test_zeros_last_until_a_good_state_and_efforts_return_by_a_ramp():
    sender = Sender(2 * TIMEOUT, 2 * TIMEOUT, 0.0)
    sender.settle()
    sender.send_for_state()
    assert len(sender.sent) == 3 and sender.sent[1][1].any(), "the ramp to zero had not ended"
    first = len(sender.sent) - 1
    for _ in range(30):
        sender.now += 5 * MS
        sender.tick()
    assert len(sender.sent) == first + 31 and not np.any([efforts for _, efforts, _ in sender.sent[first:]])
    first = len(sender.sent)
    for _ in range(600):
        sender.now += MS
        sender.send_for_state()
    returning = np.array([efforts for _, efforts, _ in sender.sent[first - 1 :]])
    steps = np.abs(np.diff(returning, axis=0)).max()
    assert steps < 1.01 * np.abs(DYNAMICS.gravity(Q)).max() * MS / RAMP
    np.testing.assert_allclose(returning[-1], DYNAMICS.gravity(Q), rtol=1e-9, atol=1e-9)


def test_late_efforts_are_followed_by_decaying_ones():
    sender = Sender(2 * TIMEOUT, 0.0)
    sender.settle()
    sender.send_for_state()
    (_, stale, stamp), (_, sent, later_stamp) = sender.sent
    assert stamp == "of the state" and later_stamp is None
    assert 0 < np.abs(sent).max() < np.abs(stale).max() and sender.controller.fault


def test_efforts_in_time_are_sent_once_and_unchanged():
    sender = Sender(0.5 * TIMEOUT)
    sender.settle()
    sender.send_for_state()
    ((_, sent, stamp),) = sender.sent
    np.testing.assert_allclose(sent, DYNAMICS.gravity(Q), rtol=1e-9, atol=1e-9)
    assert stamp == "of the state" and not sender.controller.fault
