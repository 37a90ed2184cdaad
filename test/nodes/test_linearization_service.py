"""Derivatives and linear state spaces over a real service, beside Pinocchio and differences over services; refusals."""

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio
import pytest
from geometry_msgs.msg import WrenchStamped
from nodes.service_requests import (
    PANDA,
    base_trajectory,
    call_service,
    call_successfully,
    direct_request,
    inverse_request,
    point,
    terms_request,
)
from scipy.spatial.transform import Rotation

from robot_dynamics import Base, Dynamics, load_robot
from robot_dynamics.model.loading import shipped_robots
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics_interfaces.srv import Linearize

ORDER = [6, 0, 5, 1, 4, 2, 3]  # joints of the requests
Q, QD, QDD = np.random.default_rng(5).uniform(-1, 1, (3, 7))
FIELDS = [
    f"{kind}_by_{by}"
    for kind, last in (("acceleration", "efforts"), ("effort", "accelerations"))
    for by in ("positions", "velocities", last)
]


def request_of(names, **state):
    others = {key: state.pop(key) for key in ("base", "external_wrenches") if key in state}
    return Linearize.Request(joint_names=list(names), state=point(0, **state), **others)


def matrix(response, field):
    """A field as a matrix with a row for each coordinate; those of the state space have twice as many."""
    rows = len(response.joint_names) * (2 if field in "ab" else 1)
    return np.reshape(getattr(response, field), (rows, -1))


def test_panda_is_differentiated_as_by_pinocchio(client, panda, panda_dynamics):
    model = pinocchio.buildModelFromUrdf(str(shipped_robots()["panda"]))
    data = model.createData()
    assert list(model.names)[1:] == PANDA
    viscous = np.array([joint.viscous_friction for joint in panda_dynamics.robot.joints])
    coulomb = np.array([joint.coulomb_friction for joint in panda_dynamics.robot.joints])
    pick = np.ix_(ORDER, ORDER)
    response = call_successfully(
        client,
        panda,
        request_of([PANDA[k] for k in ORDER], positions=Q[ORDER], velocities=QD[ORDER], accelerations=QDD[ORDER]),
    )
    assert response.joint_names == response.input_names == [PANDA[k] for k in ORDER]
    by_q, by_qd, mass = pinocchio.computeRNEADerivatives(model, data, Q, QD, QDD)
    efforts = pinocchio.rnea(model, data, Q, QD, QDD)
    for field, expected in zip(FIELDS[3:], (by_q, by_qd + np.diag(viscous), mass), strict=True):
        np.testing.assert_allclose(matrix(response, field), expected[pick], rtol=0, atol=1e-10)
    np.testing.assert_allclose(response.efforts, (efforts + viscous * QD + coulomb * np.sign(QD))[ORDER], atol=1e-10)
    by_q, by_qd, inverse = pinocchio.computeABADerivatives(model, data, Q, QD, efforts)
    for field, expected in zip(FIELDS[:3], (by_q, by_qd - inverse @ np.diag(viscous), inverse), strict=True):
        np.testing.assert_allclose(matrix(response, field), expected[pick], rtol=0, atol=1e-9)
    zero = np.zeros((7, 7))
    expected = np.block([[zero, np.eye(7)], [matrix(response, field) for field in FIELDS[:2]]])
    np.testing.assert_array_equal(matrix(response, "a"), expected)
    np.testing.assert_array_equal(matrix(response, "b"), np.vstack([zero, matrix(response, FIELDS[2])]))


def test_same_state_from_efforts_and_from_accelerations(client, panda):
    from_accelerations = call_successfully(client, panda, request_of(PANDA, positions=Q, accelerations=QDD))
    efforts = np.array(from_accelerations.efforts)
    from_efforts = call_successfully(client, panda, request_of(PANDA, positions=Q, effort=efforts))
    np.testing.assert_allclose(from_efforts.accelerations, QDD, atol=1e-9)
    for field in ("a", "b", *FIELDS):
        np.testing.assert_allclose(matrix(from_efforts, field), matrix(from_accelerations, field), atol=1e-7)


@pytest.mark.parametrize("robot", ["four_bar", "irb460"])
def test_loop_is_differentiated_as_by_differences_over_the_services(client, start_server, robot):
    dynamics = Dynamics(load_robot(robot), compiled=False)
    server = start_server({"robot_file": robot})
    names = dynamics.joint_names
    n = len(names)
    start = dynamics.initial_joint_positions[[dynamics.robot.joint_numbers[name] for name in names]] + 0.1
    qd, qdd = np.random.default_rng(1).uniform(0.3, 1, (2, n))  # Coulomb friction is constant away from rest
    response = call_successfully(client, server, request_of(names, positions=start, velocities=qd, accelerations=qdd))
    efforts = np.array(response.efforts)
    step = 1e-5
    steps = np.concatenate([[k, -k] for k in step * np.eye(n)])
    rest = np.zeros_like(steps)

    def differences(make_request, field, last):
        """Derivatives of a field of points by positions, velocities and the last argument."""
        columns = []
        for dq, dv, da in ((steps, rest, rest), (rest, steps, rest), (rest, rest, steps)):
            answer = call_successfully(client, server, make_request(names, start + dq, qd + dv, last + da))
            numbers = [answer.trajectory.joint_names.index(name) for name in names]
            values = np.array([getattr(each, field) for each in answer.trajectory.points])[:, numbers]
            columns.append((values[::2] - values[1::2]).T / (2 * step))
        return columns

    for field, expected in zip(FIELDS[:3], differences(direct_request, "accelerations", efforts), strict=True):
        np.testing.assert_allclose(matrix(response, field), expected, atol=2e-6 * max(1, np.abs(expected).max()))
    for field, expected in zip(FIELDS[3:], differences(inverse_request, "effort", qdd), strict=True):
        np.testing.assert_allclose(matrix(response, field), expected, atol=2e-6 * max(1, np.abs(expected).max()))
    assert response.input_names == [name for name in names if name not in dynamics.unactuated_joint_names]


