"""Robots with loops through the one door, against references that are derived otherwise: multipliers on maximal
coordinates, closed forms of planar linkages, Pinocchio's constrained dynamics; and against the laws of work."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from peers.five_bar import random_five_bar
from peers.four_bar import random_four_bar
from peers.loop_states import closed_positions, loop_gaps, loop_jacobian, random_closed_state
from peers.maximal_coordinates import MaximalCoordinates
from peers.pinocchio_loops import PinocchioLoops
from peers.random_loops import random_loops, random_placement

from robot_dynamics import Base, Dynamics, InvalidInputError, SingularModelError
from robot_dynamics.model.joint import Mimic, Spring
from robot_dynamics.model.minimal_frames import minimal_frames
from robot_dynamics.model.robot import Frame

LINKAGES = {"four_bar": random_four_bar, "five_bar": random_five_bar}


def relative_error(found, expected):
    scale = np.abs(expected).max(initial=0)
    return np.abs(np.asarray(found) - expected).max(initial=0) / (scale if scale > 1e-9 else 1)


class Question:
    """A random closed state of a random robot, with wrenches on some of its links, and its base told to move or not."""

    def __init__(self, seed, told_base=False, **kinds):
        looped = random_loops(seed, **kinds)
        rng = np.random.default_rng([seed, 9])
        self.robot, self.looped = looped.robot, looped
        self.dynamics = Dynamics(self.robot, compiled=False)
        self.independent = [self.robot.joint_numbers[name] for name in self.dynamics.joint_names]
        self.q, self.qd = random_closed_state(self.robot, looped.q, looped.dependents, rng)
        self.driven = [number for number in self.independent if self.robot.joints[number].actuated]
        self.told = np.full(len(self.q), np.nan)
        self.told[self.driven] = rng.uniform(-3, 3, len(self.driven))
        numbers = rng.choice(len(self.robot.links), size=min(3, len(self.robot.links)), replace=False)
        wrenches = {int(number): rng.uniform(-20, 20, 6) for number in numbers}
        self.of_peer = {"external_wrenches": wrenches}
        self.of_door = {"external_wrenches": {self.robot.links[n].name: wrench for n, wrench in wrenches.items()}}
        if self.robot.moving_base:
            pose, twist = random_placement(rng), rng.uniform(-1, 1, 6)
            acceleration = rng.uniform(-3, 3, 6) if told_base else None
            self.of_peer |= {"pose": pose, "twist": twist, "base_acceleration": acceleration}
            self.of_door["base"] = Base(pose, twist, acceleration)

    def inverse(self, peer):
        return peer.inverse(self.q, self.qd, self.told, **self.of_peer)

    def solve(self, **given):
        return self.dynamics.solve(self.q, self.qd[self.independent], **given, **self.of_door)


@pytest.mark.parametrize("seed", range(120))
def test_both_models_are_those_of_multipliers_on_maximal_coordinates(seed):
    """Efforts, accelerations of all joints and of the base, and the reactions that rigid bodies determine, to 1e-8."""
    question = Question(seed, told_base=seed % 2 > 0)
    expected = question.inverse(MaximalCoordinates(question.robot))
    inverse = question.solve(qdd=question.told[question.independent])
    assert relative_error(inverse.motion.positions, question.q) < 1e-11
    assert relative_error(inverse.motion.velocities, question.qd) < 1e-9
    assert relative_error(inverse.efforts, expected.efforts[question.independent]) < 1e-8
    assert relative_error(inverse.motion.accelerations, expected.accelerations) < 1e-8
    direct = question.solve(efforts=expected.efforts[question.independent])
    assert relative_error(direct.motion.accelerations, expected.accelerations) < 1e-8
    assert relative_error(direct.accelerations, expected.accelerations[question.independent]) < 1e-8
    for answer in (inverse, direct):
        if question.robot.moving_base:
            assert relative_error(answer.base_acceleration, expected.base_acceleration) < 1e-8
        if np.abs(question.qd).min() < 1e-9:
            continue  # a joint that its loop holds still: on which side dry friction holds it, rounding decides
        scale = max(1, np.abs([reaction.wrench for reaction in expected.reactions]).max())
        for wrench, reaction in zip(answer.reactions[1:], expected.reactions, strict=True):
            there = reaction.determinate
            assert np.abs(wrench - reaction.wrench)[there].max(initial=0) < 1e-8 * scale


def test_reactions_of_cut_joints_are_compared():
    """The test above has determinate reactions of cut joints in spatial loops: most of them, whole."""
    whole = 0
    for seed in range(40):
        question = Question(seed, kinds=("spatial",))
        reactions = question.inverse(MaximalCoordinates(question.robot)).reactions
        cut = [loop.moved.link - 1 for loop in question.robot.loops]
        whole += sum(reactions[number].determinate.all() for number in cut if number >= 0)
    assert whole > 20


@pytest.mark.parametrize("seed", range(60))
def test_both_models_are_those_of_pinocchio(seed):
    question = Question(seed, told_base=seed % 2 > 0)
    expected = question.inverse(PinocchioLoops(question.robot))
    inverse = question.solve(qdd=question.told[question.independent])
    direct = question.solve(efforts=expected.efforts[question.independent])
    assert relative_error(inverse.efforts, expected.efforts[question.independent]) < 1e-6
    assert relative_error(direct.motion.accelerations, expected.accelerations) < 1e-6


def reachable(linkage, rng, count):
    """(count, n) and (count, all joints): random positions of the independent joints and of all, at which it closes."""
    found = []
    while len(found) < count:
        q = rng.uniform(-3, 3, len(linkage.independent))
        try:
            found.append((q, linkage.positions(q)))
        except ValueError:
            continue
    return tuple(map(np.array, zip(*found, strict=True)))


@pytest.mark.parametrize("kind", LINKAGES)
@pytest.mark.parametrize("seed", range(20))
def test_both_models_of_linkages_are_those_of_closed_forms(kind, seed):
    """1000 random states in all for each kind, as batches: friction, rotors and springs in all joints."""
    linkage = LINKAGES[kind](seed, friction=seed % 3 > 0, springs=seed % 2 > 0)
    dynamics = Dynamics(linkage.robot(linkage.independent), compiled=False)
    rng = np.random.default_rng([seed, 4])
    q, closed = reachable(linkage, rng, 50)
    qd, qdd = rng.uniform(-3, 3, (2, *q.shape))
    known = (
        dynamics.expand_positions(q) if kind == "four_bar" else dynamics.expand_positions(closed)
    )  # not all ways to a five-bar are open
    turns = (known - closed) / (2 * np.pi)  # closed forms give angles between -π and π
    assert np.abs(turns - np.round(turns)).max() < 1e-11
    states = list(zip(q, qd, qdd, strict=True))
    efforts, everyone = (np.array([of(*state) for state in states]) for of in (linkage.inverse, linkage.accelerations))
    q = closed  # springs count whole turns
    for k in range(len(q)):
        assert relative_error(dynamics.inverse(q[k], qd[k], qdd[k]), efforts[k]) < 1e-9
    assert relative_error(dynamics.inverse(q, qd, qdd), efforts) < 1e-9
    assert relative_error(dynamics.direct(q, qd, efforts), qdd) < 1e-9
    assert relative_error(dynamics.expand_accelerations(qdd, q, qd), everyone) < 1e-9


@pytest.mark.parametrize("seed", range(30))
def test_terms_add_up_to_the_inverse_model(seed):
    """A q̈ + coriolis + gravity + friction + elasticity, joint rows, at a told base acceleration; A is symmetric, and
    its kinetic energy that of the bodies."""
    question = Question(seed, told_base=True)
    dynamics, qd = question.dynamics, question.qd[question.independent]
    base = question.of_door.get("base")
    rows = 6 if question.robot.moving_base else 0
    moving = {"base": replace(base, acceleration=None)} if base else {}
    A = dynamics.inertia_matrix(question.q)
    assert relative_error(A, A.T) < 1e-12
    peer = MaximalCoordinates(question.robot)
    rates = np.concatenate([base.twist if base else [], qd])
    energy = peer.energy(question.q, question.qd, **{key: question.of_peer[key] for key in ("pose", "twist") if base})
    assert abs(0.5 * rates @ A @ rates - energy.kinetic) < 1e-10 * energy.kinetic
    answer = dynamics.solve(question.q, qd, qdd=question.told[question.independent], base=base)
    accelerations = np.concatenate([base.acceleration if base else [], answer.accelerations])
    terms = A @ accelerations + dynamics.coriolis(question.q, qd, **moving) + dynamics.gravity(question.q, **moving)
    lost = dynamics.friction(qd, question.q) + dynamics.elasticity(question.q, qd)
    total = terms[rows:] + lost
    assert np.abs(total - answer.efforts).max() < 1e-9 * max(1, np.abs(terms).max(), np.abs(lost).max())


@pytest.mark.parametrize("seed", range(25))
def test_compiled_programs_and_traced_python_give_the_same(seed):
    question = Question(seed, told_base=seed % 2 > 0)
    dynamics, q, qd = question.dynamics, question.q, question.qd[question.independent]
    wrenches = question.of_door["external_wrenches"]
    expected = question.solve(qdd=question.told[question.independent])
    base, moving = question.of_door.get("base"), []
    if base:
        moving = [base.twist, base.pose[:3, :3].T @ question.robot.gravity]
        moving += [] if base.acceleration is None else [base.acceleration]
    told = base is not None and base.acceleration is not None
    for model, last, found in (
        ("inverse", expected.accelerations, expected.efforts),
        ("direct", expected.efforts, expected.accelerations),
    ):
        program = dynamics.compile(model, wrenches=tuple(wrenches), prescribed_base=told)
        given = [q, qd, last, *moving, *wrenches.values()]
        one = program.evaluate(*(np.ascontiguousarray(value) for value in given))
        many = program.batch(*(np.tile(value, (11, 1)) for value in given))
        first, rows = (one[0], many[0]) if isinstance(one, tuple) else (one, many)
        assert relative_error(first, found) < 1e-9
        assert relative_error(rows, np.tile(found, (11, 1))) < 1e-9


@pytest.mark.parametrize("seed", range(40))
def test_loops_are_closed_wherever_the_door_has_been(seed):
    """Residual below 1e-11 by an own measure, for batches with a seed, and along a trajectory without."""
    looped = random_loops(seed)
    dynamics, rng = Dynamics(looped.robot, compiled=seed % 2 > 0), np.random.default_rng(seed)
    states = np.array([random_closed_state(looped.robot, looped.q, looped.dependents, rng, 0.1)[0] for _ in range(10)])
    near = states.copy()
    dependents = list(looped.dependents)
    near[:, dependents] += rng.uniform(-0.05, 0.05, (10, len(dependents)))
    found = dynamics.expand_positions(near)
    assert max(np.abs(loop_gaps(looped.robot, q)).max() for q in found) < 1e-11
    independent = [looped.robot.joint_numbers[name] for name in dynamics.joint_names]
    way = np.linspace(looped.q, states[0], 30)
    followed = dynamics.expand_trajectory(np.concatenate([looped.q[None], way]) if seed % 3 else way)
    assert max(np.abs(loop_gaps(looped.robot, q)).max() for q in followed) < 1e-11
    assert np.abs(followed[-1, independent] - states[0, independent]).max() < 1e-12


@pytest.mark.parametrize("seed", range(12))
def test_power_of_a_motion_is_accounted_for(seed):
    """d/dt (kinetic + potential + elastic) = motors + wrenches - dissipation, to 1e-7 of the largest power."""
    question = Question(seed, moving_base=False, elastic=True)
    robot, dynamics, independent = question.robot, question.dynamics, question.independent
    peer = MaximalCoordinates(robot)
    inverse = question.solve(qdd=question.told[independent])
    qdd = inverse.accelerations
    wrenches = question.of_peer["external_wrenches"]
    h = 3e-5

    def energy(t):
        """Along the motion of constant accelerations of the independent joints."""
        near = question.q.copy()
        x, v = (
            question.q[independent] + t * question.qd[independent] + t * t / 2 * qdd,
            question.qd[independent] + t * qdd,
        )
        near[independent] = x
        q = dynamics.expand_positions(near)
        return peer.energy(q, dynamics.expand_velocities(v, q))

    weights = {4: -1 / 280, 3: 4 / 105, 2: -1 / 5, 1: 4 / 5}  # of the central difference of eighth order
    rate = sum(w * (sum(energy(k * h)[:3]) - sum(energy(-k * h)[:3])) for k, w in weights.items()) / h
    terms = [
        inverse.efforts @ question.qd[independent],
        peer.power_of_wrenches(question.q, question.qd, wrenches),
        -energy(0).dissipation,
    ]
    assert all(term != 0 for term in terms)
    assert abs(rate - sum(terms)) < 1e-7 * max(map(abs, [rate, *terms]))


@pytest.mark.parametrize("seed", range(20))
def test_efforts_at_rest_are_the_slope_of_the_potential(seed):
    """Virtual work: Γ_c is the finite difference of gravity's and the springs' potential along the closed loops."""
    looped = random_loops(seed, moving_base=False)
    robot = looped.robot
    dynamics, peer = Dynamics(robot, compiled=False), MaximalCoordinates(robot)
    independent = [robot.joint_numbers[name] for name in dynamics.joint_names]
    rest = np.zeros(len(robot.joints))

    def potential(q):
        return sum(peer.energy(closed_positions(robot, q, looped.dependents), rest)[1:3])

    h, slope = 1e-5, []
    for number in independent:
        move = h * np.eye(len(rest))[number]
        slope.append((potential(looped.q + move) - potential(looped.q - move)) / (2 * h))
    held = dynamics.gravity(looped.q) + dynamics.elasticity(looped.q, rest[: len(independent)])
    assert np.abs(held - slope).max() < 1e-6 * max(1, np.abs(slope).max())


def elastic_crank(linkage, start, rest):
    """Dynamics of a linkage without motor and friction, a stiff spring at its first crank."""
    robot = linkage.robot(start)
    crank = replace(robot.joints[0], actuated=False, spring=Spring(1e5, rest))
    return Dynamics(replace(robot, joints=(crank, *robot.joints[1:])), compiled=False)


@pytest.mark.parametrize("seed", range(8))
def test_equilibrium_far_from_where_it_is_sought_is_in_the_same_assembly_mode(seed):
    """A crank that turns all the way, drawn half a turn on by its spring: batches with wrenches, and one sample."""
    linkage = random_four_bar(seed, friction=False)
    dynamics = elastic_crank(linkage, 0.5, 0.5 + (-1) ** seed * 3)
    wrenches = {"rocker": np.array([[1.0, 2, 3, 0.1, 0.2, 0.3], [0, 0, 0, 0, 0, 0]])}
    found = dynamics.equilibrium(dynamics.initial_joint_positions, external_wrenches=wrenches)
    peer, rest = MaximalCoordinates(dynamics.robot), np.zeros(4)
    for sample, q in enumerate(found.joint_positions):
        turns = (q - linkage.positions(q[:1])) / (2 * np.pi)
        assert np.abs(q[0] - 0.5) > 2.5 and np.abs(turns - np.round(turns)).max() < 1e-11
        moved = peer.direct(q, rest, rest, external_wrenches={3: wrenches["rocker"][sample]})
        begun = peer.direct(dynamics.initial_joint_positions, rest, rest)
        assert np.abs(moved.accelerations).max() < 1e-8 * np.abs(begun.accelerations).max()
    assert found.stable.all()
    one = dynamics.equilibrium(dynamics.initial_joint_positions)
    assert np.abs(one.joint_positions - found.joint_positions[1]).max() < 1e-9


def test_equilibrium_at_which_loops_do_not_close_says_that_it_was_sought():
    """A crank that cannot turn all the way, drawn past its dead centre: not the positions of the question are open."""
    linkage = replace(random_four_bar(1, friction=False), crank=0.6, coupler=0.5, rocker=0.4, ground=0.8)
    dynamics = elastic_crank(linkage, 0.5, 3.0)
    with pytest.raises(SingularModelError, match=r"no equilibrium was found.*loop 'four_bar'") as refused:
        dynamics.equilibrium(dynamics.initial_joint_positions)
    assert "at sample" not in str(refused.value)


@pytest.mark.parametrize("seed", range(10))
def test_frames_chosen_anew_change_nothing(seed):
    question = Question(seed)
    other = Dynamics(minimal_frames(question.robot), compiled=False)
    expected = question.solve(qdd=question.told[question.independent])
    found = other.solve(question.q, question.qd[question.independent], qdd=question.told[question.independent],
                        **question.of_door)  # fmt: skip
    assert relative_error(found.efforts, expected.efforts) < 1e-9
    assert relative_error(found.reactions, expected.reactions) < 1e-7


@settings(max_examples=60)
@given(st.integers(0, 500), st.integers(0, 2**32))
def test_rates_are_in_the_null_space_of_an_own_jacobian(seed, chance):
    looped = random_loops(seed % 30)
    dynamics = Dynamics(looped.robot, compiled=False)
    qd = np.random.default_rng(chance).uniform(-5, 5, len(dynamics.joint_names))
    rates = dynamics.expand_velocities(qd, looped.q)
    assert (
        np.abs(loop_jacobian(looped.robot, dynamics.expand_positions(looped.q)) @ rates).max()
        < 1e-9 * np.abs(rates).max()
    )


@pytest.mark.parametrize("far", [1e200, 1.7e308])
def test_positions_too_far_for_numbers_are_refused(far):
    """Joints of loops that slide: the ends of the loops are nowhere."""
    looped = random_loops(0, loops=2, kinds=("planar",), moving_base=False)
    robot, dynamics = looped.robot, Dynamics(looped.robot, compiled=False)
    assert any(robot.joints[number].prismatic for number in robot.joints_in_loops)
    everyone = np.full(len(robot.joints), far)
    partly = everyone.copy()
    partly[dynamics.all_joint_names.index(dynamics.dependent_joint_names[0])] = np.nan
    for q in (everyone[: len(dynamics.joint_names)], everyone, partly):
        with pytest.raises(SingularModelError, match="does not close"):
            dynamics.expand_positions(q)


def test_positions_keep_their_whole_turns():
    """Springs count them: of joints that are given, and of those that are told."""
    linkage = random_four_bar(2, friction=False)
    dynamics = Dynamics(linkage.robot(linkage.independent), compiled=False)
    q = np.array([[0.3], [0.3 + 6 * np.pi], [0.3 - 40 * np.pi]])
    found = dynamics.expand_positions(q)
    assert np.abs(found[:, 0] - q[:, 0]).max() < 1e-15 and np.abs(found[:, 1:] - found[0, 1:]).max() < 1e-9
    turned = found[0] + 2 * np.pi * np.array([3, -5, 7, 1])
    assert np.abs(dynamics.expand_positions(turned) - turned).max() < 1e-12


@pytest.mark.parametrize("seed", range(5))
def test_followers_outside_of_loops_do_not_keep_turns_from_being_taken_off(seed):
    """A gear of any ratio at the crank, and a slide elsewhere, both a thousand turns and metres away."""
    linkage = random_four_bar(seed, friction=False)
    plain = linkage.robot(linkage.independent)
    joints = [
        replace(plain.joints[0], name=name, antecedent=0, prismatic=prismatic, mimic=mimic)
        for name, prismatic, mimic in (("gear", False, Mimic("crank", 0.37)), ("slide", True, None))
    ]
    links = [replace(plain.links[1], name=name) for name in ("gear", "slide")]
    frames = [Frame(link.name, 5 + number, np.eye(4)) for number, link in enumerate(links)]
    robot = replace(plain, joints=(*plain.joints, *joints), links=(*plain.links, *links),
                    frames=(*plain.frames, *frames))  # fmt: skip
    dynamics, q = Dynamics(robot, compiled=False), np.random.default_rng(seed).uniform(-3, 3, 8)
    assert dynamics.joint_names == ("crank", "slide")
    found = dynamics.expand_positions(np.stack([q + 2000 * np.pi, 1e6 * q], axis=-1))
    turns = (found[:, :4] - [linkage.positions(crank) for crank in q[:, None]]) / (2 * np.pi)
    assert np.abs(turns - np.round(turns)).max() < 1e-11
    np.testing.assert_allclose(found[:, 4:], np.stack([0.37 * (q + 2000 * np.pi), 1e6 * q], axis=-1), rtol=1e-14)


def test_a_trajectory_that_leaves_where_loops_close_names_its_sample():
    linkage = replace(random_four_bar(1, friction=False), crank=0.6, coupler=0.5, rocker=0.4, ground=0.8)
    dynamics = Dynamics(linkage.robot(0.5), compiled=False)
    way = np.linspace(0.5, 2.5, 21)[:, None]
    reach = np.arccos((0.6**2 + 0.8**2 - 0.9**2) / (2 * 0.6 * 0.8))  # coupler and rocker on one line
    with pytest.raises(SingularModelError, match=f"at sample {int(np.sum(way < reach))}:"):
        dynamics.expand_trajectory(way)
    assert len(dynamics.expand_trajectory(way[way[:, 0] < reach])) == np.sum(way < reach)


def test_rates_beyond_all_numbers_are_refused():
    looped = random_loops(0)
    dynamics = Dynamics(looped.robot, compiled=False)
    large, rest = np.full(len(dynamics.joint_names), 1e308), np.zeros(len(dynamics.joint_names))
    with pytest.raises(InvalidInputError, match="no finite number"):
        dynamics.expand_accelerations(rest, looped.q, large)
