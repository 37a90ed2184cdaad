"""The streaming process has no shared memory, as its maps and files show, and reaches peers that use it.

This process is such a peer.
"""

import os
import re
import shutil
import subprocess
import sys
from contextlib import contextmanager, suppress
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from nodes.controller_probe import PANDA, ControllerProbe

from robot_dynamics.nodes import middleware
from robot_dynamics.nodes.middleware import PROFILES, large_messages, shared_memory, without_shared_memory
from robot_dynamics.nodes.processes import running_node, terminate_process

NAMES = (
    *middleware.PROFILE_VARIABLES,
    middleware.TRANSPORTS,
    middleware.RANGE,
    middleware.LOCALHOST_ONLY,
    middleware.PEERS,
)
WARNING = "the middleware uses shared memory (/dev/shm/fast"


def segments(process):
    """Shared memory of Fast DDS that a process has mapped or holds open."""
    folder = Path(f"/proc/{process.pid}")
    probe = []
    for file in (folder / "fd").iterdir():
        with suppress(FileNotFoundError):  # closed since the folder was listed
            probe.append(os.readlink(file))
    text = (folder / "maps").read_text() + "\n".join(probe)
    return sorted(set(middleware.SEGMENT.findall(text)))


HERE, ALONE = ({"ROS_AUTOMATIC_DISCOVERY_RANGE": name} for name in ("LOCALHOST", "OFF"))


@contextmanager
def streaming(client, namespace, log, environment):
    """A computed_torque; unless it is alone, its efforts reach this process, and the states of this process it."""
    variables = {**dict.fromkeys(NAMES, ""), **environment}
    parameters = {"robot_file": "panda", "state_timeout": 1.0, "deadline": 1.0}
    with log.open("w") as file, running_node("computed_torque", parameters, namespace, variables, file) as process:
        stand = ControllerProbe(f"{namespace}/computed_torque", client)
        try:
            if environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == "OFF":
                stand.wait_until(lambda: "controls panda_joint1" in log.read_text(), "it is active")
            else:
                stand.stream_until_steady()
            yield process
        finally:
            stand.close()


@pytest.mark.parametrize(
    "environment",
    [
        HERE,
        {"ROS_LOCALHOST_ONLY": "1"},
        ALONE,  # as in a subnet, where no test talks
        {**HERE, "ROS_STATIC_PEERS": "localhost;127.0.0.1"},
        {**HERE, "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"},
    ],
    ids=lambda environment: ",".join(environment.values()),
)
def test_streaming_node_uses_no_shared_memory(environment, ros, client, tmp_path):
    assert shared_memory(), "this process does, else it is no peer that does"
    with streaming(client, "/udp", tmp_path / "log", environment) as process:
        assert segments(process) == []
    assert WARNING not in (tmp_path / "log").read_text()


@pytest.mark.parametrize(
    ("environment", "shared"),
    [
        ({**HERE, "FASTDDS_BUILTIN_TRANSPORTS": "DEFAULT"}, True),
        ({**ALONE, "FASTDDS_BUILTIN_TRANSPORTS": "DEFAULT"}, True),
        ({**HERE, "FASTRTPS_DEFAULT_PROFILES_FILE": "profile.xml"}, True),  # rmw_fastrtps adds it
        ({**ALONE, "FASTRTPS_DEFAULT_PROFILES_FILE": "profile.xml"}, False),
    ],
    ids=lambda value: ",".join(value.values()) if isinstance(value, dict) else str(value),
)
def test_choices_of_the_user_stay_and_shared_memory_is_reported(environment, shared, ros, client, tmp_path):
    profile = tmp_path / "profile.xml"
    profile.write_text(
        '<dds xmlns="http://www.eprosima.com"><profiles><participant profile_name="mine" is_default_profile="true">'
        "<rtps><participantID>77</participantID></rtps></participant></profiles></dds>"
    )
    environment = {name: value.replace(profile.name, str(profile)) for name, value in environment.items()}
    with streaming(client, "/chosen", tmp_path / "log", environment) as process:
        assert bool(segments(process)) == shared
        port = 7410 + 250 * int(os.environ["ROS_DOMAIN_ID"]) + 2 * 77  # that of participant 77, as the profile says
        ports = {int(line.split()[1].split(":")[1], 16) for line in Path("/proc/net/udp").read_text().splitlines()[1:]}
        assert (port in ports) == ("FASTRTPS_DEFAULT_PROFILES_FILE" in environment)
    assert (WARNING in (tmp_path / "log").read_text()) == shared


