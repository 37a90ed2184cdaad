"""payload_identifier in a process of its own, with joint states of a process that publishes those of a loaded Panda.

The efforts are those of Pinocchio with a body of known mass, centre and inertia at the flange, with friction that the
description does not have, and noise. Samples pass faster than real time, as a bag may be played.
"""

import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from nodes.service_requests import PANDA, call_successfully, terms_request
from peers.recorded import loaded_panda, panda_model, panda_motion, write_table
from std_srvs.srv import Trigger

from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics_interfaces.srv import IdentifyPayload

pytest.importorskip("clarabel", reason="clarabel, which computes physically consistent inertias, is not installed")
PUBLISHER = Path(__file__).with_name("table_publisher.py")
SPEED = 4.0
DURATION = 3.5  # [s] of a measurement: 14 s of motion
LINK = "panda_link8"
FLANGE = np.array([0, 0, 0.107])  # [m] LINK in the last link of the model of Pinocchio
CENTRE = np.array([0.02, -0.03, 0.093])  # [m] in LINK
POSTURE = np.array([0.2, -0.4, 0.1, -1.7, 0.3, 1.9, 0.6])


def table(path, mass, *, model=None, change=lambda run, noisy: run._replace(efforts=noisy), moment=0.002):
    """A table of 20 s of a motion that repeats itself, with a payload of a mass [kg]."""
    model = model or loaded_panda(mass, CENTRE + FLANGE, moment * mass)
    run = panda_motion(duration=20.0, rate=100.0, seed=1, viscous=0.2, coulomb=0.2, model=model)
    noise = np.random.default_rng(1).normal(scale=0.3, size=run.efforts.shape)
    return write_table(path, change(run, run.efforts + noise))


@contextmanager
def running_robot(path, namespace):
    """A process that publishes a table."""
    process = subprocess.Popen([sys.executable, PUBLISHER, path, f"{namespace}/joint_states", str(SPEED)])
    try:
        yield
        assert process.poll() is None, "the publisher ended"
    finally:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def identifier(start_module_server):
    return start_module_server({"robot_file": "panda"}, executable="payload_identifier")


def namespace_of(node):
    return node.rpartition("/")[0]


def identify(client, node, duration=DURATION, **fields):
    return client.call(
        IdentifyPayload, f"{node}/identify_payload", IdentifyPayload.Request(duration=duration, **fields), timeout=60.0
    )


def vector(message):
    return np.array([message.x, message.y, message.z])


@pytest.mark.parametrize("mass", [1.0, 5.0])
def test_payload_of_a_running_robot_is_found_within_its_deviation(client, identifier, tmp_path, mass):
    with running_robot(table(tmp_path / "run.csv", mass), namespace_of(identifier)):
        response = identify(client, identifier)
    assert response.success and response.determined and response.link == LINK, response.message
    assert abs(response.mass - mass) < min(0.05 * mass, response.mass_deviation)
    assert 0.029 * mass < response.mass_deviation < 0.05 * mass
    assert (np.abs(vector(response.centre) - CENTRE) < 3 * vector(response.centre_deviation)).all()
    assert response.mass_determined and all(response.centre_determined) and response.blocks > 8
    moments = 0.002 * mass * np.array([1, 0, 0, 1, 0, 1])
    assert (np.abs(response.inertia - moments) < 3 * np.array(response.inertia_deviation)).all()
    np.testing.assert_allclose(response.first_moments, response.mass * vector(response.centre), atol=1e-9)
    assert response.joint_names == PANDA
    assert (np.array(response.residual_rms) < np.array(response.residual_rms_without_load)).all()


def test_payload_is_set_on_a_running_node_whose_gravity_then_has_it(client, start_server, tmp_path):
    server = start_server({"robot_file": "panda"})
    namespace = namespace_of(server)
    identifier = start_server({"robot_file": "panda"}, namespace=namespace, executable="payload_identifier")
    request = terms_request(PANDA, POSTURE, np.zeros(7))
    before = np.array(call_successfully(client, server, request).gravity)
    with running_robot(table(tmp_path / "run.csv", 2.5), namespace):
        response = identify(client, identifier, set_nodes=["dynamics_server"])
    assert response.success and response.set_nodes == [server], response.message
    assert abs(response.mass - 2.5) < min(0.125, response.mass_deviation)
    after = np.array(call_successfully(client, server, request).gravity)
    # by hand: each joint lifts the weight at its lever, the horizontal distance of the load from its axis
    model = panda_model()
    data = model.createData()
    pin.forwardKinematics(model, data, POSTURE)
    load = data.oMi[7].act(vector(response.centre) + FLANGE)
    weight = response.mass * 9.81
    levers = [np.cross(data.oMi[k].rotation[:, 2], load - data.oMi[k].translation)[2] for k in range(1, 8)]
    np.testing.assert_allclose(after - before, weight * np.array(levers), atol=2e-3)
    assert abs(after - before).max() > 5


def test_baseline_without_load_cancels_errors_of_the_description(client, start_server, tmp_path):
    identifier = start_server({"robot_file": "panda"}, executable="payload_identifier")
    empty, loaded = panda_model(), loaded_panda(2.0, CENTRE + FLANGE, 0.004)
    for model in (empty, loaded):  # links of this robot are heavier than described
        for link in (5, 6, 7):
            extra = pin.Inertia(0.4, np.array([0.0, 0.02, 0.01]), 0.001 * np.eye(3))
            model.appendBodyToJoint(link, extra, pin.SE3.Identity())
    with running_robot(table(tmp_path / "empty.csv", 0.0, model=empty), namespace_of(identifier)):
        kept = identify(client, identifier, without_load=True)
        assert kept.success and not kept.determined and "s without load are kept" in kept.message, kept.message
    with running_robot(table(tmp_path / "loaded.csv", 2.0, model=loaded), namespace_of(identifier)):
        alone = identify(client, identifier)
        both = identify(client, identifier, use_without_load=True)
    assert both.success, both.message
    assert abs(both.mass - 2.0) < min(0.1, both.mass_deviation)
    assert abs(alone.mass - 2.0) > 0.3  # what the baseline is good for


