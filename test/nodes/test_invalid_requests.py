"""Invalid requests are refused with a reason, and the server goes on serving its robot."""

import re

import numpy as np
import pytest
from nodes.service_requests import (
    PANDA,
    QD,
    QDD,
    Q,
    assert_still_serves,
    base_trajectory,
    call_service,
    call_successfully,
    direct_request,
    inverse,
    inverse_request,
    terms_request,
    wrench,
)
from peers.real_robots import real_urdf


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


STILL = base_trajectory([[0, 0, 0, 1]] * 3, np.zeros((3, 3)), np.zeros((3, 6)))

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
    "answer overflows": (inverse(qd=QD + 1e200), "the result.* is not a finite number"),
    "wrench overflows": (inverse(external_wrenches=[wrench("panda_link8", [1.7e308] * 6)]), "not a finite number"),
    "terms overflow": (terms(qd=QD[0] + 1e200), "not a finite number"),
    "20 000 names of a joint": (inverse(["panda_joint1"] * 20_000, Q[:0]), "named more than once"),
    "long name": (inverse(["x" * 1_000_000, *PANDA[1:]]), "unknown joint 'x{100}'"),
    "terms with efforts": (with_efforts(terms()), r"^state.effort has values: the terms do not depend on it"),
    "terms without velocities": (terms(qd=QD[0, :0]), r"^state.velocities has 0 values"),
    "terms of an unknown joint": (terms(names=["a", *PANDA[1:]]), "unknown joint 'a'"),
    "terms with NaN": (terms(q=with_value(Q[0], 3, np.nan)), r"positions\[3\] is nan"),
    "terms with a base": (terms(base=STILL.points[0]), "is fixed"),
}


@pytest.mark.parametrize("case", BAD)
def test_invalid_request_is_refused_with_a_reason_and_the_next_is_served(case, client, panda, panda_dynamics):
    request, reason = BAD[case]
    response = call_service(client, panda, request)
    assert not response.success
    assert re.search(reason, response.message), response.message
    assert_still_serves(client, panda, panda_dynamics)


@pytest.mark.parametrize(
    ("request_of", "field_name"), [(inverse, "effort"), (direct, "accelerations")], ids=["inverse", "direct"]
)
def test_computed_field_must_be_left_empty(request_of, field_name, client, panda):
    request = request_of()
    setattr(request.trajectory.points[1], field_name, [0.0] * 7)
    response = call_service(client, panda, request)
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
    return base_trajectory(**{**arguments, **changes})


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
def test_invalid_state_of_the_base_is_refused_with_a_reason(case, client, flyer):
    base, reason = BAD_BASES[case]
    response = call_service(client, flyer, flyer_request(base))
    assert not response.success
    assert re.search(reason, response.message), response.message
    call_successfully(client, flyer, flyer_request(base_with()))


def test_mimic_joint_that_disagrees_is_refused(client, start_server):
    server = start_server({"robot_description": real_urdf("panda")})
    joints = [*PANDA, "panda_finger_joint1", "panda_finger_joint2"]
    q = np.zeros((1, 9))
    q[0, 8] = 0.01
    response = call_service(client, server, inverse_request(joints, q, 0 * q, 0 * q))
    assert not response.success and "'panda_finger_joint2' depends on others, which put it at 0" in response.message


def test_singular_direct_model_is_refused(client, start_server):
    server = start_server({"robot_description": '<robot name="r"><link name="a"/><link name="b"/>'
        '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>'})  # fmt: skip
    unit_value = np.ones((1, 1))
    response = call_service(client, server, direct_request(["j"], unit_value, unit_value, unit_value))
    assert not response.success and "nothing with inertia resists joint 'j'" in response.message
    response = call_service(client, server, inverse_request(["j"], unit_value, unit_value, unit_value))
    assert response.success and "none of its moving links has a mass" in response.message
