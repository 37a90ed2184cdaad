"""What the README tells a user to type does what it says: Python runs, questions are answered by a real server."""

import importlib
import re
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from rosidl_parser.definition import AbstractSequence, NamespacedType

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.nodes.robot_source import PARAMETERS
from robot_dynamics.nodes.running import Caller, running_node

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
BASH = re.findall(r"```bash\n(.*?)```", README, re.DOTALL)
STARTS = "ros2|make|\\.venv|git|rosdep|colcon|source"
COMMANDS = [command for block in BASH for command in re.split(rf"\n(?={STARTS})", block)]


def fill(message, values):
    """Put nested dicts and lists into a message, as the command line of ROS 2 does."""
    for field, kind in zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True):
        if field in values:
            setattr(message, field, filled(kind, values[field], getattr(message, field)))
    assert set(values) <= set(message.get_fields_and_field_types()), f"{type(message).__name__} has no such field"
    return message


def filled(kind, value, present):
    if isinstance(kind, AbstractSequence):
        return [filled(kind.value_type, item, 0.0) for item in value]
    if isinstance(kind, NamespacedType):
        return fill(getattr(importlib.import_module(".".join(kind.namespaces)), kind.name)(), value)
    return type(present)(value) if isinstance(value, int) and not isinstance(value, bool) else value


def words(beginning):
    return [shlex.split(command, comments=True) for command in COMMANDS if command.startswith(beginning)]


def started_as(command):
    """(parameters, namespace) of a server's command line."""
    parameters, namespace = {}, "/"
    for flag, value in pairwise(command):
        if flag == "-p":
            name, text = value.split(":=", 1)
            parameters[name] = yaml.safe_load(text)
        if flag == "-r":
            namespace = value.removeprefix("__ns:=")
    return parameters, namespace


@pytest.fixture(scope="module")
def caller(ros):
    made = Caller("reader")
    yield made
    made.close()


def test_both_ways_to_start_a_server_are_the_same():
    without_ros, with_ros = words(".venv/bin/dynamics_server")[0], words("ros2 run")[0]
    assert with_ros[:4] == ["ros2", "run", "robot_dynamics", "dynamics_server"]
    assert without_ros[1:] == with_ros[4:]


def test_questions_of_the_readme_are_answered_by_the_servers_of_the_readme(caller):
    servers = [started_as(command) for command in words("ros2 run")]
    asked = words("ros2 service call")
    assert len(servers) == 3 and len(asked) == 6
    for parameters, namespace in servers:
        with running_node("dynamics_server", parameters, namespace):
            name = f"{namespace.rstrip('/')}/dynamics_server"
            for _, _, _, service, kind, question in [a for a in asked if a[3].startswith(name + "/")]:
                package, _, kind = kind.split("/")
                service_type = getattr(importlib.import_module(f"{package}.srv"), kind)
                response = caller.call(service_type, service, fill(service_type.Request(), yaml.safe_load(question)))
                assert response.success, response.message
                if kind == "InverseDynamics":
                    assert np.isfinite(response.trajectory.points[0].effort).all()
                    assert bool(response.reactions) == ("reaction_wrenches: true" in question)
                if namespace == "/space":
                    assert response.base.points[0].accelerations[0].linear.z < 0
            if namespace == "/":
                command = [sys.executable, "-c", python_of("rclpy")]
                python = subprocess.run(command, capture_output=True, text=True, timeout=60)
                assert python.stdout.startswith("True  [") and "successful=True" in python.stdout, python
            for _, _, _, node, parameter, text in words("ros2 param set") if namespace == "/" else []:
                assert node == name
                result = caller.set_parameters(node, {parameter: yaml.safe_load(text)})
                assert result.successful, result.reason


