"""States of several publishers: which of them contradict each other, by their numbers and values."""

import numpy as np
import pytest
from nodes.controller_probe import PANDA, Q
from sensor_msgs.msg import JointState

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.nodes.codecs.joint_states import JointStateReader
from robot_dynamics.nodes.computed_torque.state_agreement import (
    HOLD_TIME,
    POSITION_TOLERANCE,
    VELOCITY_TOLERANCE,
    ReceivedState,
    StateAgreement,
)

TIMEOUT = 0.02
PERIOD = 0.001


class Stream:
    """States that reach a node; `publishers` is the number of publishers in the graph."""

    def __init__(self, publishers=2):
        self.publishers = publishers
        self.time = 0.0
        self.agreement = StateAgreement(lambda: self.publishers, lambda: "/first and /second")
        dynamics = Dynamics(load_robot("panda"), compiled=False)
        self._reader = JointStateReader(dynamics, PANDA[:2], "/", np.zeros(7), np.zeros(7), np.zeros(0))

    def send(self, number, q, qd=None, names=PANDA):
        message = JointState(name=list(names), position=np.asarray(q, dtype=float))
        message.velocity = np.zeros(len(names)) if qd is None else np.asarray(qd, dtype=float)
        self.time += PERIOD
        state = ReceivedState(message, number, self.time)
        return self.agreement.check(self._reader.find_mapping(message), state, self.time, TIMEOUT)


@pytest.mark.parametrize("start", [1, 40, 39, 41, 5000, None], ids=str)
def test_alternating_positions_contradict_at_once_and_until_one_publisher_stops(start):
    stream = Stream()
    sent = []
    for k in range(30):  # the first publisher alone
        assert not stream.send(k + 10, Q)
    for k in range(30):
        sent.append(stream.send(None if start is None else start + k, Q + 0.2))
        sent.append(stream.send(None if start is None else 40 + k, Q))
    # a number of the second publisher that follows by chance passes for the next state of the first one, once
    assert all(sent[1:] if start == 40 else sent)
    first, second = ("0.3", "0.1") if start == 40 else ("0.1", "0.3")
    assert f"panda_joint1 is at {first} and {second} rad or m" in sent[-1] and "/first and /second" in sent[-1]
    for k in range(round(HOLD_TIME / PERIOD) - 2):
        assert stream.send(70 + k, Q)
    for k in range(20):
        last = stream.send(5000 + k, Q)
    assert not last


def test_a_joint_that_accelerates_agrees_with_itself_and_one_at_rest_contradicts_its_motion():
    stream = Stream()
    times = PERIOD * np.arange(400)
    for k, time in enumerate(times):
        moving = Q + 20.0 * 0.5 * time**2, np.full(7, 20.0 * time)
        assert not stream.send(3 * k, *moving)  # two of three are lost
        assert not stream.send(2 * k + 7, *moving)
    assert "panda_joint1 moves at 7.98 and 0 rad/s or m/s" in stream.send(9000, moving[0], np.zeros(7))


@pytest.mark.parametrize("number", [7, 9], ids=["same publisher again", "a message was lost"])
def test_values_within_tolerances_agree(number):
    stream = Stream()
    signs = (-1.0) ** np.arange(7)
    stream.send(7, Q)
    assert not stream.send(number, Q + 0.9 * POSITION_TOLERANCE * signs, 0.9 * VELOCITY_TOLERANCE * signs)
    assert stream.send(number, Q - 0.9 * POSITION_TOLERANCE * signs)


def test_publishers_of_arm_and_gripper_have_nothing_to_compare_and_common_joints_are_compared():
    stream = Stream()
    for k in range(50):
        assert not stream.send(k + 1, Q[:5], names=PANDA[:5])
        assert not stream.send(k + 3, [0.1 * (-1) ** k], names=["gripper"])  # of another robot
        assert not stream.send(k + 2, Q[5:], names=PANDA[5:])
    assert "panda_joint4" in stream.send(700, [Q[3] + 0.1], names=[PANDA[3]])
    assert stream.send(52, Q[5:], names=PANDA[5:])  # no state is used until they agree


def test_a_single_publisher_may_jump_and_begin_anew():
    stream = Stream(publishers=1)
    for number, q in ((5, Q), (6, Q + 1.0), (9, Q), (1, Q + 1.0), (2, Q)):
        assert not stream.send(number, q)
    stream = Stream(publishers=2)
    for number, q in ((5, Q), (6, Q + 1.0)):  # a simulator that is reset
        assert not stream.send(number, q)
    stream.time += 2 * TIMEOUT  # a publisher that is killed, and started again
    assert not stream.send(1, Q)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_that_are_not_finite_are_left_to_those_who_refuse_them(bad):
    stream = Stream()
    stream.send(5, Q)
    assert not stream.send(5, [bad, *Q[1:]])
    assert not stream.send(5, Q[:6])  # a message without a value for each name


def test_many_lists_of_names_take_bounded_memory():
    stream = Stream()
    for k in range(100):
        assert not stream.send(k, [*Q, 0.0], names=[*PANDA, f"other{k}"])
    assert len(stream.agreement._latest) <= 16 and len(stream.agreement._common) <= 16 * 16
