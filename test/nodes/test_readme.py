"""The commands and examples of the README run: Python, requests to real servers, launch files, tables."""

import importlib
import re
import shlex
import subprocess
import sys
import time
from collections import deque
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import Twist
from nodes.controller_probe import ControllerProbe
from page_runner.messages import fill
from peers.recorded import loaded_panda, messages, panda_motion, write_bag
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.cli import excite
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.nodes.computed_torque.parameters import PARAMETERS as CONTROL_PARAMETERS
from robot_dynamics.nodes.mobile_base_simulator import parameters as simulator_parameters
from robot_dynamics.nodes.processes import running_node
from robot_dynamics.nodes.replay_check.parameters import PARAMETERS as REPLAY_PARAMETERS
from robot_dynamics.nodes.robot_source import PARAMETERS

from .simulator_probe import SimulatorProbe, seconds

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
BASH = re.findall(r"```bash\n(.*?)```", README, re.DOTALL)
STARTS = "ros2|make|\\.venv|git|rosdep|colcon|source"
COMMANDS = [command for block in BASH for command in re.split(rf"\n(?={STARTS})", block)]


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
        if flag == "--params-file":
            (told,) = yaml.safe_load((ROOT / value).read_text()).values()
            parameters.update(told["ros__parameters"])
    return parameters, namespace


@pytest.fixture(scope="module")
def client(ros):
    service_client = ServiceClient("reader")
    yield service_client
    service_client.close()


def test_server_is_started_alike_with_and_without_ros_installation():
    without_ros, with_ros = words(".venv/bin/dynamics_server")[0], words("ros2 run")[0]
    assert with_ros[:4] == ["ros2", "run", "robot_dynamics", "dynamics_server"]
    assert without_ros[1:] == with_ros[4:]


def test_requests_of_the_readme_are_served_by_its_servers(client):
    servers = [started_as(command) for command in words("ros2 run") if command[3] == "dynamics_server"]
    calls = [command for command in words("ros2 service call") if "dynamics_server/" in command[3]]
    assert len(servers) == 4 and len(calls) == 7
    for parameters, namespace in servers:
        with running_node("dynamics_server", parameters, namespace):
            name = f"{namespace.rstrip('/')}/dynamics_server"
            for _, _, _, service, kind, text_of_request in [a for a in calls if a[3].startswith(name + "/")]:
                package, _, kind = kind.split("/")
                service_type = getattr(importlib.import_module(f"{package}.srv"), kind)
                response = client.call(
                    service_type, service, fill(service_type.Request(), yaml.safe_load(text_of_request))
                )
                assert response.success, response.message
                if kind == "InverseDynamics":
                    assert np.isfinite(response.trajectory.points[0].effort).all()
                    assert bool(response.reactions) == ("reaction_wrenches: true" in text_of_request)
                if namespace == "/space":
                    assert response.base.points[0].accelerations[0].linear.z < 0
            if namespace == "/":
                command = [sys.executable, "-c", python_of("rclpy")]
                python = subprocess.run(command, capture_output=True, text=True, timeout=180)
                assert python.stdout.startswith("True  [") and "successful=True" in python.stdout, python
            for _, _, _, node, parameter, text in words(f"ros2 param set {name}"):
                result = client.set_parameters(node, {parameter: yaml.safe_load(text)})
                assert result.successful, result.reason


@pytest.mark.parametrize(
    ("imported", "printed"),
    [
        ("Dynamics, Inertia", "panda_joint7"),
        ("Base", "(7, 6)"),
        ('Dynamics, load_robot\n\ndynamics = Dynamics(load_robot("manutec', "'spring_3'"),
        ("load_robot, Base\n", "after 1 s"),
        ("Dynamics, load_robot\nfrom robot_dynamics.ident", "37 base parameters"),
        ('Dynamics, load_robot\n\ndynamics = Dynamics(load_robot("hexapod_stack', "6.2606"),
        ("Dynamics, load_robot\n\ndelta = Dynamics", "[1. 0. 2. 0. 0. 0.]"),
        ("load_robot, Dynamics\n", "(100000, 7) 314 × / 289 +"),
        ("Dynamics, load_robot\nfrom robot_dynamics.flex", "(5, 144) (90, 90) (5, 5, 3)"),
    ],
)
def test_python_of_the_readme_runs(imported, printed, capsys):
    exec(compile(python_of(f"numpy as np\nfrom robot_dynamics import {imported}"), "README.md", "exec"), {})
    assert printed in capsys.readouterr().out