def test_motion_that_shows_no_payload_is_refused_and_sets_nothing(client, start_server, tmp_path):
    server = start_server({"robot_file": "panda"})
    identifier = start_server({"robot_file": "panda"}, namespace=namespace_of(server), executable="payload_identifier")
    request = terms_request(PANDA, POSTURE, np.zeros(7))
    before = call_successfully(client, server, request).gravity

    def still(run, noisy):
        noise = noisy - run.efforts
        return run._replace(q=0 * run.q + run.q[0], qd=0 * run.qd, efforts=run.efforts[0] + noise)

    def of_first_joint(run, noisy):  # its axis is vertical: no weight acts on it
        model = loaded_panda(2.5, CENTRE + FLANGE, 0.005)
        data = model.createData()
        q, qd, qdd = (np.zeros_like(run.q) for _ in range(3))
        q += run.q[0]
        q[:, 0], qd[:, 0], qdd[:, 0] = run.q[:, 0], run.qd[:, 0], run.qdd[:, 0]
        efforts = [pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)]
        return run._replace(q=q, qd=qd, efforts=np.array(efforts) + noisy - run.efforts)

    for number, change in enumerate((still, of_first_joint)):
        with running_robot(table(tmp_path / f"{number}.csv", 2.5, change=change), namespace_of(identifier)):
            response = identify(client, identifier, set_nodes=[server])
        assert not response.success and not response.determined and not response.set_nodes
        assert not any([response.mass_determined, *response.centre_determined, *response.inertia_determined])
        expected = ("samples at rest do not count", "the load is not determined: mass")[number]
        assert expected in response.message
    assert call_successfully(client, server, request).gravity == before


def test_values_that_are_no_numbers_and_pauses_are_left_out(client, identifier, tmp_path):
    def damaged(run, noisy):
        efforts, q, times = noisy.copy(), run.q.copy(), run.times.copy()
        efforts[300:320] = np.nan
        q[700:705, 3] = np.inf
        kept = np.r_[0:900, 960:1400, 1401:2000]
        return run._replace(times=times[kept], q=q[kept], qd=run.qd[kept], efforts=efforts[kept])

    with running_robot(table(tmp_path / "run.csv", 3.0, change=damaged), namespace_of(identifier)):
        response = identify(client, identifier, duration=5.0)
    assert response.success, response.message
    assert abs(response.mass - 3.0) < min(0.15, response.mass_deviation)
    assert "measurement: " in response.message  # what was left out


def test_only_one_measurement_runs_and_it_can_be_stopped(ros, client, identifier, tmp_path):
    responses = []

    def measure():
        other = ServiceClient("measuring_client")
        responses.append(identify(other, identifier, duration=100.0))
        other.close()

    assert not client.call(Trigger, f"{identifier}/stop", Trigger.Request()).success
    with running_robot(table(tmp_path / "run.csv", 2.0), namespace_of(identifier)):
        threads = [threading.Thread(target=measure) for _ in range(2)]  # equal requests share the measurement
        for thread in threads:
            thread.start()
            time.sleep(1.5)
        refused = identify(client, identifier, duration=99.0)
        assert not refused.success and "a measurement runs: measuring" in refused.message
        time.sleep(1.5)
        stopped = client.call(Trigger, f"{identifier}/stop", Trigger.Request())
        assert stopped.success and stopped.message.startswith("stopped after"), stopped.message
        for thread in threads:
            thread.join(30)
        absent = identify(client, identifier, duration=100.0, set_nodes=["/nobody"])
        assert not absent.success and "set_nodes: no node /nobody runs. Nodes with parameters are: " in absent.message
    assert len(responses) == 2 and responses[0] == responses[1]
    assert responses[0].success and abs(responses[0].mass - 2.0) < 0.1, responses[0].message


def test_invalid_requests_are_refused(client, identifier):
    def refusal(**fields):
        response = identify(client, identifier, **{"duration": 0.2, **fields})
        assert not response.success and response.mass == 0
        return response.message

    assert "no message arrived on" in refusal()
    for duration in (0.0, -1.0, float("nan"), float("inf"), 1e4):
        assert "120 s at most is needed" in refusal(duration=duration)
    assert "unknown link 'hand'" in refusal(link="hand")
    assert "fixed to the base" in refusal(link="panda_link0")
    assert "nothing was measured without load" in refusal(use_without_load=True)
    assert "without_load: nothing is fitted" in refusal(without_load=True, set_nodes=[identifier])
    assert "the one without load" in refusal(set_nodes=[identifier])


def test_a_node_with_a_payload_of_its_own_sets_no_other(client, start_server):
    identifier = start_server(
        {"robot_file": "panda", "payload.link": LINK, "payload.mass": 0.7}, executable="payload_identifier"
    )
    server = start_server({"robot_file": "panda"}, namespace=namespace_of(identifier))
    response = identify(client, identifier, set_nodes=[server])
    assert not response.success and "this node has a payload of its own" in response.message
    changed = client.set_parameters(identifier, {"link": "panda_link0"})
    assert not changed.successful and "fixed to the base" in changed.reason
