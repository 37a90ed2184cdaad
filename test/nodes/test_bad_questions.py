"""What cannot be answered is refused with a reason, and the server goes on serving the robot that it had."""

import os
import re
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nodes.questions import (
    PANDA,
    ask,
    base_points,
    call,
    direct_request,
    field,
    inverse_request,
    motion,
    terms_request,
    wrench,
)
from peers.real_robots import real_urdf
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from robot_dynamics import Dynamics, Inertia, load_robot
from robot_dynamics.nodes.running import Caller

Q, QD, QDD = motion(3, 7)


def still_serves(caller, server, library):
    answer = ask(caller, server, inverse_request(PANDA, Q, QD, QDD))
    np.testing.assert_array_equal(field(answer.trajectory, "effort"), library.inverse(Q, QD, QDD))


def inverse(names=PANDA, q=Q, qd=QD, qdd=QDD, **others):
    return inverse_request(names, q, qd, qdd, **others)


def direct(names=PANDA, q=Q, qd=QD, efforts=QDD, **others):
    return direct_request(names, q, qd, efforts, **others)


def terms(names=PANDA, q=Q[0], qd=QD[0], base=None):
    return terms_request(names, q, qd, base)


def with_value(values, index, value):
    values = values.copy()
    values[index] = value
    return values


def with_efforts(request):
    request.state.effort = [0.0] * 7
    return request


STILL = base_points([[0, 0, 0, 1]] * 3, np.zeros((3, 3)), np.zeros((3, 6)))

