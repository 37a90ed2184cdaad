"""Launch files name what exists, and where `launch` can be imported they make their descriptions."""

import ast
import importlib.util
import re
from pathlib import Path

import pytest
import yaml

from robot_dynamics import load_robot, shipped_robots

ROOT = Path(__file__).parents[1]
FILES = sorted((ROOT / "launch").glob("*.launch.py"))
EXECUTABLES = set(re.findall(r'^(\w+) = "robot_dynamics\.nodes', (ROOT / "pyproject.toml").read_text(), re.MULTILINE))

DEPENDENCIES = set(re.findall(r"<exec_depend>(\w+)</exec_depend>", (ROOT / "package.xml").read_text()))


def calls(path, name):
    """Return {keyword: ast node} of each call of a function."""
    tree = ast.parse(path.read_text())
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and getattr(node.func, "id", "") == name]
    return [({word.arg: word.value for word in call.keywords}, call.args) for call in nodes]


def test_launch_files_exist_for_each_node_and_the_closed_loop():
    names = {path.name.removesuffix(".launch.py") for path in FILES}
    assert {"dynamics_server", "mobile_base_simulator", "computed_torque", "closed_loop", "view"} <= names
    for name in names - {"closed_loop", "view"}:
        assert name in EXECUTABLES


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_packages_and_files_in_launch_files_exist(path):
    text = path.read_text()
    nodes = [words for words, _ in calls(path, "Node")]
    assert nodes and re.search(r'"?package"?[=:] ?"robot_dynamics"', text)
    for words in nodes:
        package = words.get("package")
        if package is not None and ast.literal_eval(package) != "robot_dynamics":
            assert ast.literal_eval(package) in DEPENDENCIES
            continue
        executable = ast.literal_eval(words["executable"])
        assert executable in EXECUTABLES
        assert (ROOT / "robot_dynamics" / "nodes" / executable / "__main__.py").is_file()
    for _, (parts,) in calls(path, "PathJoinSubstitution"):
        package, *names = parts.elts
        assert ast.literal_eval(package.args[0]) == "robot_dynamics"
        assert ROOT.joinpath(*map(ast.literal_eval, names)).is_file()
    declared = {literal(args[0]): words for words, args in calls(path, "DeclareLaunchArgument")}
    if None not in declared:  # all of them written out
        assert literal(declared["robot"]["default_value"]) in shipped_robots()
        read = [*calls(path, "LaunchConfiguration"), *calls(path, "value_of")]
        assert {literal(args[0]) for _, args in read if isinstance(args[0], ast.Constant)} == set(declared)
    assert ast.get_docstring(ast.parse(text)).count(f"ros2 launch robot_dynamics {path.name}") == 1
    for robot in re.findall(r"robot:=(\w+)", text):
        assert robot in {*shipped_robots(), "none"}


def literal(node):
    """Return the value of an expression, None where it is not a literal."""
    return node.value if isinstance(node, ast.Constant) else None


SHIPPED = ["mobile_base_simulator", "computed_torque", "closed_loop", "turtlebot3_burger", "contact_monitor"]


@pytest.mark.parametrize("name", [*SHIPPED, "simulated_time", "machine_time"])
def test_parameter_files_have_parameters_of_the_nodes(name):
    from robot_dynamics.nodes.computed_torque import parameters as control_parameters
    from robot_dynamics.nodes.contact_monitor import parameters as monitor_parameters
    from robot_dynamics.nodes.mobile_base_simulator import parameters as simulator_parameters
    from robot_dynamics.nodes.mobile_base_simulator.simulation_setup import build_simulation

    validate = {
        "mobile_base_simulator": simulator_parameters.validate_parameter,
        "computed_torque": control_parameters.validate_parameter,
        "contact_monitor": lambda parameter, value: monitor_parameters.PARAMETERS[parameter].validate(value),
    }
    for node, section in yaml.safe_load((ROOT / "config" / f"{name}.yaml").read_text()).items():
        validate_parameter = validate[node.rpartition("/")[2]]
        assert section["ros__parameters"]
        for parameter, value in section["ros__parameters"].items():
            if parameter == "robot_file":
                assert value in shipped_robots()
            elif parameter != "use_sim_time":
                validate_parameter(parameter, value)
    defaults = {key: spec.validate(spec.default) for key, spec in simulator_parameters.PARAMETERS.items()}
    build_simulation(defaults, load_robot("ur5e"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_launch_descriptions_are_created(path):
    pytest.importorskip("launch.actions", reason="launch is part of ROS, and not among its wheels")
    pytest.importorskip("launch_ros.actions", reason="launch_ros is part of ROS, and not among its wheels")
    spec = importlib.util.spec_from_file_location(path.stem.replace(".", "_"), path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    nodes = [entity for entity in module.generate_launch_description().entities if hasattr(entity, "node_executable")]
    executables = [ast.literal_eval(words["executable"]) for words, _ in calls(path, "Node")]
    assert [node.node_executable for node in nodes] == executables
