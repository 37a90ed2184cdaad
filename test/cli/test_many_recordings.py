"""Many recordings, in this process, in several, and on a Dask cluster of processes: the answers are the same."""

import json
import os
from argparse import Namespace

import numpy as np
import pytest
from peers.recorded import JOINTS, messages, panda_motion, write_bag

from robot_dynamics.cli.executors import open_executor
from robot_dynamics.cli.main import main
from robot_dynamics.errors import RobotDynamicsError

CLOSED = "tcp://127.0.0.1:9"  # the port of `discard`, where nobody listens


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Three motions of one Panda; in the last one a joint is pushed from 6 s on."""
    folder = tmp_path_factory.mktemp("bags")
    motions = [panda_motion(10.0 + seed, seed=seed) for seed in (1, 2, 3)]
    efforts = motions[2].efforts.copy()
    efforts[600:, 3] += 12.0
    motions[2] = motions[2]._replace(efforts=efforts)
    return [write_bag(folder / f"run_{k}", messages(motion)) for k, motion in enumerate(motions)]


@pytest.fixture(scope="module")
def cluster():
    LocalCluster = pytest.importorskip("distributed", reason="dask[distributed] is not installed").LocalCluster
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None,
                      silence_logs="ERROR") as started:  # fmt: skip
        yield started


def done_by(cluster):
    """{kind: how many tasks of it} that the processes of a cluster have done so far."""
    return {name.strip("_"): prefix.state_counts["memory"] for name, prefix in cluster.scheduler.task_prefixes.items()}


def identified(bags, path, *arguments):
    told = ["identify", *bags[:2], "--validate", bags[2], "--robot", "panda", "--method", "robust", "--json", path]
    assert main([*map(str, told), *arguments]) == 0
    return json.loads(path.read_text())


def same(one, other):
    """Whether plain data are the same, numbers to 1e-9."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        return all(same(one[key], other[key]) for key in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    return one == pytest.approx(other, rel=1e-9, abs=1e-12) if isinstance(one, float) else one == other


def test_identification_is_the_same_whoever_gathers(bags, cluster, tmp_path, capfd):
    here = identified(bags, tmp_path / "here.json")
    capfd.readouterr()
    there = identified(bags, tmp_path / "there.json", "--scheduler", cluster.scheduler_address)
    assert capfd.readouterr().err == ""
    assert done_by(cluster) == {"run_task": 2 * (1 + 6 + 1) + 1}  # unweighted, six rounds of weights, residuals
    assert same(here, there) and len(here["parameters"]) == 69 and here["trained"]["samples"] > 2000
    assert any("ends of stretches" in note for note in here["notes"])


def test_checks_are_the_same_whoever_does_them(bags, cluster, tmp_path, capfd):
    text = tmp_path / "notes.mcap"
    text.write_text("hello")
    told = ["replay-check", *map(str, [*bags, text]), "--robot", "panda", "--faults"]
    answers, outputs = [], []
    reports = ["--report", str(tmp_path / "out")]
    for arguments in (reports, ["--jobs", "2"], ["--scheduler", cluster.scheduler_address]):
        figures = tmp_path / "all.json"
        assert main([*told, "--json", str(figures), *arguments]) == 3
        answers.append(json.loads(figures.read_text()))
        outputs.append(capfd.readouterr().out)
    assert same(answers[0], answers[1]) and same(answers[0], answers[2]) and len(set(outputs)) == 1
    assert done_by(cluster)["outcome"] == 4
    assert "2 passed, 1 FAILED, 1 not checked" in outputs[0]
    recordings = answers[0]["recordings"]
    assert [each["passed"] for each in recordings] == [True, True, False, None]
    assert recordings[2]["since"] == 6.0 and "is no bag" in recordings[3]["refused"]
    written = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert len(written) == 3 and written[0].endswith("run_0.html")
    joints = {each["joint"]: each for each in answers[0]["joints"]}
    assert [name for name in JOINTS if joints[name]["failed"]] == ["panda_joint4"]
    residuals = [each["joints"][3]["rms"] ** 2 * each["joints"][3]["samples"] for each in recordings[:3]]
    samples = sum(each["joints"][3]["samples"] for each in recordings[:3])
    assert joints["panda_joint4"]["rms"] == pytest.approx(np.sqrt(sum(residuals) / samples))
    assert joints["panda_joint4"]["worst"] == str(bags[2])


def test_what_cannot_be_done_is_told(bags, capsys):
    several = [str(bag) for bag in bags[:2]]
    for arguments, expected in (
        ([*several, "--jobs", "0"], "at least one"),
        ([*several, "--jobs", "2", "--scheduler", CLOSED], "use one of the two"),
        ([*several, "--scheduler", "nonsense://"], "no Dask scheduler responds"),
        ([*several, "--golden", several[0]], "take one recording, not 2"),
    ):  # fmt: skip
        assert main(["replay-check", *arguments, "--robot", "panda"]) == 1
        assert expected in capsys.readouterr().err


def test_a_process_that_dies_is_told():
    with (
        pytest.raises(RobotDynamicsError, match="--jobs 2"),
        open_executor(Namespace(jobs=2, scheduler=None)) as executor,
    ):
        executor.submit(os._exit, 1).result(timeout=60)