def test_flexible_arm_of_the_readme_runs(tmp_path, monkeypatch, capsys):
    (mast,) = re.findall(r"```yaml\n(# mast.yaml\n.*?)```", README, re.DOTALL)
    (tmp_path / "mast.yaml").write_text(mast)
    monkeypatch.chdir(tmp_path)
    block = python_of("numpy as np\nfrom robot_dynamics import Dynamics, load_robot\n\narm = ")
    exec(compile(block, "README.md", "exec"), {})
    assert "(44, 44) (42, 42) [" in capsys.readouterr().out


def test_mdh_table_and_commands_of_the_readme_run(tmp_path):
    (table,) = re.findall(r"```yaml\n(# arm.yaml\n.*?)```", README, re.DOTALL)
    (tmp_path / "arm.yaml").write_text(table)
    (mast,) = re.findall(r"```yaml\n(# mast.yaml\n.*?)```", README, re.DOTALL)
    mast_frequencies = Dynamics(load_robot(mast)).elastodynamics.frequencies([0.0, 0.0])
    assert 1 < mast_frequencies[0] < 20 and not load_robot(mast).warnings
    for name, model in (("run", None), ("run_loaded", loaded_panda(2.5))):
        write_bag(tmp_path / name, messages(panda_motion(duration=12.0, model=model)))
    commands = [command for command in COMMANDS if command.startswith(".venv/bin/robot-dynamics")]
    for command in commands:
        program = Path(sys.executable).with_name("robot-dynamics")
        told = command.strip().replace(".venv/bin/robot-dynamics", str(program))
        done = subprocess.run(told, shell=True, cwd=tmp_path, capture_output=True, text=True, timeout=180)
        assert done.returncode == 0 and not done.stderr, done
    arm, longer, panda = (load_robot(tmp_path / name) for name in ("arm.yaml", "longer.yaml", "panda.urdf"))
    assert (arm.joints[1].placement[0, 3], longer.joints[1].placement[0, 3]) == (0.4, 0.5)
    assert [joint.role for joint in arm.joints] == ["actuated", "elastic"] and not arm.warnings
    assert Dynamics(panda, compiled=False).joint_names == Dynamics(load_robot("panda"), compiled=False).joint_names
    assert load_robot(tmp_path / "puma560.par").name == "puma560" and len(commands) == 19
    assert "passed" in (tmp_path / "report.html").read_text()
    assert "longer.yaml" in README and (tmp_path / "mdh.schema.json").read_text().startswith("{")


def python_of(beginning):
    """The one block of Python in the README that begins with importing that."""
    (block,) = [
        block
        for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL)
        if block.startswith(f"import {beginning}")
    ]
    return block


def test_table_of_parameters_is_that_of_the_node():
    rows = dict(re.findall(r"^\| `([a-z_.]+)` \| (.*?)\|", README.split("## Parameters")[1], re.MULTILINE))
    assert list(rows) == list(PARAMETERS)
    for name, told in rows.items():
        default = PARAMETERS[name].default
        assert (yaml.safe_load(told.strip(" `")) if told else "") == default, name


def test_computed_torque_of_the_readme_streams(client):
    command = words(".venv/bin/computed_torque")[0]
    assert "robot:=panda" in words("ros2 launch robot_dynamics computed_torque.launch.py")[0]
    parameters, _ = started_as(command)
    file = ROOT / command[command.index("--params-file") + 1]
    parameters.update(yaml.safe_load(file.read_text())["/**/computed_torque"]["ros__parameters"])
    published = words("ros2 topic pub --once /computed_torque/reference")[0]
    assert published[5] == "trajectory_msgs/msg/JointTrajectory"
    with running_node("computed_torque", {**parameters, "state_timeout": 0.5, "deadline": 1.0}, "/readme"):
        probe = ControllerProbe("/readme/computed_torque", client)
        try:
            probe.stream_until_steady()
            probe.reference.publish(fill(JointTrajectory(), yaml.safe_load(published[6])))
            probe.stream_until(lambda: any(message == "computed_torque" for _, message, _ in probe.diagnostics), "it")
            ((*_, parameter, value),) = words("ros2 param set /computed_torque")
            assert probe.set_parameters(**{parameter: value}).successful
            probe.stream_until(lambda: probe.has_diagnostic(value), value)
        finally:
            probe.close()


