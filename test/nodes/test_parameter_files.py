"""Parameter files with empty lists, and files that `ros2 param dump` writes, loaded by real processes."""

import time

import pytest
import yaml
from nodes.service_requests import assert_still_serves, call_service, inverse
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters

from robot_dynamics.nodes.processes import running_node

# the lists of each node that may be empty
LISTS = {
    "dynamics_server": ("gravity",),
    "computed_torque": ("gravity", "joints", "effort_limits"),
    "mobile_base_simulator": (
        *("gravity", "joints", "wheels.joints", "wheels.radii", "wheels.roller_angles", "ground.points"),
        *("initial.joints", "initial.positions", "initial.velocities"),
    ),
    "payload_identifier": ("gravity", "topics"),
    "replay_check": ("gravity", "topics"),
    "contact_monitor": ("gravity", "locked_joints"),
}
READY = {"computed_torque": "controls panda_joint1", "mobile_base_simulator": "simulates Robot('panda'"}
ELEMENTS = ("bool", "integer", "double", "string")
# fields of a ParameterValue in the order of its types, which begin with 1
FIELDS = [f"{name}_value" for name in (*ELEMENTS, *(f"{element}_array" for element in ("byte", *ELEMENTS)))]


class Log:
    """What a node prints into a file."""

    def __init__(self, folder):
        self._path = folder / "log"
        self.file = self._path.open("w")

    def text(self):
        return self._path.read_text()

    def wait_for(self, text, process, patience=60.0):
        deadline = time.monotonic() + patience
        while text not in self.text():
            assert process.poll() is None and time.monotonic() < deadline, self.text()
            time.sleep(0.05)


def dumped(client, node):
    """The text of a parameter file as `ros2 param dump` writes it."""
    names = client.call(ListParameters, f"{node}/list_parameters", ListParameters.Request()).result.names
    request = GetParameters.Request(names=sorted(names))
    values = client.call(GetParameters, f"{node}/get_parameters", request).values
    tree = {}
    for name, value in zip(request.names, values, strict=True):
        *folders, leaf = name.split(".")
        section_of_name = tree
        for folder in folders:
            section_of_name = section_of_name.setdefault(folder, {})
        entry = getattr(value, FIELDS[value.type - 1]) if value.type else None
        section_of_name[leaf] = list(entry) if value.type >= ParameterType.PARAMETER_BYTE_ARRAY else entry
    return yaml.dump({node: {"ros__parameters": tree}}, default_flow_style=False)


def set_value(client, node, name, value):
    """(successful, reason) of setting a parameter to a ParameterValue."""
    request = SetParameters.Request(parameters=[Parameter(name=name, value=value)])
    (result,) = client.call(SetParameters, f"{node}/set_parameters", request).results
    return result.successful, result.reason


# what `ros2 param set ... "[]"` sends, whatever the parameter is
EMPTY = ParameterValue(type=ParameterType.PARAMETER_BOOL_ARRAY)


@pytest.mark.parametrize("executable", LISTS)
def test_empty_lists_in_a_file_and_in_a_dump_are_empty_lists(executable, client, tmp_path):
    namespace, ready = f"/empty_{executable}", READY.get(executable, "serving Robot('panda'")
    node = f"{namespace}/{executable}"
    log = Log(tmp_path)
    node_parameters = {"robot_file": "panda", **{name: [] for name in LISTS[executable]}}
    with running_node(executable, node_parameters, namespace, log=log.file) as process:
        log.wait_for(ready, process)
        started = dumped(client, node)
        if executable in ("replay_check", "payload_identifier"):  # topics are fixed when they begin
            assert "topics: []" in started
        else:
            for name in LISTS[executable] if executable != "computed_torque" else ("gravity", "effort_limits"):
                if (executable, name) != ("computed_torque", "gravity"):  # fixed while efforts are sent
                    assert set_value(client, node, name, EMPTY) == (True, ""), name
        again = dumped(client, node)
    assert "refused" not in log.text() and "rror" not in log.text() and "null" not in started + again, log.text()
    (section,) = yaml.safe_load(again).values()
    assert section["ros__parameters"]["gravity"] == []
    (tmp_path / "second").mkdir()
    second = Log(tmp_path / "second")
    with running_node(executable, section["ros__parameters"], namespace, log=second.file) as process:
        second.wait_for(ready, process)
    assert "refused" not in second.text() and "rror" not in second.text(), second.text()


def test_empty_gravity_list_means_gravity_of_the_earth(client, start_server, panda_dynamics):
    server = start_server({"robot_file": "panda", "gravity": []})
    assert_still_serves(client, server, panda_dynamics)
    assert client.set_parameters(server, {"gravity": [0.0, 0.0, 0.0]}).successful
    weightless = call_service(client, server, inverse()).trajectory.points[0].effort
    assert set_value(client, server, "gravity", EMPTY) == (True, "")
    assert list(call_service(client, server, inverse()).trajectory.points[0].effort) != list(weightless)
    assert_still_serves(client, server, panda_dynamics)


def test_parameters_cannot_be_removed_and_lists_are_shown_as_lists(client, start_server, panda_dynamics):
    server = start_server({"robot_file": "panda"})
    for name in ("gravity", "payload.mass", "robot_file", "strict", "payload.inertia"):
        successful, reason = set_value(client, server, name, ParameterValue())
        assert not successful and reason == f"parameter {name} is read by this node and cannot be removed"
    for value in (EMPTY, ParameterValue(type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=[1.0])):
        successful, reason = set_value(client, server, "payload.inertia", value)
        assert not successful and f"payload.inertia is {'[1.0]' if value is not EMPTY else '[]'}: 6 numbers" in reason
    assert_still_serves(client, server, panda_dynamics)


@pytest.mark.parametrize(
    ("executable", "wrong", "expected_text"),
    [
        ("mobile_base_simulator", {"wheels.joints": ["a"], "wheels.radii": []}, "wheels.radii has 0 values and"),
        ("mobile_base_simulator", {"initial.pose": []}, "parameter initial.pose is []: 7 numbers are needed"),
        ("mobile_base_simulator", {"step": []}, "parameter step is []: a number is needed"),
        ("computed_torque", {"kp": []}, "parameter kp has 0 values: 7 are needed"),
        ("computed_torque", {"kd": [-1.0, 2.0]}, "parameter kd is [-1.0, 2.0]: numbers of 0 or more"),
        ("computed_torque", {"mode": []}, "parameter mode is []: a text is needed"),
        ("dynamics_server", {"payload.first_moments": []}, "payload.first_moments is []: 3 numbers are needed"),
    ],
)
def test_invalid_empty_lists_are_refused_with_the_accepted_values(executable, wrong, expected_text, tmp_path):
    log = Log(tmp_path)
    with running_node(executable, {"robot_file": "panda", **wrong}, "/wrong", log=log.file) as process:
        deadline = time.monotonic() + 60
        while expected_text not in log.text():
            assert time.monotonic() < deadline, log.text()
            if process.poll() is not None:
                process.wait()
                break
            time.sleep(0.05)
    assert expected_text in log.text() and "array(" not in log.text() and "Traceback" not in log.text(), log.text()
