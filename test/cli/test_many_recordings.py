"""Many recordings in this process, in several processes, and on a Dask cluster: the results are equal."""

import json
import os
from argparse import Namespace

import numpy as np
import pytest
from peers.cluster import local_cluster
from peers.recorded import JOINTS, messages, panda_motion, write_bag

from robot_dynamics.cli.executors import open_executor
from robot_dynamics.cli.main import main
from robot_dynamics.errors import RobotDynamicsError

CLOSED = "tcp://127.0.0.1:9"  # the port of `discard`, without a listener


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Three recordings of a Panda; in the last recording a joint is pushed after 6 s."""
    folder = tmp_path_factory.mktemp("bags")
    motions = [panda_motion(10.0 + seed, seed=seed) for seed in (1, 2, 3)]
    efforts = motions[2].efforts.copy()
    efforts[600:, 3] += 12.0
    motions[2] = motions[2]._replace(efforts=efforts)
    return [write_bag(folder / f"run_{k}", messages(motion)) for k, motion in enumerate(motions)]


@pytest.fixture(scope="module")
def cluster():
    with local_cluster() as started:
        yield started


def completed_tasks(cluster):
    """Return the numbers of tasks that a cluster has completed, by the name of the function."""
    return {name.strip("_"): prefix.state_counts["memory"] for name, prefix in cluster.scheduler.task_prefixes.items()}


def identified(bags, path, *arguments):
    command = ["identify", *bags[:2], "--validate", bags[2], "--robot", "panda", "--method", "robust", "--json", path]
    assert main([*map(str, command), *arguments]) == 0
    return json.loads(path.read_text())


def equal(first, second):
    """Whether plain data are equal, numbers to 1e-9."""
    if isinstance(first, dict):
        assert first.keys() == second.keys()
        return all(equal(first[key], second[key]) for key in first)
    if isinstance(first, list):
        return len(first) == len(second) and all(map(equal, first, second))
    return first == pytest.approx(second, rel=1e-9, abs=1e-12) if isinstance(first, float) else first == second


@pytest.mark.slow
def test_identification_is_equal_with_every_executor(bags, cluster, tmp_path, capfd):
    local = identified(bags, tmp_path / "here.json")
    capfd.readouterr()
    distributed = identified(bags, tmp_path / "there.json", "--scheduler", cluster.scheduler_address)
    assert capfd.readouterr().err == ""
    # unweighted, six rounds of weights, residuals; friction models; validation
    assert completed_tasks(cluster) == {"run_task": 2 * (1 + 6 + 2) + 2 + 2}
    assert equal(local, distributed) and len(local["parameters"]) == 69 and local["trained"]["samples"] > 2000
    assert any("ends of segments" in note for note in local["notes"])


@pytest.mark.slow
def test_checks_are_equal_with_every_executor(bags, cluster, tmp_path, capfd):
    text = tmp_path / "notes.mcap"
    text.write_text("hello")
    command = ["replay-check", *map(str, [*bags, text]), "--robot", "panda", "--faults"]
    results, outputs = [], []
    reports = ["--report", str(tmp_path / "out")]
    for arguments in (reports, ["--jobs", "2"], ["--scheduler", cluster.scheduler_address]):
        figures = tmp_path / "all.json"
        assert main([*command, "--json", str(figures), *arguments]) == 3
        results.append(json.loads(figures.read_text()))
        outputs.append(capfd.readouterr().out)
    assert equal(results[0], results[1]) and equal(results[0], results[2]) and len(set(outputs)) == 1
    assert completed_tasks(cluster)["check_or_divide"] == 4
    assert "2 passed, 1 FAILED, 1 not checked" in outputs[0]
    recordings = results[0]["recordings"]
    assert [entry["passed"] for entry in recordings] == [True, True, False, None]
    assert recordings[2]["since"] == 6.0 and "is no bag" in recordings[3]["refused"]
    written = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert len(written) == 3 and written[0].endswith("run_0.html")
    joints = {entry["joint"]: entry for entry in results[0]["joints"]}
    assert [name for name in JOINTS if joints[name]["failed"]] == ["panda_joint4"]
    residuals = [entry["joints"][3]["rms"] ** 2 * entry["joints"][3]["samples"] for entry in recordings[:3]]
    samples = sum(entry["joints"][3]["samples"] for entry in recordings[:3])
    assert joints["panda_joint4"]["rms"] == pytest.approx(np.sqrt(sum(residuals) / samples))
    assert joints["panda_joint4"]["worst"] == str(bags[2])


def test_wrong_executors_are_refused(bags, capsys):
    several = [str(bag) for bag in bags[:2]]
    for arguments, expected in (
        ([*several, "--jobs", "0"], "at least one"),
        ([*several, "--jobs", "2", "--scheduler", CLOSED], "use one of the two"),
        ([*several, "--scheduler", "nonsense://"], "no Dask scheduler responds"),
        ([*several, "--golden", several[0]], "take one recording, not 2"),
    ):  # fmt: skip
        assert main(["replay-check", *arguments, "--robot", "panda"]) == 1
        assert expected in capsys.readouterr().err


def test_killed_process_is_reported():
    with (
        pytest.raises(RobotDynamicsError, match="--jobs 2"),
        open_executor(Namespace(jobs=2, scheduler=None)) as executor,
    ):
        executor.submit(os._exit, 1).result(timeout=60)
