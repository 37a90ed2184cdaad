"""References for robots with loops agree with each other: multipliers on maximal coordinates, closed forms of planar
linkages, Pinocchio."""

from dataclasses import replace

import numpy as np
import pytest
from peers.five_bar import random_five_bar
from peers.four_bar import random_four_bar
from peers.link_motion import link_motion
from peers.loop_states import (
    closed_positions,
    closed_rates,
    condition_of,
    loop_gaps,
    mobility,
    random_closed_state,
)
from peers.maximal_coordinates import MaximalCoordinates
from peers.pinocchio_loops import PinocchioLoops
from peers.random_loops import random_loops, random_placement
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.slow

LINKAGES = {"four_bar": random_four_bar, "five_bar": random_five_bar}


def relative_error(computed, expected):
    scale = np.abs(expected).max(initial=0)
    return np.abs(np.asarray(computed) - expected).max(initial=0) / (scale if scale > 1e-9 else 1)


def random_motion(linkage, seed):
    """Random q, q̇, q̈ of a linkage's independent joints."""
    return np.random.default_rng([seed, 3]).uniform(-3, 3, (3, len(linkage.independent)))


def embed(values, linkage, seconds):
    """Values of the independent joints among those of all, `others` for the rest."""
    computed = np.full(len(linkage.joints), float(seconds))
    computed[list(linkage.independent)] = values
    return computed


def is_actuated(joint):
    return joint.actuated and joint.mimic is None


@pytest.mark.parametrize("kind", LINKAGES)
@pytest.mark.parametrize("seed", range(30))
def test_closed_form_agrees_with_multipliers(kind, seed):
    """Both models, to 1e-11, with friction, rotors and springs in all joints, cut ones too."""
    linkage = LINKAGES[kind](seed, friction=seed % 3 > 0, springs=seed % 2 > 0)
    peer = MaximalCoordinates(linkage.robot(linkage.independent))
    for state in range(5):
        q, qd, qdd = random_motion(linkage, [seed, state])
        closed_state = linkage.positions(q), linkage.velocities(q, qd)
        efforts, accelerations = linkage.inverse(q, qd, qdd), linkage.accelerations(q, qd, qdd)
        inverse = peer.inverse(*closed_state, embed(qdd, linkage, np.nan))
        direct = peer.direct(*closed_state, embed(efforts, linkage, 0))
        assert relative_error(inverse.efforts, embed(efforts, linkage, 0)) < 1e-11
        assert relative_error(inverse.accelerations, accelerations) < 1e-11
        assert relative_error(direct.accelerations, accelerations) < 1e-11
        assert relative_error(linkage.direct(q, qd, efforts), qdd) < 1e-11


@pytest.mark.parametrize("kind", LINKAGES)
def test_rates_and_accelerations_of_closed_forms_are_derivatives_of_angles(kind):
    for seed in range(10):
        linkage = LINKAGES[kind](seed)
        q, qd, qdd = random_motion(linkage, seed)
        numerical = linkage.derivatives(linkage.joint_angles, q)
        assert relative_error(linkage.joint_rates(q), numerical) < 1e-13
        h = 1e-5
        before, after = (linkage.velocities(q + t * qd + t**2 / 2 * qdd, qd + t * qdd) for t in (-h, h))
        assert relative_error((after - before) / (2 * h), linkage.accelerations(q, qd, qdd)) < 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_power_balance_of_a_linkage(seed):
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
def test_random_loops_have_the_stated_mobility_and_stay_closed(seed):
    """As many independent joints as the mobility, the others passive and well determined; random states are closed,
    and the accelerations of multipliers keep them closed."""
    looped = random_loops(seed)
    robot, rng = looped.robot, np.random.default_rng(seed)
    assert mobility(robot, looped.q) == len(looped.independents)
    assert condition_of(robot, looped.q, looped.dependents) < 1e3
    assert {robot.joints[number].role for number in looped.dependents} <= {"passive"}
    assert {robot.joints[number].role for number in looped.independents} <= {"actuated", "elastic"}
    assert np.abs(loop_gaps(robot, looped.q)).max() < 1e-12

    q, qd = random_closed_state(robot, looped.q, looped.dependents, rng)
    prescribed = [rng.uniform(-3, 3) if is_actuated(joint) else np.nan for joint in robot.joints]
    motion = MaximalCoordinates(robot).inverse(q, qd, prescribed)
    scale = max(1, np.abs(motion.accelerations).max())
    assert motion.residual < 1e-11 * scale
    h = 1e-3
    gaps = [loop_gaps(robot, q + t * qd + t**2 / 2 * motion.accelerations) for t in (h, h / 2)]
    assert np.abs(gaps[1]).max() < np.abs(gaps[0]).max() / 7 + 1e-12, "the gap grows with the third power of time"