BAD = {
    "missing joint": (inverse(PANDA[:6], Q[:, :6], QD[:, :6], QDD[:, :6]), "joints missing: 'panda_joint7'"),
    "no joints": (inverse([], Q[:, :0], QD[:, :0], QDD[:, :0]), "joints missing: 'panda_joint1'"),
    "unknown joint": (inverse([*PANDA[:6], "panda_joint8"]), "unknown joint 'panda_joint8'"),
    "duplicate joint": (inverse([*PANDA[:6], "panda_joint1"]), "'panda_joint1' is named more than once"),
    "wrong namespace": (inverse([f"other/{name}" for name in PANDA]), "unknown joint 'other/panda_joint1'"),
    "no points": (inverse(q=Q[:0]), "no points"),
    "few positions": (inverse(q=Q[:, :6]), r"points\[0\].positions has 6 values: 7 are needed"),
    "no velocities": (inverse(qd=QD[:, :0]), r"points\[0\].velocities has 0 values"),
    "many accelerations": (inverse(qdd=np.ones((3, 9))), r"points\[0\].accelerations has 9 values"),
    "NaN position": (inverse(q=with_value(Q, (1, 4), np.nan)), r"points\[1\].positions\[4\] is nan"),
    "infinite velocity": (inverse(qd=with_value(QD, (2, 0), np.inf)), r"points\[2\].velocities\[0\] is inf"),
    "NaN effort": (direct(efforts=with_value(QDD, (0, 6), np.nan)), r"points\[0\].effort\[6\] is nan"),
    "no efforts": (direct(efforts=QDD[:, :0]), r"points\[0\].effort has 0 values"),
    "wrench on an unknown link": (
        inverse(external_wrenches=[wrench("panda_link8", np.ones(6)), wrench("panda_tip", np.ones(6))]),
        r"external_wrenches\[1\].header.frame_id: unknown link 'panda_tip'",
    ),
    "wrench on no link": (inverse(external_wrenches=[wrench("", np.ones(6))]), "unknown link ''"),
    "NaN wrench": (inverse(external_wrenches=[wrench("panda_link8", [np.nan] * 6)]), "finite numbers"),
    "wrench at no point": (inverse(external_wrenches=[wrench("panda_link8", np.ones(6), 99)]), "no point has that"),
    "base of a fixed robot": (inverse(base=STILL), "the base of 'panda' is fixed"),
    "answer overflows": (inverse(qd=QD + 1e200), "the answer.* is no finite number"),
    "wrench overflows": (inverse(external_wrenches=[wrench("panda_link8", [1.7e308] * 6)]), "no finite number"),
    "terms overflow": (terms(qd=QD[0] + 1e200), "no finite number"),
    "20 000 names of a joint": (inverse(["panda_joint1"] * 20_000, Q[:0]), "named more than once"),
    "long name": (inverse(["x" * 1_000_000, *PANDA[1:]]), "unknown joint 'x{100}'"),
    "terms with efforts": (with_efforts(terms()), r"^state.effort has values: the terms do not depend on it"),
    "terms without velocities": (terms(qd=QD[0, :0]), r"^state.velocities has 0 values"),
    "terms of an unknown joint": (terms(names=["a", *PANDA[1:]]), "unknown joint 'a'"),
    "terms with NaN": (terms(q=with_value(Q[0], 3, np.nan)), r"positions\[3\] is nan"),
    "terms with a base": (terms(base=STILL.points[0]), "is fixed"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_question_is_refused_with_a_reason_and_the_next_is_answered(case, caller, panda, library):
    request, reason = BAD[case]
    response = call(caller, panda, request)
    assert not response.success
    assert re.search(reason, response.message), response.message
    still_serves(caller, panda, library)


@pytest.mark.parametrize(
    ("request_of", "field_name"), [(inverse, "effort"), (direct, "accelerations")], ids=["inverse", "direct"]
)
def test_field_that_is_asked_for_must_be_left_empty(request_of, field_name, caller, panda):
    request = request_of()
    setattr(request.trajectory.points[1], field_name, [0.0] * 7)
    response = call(caller, panda, request)
    assert not response.success and f"points[1].{field_name} has values" in response.message


@pytest.fixture(scope="module")
def flyer(start_module_server):
    return start_module_server({"robot_file": "free_flying_arm"})


def six(values):
    return values[:, :6]


def flyer_request(base):
    joints = [
        f"arm_{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    ]
    return inverse_request(joints, six(Q), six(QD), six(QDD), base=base)


def base_with(**changes):
    arguments = {"quaternions": [[0, 0, 0, 1.0]] * 3, "positions": np.zeros((3, 3)), "twists": np.zeros((3, 6))}
    return base_points(**{**arguments, **changes})


def named(name):
    base = base_with()
    base.joint_names = [name]
    return base


def partly_told():
    base = base_with(accelerations=np.zeros((3, 6)))
    base.points[1].accelerations = []
    return base


def without_twist():
    base = base_with()
    base.points[2].velocities = []
    return base


def at_another_time():
    base = base_with()
    base.points[1].time_from_start.sec = 7
    return base


BAD_BASES = {
    "none": (base_with(quaternions=[], positions=[], twists=[]), "base.points has 0 entries"),
    "too few": (
        base_with(quaternions=[[0, 0, 0, 1]], positions=np.zeros((1, 3)), twists=np.zeros((1, 6))),
        "1 entries",
    ),
    "zero quaternion": (base_with(quaternions=[[0, 0, 0, 1], [0, 0, 0, 0], [0, 0, 0, 1]]), r"points\[1\].*norm 0"),
    "NaN quaternion": (base_with(quaternions=[[np.nan] * 4] * 3), "norm nan"),
    "NaN position": (base_with(positions=np.full((3, 3), np.nan)), "translation is not finite"),
    "infinite twist": (base_with(twists=np.full((3, 6), np.inf)), r"velocities\[0\] is not finite"),
    "other link": (named("wrist"), "unknown base link 'wrist'"),
    "partly told": (partly_told(), r"base.points\[1\].accelerations has 0 entries.*at all points or at none"),
    "no twist": (without_twist(), r"base.points\[2\].velocities has 0 entries"),
    "other time": (at_another_time(), r"base.points\[1\].time_from_start"),
}


@pytest.mark.parametrize("case", BAD_BASES)
def test_bad_state_of_the_base_is_refused_with_a_reason(case, caller, flyer):
    base, reason = BAD_BASES[case]
    response = call(caller, flyer, flyer_request(base))
    assert not response.success
    assert re.search(reason, response.message), response.message
    ask(caller, flyer, flyer_request(base_with()))


def test_mimic_joint_that_disagrees_is_refused(caller, start_server):
    server = start_server({"robot_description": real_urdf("panda")})
    joints = [*PANDA, "panda_finger_joint1", "panda_finger_joint2"]
    q = np.zeros((1, 9))
    q[0, 8] = 0.01
    response = call(caller, server, inverse_request(joints, q, 0 * q, 0 * q))
    assert not response.success and "'panda_finger_joint2' depends on others, which put it at 0" in response.message


def test_direct_model_without_an_answer_is_refused(caller, start_server):
    server = start_server({"robot_description": '<robot name="r"><link name="a"/><link name="b"/>'
        '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>'})  # fmt: skip
    one = np.ones((1, 1))
    response = call(caller, server, direct_request(["j"], one, one, one))
    assert not response.success and "nothing with inertia resists joint 'j'" in response.message
    ask(caller, server, inverse_request(["j"], one, one, one))


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
def test_refused_description_leaves_the_old_robot_loaded(case, caller, panda, library):
    text, reason = REFUSED[case]
    assert text != GOOD
    result = caller.set_parameters(panda, {"robot_description": text})
    assert not result.successful and reason in result.reason
    still_serves(caller, panda, library)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"robot_file": "/no/such/robot.urdf"}, "cannot be read"),
        ({"robot_file": ""}, "would be empty"),
        ({"base": "floating"}, "fixed, moving"),
        ({"gravity": [0.0, 9.81]}, "3 numbers are needed"),
        ({"gravity": [0.0, 0.0, float("nan")]}, "three finite numbers"),
        ({"payload.link": "panda_link99", "payload.mass": 1.0}, "payload.link: unknown link 'panda_link99'"),
        ({"payload.link": "panda_link8", "payload.mass": -1.0}, "mass -1"),
        ({"payload.link": "panda_link8", "payload.inertia": [1.0, 2.0]}, "6 numbers are needed, xx, xy"),
        ({"payload.link": "panda_link8", "payload.first_moments": [1.0, float("nan"), 0.0]}, "finite"),
        ({"payload.link": "panda_link8", "payload.first_moments": [1.0, 0.0, 0.0], "strict": True}, "'panda_link7'"),
        ({"payload.mass": "heavy"}, "'heavy': a number is needed"),
        ({"strict": "yes"}, "true or false is needed"),
        ({"robot_file": 7}, "a text is needed"),
    ],
)
def test_refused_parameter_leaves_the_old_robot_loaded(change, reason, caller, panda, library):
    result = caller.set_parameters(panda, change)
    assert not result.successful and reason in result.reason, result.reason
    still_serves(caller, panda, library)


