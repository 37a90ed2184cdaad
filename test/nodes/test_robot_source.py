"""The robot of a server: parameters, files, the latched topic. A refused change leaves the loaded robot."""

import os
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nodes.service_requests import (
    PANDA,
    QD,
    QDD,
    Q,
    assert_still_serves,
    call_service,
    call_successfully,
    field,
    inverse,
    inverse_request,
)
from peers.real_robots import real_urdf
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from robot_dynamics import Dynamics, Inertia, load_robot
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.nodes.processes import running_node

GOOD = real_urdf("ur5")
REFUSED = {
    "malformed": (GOOD[:-20], "not well-formed"),
    "doctype": ("<!DOCTYPE robot>" + GOOD, "DOCTYPE"),
    "external entity": ('<!DOCTYPE r [<!ENTITY f SYSTEM "file:///etc/passwd">]><robot name="&f;"/>', "DOCTYPE"),
    "external include": (
        '<robot name="r" xmlns:i="http://www.w3.org/2001/XInclude"><i:include href="/etc/passwd"/></robot>',
        "XInclude",
    ),
    "unknown joint type": (GOOD.replace('type="revolute"', 'type="hinge"', 1), "type 'hinge'"),
    "cycle": (
        '<robot name="r"><link name="a"/><link name="b"/>'
        '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
        '<joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint></robot>',
        "cycle",
    ),
    "two roots": ('<robot name="r"><link name="a"/><link name="b"/></robot>', "all roots"),
    "missing inertia": ('<robot name="r"><link name="a"><inertial><mass value="1"/></inertial></link></robot>', "'a'"),
    "negative mass": (GOOD.replace('<mass value="3.7"/>', '<mass value="-3.7"/>'), "negative"),
    "NaN": (GOOD.replace('<mass value="3.7"/>', '<mass value="nan"/>'), "nan"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_description_leaves_the_old_robot_loaded(case, client, panda, panda_dynamics):
    text, reason = REFUSED[case]
    assert text != GOOD
    result = client.set_parameters(panda, {"robot_description": text})
    assert not result.successful and reason in result.reason
    assert_still_serves(client, panda, panda_dynamics)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"robot_file": "/no/such/robot.urdf"}, "set robot_path at its start"),
        ({"robot_file": "pnda"}, "set robot_path at its start"),
        ({"robot_path": ["/"]}, "read at startup"),
        ({"robot_file": ""}, "would be empty"),
        ({"base": "floating"}, "fixed, moving"),
        ({"gravity": [0.0, 9.81]}, "3 numbers are needed"),
        ({"gravity": [0.0, 0.0, float("nan")]}, "three finite numbers"),
        ({"locked_joints": ["panda_joint99"]}, "locked_joints: locked joint: unknown moving joint 'panda_joint99'"),
        ({"locked_joints": ["panda_joint7"], "locked_positions": [0.1, 0.2]}, "2 numbers and locked_joints 1 names"),
        ({"locked_joints": ["panda_joint7"] * 2}, "'panda_joint7' more than once"),
        ({"payload.link": "panda_link99", "payload.mass": 1.0}, "payload.link: unknown link 'panda_link99'"),
        ({"payload.link": "panda_link8", "payload.mass": -1.0}, "payload.mass is -1: 0 or more"),
        ({"payload.link": "panda_link8", "payload.inertia": [1.0, 2.0]}, "6 numbers are needed, xx, xy"),
        ({"payload.link": "panda_link8", "payload.first_moments": [1.0, float("nan"), 0.0]}, "finite"),
        ({"payload.link": "panda_link8", "payload.first_moments": [1.0, 0.0, 0.0], "strict": True}, "'panda_link7'"),
        ({"payload.mass": "heavy"}, "'heavy': a number is needed"),
        ({"strict": "yes"}, "true or false is needed"),
        ({"robot_file": 7}, "a text is needed"),
    ],
)
def test_refused_parameter_leaves_the_old_robot_loaded(change, reason, client, panda, panda_dynamics):
    result = client.set_parameters(panda, change)
    assert not result.successful and reason in result.reason, result.reason
    assert_still_serves(client, panda, panda_dynamics)


@pytest.fixture
def reader(start_server, tmp_path):
    """A server of the shipped Panda that may read the files of a test while it runs."""
    return start_server({"robot_file": "panda", "robot_path": [str(tmp_path)]})