def random_arguments(looped, rng, prescribed_base=False):
    """(q, q̇, prescribed accelerations, further arguments) of a random closed state with wrenches on some links."""
    robot = looped.robot
    q, qd = random_closed_state(robot, looped.q, looped.dependents, rng)
    free = set(range(len(q))) - set(looped.dependents)
    has_motor = [number in free and is_actuated(joint) for number, joint in enumerate(robot.joints)]
    prescribed = np.where(has_motor, rng.uniform(-3, 3, len(q)), np.nan)
    loaded = rng.choice(len(robot.links), size=min(3, len(robot.links)), replace=False)
    arguments = {"external_wrenches": {int(link): rng.uniform(-20, 20, 6) for link in loaded}}
    if robot.moving_base:
        arguments |= {"pose": random_placement(rng), "twist": rng.uniform(-1, 1, 6)}
        if prescribed_base:
            arguments["base_acceleration"] = rng.uniform(-3, 3, 6)
    return q, qd, prescribed, arguments


@pytest.mark.parametrize("seed", range(60))
def test_multipliers_agree_with_pinocchio(seed):
    """Both models of random robots, to 1e-9: redundant loops, elastic and mimic joints, wrenches, any base."""
    looped = random_loops(seed)
    rng = np.random.default_rng([seed, 8])
    maximal, pinocchio = MaximalCoordinates(looped.robot), PinocchioLoops(looped.robot)
    for state in range(3):
        q, qd, prescribed, arguments = random_arguments(looped, rng, prescribed_base=state == 2)
        inverse = maximal.inverse(q, qd, prescribed, **arguments)
        direct = maximal.direct(q, qd, inverse.efforts, **arguments)
        assert relative_error(direct.accelerations, inverse.accelerations) < 1e-9
        for computed in (
            pinocchio.inverse(q, qd, prescribed, **arguments),
            pinocchio.direct(q, qd, inverse.efforts, **arguments),
        ):
            assert relative_error(computed.accelerations, inverse.accelerations) < 1e-9
            assert relative_error(computed.efforts, inverse.efforts) < 1e-9
            if looped.robot.moving_base:
                assert relative_error(computed.base_acceleration, inverse.base_acceleration) < 1e-9
                assert relative_error(computed.base_wrench, inverse.base_wrench) < 1e-9


@pytest.mark.parametrize("kind", LINKAGES)
@pytest.mark.parametrize("seed", range(10))
def test_pinocchio_agrees_with_closed_form(kind, seed):
    """A_c and H_c, to 1e-9."""
    linkage = LINKAGES[kind](seed, springs=seed % 2 > 0)
    pinocchio = PinocchioLoops(linkage.robot(linkage.independent))
    q, qd, qdd = random_motion(linkage, seed)
    A, H = pinocchio.projected(linkage.positions(q), linkage.velocities(q, qd), linkage.independent)
    assert relative_error(A, linkage.mass_matrix(q).real) < 1e-9
    assert relative_error(H, linkage.bias(q, qd)) < 1e-9
    assert relative_error(A @ qdd + H, linkage.inverse(q, qd, qdd)) < 1e-9


def wrenches_of_reaction(loop, reaction, poses):
    """{link: (6,)}: wrenches of a reaction in frame k+B on the two links of its loop, in their frames."""
    computed = {}
    point = poses[loop.closed_on.link] @ loop.closed_on.placement
    for end, sign in zip(loop.ends, (1, -1), strict=True):
        relative = np.linalg.inv(poses[end.link]) @ point
        force, moment = relative[:3, :3] @ reaction.wrench[:3], relative[:3, :3] @ reaction.wrench[3:]
        computed[end.link] = sign * np.concatenate([force, moment + np.cross(relative[:3, 3], force)])
    return computed


@pytest.mark.parametrize("seed", range(30))
def test_loop_reactions_applied_to_the_open_tree_require_the_same_efforts(seed):
    """Pinocchio's recursion of the open tree under the loop reactions: efforts, and wrenches of all its joints."""
    looped = random_loops(seed)
    robot, rng = looped.robot, np.random.default_rng([seed, 9])
    q, qd, prescribed, arguments = random_arguments(looped, rng, prescribed_base=seed % 2 > 0)
    motion = MaximalCoordinates(robot).inverse(q, qd, prescribed, **arguments)
    assert set(motion.loop_reactions) == {loop.name for loop in robot.loops}
    wrenches = {number: wrench.copy() for number, wrench in arguments["external_wrenches"].items()}
    for loop in robot.loops:
        for link, loop_wrench in wrenches_of_reaction(
            loop, motion.loop_reactions[loop.name], link_motion(robot, q).poses
        ).items():
            wrenches[link] = wrenches.get(link, 0) + loop_wrench
    tree = PinocchioLoops(replace(robot, loops=()))
    names = [link.name for link in robot.links]
    base = motion.base_acceleration if robot.moving_base else ()
    named = {names[number]: wrench for number, wrench in wrenches.items()}
    pose, twist = arguments.get("pose"), arguments.get("twist", ())
    expected = tree.reactions(q, qd, motion.accelerations, names[1:], pose, twist, base, named)
    computed = np.array([reaction.wrench for reaction in motion.reactions])
    assert relative_error(computed, expected) < 1e-9
    if all(reaction.determinate.all() for reaction in motion.loop_reactions.values()):
        assert all(reaction.determinate.all() for reaction in motion.reactions)


