"""The references that robots with loops are checked against agree with each other, so that each can be trusted:
multipliers on maximal coordinates, closed forms of planar linkages, Pinocchio."""

import numpy as np
import pytest
from peers.five_bar import random_five_bar
from peers.four_bar import random_four_bar
from peers.loop_states import condition_of, loop_gaps, mobility, random_closed_state
from peers.maximal_coordinates import MaximalCoordinates
from peers.random_loops import random_loops

LINKAGES = {"four_bar": random_four_bar, "five_bar": random_five_bar}


def relative_error(found, expected):
    scale = np.abs(expected).max(initial=0)
    return np.abs(np.asarray(found) - expected).max(initial=0) / (scale if scale > 1e-9 else 1)


def random_motion(linkage, seed):
    """Random q, q̇, q̈ of a linkage's independent joints."""
    return np.random.default_rng([seed, 3]).uniform(-3, 3, (3, len(linkage.independent)))


def spread(values, linkage, others):
    """Values of the independent joints among those of all, `others` elsewhere."""
    found = np.full(len(linkage.joints), float(others))
    found[list(linkage.independent)] = values
    return found


def is_driven(joint):
    return joint.actuated and joint.mimic is None


@pytest.mark.parametrize("kind", LINKAGES)
@pytest.mark.parametrize("seed", range(30))
def test_closed_form_agrees_with_multipliers(kind, seed):
    """Both models, to 1e-11, with friction, rotors and springs in all joints, cut ones too."""
    linkage = LINKAGES[kind](seed, friction=seed % 3 > 0, springs=seed % 2 > 0)
    peer = MaximalCoordinates(linkage.robot(linkage.independent))
    for state in range(5):
        q, qd, qdd = random_motion(linkage, [seed, state])
        everyone = linkage.positions(q), linkage.velocities(q, qd)
        efforts, accelerations = linkage.inverse(q, qd, qdd), linkage.accelerations(q, qd, qdd)
        inverse = peer.inverse(*everyone, spread(qdd, linkage, np.nan))
        direct = peer.direct(*everyone, spread(efforts, linkage, 0))
        assert relative_error(inverse.efforts, spread(efforts, linkage, 0)) < 1e-11
        assert relative_error(inverse.accelerations, accelerations) < 1e-11
        assert relative_error(direct.accelerations, accelerations) < 1e-11
        assert relative_error(linkage.direct(q, qd, efforts), qdd) < 1e-11


@pytest.mark.parametrize("kind", LINKAGES)
def test_rates_and_accelerations_of_closed_forms_are_derivatives_of_its_angles(kind):
    for seed in range(10):
        linkage = LINKAGES[kind](seed)
        q, qd, qdd = random_motion(linkage, seed)
        numerical = linkage.derivatives(linkage.joint_angles, q)
        assert relative_error(linkage.joint_rates(q), numerical) < 1e-13
        h = 1e-5
        before, after = (linkage.velocities(q + t * qd + t**2 / 2 * qdd, qd + t * qdd) for t in (-h, h))
        assert relative_error((after - before) / (2 * h), linkage.accelerations(q, qd, qdd)) < 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_power_of_motors_goes_into_energy_and_friction_of_a_linkage(seed):
    """d/dt (T + V) + losses = Γ·q̇, the energies of the multiplier model along a motion of the closed form."""
    linkage = random_five_bar(seed, springs=True)
    peer = MaximalCoordinates(linkage.robot(linkage.independent))
    q, qd, qdd = random_motion(linkage, seed)

    def energy(t):
        position, rate = q + t * qd + t**2 / 2 * qdd, qd + t * qdd
        return peer.energy(linkage.positions(position), linkage.velocities(position, rate))

    h = 1e-4
    stored = [sum(energy(t)[:3]) for t in (-2 * h, -h, h, 2 * h)]
    rate = (stored[0] - 8 * stored[1] + 8 * stored[2] - stored[3]) / (12 * h)
    power = linkage.inverse(q, qd, qdd) @ qd
    assert abs(rate + energy(0).dissipation - power) < 1e-8 * max(abs(rate), abs(power))


@pytest.mark.parametrize("seed", range(40))
def test_random_loops_close_and_move_as_said(seed):
    """As many independent joints as the mobility, the others passive and in good condition; other states close too,
    and the accelerations of multipliers keep them closed."""
    looped = random_loops(seed)
    robot, rng = looped.robot, np.random.default_rng(seed)
    assert mobility(robot, looped.q) == len(looped.independents)
    assert condition_of(robot, looped.q, looped.dependents) < 1e3
    assert {robot.joints[number].role for number in looped.dependents} <= {"passive"}
    assert {robot.joints[number].role for number in looped.independents} <= {"actuated", "elastic"}
    assert np.abs(loop_gaps(robot, looped.q)).max() < 1e-12

    q, qd = random_closed_state(robot, looped.q, looped.dependents, rng)
    told = [rng.uniform(-3, 3) if is_driven(joint) else np.nan for joint in robot.joints]
    motion = MaximalCoordinates(robot).inverse(q, qd, told)
    scale = max(1, np.abs(motion.accelerations).max())
    assert motion.residual < 1e-11 * scale
    h = 1e-3
    gaps = [loop_gaps(robot, q + t * qd + t**2 / 2 * motion.accelerations) for t in (h, h / 2)]
    assert np.abs(gaps[1]).max() < np.abs(gaps[0]).max() / 7 + 1e-12, "open by the third power of time"