def test_table_of_parameters_of_computed_torque_is_that_of_the_node():
    table = README.split("| of computed_torque |")[1].split("\n\n")[0]
    rows = dict(re.findall(r"^\| `([a-z_]+)` \| (.*?)\|", table, re.MULTILINE))
    assert list(rows) == list(CONTROL_PARAMETERS)
    for name, told in rows.items():
        assert (yaml.safe_load(told.strip(" `")) if told.strip() else "") == CONTROL_PARAMETERS[name].default, name


def test_excite_takes_as_long_in_the_readme_as_in_its_help():
    taken = [re.findall(r"It takes (.*? seconds?|a second .*?)\b", text) for text in (README, excite.__doc__)]
    assert taken == [["some seconds"], ["some seconds"]]


def test_simulators_of_the_readme_run_and_accept_its_messages(client):
    started = [command for command in words(".venv/bin/mobile_base_simulator") if "~/effort" not in command[-1]]
    publications = [
        command[5:] for command in words("ros2 topic pub --rate") if "/mobile_base_simulator/" in command[5]
    ]
    assert len(started) == 3 and len(publications) == 2
    for command in started[:2]:
        parameters, namespace = started_as(command)
        with running_node("mobile_base_simulator", parameters, namespace):
            node = SimulatorProbe(f"{namespace.rstrip('/')}/mobile_base_simulator", client)
            node.wait_until(lambda node=node: node.joint_states, "joint_states")
            if namespace == "/space":
                node.wait_until(lambda node=node: node.odom, "odom")
            messages = []
            for topic, kind, message in publications if namespace == "/" else []:
                package, _, kind = kind.split("/")
                message_type = getattr(importlib.import_module(f"{package}.msg"), kind)
                messages.append((topic, fill(message_type(), yaml.safe_load(message))))

            def efforts_act(node=node, messages=messages):
                for topic, message in messages:  # again and again, as `ros2 topic pub --rate` does
                    node.publish(topic, message)
                return any(np.any(state.effort) for state in node.joint_states)

            if namespace == "/":
                node.wait_until(efforts_act, "efforts that act")
                assert not node.has_diagnostic("refused:")


def test_commands_of_the_readme_are_published_faster_than_they_time_out():
    """What is published once a second, as `ros2 topic pub` does by itself, acts for a tenth of the time."""
    wheels = started_as(next(c for c in words(".venv/bin/mobile_base_simulator") if "--params-file" in c))[0]
    default = simulator_parameters.PARAMETERS["command_timeout"].default
    published = [command[3:] for command in words("ros2 topic pub")]
    assert len(published) == 4
    for first, *others in published:
        if first == "--once":
            assert others[0] == "/computed_torque/reference"
            continue
        timeout = wheels["command_timeout"] if others[1] == "/cmd_vel" else default
        assert first == "--rate" and float(others[0]) > 2 / timeout, (first, others)


def test_wheeled_robot_of_the_readme_follows_its_command(client):
    (command,) = [command for command in words(".venv/bin/mobile_base_simulator") if "--params-file" in command]
    (driven,) = [command for command in words("ros2 topic pub") if "/cmd_vel" in command]
    message = fill(Twist(), yaml.safe_load(driven[-1]))
    with running_node("mobile_base_simulator", started_as(command)[0]):
        node = SimulatorProbe("/mobile_base_simulator", client)

        def there():
            node.publish("/cmd_vel", message)
            if not node.odom or abs(node.odom[-1].twist.twist.angular.z - message.angular.z) > 1e-4:
                return False
            reached.append(seconds(node.odom[-1].header.stamp))
            # on a busy machine joint_states, of which there are more, are heard later than odom
            return seconds(node.joint_states[-1].header.stamp) >= reached[0]

        reached = []
        node.wait_until(there, "the twist that was commanded")
        told = dict(zip(node.joint_states[-1].name, node.joint_states[-1].velocity, strict=True))
    for wheel, side in (("wheel_left_joint", -1), ("wheel_right_joint", 1)):  # 0.033 m of radius, 0.16 m apart
        assert told[wheel] == pytest.approx((message.linear.x + side * 0.08 * message.angular.z) / 0.033, rel=1e-3)