def test_running_node_reads_no_file_outside_the_folders_that_it_may_read(client, reader, panda_dynamics, tmp_path):
    secret = tmp_path.with_name(f"{tmp_path.name}_secret")
    secret.write_text("root:$y$secret")
    (tmp_path / "link.urdf").symlink_to(secret)
    for path in (secret, tmp_path / ".." / secret.name, tmp_path / "link.urdf", "/no/such/file"):
        result = client.set_parameters(reader, {"robot_file": str(path)})
        assert not result.successful and "set robot_path at its start" in result.reason
        assert "secret" not in result.reason.replace(secret.name, "") and "exist" not in result.reason
    assert_still_serves(client, reader, panda_dynamics)


def test_running_node_reads_files_of_its_folders_and_shipped_robots(client, reader, tmp_path):
    (tmp_path / "robot.urdf").write_text(real_urdf("kinova"))
    assert client.set_parameters(reader, {"robot_file": str(tmp_path / "robot.urdf")}).successful
    assert client.set_parameters(reader, {"robot_file": "ur5e"}).successful


def test_file_of_100_megabytes_is_refused_and_the_old_robot_stays(client, reader, panda_dynamics, tmp_path):
    path = tmp_path / "large.urdf"
    path.write_text(GOOD + " " * 100_000_000)
    result = client.set_parameters(reader, {"robot_file": str(path)})
    assert not result.successful and "100" in result.reason and "at most" in result.reason
    assert_still_serves(client, reader, panda_dynamics)


