"""Fuzzing: a short campaign against each target that needs no node, and what the campaign itself notices.

`make fuzz SECONDS=...` runs long campaigns, also against real nodes. The corpus is run first: inputs that were finds
once stay there.
"""

import json
import os
import random
import signal
import subprocess
import sys
import time

import pytest
from fuzzing import campaign
from fuzzing.campaign import Outcome, read_corpus, run_campaign
from fuzzing.line_coverage import LineCoverage
from fuzzing.process_usage import cpu_time, resident_memory
from fuzzing.targets import CORPUS, make_target

from robot_dynamics import load_robot
from robot_dynamics.model.formats import decoding

# inputs of a short run: as many as take a few seconds
INPUTS = {"descriptions": int(os.environ.get("MUTATIONS", "400")), "recordings": 40, "requests": 40}
pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", INPUTS)
def test_short_campaign_finds_nothing(name, tmp_path):
    if name == "recordings":
        pytest.importorskip("rosbags.rosbag2", reason="rosbags, which reads bags, is not installed")
    if name == "requests":
        pytest.importorskip("rclpy", reason="ROS is not installed")
    seeds = read_corpus(CORPUS / name)
    summary = run_campaign(make_target(name), seeds, tmp_path, inputs=len(seeds) + INPUTS[name], seed=0)
    print(summary.text())
    reasons = [file.read_text() for file in sorted((tmp_path / "finds").glob("*.txt"))]
    assert summary.finds == [], reasons[:3]
    assert summary.inputs == len(seeds) + INPUTS[name] and summary.lines > 500
    assert summary.kinds["compared"] > 0 and summary.kinds["refused"] > 0


def test_mutated_requests_can_be_sent():
    """rclpy checks the ranges of integers only when it serializes a message, with errors of several kinds."""
    serialization = pytest.importorskip("rclpy.serialization", reason="ROS is not installed")
    from fuzzing.message_mutations import fill_message
    from trajectory_msgs.msg import JointTrajectory

    from robot_dynamics.nodes.dynamics_server.node import SERVICES

    for value in (-1, 2**32):
        with pytest.raises(ValueError, match=f"{value} is no uint32"):
            fill_message(JointTrajectory(), {"points": [{"time_from_start": {"sec": 0, "nanosec": value}}, {}]})
    kinds = {name: kind for kind, name, _ in SERVICES}
    target, seeds, rng = make_target("requests"), read_corpus(CORPUS / "requests"), random.Random(0)
    changed = 0
    for _ in range(500):
        seed = rng.choice(seeds)
        data = target.mutate(seed, rng, seeds)
        content = json.loads(data)
        changed += data != seed
        serialization.serialize_message(fill_message(kinds[content["service"]].Request(), content["request"]))
    assert changed > 400  # a mutation may be none, as an empty list in another order


class FaultyTarget:
    """Does what the first byte says, after a sound input."""

    name = "faulty"

    def prepare(self):
        pass

    def mutate(self, data, rng, corpus):
        return b"sound"

    def run(self, data):
        match data[:1]:
            case b"c":
                os.kill(os.getpid(), signal.SIGSEGV)
            case b"h":
                while True:
                    pass
            case b"w":
                signal.pause()
            case b"m":
                bytearray(campaign.MEMORY * 2)[:] = b"x" * (campaign.MEMORY * 2)
            case b"e":
                raise KeyError("name")
        return Outcome("accepted")


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"crash", "crash: SIGSEGV"),
        (b"hang", "hang: more than 0.4 s of CPU time for 4 bytes"),
        (b"wait", "hang: more than 2 s"),
        (b"memory", "memory: "),
        (b"error", "KeyError at test_campaign.py:run"),
    ],
)
def test_faults_are_finds_and_the_campaign_goes_on(data, what, tmp_path, monkeypatch):
    monkeypatch.setattr(campaign, "CPU_PER_KILOBYTE", 0.2 if data == b"hang" else 10.0)
    monkeypatch.setattr(campaign, "CPU_FACTOR_TRACED", 1.0)
    monkeypatch.setattr(campaign, "WALL_TIME", 2.0 if data == b"wait" else 100.0)
    monkeypatch.setattr(campaign, "MEMORY", 200_000_000)
    summary = run_campaign(FaultyTarget(), [b"sound", data], tmp_path, inputs=20)
    assert len(summary.finds) == 1 and what in summary.finds[0], summary.finds
    (saved,) = (file for file in (tmp_path / "finds").iterdir() if file.suffix != ".txt")
    assert saved.read_bytes() == data
    assert summary.kinds["accepted"] >= 15


def test_time_of_a_process_is_that_which_the_system_tells_the_process():
    before = time.process_time()
    used = cpu_time(os.getpid())
    assert before - 0.02 <= used <= time.process_time() + 0.02  # both count the same time, the file in ticks


def test_memory_of_a_process_grows_by_what_the_process_takes():
    allocate = (
        "print(0, flush=True); input(); block = bytearray(b'x') * 50_000_000; print(len(block), flush=True); input()"
    )
    with subprocess.Popen([sys.executable, "-c", allocate], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin and process.stdout
        process.stdout.readline()  # the interpreter has started: its memory is not counted
        before = resident_memory(process.pid)
        process.stdin.write(b"\n")
        process.stdin.flush()
        size = int(process.stdout.readline())
        grown = resident_memory(process.pid) - before
        process.communicate(b"\n", timeout=30)
    assert size - 5e6 < grown < size + 10e6


def test_inputs_that_reach_new_lines_are_noticed():
    coverage = LineCoverage([decoding.__file__])
    counts = []
    for text in (b'<robot name="a"><link name="b"/></robot>',) * 2 + ("\ufeffrobot: x".encode("utf-16"),):
        coverage.start()
        try:
            load_robot(text)
        except Exception:
            pass
        finally:
            coverage.stop()
        counts.append(coverage.count)
    assert 0 < counts[0] == counts[1] < counts[2]
