"""Faults of computed_torque on a terminal: the first at once, many within a second in one line, and the last state."""

import time

import numpy as np
from nodes.controller_probe import ControllerProbe, Q

from robot_dynamics.nodes.computed_torque.fault_log import PERIOD, FaultLog
from robot_dynamics.nodes.processes import running_node


class Lines(list):
    """A logger that keeps what it is given."""

    def warning(self, text):
        self.append(text)

    info = warning


def test_first_change_is_logged_at_once_and_later_ones_together():
    lines, now = Lines(), [100.0]
    log = FaultLog(lines, lambda: now[0])
    log.restart("no joint_states yet")

    def update(fault, at):
        now[0] = 100 + at
        log.update(fault)

    update("no joint_states yet", 0.0)
    assert not lines
    update("", 0.1)
    assert lines == ["efforts are sent again"]
    for k in range(50):  # within the period of the last line
        update(f"position is {k}" if k % 2 == 0 else "", 0.2 + k * 0.01)
    assert len(lines) == 1
    update("", 0.1 + PERIOD)
    assert lines[1:] == [
        "efforts began to go to zero 25 times in 1.0 s, the last time: position is 48; they are sent again"
    ]
    update("", 50.0)
    update("too old by 3 s", 60.0)
    update("too old by 4 s", 61.5)  # the same but for its numbers
    assert lines[2:] == ["efforts go to zero: too old by 3 s"]
    update("", 61.6)
    assert lines[3:] == ["efforts are sent again"]
    update("too old by 5 s", 61.7)
    update("", 61.8)
    update("", 63.0)
    assert lines[4:] == ["efforts began to go to zero: too old by 5 s; they are sent again"]


def test_alternating_states_are_logged_once_a_second(client, tmp_path):
    log, parameters = tmp_path / "log", {"robot_file": "panda", "deadline": 1.0, "state_timeout": 0.5}
    began = time.monotonic()
    with log.open("w") as file, running_node("computed_torque", parameters, "/in_turn", log=file):
        stand = ControllerProbe("/in_turn/computed_torque", client)
        stand.stream_until_steady()
        for _ in range(100):
            stand.publish(np.full(7, np.nan))
            time.sleep(0.01)
            stand.publish(Q)
            time.sleep(0.01)
        stand.stream_until(lambda: "they are sent again" in log.read_text(), "the last state on the terminal")
        stand.close()
        elapsed = time.monotonic() - began
    lines = [line for line in log.read_text().splitlines() if "efforts " in line]
    assert len(lines) <= elapsed / PERIOD + 2, "\n".join(lines)
    assert any("efforts began to go to zero" in line and "times in" in line and "is nan" in line for line in lines)