def test_installed_executable_uses_no_shared_memory(ros, client, tmp_path):
    executable = shutil.which("computed_torque", path=str(Path(sys.executable).parent))
    if executable is None:
        pytest.skip("there is no executable computed_torque beside that of Python")
    environment = {**os.environ, **dict.fromkeys(NAMES, ""), **HERE}
    command = [executable, "--ros-args", "-p", "robot_file:=panda", "-p", "state_timeout:=1.0", "-r", "__ns:=/script"]
    process = subprocess.Popen(command, env=environment, cwd=tmp_path)
    stand = ControllerProbe("/script/computed_torque", client)
    try:
        stand.stream_until_steady()
        assert segments(process) == []
    finally:
        stand.close()
        terminate_process(process)


def set_here(monkeypatch, **environment):
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    return dict(os.environ)


def test_environment_is_restored_and_a_profile_in_the_folder_is_respected(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    before = set_here(monkeypatch, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST", ROS_STATIC_PEERS="127.0.0.5")
    with without_shared_memory():
        profile = Path(os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"])
        assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SYSTEM_DEFAULT"
        assert profile.parent != PROFILES and profile.read_text().count("<address>") == 2
    assert dict(os.environ) == before and not profile.exists()
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").write_text("<dds/>")
    with without_shared_memory():
        assert dict(os.environ) == {**before, "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
    monkeypatch.setenv("SKIP_DEFAULT_XML_FILE", "1")
    with without_shared_memory():
        assert "FASTRTPS_DEFAULT_PROFILES_FILE" in os.environ


def test_static_peer_without_an_address_is_refused(monkeypatch):
    set_here(monkeypatch, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST", ROS_STATIC_PEERS="no such name")
    with pytest.raises(RuntimeError, match="ROS_STATIC_PEERS names 'no such name'"), without_shared_memory():
        pass


def test_other_middleware_is_not_changed(monkeypatch):
    before = set_here(monkeypatch, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    monkeypatch.setattr(middleware, "get_rmw_implementation_identifier", lambda: "rmw_cyclonedds_cpp")
    with without_shared_memory():
        assert dict(os.environ) == before


SEND_LARGE_REQUEST = """
import sys
import numpy as np
import rclpy
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.nodes.middleware import large_messages
from robot_dynamics_interfaces.srv import InverseDynamicsBatch

service, path, *joints = sys.argv[1:]
with large_messages():
    rclpy.init()
    client = ServiceClient("large_requests")
q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 10_000, 7))
fields = {"positions": q, "velocities": qd, "accelerations": qdd}
result = client.call_batch(InverseDynamicsBatch, service, joints, points_per_request=10_000, **fields)
np.save(path, result["efforts"])
print("sent", flush=True)
sys.stdin.read()
"""


def test_message_of_ten_thousand_points_fits_into_the_shared_memory_of_client_and_server(tmp_path, panda_dynamics):
    """What does not fit is lost at first. A participant maps its own segment and those of its peers."""
    variables = {**dict.fromkeys(NAMES, ""), **HERE}
    path = tmp_path / "efforts.npy"
    with running_node("dynamics_server", {"robot_file": "panda"}, "/large", variables) as server:
        command = [sys.executable, "-c", SEND_LARGE_REQUEST, "/large/dynamics_server/inverse_dynamics_batch"]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        with subprocess.Popen([*command, path, *PANDA], env={**os.environ, **variables}, **pipes) as client_process:
            assert client_process.stdout.readline().strip() == b"sent"
            sizes = [
                sorted(Path(name).stat().st_size for name in segments(process) if re.search(r"_[0-9a-f]{16}$", name))
                for process in (server, client_process)
            ]
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 10_000, 7))
    np.testing.assert_allclose(np.load(path), panda_dynamics.inverse(q, qd, qdd), rtol=1e-9, atol=1e-9)
    message_size = 3 * 8 * q.size
    for sizes_of_process in sizes:
        assert sum(size > message_size for size in sizes_of_process) >= 2, sizes


def test_large_messages_respect_transports_and_profiles_of_the_user(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    before = set_here(monkeypatch, ROS_AUTOMATIC_DISCOVERY_RANGE="SUBNET")
    with large_messages():
        assert dict(os.environ) != before
        assert Path(os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"]) == PROFILES / "large_messages.xml"
    for name, value in (("FASTDDS_BUILTIN_TRANSPORTS", "DEFAULT"), ("FASTRTPS_DEFAULT_PROFILES_FILE", "mine.xml")):
        before = set_here(monkeypatch, **{name: value})
        with large_messages():
            assert dict(os.environ) == before


@pytest.mark.parametrize("name", ["udp", "large_messages"])
def test_profiles_differ_in_their_discovery_alone(name):
    """The profile for one machine has what rmw_fastrtps sets up for ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST."""

    def parts(file):
        root = ElementTree.parse(PROFILES / file).getroot()
        for parent in root.iter():
            for child in list(parent):
                if child.tag.rpartition("}")[2] in ("builtin", "maxInitialPeersRange"):
                    parent.remove(child)
        return [(element.tag, (element.text or "").strip()) for element in root.iter()]

    assert parts(f"{name}_localhost.xml") == parts(f"{name}.xml")
