"""The nodes that launch files start, on machines without `launch`, which is not among the wheels of ROS.

It has the few classes that our files use, with the rules of `ros2 launch` (launch 3.4, launch_ros 0.26).
"""

import importlib.util
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace

import yaml

ROOT = Path(__file__).parents[2]


def typed_arguments(arguments):
    """{name: value} of arguments `name:=value`. Raises ValueError for arguments that ros2 launch calls malformed."""
    values = {}
    for argument in arguments:
        name, assigned, value = argument.partition(":=")
        if not (name and assigned and value):
            raise ValueError(f"malformed launch argument '{argument}', expected format '<name>:=<value>'")
        values[name] = value
    return values


def performed(value, context):
    """The text of a substitution, or of a list of them, for the launch arguments of `context`."""
    if isinstance(value, list | tuple):
        return "".join(performed(item, context) for item in value)
    return value if isinstance(value, str) else value.perform(context)


def _truth(value):
    return str(bool(value)).lower()


class _Substitution:
    """A substitution by a function; also the base class of those of a launch file, which have a method `perform`."""

    def __init__(self, perform=None):
        if perform is not None:
            self.perform = perform


@dataclass
class DeclareLaunchArgument:
    name: str
    default_value: object = None
    description: str = ""


@dataclass
class ParameterValue:
    value: object
    value_type: type

    def evaluated(self, context):
        text = performed(self.value, context)
        return text if self.value_type is str else yaml.safe_load(text)


@dataclass
class IfCondition:
    expression: object

    def evaluate(self, context):
        return {"true": True, "false": False}[performed(self.expression, context)]


@dataclass
class Node:
    package: str
    executable: str
    namespace: object = ""
    arguments: list = field(default_factory=list)
    parameters: list = field(default_factory=list)
    remappings: list = field(default_factory=list)
    condition: IfCondition | None = None
    output: str = "log"

    def starts(self, context):
        return self.condition is None or self.condition.evaluate(context)

    def program_arguments(self, context):
        """Arguments before --ros-args on the command line."""
        return [performed(word, context) for word in self.arguments]

    def ros_arguments(self, context, folder):
        """Arguments after --ros-args on the command line; dicts of parameters are written into files in a folder."""
        namespace = performed(self.namespace, context)
        words = ["-r", f"__ns:=/{namespace.strip('/')}"] if namespace else []
        for number, parameters in enumerate(self.parameters):
            if isinstance(parameters, dict):
                values = {name: _parameter(value, context) for name, value in parameters.items()}
                path = Path(folder) / f"{self.executable}_{namespace.strip('/')}_{number}.yaml"
                path.write_text(yaml.dump({"/**": {"ros__parameters": values}}))
            else:
                path = performed(parameters, context)
            words += ["--params-file", str(path)]
        for old, new in self.remappings:
            words += ["-r", f"{performed(old, context)}:={performed(new, context)}"]
        return words


def _parameter(value, context):
    """The value of one parameter: without a type the text of a substitution is YAML, as in launch_ros."""
    if isinstance(value, ParameterValue):
        return value.evaluated(context)
    return yaml.safe_load(performed(value, context)) if isinstance(value, _Substitution) else value


def _equals(left, right):
    return lambda context: performed(left, context) == performed(right, context)


SUBSTITUTIONS = {
    "LaunchConfiguration": lambda name: _Substitution(lambda context: context[name]),
    "EqualsSubstitution": lambda left, right: _Substitution(lambda c: _truth(_equals(left, right)(c))),
    "NotEqualsSubstitution": lambda left, right: _Substitution(lambda c: _truth(not _equals(left, right)(c))),
    "IfElseSubstitution": lambda condition, yes="", no="": _Substitution(
        lambda c: performed(yes if performed(condition, c) == "true" else no, c)
    ),
    "PathJoinSubstitution": lambda parts: _Substitution(lambda c: "/".join(performed(part, c) for part in parts)),
}
MODULES = {
    "launch": {"LaunchDescription": lambda entities: SimpleNamespace(entities=entities)},
    "launch.substitution": {"Substitution": _Substitution},
    "launch.conditions": {"IfCondition": IfCondition},
    "launch.actions": {"DeclareLaunchArgument": DeclareLaunchArgument},
    "launch.substitutions": SUBSTITUTIONS,
    "launch_ros": {},
    "launch_ros.actions": {"Node": Node},
    "launch_ros.parameter_descriptions": {"ParameterValue": ParameterValue},
    "launch_ros.substitutions": {"FindPackageShare": lambda _: _Substitution(lambda _: str(ROOT))},
}


IMPORTERS = ("robot_dynamics.nodes.launching",)  # modules that import the classes above


def description(path):
    """The entities of the launch file at a Path: DeclareLaunchArguments and Nodes."""
    before = {name: sys.modules.get(name) for name in (*MODULES, *IMPORTERS)}
    for name in IMPORTERS:
        sys.modules.pop(name, None)
    try:
        for name, members in MODULES.items():
            sys.modules[name] = ModuleType(name)
            vars(sys.modules[name]).update(members)
        spec = importlib.util.spec_from_file_location(path.stem.replace(".", "_"), path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.generate_launch_description().entities
    finally:
        for name, module in before.items():
            if module is None:
                sys.modules.pop(name, None)
            else:
                sys.modules[name] = module


def started(file, arguments, folder):
    """[(executable, arguments after --ros-args)] of our own nodes of `ros2 launch robot_dynamics FILE ARGUMENTS...`."""
    nodes, context = started_nodes(file, arguments)
    own = [node for node in nodes if node.package == "robot_dynamics"]
    return [(node.executable, node.ros_arguments(context, folder)) for node in own]


def started_nodes(file, arguments):
    """(Nodes of all packages, context) of `ros2 launch robot_dynamics FILE ARGUMENTS...`."""
    entities = description(ROOT / "launch" / file)
    declared = {item.name: item for item in entities if isinstance(item, DeclareLaunchArgument)}
    context = typed_arguments(arguments)
    assert set(context) <= set(declared), f"{file} has the arguments {', '.join(declared)}"
    for name, argument in declared.items():
        if name not in context:
            context[name] = performed(argument.default_value, context)
    return [item for item in entities if isinstance(item, Node) and item.starts(context)], context
