"""The wheel of robot_dynamics alone, with the packages that it requires, in an empty environment."""

import json
from pathlib import Path

import pytest

# A motion of the RX90 with the efforts of its model: an MDH table, so that no URDF is read.
WRITE_RECORDING = """
import numpy as np
from robot_dynamics import Dynamics, load_robot

dynamics = Dynamics(load_robot("rx90"), compiled=False)
times = np.arange(0, 10, 0.01)[:, None]
rates, phases = np.random.default_rng(0).uniform(1, 3, (2, 1, 6))
q, qd, qdd = (0.2 * rates**k * f(rates * times + phases) for k, f in enumerate((np.sin, np.cos, lambda x: -np.sin(x))))
columns = np.stack([q, qd, dynamics.inverse(q, qd, qdd)], axis=-1).reshape(len(times), -1)
head = [f"{name}.{kind}" for name in dynamics.joint_names for kind in ("position", "velocity", "effort")]
np.savetxt("run.csv", np.column_stack([times, columns]), delimiter=",", header=",".join(["time", *head]), comments="")
"""
MODULES = """
import importlib, json, pkgutil, robot_dynamics
missing, count = {}, 0
for module in pkgutil.walk_packages(robot_dynamics.__path__, "robot_dynamics."):
    if module.name.endswith("__main__"):
        continue
    count += 1
    try:
        importlib.import_module(module.name)
    except ModuleNotFoundError as error:
        missing[module.name] = error.name
print(json.dumps([count, missing]))
"""
FOREIGN = """
import sys
before = set(sys.modules)
import robot_dynamics
names = {name.partition(".")[0] for name in set(sys.modules) - before} - set(sys.stdlib_module_names)
print(sorted(names), robot_dynamics.__file__)
"""
# {extra: (a task that needs it, beginning of the line that names it)}
TASKS = {
    "bags": (["replay-check", "run.mcap", "--robot", "rx90"], "reading or writing a bag needs rosbags"),
    "plots": (["map", "gough_stewart", "--over", "x:0:1:3", "--output", "map.png"], "needs matplotlib"),
    "view": (["replay-check", "run.csv", "--robot", "rx90", "--report", "report.html"], "a report needs plotly"),
    "identify": (["identify", "run.csv", "--robot", "rx90", "--output", "rx90.yaml"], "needs clarabel"),
    "fleet": (["replay-check", "run.csv", "--robot", "rx90", "--scheduler", "tcp://localhost:9"], "needs distributed"),
}


@pytest.fixture
def recording(core, tmp_path):
    """Return the folder of a recording, run.csv, and of a bag that nothing has been written to, run.mcap."""
    done = core.run("python", "-c", WRITE_RECORDING, scratch=tmp_path)
    assert done.returncode == 0, done.stderr
    (tmp_path / "run.mcap").write_bytes(b"\x89MCAP0\r\n")
    return tmp_path


def test_import_loads_no_other_package(core, tmp_path):
    done = core.run("python", "-c", FOREIGN, scratch=tmp_path)
    assert done.stdout.startswith("['robot_dynamics'] ") and str(core.folder) in done.stdout, done


def test_only_nodes_and_tasks_of_extras_need_more_packages(core, tmp_path):
    done = core.run("python", "-c", MODULES, scratch=tmp_path)
    assert done.returncode == 0, done.stderr
    count, missing = json.loads(done.stdout)
    others = {name: package for name, package in missing.items() if not name.startswith("robot_dynamics.nodes.")}
    assert count > 200
    assert set(others.values()) == {"matplotlib", "llvmlite"} and len(others) < 8, others


@pytest.mark.parametrize(
    ("arguments", "printed"),
    [
        (["--version"], "robot-dynamics 0.2.0"),
        (["robots"], "gough_stewart"),
        (["show", "panda"], "panda_joint7"),
        (["show", "rx90"], "robot 'rx90'"),
        (["count", "ur5e"], "192"),
        (["frequencies", "navaro", "--count", "3"], "Hz"),
        (["schema"], "json-schema.org"),
        (["convert", "panda", "panda.yaml"], "panda.yaml"),
    ],
)
def test_command_line_runs(core, tmp_path, arguments, printed):
    done = core.run("robot-dynamics", *arguments, scratch=tmp_path)
    assert done.returncode == 0 and printed in done.stdout, done


