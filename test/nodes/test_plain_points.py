"""Requests of one point have the same responses whether they take the short way of plain_points or the general one."""

import numpy as np
import pytest
from nodes.service_requests import PANDA
from trajectory_msgs.msg import JointTrajectoryPoint

from robot_dynamics import Dynamics, RobotDynamicsError, load_robot
from robot_dynamics.nodes.dynamics_server import batch_services, plain_points, services, trajectory_services
from robot_dynamics.nodes.dynamics_server.request_turns import PendingRequest
from robot_dynamics_interfaces.srv import (
    DirectDynamics,
    DirectDynamicsBatch,
    DynamicsTerms,
    DynamicsTermsBatch,
    InverseDynamics,
    InverseDynamicsBatch,
)

HANDLERS = {
    InverseDynamics: trajectory_services.handle_inverse_dynamics,
    DirectDynamics: trajectory_services.handle_direct_dynamics,
    InverseDynamicsBatch: batch_services.handle_inverse_dynamics_batch,
    DirectDynamicsBatch: batch_services.handle_direct_dynamics_batch,
    DynamicsTerms: services.handle_dynamics_terms,
    DynamicsTermsBatch: batch_services.handle_dynamics_terms_batch,
}
FLAT = (InverseDynamicsBatch, DirectDynamicsBatch)
TERMS = (DynamicsTerms, DynamicsTermsBatch)
SHUFFLED = PANDA[::-1]


@pytest.fixture(scope="module")
def dynamics():
    return Dynamics(load_robot("panda"), compiled=False)


def make_request(kind, names, rows):
    """A request of one point; rows: positions, velocities and accelerations or efforts."""
    q, qd, drive = (list(map(float, row)) for row in rows)
    if kind is DynamicsTerms:
        return kind.Request(joint_names=names, state=JointTrajectoryPoint(positions=q, velocities=qd))
    if kind is DynamicsTermsBatch:
        return kind.Request(count=1, joint_names=names, positions=q, velocities=qd)
    if kind in FLAT:
        last = {"accelerations" if kind is InverseDynamicsBatch else "efforts": drive}
        return kind.Request(count=1, joint_names=names, positions=q, velocities=qd, **last)
    request = kind.Request()
    request.trajectory.joint_names = names
    last = {"accelerations" if kind is InverseDynamics else "effort": drive}
    request.trajectory.points = [JointTrajectoryPoint(positions=q, velocities=qd, **last)]
    request.trajectory.points[0].time_from_start.sec = 3
    return request


def respond(kind, request, dynamics):
    """(response or reason of refusal, whether a PointWork was made)."""
    response = kind.Response()
    try:
        work = HANDLERS[kind](request, response, dynamics, "/")
        if work is not None:
            assert PendingRequest(work, str).advance(10.0)
    except RobotDynamicsError as error:
        return str(error), False
    return response, work is not None


def refuse_all(monkeypatch):
    for module, name in (
        (trajectory_services, "complete_plain_trajectory"),
        (batch_services, "complete_plain_batch"),
        (batch_services, "complete_plain_terms"),
        (services, "complete_plain_terms"),
    ):
        monkeypatch.setattr(module, name, lambda *arguments: False)