def test_moving_base_with_a_wrench_and_elastic_joints(client, start_server):
    dynamics = Dynamics(load_robot("free_flying_arm"), compiled=False)
    flyer = start_server({"robot_file": "free_flying_arm"})
    turn, position, twist = Rotation.from_rotvec([0.3, -0.5, 0.9]), [0.1, -0.4, 2.0], [0.2, -0.1, 0.4, 0.5, 0.3, -0.7]
    moving = base_trajectory([turn.as_quat()], [position], [twist]).points[0]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn.as_matrix(), position
    link = dynamics.robot.links[-1].name
    wrench = WrenchStamped()
    wrench.header.frame_id = link
    wrench.wrench.force.x, wrench.wrench.torque.y = 3.0, 0.5
    arguments = {"base": Base(pose, twist), "external_wrenches": {link: np.array([3.0, 0, 0, 0, 0.5, 0])}}
    names, q, qd, efforts = dynamics.joint_names, Q[:6], QD[:6], QDD[:6]
    request = request_of(names, positions=q, velocities=qd, effort=efforts, base=moving, external_wrenches=[wrench])
    response = call_successfully(client, flyer, request)
    linear = dynamics.linearize(q, qd, efforts, **arguments)
    assert response.joint_names[:6] == [f"base.{kind}.{axis}" for kind in ("linear", "angular") for axis in "xyz"]
    np.testing.assert_allclose(matrix(response, "a"), linear.A, atol=1e-9 * np.abs(linear.A).max())
    np.testing.assert_allclose(matrix(response, "b"), linear.B, atol=1e-9 * np.abs(linear.B).max())
    assert np.shape(matrix(response, "acceleration_by_efforts")) == (12, 6)

    elastic = Dynamics(load_robot("manutec_r3"), compiled=False)
    server = start_server({"robot_file": "manutec_r3"})
    rest = elastic.equilibrium(np.zeros(9))
    names = elastic.joint_names[::-1]
    response = call_successfully(
        client, server, request_of(names, positions=rest.positions[::-1], effort=rest.efforts[::-1])
    )
    linear = elastic.linearize(rest.positions, np.zeros(9), rest.efforts)
    assert response.input_names == [name for name in names if name not in elastic.unactuated_joint_names]
    backwards = [*range(8, -1, -1), *range(17, 8, -1)]
    np.testing.assert_allclose(
        matrix(response, "a"), linear.A[np.ix_(backwards, backwards)], atol=1e-8 * np.abs(linear.A).max()
    )
    np.testing.assert_allclose(matrix(response, "b"), linear.B[backwards][:, ::-1], atol=1e-8 * np.abs(linear.B).max())
    np.testing.assert_allclose(response.accelerations, 0, atol=1e-6)


def test_invalid_requests_are_refused(client, panda):
    def refusal(**others):
        names = others.pop("names", PANDA)
        others = {"positions": Q, "effort": QD, **others}
        response = call_service(client, panda, request_of(names, **others))
        assert not response.success
        return response.message

    assert "joints missing: 'panda_joint7'" in refusal(names=PANDA[:6])
    assert "state has neither effort nor accelerations" in refusal(effort=[])
    assert "state has both effort and accelerations" in refusal(accelerations=QDD)
    assert "state.positions[2] is nan" in refusal(positions=[0, 0, np.nan, 0, 0, 0, 0])
    assert "state.effort[0] is inf" in refusal(effort=[np.inf, 0, 0, 0, 0, 0, 0])
    assert "state.velocities has 2 values" in refusal(velocities=[1.0, 2.0])
    assert "leave the field base empty" in refusal(base=base_trajectory([[0, 0, 0, 1]], [[0] * 3], [[0] * 6]).points[0])
    wrench = WrenchStamped()
    wrench.header.frame_id = "hand"
    assert "external_wrenches[0].header.frame_id: unknown link 'hand'" in refusal(external_wrenches=[wrench])


def test_programs_are_compiled_beside_other_requests(ros, client, start_server, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # no programs of earlier runs
    dynamics = Dynamics(load_robot("delta"), compiled=False)
    names = dynamics.joint_names
    server = start_server({"robot_file": "delta"})
    q = dynamics.initial_joint_positions[[dynamics.robot.joint_numbers[name] for name in names]]
    terms = terms_request(names, q, np.zeros(3))
    call_successfully(client, server, terms)

    def linearize():
        caller = ServiceClient("linearizing_client")
        try:
            return caller.call(Linearize, f"{server}/linearize", request_of(names, positions=q, effort=[0] * 3), 120)
        finally:
            caller.close()

    with ThreadPoolExecutor(1) as pool:
        began = time.monotonic()
        linearized = pool.submit(linearize)
        waits = []
        while not linearized.done():
            sent = time.monotonic()
            call_successfully(client, server, terms)
            waits.append(time.monotonic() - sent)
            time.sleep(0.02)
        duration = time.monotonic() - began
    assert linearized.result().success, linearized.result().message
    assert len(waits) > 5 and max(waits) < duration / 3, (duration, waits)