def test_file_of_100_megabytes_is_refused_and_the_old_robot_stays(caller, panda, library, tmp_path):
    path = tmp_path / "large.urdf"
    path.write_text(GOOD + " " * 100_000_000)
    result = caller.set_parameters(panda, {"robot_file": str(path)})
    assert not result.successful and "100" in result.reason and "at most" in result.reason
    still_serves(caller, panda, library)


def test_server_survives_descriptions_that_no_parser_foresaw(caller, panda, library, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    undefined = tmp_path / "undefined.urdf"
    undefined.write_bytes(b'<?xml version="1.0" encoding="undefined"?><robot/>')
    for change in (
        {"robot_file": str(tmp_path / "pipe")},
        {"robot_file": str(undefined)},
        {"robot_description": "panda"},
    ):
        assert not caller.set_parameters(panda, change).successful
        still_serves(caller, panda, library)


def test_file_that_changed_is_read_again(caller, start_server, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(real_urdf("ur5"))
    server = start_server({"robot_file": str(path)})
    path.write_text(real_urdf("kinova"))
    assert caller.set_parameters(server, {"robot_file": str(path)}).successful
    response = call(caller, server, inverse())
    assert (not response.success and "known are j2n6s200_joint_1" in response.message) or "j2" in response.message


def test_whole_numbers_are_numbers(caller, start_server):
    server = start_server({"robot_file": "panda", "gravity": [0, 0, -10]})
    assert caller.set_parameters(server, {"payload.link": "panda_link8", "payload.mass": 2}).successful
    heavy = Dynamics(load_robot("panda", gravity=(0, 0, -10)).with_payload("panda_link8", Inertia(2.0)))
    answer = ask(caller, server, inverse())
    np.testing.assert_array_equal(field(answer.trajectory, "effort"), heavy.inverse(Q, QD, QDD))


@pytest.mark.parametrize(
    ("description", "reason"),
    [("<robot", "not well-formed"), ("", "nothing came on the topic robot_description"), (" ", "is empty")],
)
def test_server_without_a_robot_says_why_and_serves_when_it_gets_one(
    description, reason, caller, start_server, library
):
    server = start_server({"robot_description": description})
    response = call(caller, server, inverse())
    assert not response.success and "no robot is loaded: " in response.message
    assert reason in response.message
    assert caller.set_parameters(server, {"robot_description": "", "robot_file": "panda"}).successful
    still_serves(caller, server, library)


def publisher(caller, server):
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    return caller.node.create_publisher(String, server.rsplit("/", 1)[0] + "/robot_description", qos)


def eventually(caller, condition, seconds=30):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not happen in time"
        caller.spin(0.1)


def test_latched_topic_gives_the_robot_and_another_one_later(caller, start_server):
    """The description is published before the server is there; it changes; bad ones and one of 100 MB are refused."""
    name = "/latched"
    latched = publisher(caller, f"{name}/dynamics_server")
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
        return call(caller, server, inverse_request(names, zero, zero, zero)).success

    eventually(caller, lambda: serves(ur5))
    latched.publish(String(data=real_urdf("panda")))
    joints = [*PANDA, "panda_finger_joint1"]
    eventually(caller, lambda: serves(joints))
    assert not serves(ur5)
    messages = []
    caller.node.create_subscription(DiagnosticArray, "/diagnostics", messages.append, 10)

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
        eventually(caller, lambda reason=reason: diagnosed(reason))
        assert serves(joints) and not serves(ur5)
    caller.node.destroy_publisher(latched)


def test_parameter_comes_before_the_topic(caller, start_server, library):
    server = start_server({"robot_file": "panda"}, namespace="/preferred")
    latched = publisher(caller, server)
    latched.publish(String(data=GOOD))
    eventually(caller, lambda: latched.get_subscription_count() == 1)
    caller.spin(1.0)
    still_serves(caller, server, library)
    # it came all the same, and is used once no parameter names a robot
    assert caller.set_parameters(server, {"robot_file": ""}).successful
    assert "shoulder_pan_joint" in call(caller, server, inverse(["shoulder_pan_join", *PANDA[1:]])).message
    caller.node.destroy_publisher(latched)


def test_diagnostics_tell_what_is_served_and_what_was_refused(start_server):
    server = start_server({"robot_file": "panda"})
    own = Caller("listener")
    found = []
    own.node.create_subscription(DiagnosticArray, "/diagnostics", found.append, 10)
    call(own, server, inverse(PANDA[:6], Q[:, :6], QD[:, :6], QDD[:, :6]))

    def told():
        statuses = [status for message in found for status in message.status if status.name.startswith(server)]
        values = [{pair.key: pair.value for pair in status.values} for status in statuses]
        return any(
            status.level == DiagnosticStatus.OK
            and value["requests refused"] == "1"
            and "panda_joint7" in value["last refusal"]
            for status, value in zip(statuses, values, strict=True)
        )

    eventually(own, told)
    own.close()