@pytest.mark.parametrize("kind", HANDLERS, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("names", [PANDA, SHUFFLED], ids=["same order", "other order"])
def test_responses_of_both_ways_are_the_same(kind, names, dynamics, monkeypatch):
    rows = np.random.default_rng(1).uniform(-1, 1, (3, 7))
    short, has_work = respond(kind, make_request(kind, names, rows), dynamics)
    assert not has_work and short.success
    refuse_all(monkeypatch)
    general, has_work = respond(kind, make_request(kind, names, rows), dynamics)
    assert has_work or kind is DynamicsTerms
    order = [names.index(name) for name in PANDA]
    q, qd, drive = rows[:, order]
    if kind in TERMS:
        assert short.joint_names == general.joint_names == names
        matrix = np.reshape(short.inertia_matrix, (7, 7))
        np.testing.assert_allclose(matrix[np.ix_(order, order)], dynamics.inertia_matrix(q), rtol=1e-9, atol=1e-12)
        for term in ("inertia_matrix", "coriolis", "gravity", "friction", "elasticity"):
            np.testing.assert_allclose(getattr(short, term), getattr(general, term), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(np.array(short.coriolis)[order], dynamics.coriolis(q, qd), rtol=1e-9, atol=1e-12)
        return
    assert short == general
    is_inverse = kind in (InverseDynamics, InverseDynamicsBatch)
    results = short if kind in FLAT else short.trajectory.points[0]
    efforts = "efforts" if kind in FLAT else "effort"
    expected = (dynamics.inverse if is_inverse else dynamics.direct)(q, qd, drive)
    values = np.array(getattr(results, efforts if is_inverse else "accelerations"))
    np.testing.assert_allclose(values[order], expected, rtol=1e-9, atol=1e-9)


INVALID = {
    "nan": (PANDA, [[np.nan] * 7, [0] * 7, [0] * 7], "nan"),
    "inf": (PANDA, [[0] * 7, [0] * 7, [0, np.inf, *[0] * 5]], "inf"),
    "too few": (PANDA, [[0] * 7, [0] * 6, [0] * 7], "6 values"),
    "missing joint": (PANDA[:6], [[0] * 6] * 3, "joints missing"),
    "empty": (PANDA, [[0] * 7, [0] * 7, []], "0 values"),
}
OF_ACCELERATIONS = ("inf", "empty")  # and of efforts, which requests for terms do not have


@pytest.mark.parametrize(
    ("kind", "case"),
    [(kind, case) for kind in HANDLERS for case in INVALID if kind not in TERMS or case not in OF_ACCELERATIONS],
    ids=lambda value: value if isinstance(value, str) else value.__name__,
)
def test_refusals_of_both_ways_are_the_same(kind, case, dynamics, monkeypatch):
    names, rows, reason = INVALID[case]
    text, _ = respond(kind, make_request(kind, names, rows), dynamics)
    assert isinstance(text, str) and reason in text
    refuse_all(monkeypatch)
    assert respond(kind, make_request(kind, names, rows), dynamics)[0] == text


@pytest.mark.parametrize("term", ["gravity", "inertia_matrix", "friction", "elasticity"])
@pytest.mark.parametrize("row", [0, 1], ids=["positions", "velocities"])
def test_values_that_are_not_finite_are_refused_where_a_term_does_not_depend_on_them(term, row, dynamics):
    rows = np.zeros((3, 7))
    rows[row, 3] = np.nan
    request = make_request(DynamicsTermsBatch, PANDA, rows)
    request.terms = [term]
    reason, _ = respond(DynamicsTermsBatch, request, dynamics)
    assert isinstance(reason, str) and "nan" in reason


def test_requests_and_robots_with_more_take_the_general_way(dynamics, monkeypatch):
    rows = np.zeros((3, 7))
    for field, value in (("motion", True), ("reaction_wrenches", True), ("wrench_links", ["panda_link8"])):
        request = make_request(InverseDynamicsBatch, PANDA, rows)
        setattr(request, field, value)
        if field == "wrench_links":
            request.external_wrenches = [1.0] * 6
        response, has_work = respond(InverseDynamicsBatch, request, dynamics)
        assert has_work and response.success
    request = make_request(InverseDynamicsBatch, PANDA, rows)
    request.base_poses = [0.0] * 7
    assert respond(InverseDynamicsBatch, request, dynamics)[0].startswith("the base of 'panda' is fixed")
    request = make_request(InverseDynamics, PANDA, rows)
    request.trajectory.points[0].effort = [0.0] * 7
    assert "the service computes it" in respond(InverseDynamics, request, dynamics)[0]
    for name in ("four_bar", "gough_stewart", "free_flying_arm", "manutec_r3"):
        other = Dynamics(load_robot(name), compiled=False)
        assert not plain_points.match_joints(other.joint_names, other, "/").is_plain, name