def test_closed_loop_of_the_readme_reaches_its_posture(client):
    (simulator,) = [command for command in words(".venv/bin/mobile_base_simulator") if "~/effort" in command[-1]]
    controller = words(".venv/bin/computed_torque")[-1]
    posture = yaml.safe_load(words("ros2 topic pub --once /computed_torque/reference")[0][6])
    remapped = dict([simulator[-1].split(":=")])
    parameters = {**started_as(controller)[0], "deadline": 1.0, "state_timeout": 1.0}  # whatever else runs here
    with (
        running_node("mobile_base_simulator", started_as(simulator)[0], "/both", remappings=remapped),
        running_node("computed_torque", parameters, "/both"),
    ):
        states, wanted = (
            deque(maxlen=1),
            dict(zip(posture["joint_names"], posture["points"][0]["positions"], strict=True)),
        )
        node = client.node
        subscription = node.create_subscription(
            JointState, "/both/joint_states", lambda state: states.append(state), 10
        )
        reference = node.create_publisher(JointTrajectory, "/both/computed_torque/reference", 10)

        def within(patience, condition):
            deadline = time.monotonic() + patience
            while not condition():
                assert time.monotonic() < deadline, states
                client.spin(0.1)

        within(60, lambda: reference.get_subscription_count() and states and any(states[0].effort))
        reference.publish(fill(JointTrajectory(), posture))

        def there():
            at = dict(zip(states[0].name, states[0].position, strict=True))
            return all(abs(at[name] - position) < 2e-3 for name, position in wanted.items())

        within(120, there)
        node.destroy_subscription(subscription)


def test_launch_files_of_the_readme_exist_and_declare_its_arguments():
    for _, _, package, file, *arguments in words("ros2 launch"):
        text = (ROOT / "launch" / file).read_text()
        assert package == "robot_dynamics"
        for argument in arguments:
            assert f'"{argument.split(":=")[0]}"' in text


def test_table_of_the_simulators_parameters_is_that_of_the_node():
    table = README.split("| parameter of the simulator |")[1].split("\n\n")[0]
    rows = re.findall(r"^\| ([a-z_.]+) \| (.*?) ?\| (.*) \|$", table, re.MULTILINE)
    assert [name for name, _, _ in rows] == list(simulator_parameters.PARAMETERS)
    for name, default, description in rows:
        assert (yaml.safe_load(default.strip("`")) if default else "") == simulator_parameters.PARAMETERS[
            name
        ].default, name
        assert description == simulator_parameters.PARAMETERS[name].description, name


def test_replay_check_of_the_readme_reports(client):
    (started,) = words(".venv/bin/replay_check")
    calls = [command for command in words("ros2 service call") if command[3].startswith("/replay_check/")]
    with running_node("replay_check", *started_as(started)):
        for _, _, _, service, kind in calls:
            assert kind == "std_srvs/srv/Trigger"
            response = client.call(Trigger, service, Trigger.Request())
            assert not response.success and "nothing was compared yet" in response.message
    assert len(calls) == 1


def test_table_of_parameters_of_replay_check_is_that_of_the_node():
    table = README.split("| of replay_check |")[1].split("\n\n")[0]
    rows = re.findall(r"^\| ([a-z_]+) \| (.*?) ?\| (.*) \|$", table, re.MULTILINE)
    assert [name for name, _, _ in rows] == list(REPLAY_PARAMETERS)
    for name, default, description in rows:
        assert (yaml.safe_load(default.strip("`")) if default else "") == REPLAY_PARAMETERS[name].default, name
        assert description == REPLAY_PARAMETERS[name].description, name


def test_messages_in_the_table_of_failures_are_in_the_code():
    code = " ".join(path.read_text() for path in [*ROOT.glob("robot_dynamics/**/*.py"), *ROOT.glob("tools/*")])
    code = re.sub(r'"\s*\n\s*f?"', "", code)
    told = re.findall(r"^\| `([^|]*)` ?(?:[^|]*)\|", README.split("## Troubleshooting")[1], re.MULTILINE)
    for text in told:
        for message in re.split(r"`, `", text.split("` ")[0]):
            if not message.startswith("ModuleNotFoundError"):
                assert message in code, message