@pytest.mark.parametrize(
    ("imported", "printed"),
    [
        ("Dynamics, Inertia", "panda_joint7"),
        ("Base", "(7, 6)"),
        ("Dynamics, load_robot\n\n", "'spring_3'"),
        ("Dynamics, load_robot\nfrom robot_dynamics.ident", "37 base parameters"),
        ("load_robot, Dynamics\n", "(100000, 7) 314 × / 289 +"),
    ],
)
def test_python_of_the_readme_runs(imported, printed, capsys):
    exec(compile(python_of(f"numpy as np\nfrom robot_dynamics import {imported}"), "README.md", "exec"), {})
    assert printed in capsys.readouterr().out


def test_mdh_table_and_commands_of_the_readme_do_what_they_say(tmp_path):
    (table,) = re.findall(r"```yaml\n(# arm.yaml\n.*?)```", README, re.DOTALL)
    (tmp_path / "arm.yaml").write_text(table)
    commands = [command for command in COMMANDS if command.startswith(".venv/bin/robot-dynamics")]
    for command in commands:
        program = Path(sys.executable).with_name("robot-dynamics")
        told = command.strip().replace(".venv/bin/robot-dynamics", str(program))
        done = subprocess.run(told, shell=True, cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0 and not done.stderr, done
    arm, longer, panda = (load_robot(tmp_path / name) for name in ("arm.yaml", "longer.yaml", "panda.urdf"))
    assert (arm.joints[1].placement[0, 3], longer.joints[1].placement[0, 3]) == (0.4, 0.5)
    assert [joint.role for joint in arm.joints] == ["actuated", "elastic"] and not arm.warnings
    assert Dynamics(panda, compiled=False).joint_names == Dynamics(load_robot("panda"), compiled=False).joint_names
    assert load_robot(tmp_path / "puma560.par").name == "puma560" and len(commands) == 10
    assert "longer.yaml" in README and (tmp_path / "mdh.schema.json").read_text().startswith("{")


def python_of(beginning):
    """The one block of Python in the README that begins with importing that."""
    (block,) = [
        block
        for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL)
        if block.startswith(f"import {beginning}")
    ]
    return block


def test_command_line_says_what_it_takes_and_refuses_the_rest():
    command = [sys.executable, "-m", "robot_dynamics.nodes.dynamics_server"]
    helped = subprocess.run([*command, "--help"], capture_output=True, text=True, timeout=60)
    assert helped.returncode == 0 and "robot_file:=panda" in helped.stdout
    for wrong in (["panda"], ["-p", "robot_file:=panda"], ["--ros-args", "-p", "robot_file"]):
        refused = subprocess.run([*command, *wrong], capture_output=True, text=True, timeout=60)
        assert refused.returncode != 0 and wrong[-1] in refused.stderr and "Traceback" not in refused.stderr


def test_table_of_parameters_is_that_of_the_node():
    rows = dict(re.findall(r"^\| `([a-z_.]+)` \| (.*?)\|", README.split("## Parameters")[1], re.MULTILINE))
    assert list(rows) == list(PARAMETERS)
    for name, told in rows.items():
        default = PARAMETERS[name][0]
        assert (yaml.safe_load(told.strip(" `")) if told else "") == default, name


def test_make_targets_of_the_readme_exist_and_ci_runs_what_it_promises():
    makefile, ci = (ROOT / "Makefile").read_text(), (ROOT / ".ci" / "run").read_text()
    for target in set(re.findall(r"`?make ([a-z]+)", README)):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
    for target in ("demo", "test", "lint", "colcon"):
        assert f"make {target}" in ci, target


def test_messages_in_the_table_of_failures_are_said_by_the_code():
    code = " ".join(path.read_text() for path in [*ROOT.glob("robot_dynamics/**/*.py"), *ROOT.glob("tools/*")])
    code = re.sub(r'"\s*\n\s*f?"', "", code)
    told = re.findall(r"^\| `([^|]*)` ?(?:[^|]*)\|", README.split("## When it fails")[1], re.MULTILINE)
    for text in told:
        for message in re.split(r"`, `", text.split("` ")[0]):
            if not message.startswith("ModuleNotFoundError"):
                assert message in code, message