@pytest.mark.parametrize("seed", range(20))
def test_exchanged_loop_ends_and_cut_links_as_bodies_agree(seed):
    """The same motion; the reactions of loops, where they are determinate, the opposite and the same."""
    looped = random_loops(seed)
    robot, rng = looped.robot, np.random.default_rng([seed, 11])
    q, qd, prescribed, arguments = random_arguments(looped, rng, prescribed_base=seed % 2 > 0)
    exchanged = [replace(loop, moved=loop.closed_on, closed_on=loop.moved) for loop in robot.loops]
    with_bodies = MaximalCoordinates(robot)
    with_bodies.cut = {}
    motion = MaximalCoordinates(robot).inverse(q, qd, prescribed, **arguments)
    seconds = MaximalCoordinates(replace(robot, loops=tuple(exchanged))), with_bodies
    for peer, sign in zip(seconds, (-1, 1), strict=True):
        second = peer.inverse(q, qd, prescribed, **arguments)
        assert relative_error(second.accelerations, motion.accelerations) < 1e-10
        assert relative_error(second.efforts, motion.efforts) < 1e-10
        for loop in robot.loops:
            (computed, is_determinate), (expected, determinate) = (
                m.loop_reactions[loop.name] for m in (second, motion)
            )
            if not (loop.is_spherical and sign < 0):  # in the axes of the other frame
                assert is_determinate.tolist() == determinate.tolist()
                scale = max(np.abs(reaction.wrench).max() for reaction in motion.reactions)
                assert np.abs(sign * computed - expected)[is_determinate].max(initial=0) < 1e-10 * scale


@pytest.mark.parametrize("seed", range(5))
def test_determinate_reactions_of_a_planar_loop(seed):
    """Forces in the plane and the moment about the axis; across it only where a spherical joint takes no moment."""
    linkage = random_four_bar(seed, friction=False)
    linkage = replace(linkage, joints=(*linkage.joints[:3], replace(linkage.joints[3], rotor_inertia=0.0)))
    q, qd, qdd = random_motion(linkage, seed)
    closed_state, prescribed = (linkage.positions(q), linkage.velocities(q, qd)), embed(qdd, linkage, np.nan)
    hinged = MaximalCoordinates(linkage.robot(0)).inverse(*closed_state, prescribed)
    jointed = MaximalCoordinates(linkage.robot(0, ball=True)).inverse(*(x[:3] for x in (*closed_state, prescribed)))
    in_plane = [True, True, False, False, False, True]
    assert hinged.loop_reactions["four_bar"].determinate.tolist() == in_plane
    # a spherical joint takes no moment
    assert jointed.loop_reactions["four_bar"].determinate.tolist() == [True, True, False, True, True, True]
    assert relative_error(jointed.efforts, hinged.efforts[:3]) < 1e-11
    force, second = (motion.loop_reactions["four_bar"].wrench[:2] for motion in (hinged, jointed))
    assert relative_error(force, second) < 1e-11


@pytest.mark.parametrize("seed", range(20))
def test_power_balance_of_motors_wrenches_and_friction(seed):
    """d/dt (kinetic + potential + elastic) + dissipation = motors + wrenches, to 1e-8 of the largest of them."""
    looped = random_loops(seed, moving_base=seed % 2 > 0)
    robot, rng = looped.robot, np.random.default_rng([seed, 10])
    q, qd, prescribed, arguments = random_arguments(looped, rng)
    peer = MaximalCoordinates(robot)
    motion = peer.inverse(q, qd, prescribed, **arguments)
    base_pose = {key: arguments[key] for key in ("pose", "twist") if key in arguments}

    def energy(t):
        rates = qd + t * motion.accelerations
        positions = closed_positions(robot, q + t * qd + t**2 / 2 * motion.accelerations, looped.dependents)
        rates = closed_rates(robot, positions, rates, looped.dependents)
        base_arguments = {}
        if base_pose:
            pose, twist = base_pose["pose"].copy(), base_pose["twist"]
            R, turning = pose[:3, :3], np.cross(twist[3:], twist[:3])
            pose[:3, 3] += R @ (t * twist[:3] + t**2 / 2 * motion.base_acceleration[:3])
            pose[:3, :3] = R @ Rotation.from_rotvec(t * twist[3:] + t**2 / 2 * motion.base_acceleration[3:]).as_matrix()
            base_arguments = {"pose": pose, "twist": twist + t * (motion.base_acceleration - [*turning, 0, 0, 0])}
        return peer.energy(positions, rates, **base_arguments)

    h = 2e-4
    stored = [sum(energy(t)[:3]) for t in (-2 * h, -h, h, 2 * h)]
    rate = (stored[0] - 8 * stored[1] + 8 * stored[2] - stored[3]) / (12 * h)
    terms = [motion.efforts @ qd, peer.power_of_wrenches(q, qd, arguments["external_wrenches"], **base_pose)]
    terms += [-energy(0).dissipation, -rate]
    assert abs(sum(terms)) < 1e-8 * max(map(abs, terms))