def test_server_survives_unforeseen_descriptions(client, reader, panda_dynamics, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    undefined = tmp_path / "undefined.urdf"
    undefined.write_bytes(b'<?xml version="1.0" encoding="undefined"?><robot/>')
    for change in (
        {"robot_file": str(tmp_path / "pipe")},
        {"robot_file": str(undefined)},
        {"robot_description": "panda"},
    ):
        assert not client.set_parameters(reader, change).successful
        assert_still_serves(client, reader, panda_dynamics)


def test_file_that_changed_is_read_again(client, start_server, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(real_urdf("ur5"))
    server = start_server({"robot_file": str(path)})
    path.write_text(real_urdf("kinova"))
    assert client.set_parameters(server, {"robot_file": str(path)}).successful
    response = call_service(client, server, inverse())
    assert (not response.success and "known are j2n6s200_joint_1" in response.message) or "j2" in response.message


def test_unknown_parameter_is_refused_with_the_right_name(client, panda):
    result = client.set_parameters(panda, {"payload_mass": 1.0})
    assert not result.successful and "'payload_mass': did you mean 'payload.mass'" in result.reason


def test_payload_that_cannot_exist_is_served_with_a_warning(client, start_server):
    server = start_server({"robot_file": "panda"})
    payload = {"payload.link": "panda_link8", "payload.mass": 2.0, "payload.first_moments": [0.0, 0.0, 0.2]}
    assert client.set_parameters(server, payload).successful
    warning = "payload on link 'panda_link8': inertia is not positive definite"
    response = call_service(client, server, inverse())
    assert response.success and warning in response.message
    reports = []
    client.node.create_subscription(DiagnosticArray, "/diagnostics", lambda array: reports.extend(array.status), 10)
    eventually(
        client,
        lambda: any(status.level == DiagnosticStatus.WARN and warning in status.message for status in reports),
    )
    assert client.set_parameters(server, {"payload.inertia": [0.02, 0.0, 0.0, 0.02, 0.0, 0.0]}).successful
    assert call_successfully(client, server, inverse()).message == ""


def test_integers_are_accepted_as_numbers(client, start_server):
    server = start_server({"robot_file": "panda", "gravity": [0, 0, -10]})
    assert client.set_parameters(server, {"payload.link": "panda_link8", "payload.mass": 2}).successful
    heavy = Dynamics(load_robot("panda", gravity=(0, 0, -10)).with_payload("panda_link8", Inertia(2.0)), compiled=False)
    served = call_successfully(client, server, inverse())
    np.testing.assert_array_equal(field(served.trajectory, "effort"), heavy.inverse(Q, QD, QDD))


def test_joints_are_locked_by_parameters_and_refused_in_requests(client, start_server):
    server = start_server({"robot_file": "panda"})
    locked = {"locked_joints": ["panda_joint7", "panda_joint6"], "locked_positions": [0.4, 1.2]}
    assert client.set_parameters(server, locked).successful
    robot = load_robot("panda", locked={"panda_joint7": 0.4, "panda_joint6": 1.2})
    served = call_successfully(client, server, inverse(PANDA[:5], Q[:, :5], QD[:, :5], QDD[:, :5]))
    expected = Dynamics(robot, compiled=False).inverse(Q[:, :5], QD[:, :5], QDD[:, :5])
    np.testing.assert_array_equal(field(served.trajectory, "effort"), expected)
    refused = call_service(client, server, inverse())
    assert not refused.success and "joint 'panda_joint6', 'panda_joint7' is locked" in refused.message
    assert client.set_parameters(server, {"locked_joints": "", "locked_positions": ""}).successful
    call_successfully(client, server, inverse())


@pytest.mark.parametrize(
    ("description", "reason"),
    [("<robot", "not well-formed"), ("", "nothing came on the topic robot_description"), (" ", "is empty")],
)
def test_server_without_a_robot_reports_why_and_serves_when_it_has_one(
    description, reason, client, start_server, panda_dynamics
):
    server = start_server({"robot_description": description})
    response = call_service(client, server, inverse())
    assert not response.success and "no robot is loaded: " in response.message
    assert reason in response.message
    assert client.set_parameters(server, {"robot_description": "", "robot_file": "panda"}).successful
    assert_still_serves(client, server, panda_dynamics)


def publisher(client, server):
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    return client.node.create_publisher(String, server.rsplit("/", 1)[0] + "/robot_description", qos)


def eventually(client, condition, seconds=30):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not happen in time"
        client.spin(0.1)


def test_latched_topic_provides_the_robot_and_replaces_it_later(client, start_server):
    """The description is published before the server is there; it changes; bad ones and one of 100 MB are refused."""
    name = "/latched"
    latched = publisher(client, f"{name}/dynamics_server")
    latched.publish(String(data=GOOD))
    server = start_server(namespace=name)
    ur5 = [
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "elbow_joint",
        "wrist_1_joint",
        "wrist_2_joint",
        "wrist_3_joint",
    ]

    def serves(names):
        zero = np.zeros((1, len(names)))
        return call_service(client, server, inverse_request(names, zero, zero, zero)).success

    eventually(client, lambda: serves(ur5))
    latched.publish(String(data=real_urdf("panda")))
    joints = [*PANDA, "panda_finger_joint1"]
    eventually(client, lambda: serves(joints))
    assert not serves(ur5)
    messages = []
    client.node.create_subscription(DiagnosticArray, "/diagnostics", messages.append, 10)

    def diagnosed(text):
        return any(
            text in status.message and status.level == DiagnosticStatus.WARN and status.hardware_id == "panda"
            for message in messages
            for status in message.status
        )

    for bad, reason in (
        ("<robot>", "not well-formed"),
        ("", "empty"),
        (GOOD + " " * 100_000_000, "are not read"),
        ("panda", "not well-formed"),  # the topic carries texts, never names of files
    ):
        latched.publish(String(data=bad))
        eventually(client, lambda reason=reason: diagnosed(reason))
        assert serves(joints) and not serves(ur5)
    client.node.destroy_publisher(latched)


def test_parameter_has_priority_over_the_topic(client, start_server, panda_dynamics):
    server = start_server({"robot_file": "panda"}, namespace="/preferred")
    latched = publisher(client, server)
    latched.publish(String(data=GOOD))
    eventually(client, lambda: latched.get_subscription_count() == 1)
    client.spin(1.0)
    assert_still_serves(client, server, panda_dynamics)
    # it came all the same, and is used once no parameter names a robot
    assert client.set_parameters(server, {"robot_file": ""}).successful
    assert "shoulder_pan_joint" in call_service(client, server, inverse(["shoulder_pan_join", *PANDA[1:]])).message
    client.node.destroy_publisher(latched)


def test_diagnostics_have_the_robot_and_the_refusals(start_server):
    server = start_server({"robot_file": "panda"})
    own = ServiceClient("listener")
    messages_received = []
    own.node.create_subscription(DiagnosticArray, "/diagnostics", messages_received.append, 10)
    call_service(own, server, inverse(PANDA[:6], Q[:, :6], QD[:, :6], QDD[:, :6]))

    def told():
        statuses = [
            status for message in messages_received for status in message.status if status.name.startswith(server)
        ]
        values = [{pair.key: pair.value for pair in status.values} for status in statuses]
        return any(
            status.level == DiagnosticStatus.OK
            and value["requests refused"] == "1"
            and "panda_joint7" in value["last refusal"]
            for status, value in zip(statuses, values, strict=True)
        )

    eventually(own, told)
    own.close()


def test_misspelt_parameter_is_reported_with_the_likely_one(tmp_path):
    told = {"robt_file": "panda", "use_sim_time": False, "qos_overrides": {"/a.subscription.depth": 1}}
    with (tmp_path / "log").open("w") as log, running_node("dynamics_server", told, "/misspelt", log=log):
        deadline, output = time.monotonic() + 30, ""
        while "Nothing reads it" not in output and time.monotonic() < deadline:
            time.sleep(0.1)
            output = (tmp_path / "log").read_text()
    assert (
        "unknown parameter 'robt_file': did you mean 'robot_file'?" in output and output.count("Nothing reads it") == 1
    )
