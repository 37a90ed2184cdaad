"""A reference of many points reaches computed_torque while it streams efforts at 1 kHz.

Timeouts are longer than by default: other tests that keep the machine busy are not meant.
"""

import os
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import peers
import pytest
from nodes.controller_probe import PANDA
from nodes.faults.bench import FURTHER, LED, LED_FURTHER, PATIENCE, Bench
from peers.effort_observer import COMMAND, STATE

PLANNER = Path(peers.__file__).with_name("trajectory_publisher.py")
POINTS = int(os.environ.get("REFERENCE_POINTS", "100000"))
LONGEST_PAUSE = 300_000_000  # [ns] a tenth of the time in which rclpy and Python read such a message
PARAMETERS = {"state_timeout": 20.0, "deadline": 20.0}


@pytest.fixture(scope="module")
def bench(ros, client, tmp_path_factory):
    with ExitStack() as stack:
        yield Bench(stack, client, tmp_path_factory.mktemp("observer"), PARAMETERS)


def longest_delay(states, commands):
    """The longest time [ns] from a state to the next command, of times at which both were received."""
    following = np.searchsorted(commands, states)
    answered = following < len(commands)
    return (commands[following[answered]] - states[answered]).max()


def publish_in_process(topic, points, positions):
    joints = [f"{name}={value}" for name, value in zip(PANDA, positions, strict=True)]
    subprocess.run([sys.executable, PLANNER, topic, str(points), *joints], check=True, timeout=4 * PATIENCE)


@pytest.mark.timeout(180)
def test_efforts_follow_the_old_reference_without_a_pause_until_the_new_one_is_read(bench):
    bench.lead()
    before = bench.diagnosis()
    bench.forget()
    with bench.waiting() as recorder:
        began = time.time_ns()
        publish_in_process(f"{bench.target}/reference", POINTS, FURTHER)
        assert bench.settled(LED_FURTHER) is LED_FURTHER
        waiting = recorder.waiting().between(began, time.time_ns())
    commands = bench.of(COMMAND)
    pause = longest_delay(bench.of(STATE)["received"], commands["received"])
    print(f"\n{POINTS} points: the longest time from a state to commands is {pause * 1e-6:.1f} ms")
    print(f"a busy machine accounts for {waiting * 1e-6:.1f} ms")
    fractions = (commands["efforts"] - LED) @ (LED_FURTHER - LED) / np.sum((LED_FURTHER - LED) ** 2)
    assert (np.diff(fractions) > -1e-6).all(), "efforts left the way from the old reference to the new one"
    assert pause < LONGEST_PAUSE + waiting
    after = bench.diagnosis()
    assert after["standstills"] == before["standstills"] and after["references refused"] == before["references refused"]
