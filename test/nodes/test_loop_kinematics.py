"""Shipped robots with loops: 1000 random states of each against multipliers on maximal coordinates.

The library, one by one and as a batch, the compiled programs and a real server agree with them.
"""

import numpy as np
import pytest
from nodes.service_requests import (
    call_service,
    call_successfully,
    direct_request,
    equilibrium_request,
    field,
    inverse_request,
    terms_request,
    wrench_values,
)
from peers.loop_states import loop_gaps
from peers.maximal_coordinates import MaximalCoordinates
from peers.reachable import reachable

from robot_dynamics import Dynamics, SingularModelError, load_robot

SERVED = ("four_bar", "irb460", "andrews_squeezer", "delta", "gough_stewart")  # of the shipped robots with loops
"""Two modules in series have their own: test_hybrid_platforms."""
STATES = 1000
STATES_OF_LEGS = 100  # of parallel robots, whose bodies are many


def near(coordinates, expected, tolerance):
    """Whether each sample (row) is, relative to its own largest number."""
    scale = np.maximum(1e-6, np.abs(expected).reshape(len(expected), -1).max(axis=1))
    worst = np.abs(coordinates - expected).reshape(len(expected), -1).max(axis=1) / scale
    return worst.max() < tolerance


@pytest.mark.parametrize("name", SERVED)
def test_library_service_batch_and_trace_agree_with_maximal_coordinates(client, start_server, name):
    dynamics, rng = Dynamics(load_robot(name), compiled=False), np.random.default_rng(3)
    peer = MaximalCoordinates(dynamics.robot)
    independent = [dynamics.robot.joint_numbers[joint] for joint in dynamics.joint_names]
    q = reachable(dynamics, STATES_OF_LEGS if dynamics.robot.platforms else STATES, rng)
    qd, qdd = rng.uniform(-2, 2, (2, *q.shape))
    positions = dynamics.expand_positions(q)
    rates = dynamics.expand_velocities(qd, positions)
    assert max(np.abs(loop_gaps(dynamics.robot, sample)).max() for sample in positions) < 1e-11

    reason = np.full(positions.shape, np.nan)
    reason[:, independent] = qdd
    motions = [peer.inverse(*state) for state in zip(positions, rates, reason, strict=True)]
    efforts = np.array([motion.efforts[independent] for motion in motions])
    accelerations = np.array([motion.accelerations for motion in motions])

    batch = dynamics.solve(positions, qd, qdd=qdd)
    assert near(batch.efforts, efforts, 1e-8)
    assert near(batch.motion.accelerations, accelerations, 1e-8)
    assert near(dynamics.direct(positions, qd, efforts), qdd, 1e-7)
    ones = [dynamics.inverse(*state) for state in zip(positions, qd, qdd, strict=True)]
    assert near(np.array(ones), efforts, 1e-8)
    inverse, direct = dynamics.compile("inverse"), dynamics.compile("direct")
    assert near(inverse.batch(positions, qd, qdd), efforts, 1e-8)
    assert near(direct.batch(positions, qd, efforts), qdd, 1e-7)
    assert near(np.array([inverse.evaluate(*state) for state in zip(positions, qd, qdd, strict=True)]), efforts, 1e-8)

    server = start_server({"robot_file": name})
    names = list(dynamics.joint_names)
    response = call_successfully(client, server, inverse_request(names, q, qd, qdd)).trajectory
    order = [dynamics.robot.joint_numbers[joint] for joint in response.joint_names]
    assert (
        sorted(order) == list(range(len(dynamics.robot.joints))) and list(response.joint_names[: len(names)]) == names
    )
    assert max(np.abs(loop_gaps(dynamics.robot, sample[np.argsort(order)])).max()
               for sample in field(response, "positions")) < 1e-11  # fmt: skip
    assert near(field(response, "velocities"), rates[:, order], 1e-8)
    assert near(field(response, "accelerations"), accelerations[:, order], 1e-8)
    assert near(field(response, "effort")[:, : len(names)], efforts, 1e-8)
    assert not field(response, "effort")[:, len(names) :].any()
    back = call_successfully(client, server, direct_request(names, q, qd, efforts)).trajectory
    assert near(field(back, "accelerations")[:, : len(names)], qdd, 1e-7)


@pytest.fixture(scope="module")
def five_bar(start_module_server):
    return start_module_server({"robot_file": "five_bar"})


DYNAMICS = Dynamics(load_robot("five_bar"), compiled=False)
NAMES = list(DYNAMICS.joint_names)
Q = DYNAMICS.initial_joint_positions[[DYNAMICS.robot.joint_numbers[name] for name in NAMES]]
ALL = list(DYNAMICS.all_joint_names)
NOTHING = np.zeros((1, len(NAMES)))
OPEN = np.zeros((1, len(ALL)))
LOOPED_PLACES = [ALL.index(name) for name in DYNAMICS.dependent_joint_names]


def all_of(values, others=np.nan):
    coordinates = np.full((1, len(ALL)), others)
    coordinates[:, [ALL.index(name) for name in NAMES]] = values
    return coordinates


