"""The executables as a user starts them: without ROS, with --version, interrupted."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = (ROOT / "pyproject.toml").read_text()
SCRIPTS = dict(re.findall(r'^([\w-]+) = "(robot_dynamics\.[\w.]+:\w+)"', PROJECT, re.MULTILINE))
NODES = sorted(name for name, target in SCRIPTS.items() if "nodes" in target)
ROS_INSTALLATION_HINT = """
import sys
from importlib.abc import MetaPathFinder

class Hidden(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        root = name.partition(".")[0]
        if root == "{hidden}" or "{hidden}" == "ros" and (root == "rclpy" or root.endswith(("_msgs", "_interfaces"))):
            raise ModuleNotFoundError(f"No module named {{root!r}}", name=root)

sys.meta_path.insert(0, Hidden())
"""


def script(name):
    """The command of an executable, as pip writes it from pyproject.toml."""
    module, function = SCRIPTS[name].split(":")
    return [sys.executable, "-c", f"import sys; sys.argv[0] = {name!r}; from {module} import {function}; "
            f"sys.exit({function}())"]  # fmt: skip


def environment(tmp_path, hidden):
    """The environment of a Python that lacks some packages."""
    (tmp_path / "sitecustomize.py").write_text(ROS_INSTALLATION_HINT.format(hidden=hidden))
    return {**os.environ, "PYTHONPATH": f"{tmp_path}:{ROOT}"}


@pytest.mark.parametrize("name", NODES)
def test_without_ros_one_line_says_what_to_install(name, tmp_path):
    done = subprocess.run(script(name), env=environment(tmp_path, "ros"), capture_output=True, text=True, timeout=120)
    assert done.returncode == 1 and not done.stdout
    (line,) = done.stderr.splitlines()
    assert (
        line.startswith(f"{name}: No module named '")
        and "source its setup.bash" in line
        and "robot_dynamics[ros]" in line
    )


@pytest.mark.parametrize(
    ("module", "package", "of_ubuntu"),
    [("matplotlib", "matplotlib", "python3-matplotlib"), ("yaml", "pyyaml", "python3-yaml")],
)
def test_missing_packages_are_named_as_pip_and_apt_name_them(module, package, of_ubuntu, tmp_path):
    done = subprocess.run(
        script("demo"), env=environment(tmp_path, module), capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 1 and done.stderr.count("\n") == 1, done.stderr
    assert f"demo needs {module}, which is not installed: pip install {package}, " in done.stderr
    assert f"sudo apt install {of_ubuntu}" in done.stderr and sys.executable in done.stderr


def test_command_line_needs_no_ros(tmp_path):
    without_ros = environment(tmp_path, "ros")
    done = subprocess.run(
        [*script("robot-dynamics"), "--version"], env=without_ros, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0 and not done.stderr


@pytest.mark.parametrize("name", ["robot-dynamics", "dynamics_server", "demo"])
def test_version_is_that_of_the_package(name):
    (version,) = re.findall(r'^version = "([\d.]+)"', PROJECT, re.MULTILINE)
    assert re.findall(r"<version>(.*)</version>", (ROOT / "package.xml").read_text()) == [version]
    done = subprocess.run([*script(name), "--version"], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (0, f"{name} {version}\n")


def left_of(process):
    """Command lines of processes of a demo that still run."""
    commands = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            command = (folder / "cmdline").read_bytes().decode().replace("\0", " ")
        except OSError:
            continue
        if f"/demo_{process.pid}" in command:
            commands.append(command)
    return commands


@pytest.mark.parametrize(
    ("until", "number"), [("serving", signal.SIGINT), ("picture: ", signal.SIGINT), ("simulates", signal.SIGTERM)]
)
def test_interrupted_demo_ends_with_one_line_and_no_processes(until, number, tmp_path):
    log = tmp_path / "log"
    options = ["--picture", "a.png", "--tracking", "b.png", "--bag", "bag"]
    with log.open("w") as file:
        process = subprocess.Popen(
            [*script("demo"), *options], stdout=file, stderr=file, cwd=tmp_path, start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1", **({"HOME": "/proc/none"} if until == "serving" else {})},
        )  # fmt: skip
        try:
            deadline = time.monotonic() + 120
            while until not in log.read_text():
                assert process.poll() is None and time.monotonic() < deadline, log.read_text()
                time.sleep(0.02)
            os.killpg(process.pid, number)  # as a terminal does
            process.wait(60)
        finally:
            process.kill()
    output = log.read_text()
    assert process.returncode == 128 + number and output.endswith("demo: interrupted\n"), output
    assert "Traceback" not in output and "Error" not in output, output
    assert not left_of(process)