def test_package_runs_as_a_module_and_has_a_version(core, tmp_path):
    listed = core.run("python", "-m", "robot_dynamics", "robots", scratch=tmp_path)
    assert listed.returncode == 0 and "gough_stewart" in listed.stdout, listed
    printed = core.run("python", "-c", "import robot_dynamics; print(robot_dynamics.__version__)", scratch=tmp_path)
    assert printed.stdout == "0.2.0\n", printed


def test_dynamics_of_a_urdf_and_of_an_mdh_table_run(core, tmp_path):
    program = """
from robot_dynamics import Dynamics, load_robot
for name in ("panda", "rx90"):
    dynamics = Dynamics(load_robot(name))
    zeros = [0.0] * len(dynamics.joint_names)
    print(dynamics.inverse(zeros, zeros, zeros).round(3).tolist())
"""
    done = core.run("python", "-c", program, scratch=tmp_path)
    panda, rx90 = map(json.loads, done.stdout.splitlines())
    assert done.returncode == 0 and len(panda) == 7 and len(rx90) == 6 and abs(panda[1]) > 1, done


def test_recording_in_csv_is_checked(core, recording):
    done = core.run("robot-dynamics", "replay-check", "run.csv", "--robot", "rx90", scratch=recording)
    assert done.returncode == 0 and "passed" in done.stdout and not done.stderr, done


@pytest.mark.parametrize("extra", TASKS)
def test_missing_extra_is_named_in_one_line(core, recording, extra):
    arguments, beginning = TASKS[extra]
    done = core.run("robot-dynamics", *arguments, scratch=recording)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 1 and beginning in line and f"robot_dynamics[{extra}]" in line, done


def test_missing_compiler_of_models_is_named_in_one_line(core, tmp_path):
    program = 'from robot_dynamics import Dynamics, load_robot; Dynamics(load_robot("rx90")).compile("inverse")'
    done = core.run("python", "-c", program, scratch=tmp_path)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 0 and "llvmlite" in line and "robot_dynamics[compiled]" in line, done


@pytest.mark.parametrize(
    ("name", "extra"),
    [
        ("dynamics_server", "ros"),
        ("computed_torque", "ros"),
        ("mobile_base_simulator", "ros"),
        ("replay_check", "ros"),
        ("joint_state_completer", "ros"),
        ("contact_monitor", "ros"),
        ("demo", "ros"),
    ],
)
def test_node_without_ros_ends_with_one_line(core, tmp_path, name, extra):
    done = core.run(name, scratch=tmp_path)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 1 and line.startswith(name) and f"robot_dynamics[{extra}]" in line, done


def test_size_is_below_340_megabytes(core):
    """Files of all packages with their bytecode, without pip, in 2**20 bytes."""
    packages = next(core.folder.glob("lib/python3*/site-packages"))
    sizes = {path: path.stat().st_size for path in packages.rglob("*") if path.is_file() and not path.is_symlink()}
    size = sum(size for path, size in sizes.items() if not path.relative_to(packages).parts[0].startswith("pip"))
    print(f"core: {size / 2**20:.0f} MB")
    assert 100 < size / 2**20 < 340


def test_extras_do_their_tasks(everything, tmp_path):
    recorded = everything.run("python", "-c", WRITE_RECORDING, scratch=tmp_path)
    assert recorded.returncode == 0, recorded.stderr
    for arguments, file in (
        (["replay-check", "run.csv", "--robot", "rx90", "--write-golden", "golden"], "golden"),
        (["replay-check", "golden", "--robot", "rx90", "--report", "report.html"], "report.html"),
        (["map", "gough_stewart", "--over", "x:0:1:3", "--output", "map.png"], "map.png"),
        (["identify", "run.csv", "--robot", "rx90", "--output", "identified.yaml"], "identified.yaml"),
        (["show", "identified.yaml"], "run.csv"),
    ):
        done = everything.run("robot-dynamics", *arguments, scratch=tmp_path)
        assert done.returncode == 0 and Path(tmp_path, file).exists(), done