def test_passive_positions_of_the_request_choose_the_assembly_mode(client, five_bar):
    """The apex on the other side of the line between the hinges: its passive angles mirrored about that line."""
    here = DYNAMICS.initial_joint_positions
    mirrored = here.copy()
    for start in np.random.default_rng(0).uniform(-3, 3, (50, len(LOOPED_PLACES))):
        mirrored[LOOPED_PLACES] = start
        try:
            mirrored_positions = DYNAMICS.expand_positions(mirrored)
        except SingularModelError:
            continue
        apart = (mirrored_positions - here + np.pi) % (2 * np.pi) - np.pi
        if np.abs(apart).max() > 0.1:
            break
    else:
        raise AssertionError("no other assembly mode was found")
    efforts_of_seeds = []
    for seed in (here, mirrored_positions):
        seeded_request = inverse_request(ALL, seed[None] + 0.02 * all_of(0, 1), all_of(1), all_of(1))
        response = call_successfully(client, five_bar, seeded_request).trajectory
        np.testing.assert_allclose(field(response, "positions")[0], seed, atol=1e-9)
        assert np.abs(loop_gaps(DYNAMICS.robot, field(response, "positions")[0])).max() < 1e-11
        efforts_of_seeds.append(field(response, "effort"))
    assert np.abs(efforts_of_seeds[0] - efforts_of_seeds[1]).max() > 1e-3


def test_response_is_a_valid_request(client, five_bar):
    first = call_successfully(
        client, five_bar, inverse_request(NAMES, Q[None] + 0.1, NOTHING + 1, NOTHING + 2)
    ).trajectory
    again = call_successfully(
        client,
        five_bar,
        inverse_request(
            list(first.joint_names), *(field(first, key) for key in ("positions", "velocities", "accelerations"))
        ),
    ).trajectory
    np.testing.assert_allclose(field(again, "effort"), field(first, "effort"), rtol=1e-9, atol=1e-12)


def test_reactions_are_returned_for_every_joint_and_the_cut_one(client, five_bar):
    request = inverse_request(NAMES, Q[None], NOTHING, NOTHING)
    request.reaction_wrenches = True
    response = call_successfully(client, five_bar, request)
    expected = DYNAMICS.solve(Q, NOTHING[0], qdd=NOTHING[0]).reactions
    order = [DYNAMICS.robot.joint_numbers[joint] for joint in response.trajectory.joint_names]
    np.testing.assert_allclose(
        list(map(wrench_values, response.reactions)), expected[[0, *(k + 1 for k in order)]], atol=1e-9
    )


def test_terms_are_those_of_the_independent_joints(client, five_bar):
    response = call_successfully(client, five_bar, terms_request(NAMES, Q, NOTHING[0] + 1))
    assert list(response.joint_names) == NAMES
    np.testing.assert_allclose(np.reshape(response.inertia_matrix, (2, 2)), DYNAMICS.inertia_matrix(Q), atol=1e-12)
    np.testing.assert_allclose(response.coriolis, DYNAMICS.coriolis(Q, NOTHING[0] + 1), atol=1e-12)
    np.testing.assert_allclose(response.gravity, DYNAMICS.gravity(Q), atol=1e-12)


def test_equilibrium_of_a_robot_without_elastic_joints_is_its_configuration(client, five_bar):
    response = call_successfully(client, five_bar, equilibrium_request(NAMES, Q[None]))
    np.testing.assert_allclose(field(response.trajectory, "effort")[0, :2], DYNAMICS.gravity(Q), atol=1e-9)


def refused(client, server, request):
    response = call_service(client, server, request)
    assert not response.success
    return response.message


def astray():
    """(1, all joints): positions from which the loop is not found closed."""
    q = DYNAMICS.initial_joint_positions.copy()
    for start in np.random.default_rng(0).uniform(-3, 3, (50, len(LOOPED_PLACES))):
        q[LOOPED_PLACES] = start
        try:
            DYNAMICS.expand_positions(q)
        except SingularModelError:
            return q[None]
    raise AssertionError("all seeds lead somewhere")


def test_impossible_loop_configurations_are_refused_and_the_node_goes_on(client, five_bar):
    rates = all_of(1.0, 0.0)
    rates[:, LOOPED_PLACES[0]] = 99.0
    pushed = all_of(0, 0.0)
    pushed[:, LOOPED_PLACES[0]] = 3.0
    here = DYNAMICS.initial_joint_positions[None]
    for request, reason in (
        (inverse_request(ALL, astray(), all_of(0), all_of(0)), "loop 'apex' does not close at sample 0"),
        (inverse_request(NAMES[:1], Q[None, :1], NOTHING[:, :1], NOTHING[:, :1]), "joints missing"),
        (inverse_request(ALL, here, rates, all_of(0)), DYNAMICS.dependent_joint_names[0]),
        (direct_request(ALL, here, all_of(0), pushed), "no motor drives it"),
        (inverse_request(ALL, here + np.inf * all_of(0, 1), all_of(0), all_of(0)), "finite"),
    ):
        message = refused(client, five_bar, request)
        assert reason in message, message
    call_successfully(client, five_bar, inverse_request(NAMES, Q[None], NOTHING, NOTHING))
