"""`Dynamics` of robots with loops, against independent references: multipliers on maximal coordinates, closed forms of
planar linkages, Pinocchio's constrained dynamics, and the laws of work."""

import os
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

PROGRAM_STATES = int(os.environ.get("PROGRAM_STATES", "12"))
LINKAGES = {"four_bar": random_four_bar, "five_bar": random_five_bar}


def relative_error(computed, expected):
    scale = np.abs(expected).max(initial=0)
    return np.abs(np.asarray(computed) - expected).max(initial=0) / (scale if scale > 1e-9 else 1)


class RandomState:
    """A random closed state of a random robot, with wrenches on some of its links, and its base free or prescribed."""

    def __init__(self, seed, base_is_prescribed=False, **kinds):
        looped = random_loops(seed, **kinds)
        rng = np.random.default_rng([seed, 9])
        self.robot, self.looped = looped.robot, looped
        self.dynamics = Dynamics(self.robot, compiled=False)
        self.independent = [self.robot.joint_numbers[name] for name in self.dynamics.joint_names]
        self.q, self.qd = random_closed_state(self.robot, looped.q, looped.dependents, rng)
        self.actuated_joints = [number for number in self.independent if self.robot.joints[number].actuated]
        self.prescribed = np.full(len(self.q), np.nan)
        self.prescribed[self.actuated_joints] = rng.uniform(-3, 3, len(self.actuated_joints))
        numbers = rng.choice(len(self.robot.links), size=min(3, len(self.robot.links)), replace=False)
        wrenches = {int(number): rng.uniform(-20, 20, 6) for number in numbers}
        self.peer_arguments = {"external_wrenches": wrenches}
        self.arguments = {"external_wrenches": {self.robot.links[n].name: wrench for n, wrench in wrenches.items()}}
        if self.robot.moving_base:
            pose, twist = random_placement(rng), rng.uniform(-1, 1, 6)
            acceleration = rng.uniform(-3, 3, 6) if base_is_prescribed else None
            self.peer_arguments |= {"pose": pose, "twist": twist, "base_acceleration": acceleration}
            self.arguments["base"] = Base(pose, twist, acceleration)

    def inverse(self, peer):
        return peer.inverse(self.q, self.qd, self.prescribed, **self.peer_arguments)

    def solve(self, **given):
        return self.dynamics.solve(self.q, self.qd[self.independent], **given, **self.arguments)


@pytest.mark.parametrize("seed", range(120))
def test_both_models_agree_with_multipliers_on_maximal_coordinates(seed):
    """Efforts, accelerations of all joints and of the base, and the reactions that rigid bodies determine, to 1e-8."""
    random_state = RandomState(seed, base_is_prescribed=seed % 2 > 0)
    expected = random_state.inverse(MaximalCoordinates(random_state.robot))
    inverse = random_state.solve(qdd=random_state.prescribed[random_state.independent])
    assert relative_error(inverse.motion.positions, random_state.q) < 1e-11
    assert relative_error(inverse.motion.velocities, random_state.qd) < 1e-9
    assert relative_error(inverse.efforts, expected.efforts[random_state.independent]) < 1e-8
    assert relative_error(inverse.motion.accelerations, expected.accelerations) < 1e-8
    direct = random_state.solve(efforts=expected.efforts[random_state.independent])
    assert relative_error(direct.motion.accelerations, expected.accelerations) < 1e-8
    assert relative_error(direct.accelerations, expected.accelerations[random_state.independent]) < 1e-8
    for result in (inverse, direct):
        if random_state.robot.moving_base:
            assert relative_error(result.base_acceleration, expected.base_acceleration) < 1e-8
        if np.abs(random_state.qd).min() < 1e-9:
            continue  # a joint that its loop locks: rounding decides the sign of its dry friction
        scale = max(1, np.abs([reaction.wrench for reaction in expected.reactions]).max())
        for wrench, reaction in zip(result.reactions[1:], expected.reactions, strict=True):
            there = reaction.determinate
            assert np.abs(wrench - reaction.wrench)[there].max(initial=0) < 1e-8 * scale


@pytest.mark.slow
def test_reactions_of_cut_joints_are_determinate_in_spatial_loops():
    """Most of them in all components: the test above compares them whole."""
    whole = 0
    for seed in range(40):
        random_state = RandomState(seed, kinds=("spatial",))
        reactions = random_state.inverse(MaximalCoordinates(random_state.robot)).reactions
        cut = [loop.moved.link - 1 for loop in random_state.robot.loops]
        whole += sum(reactions[number].determinate.all() for number in cut if number >= 0)
    assert whole > 20


@pytest.mark.parametrize("seed", range(60))
def test_both_models_agree_with_pinocchio(seed):
    random_state = RandomState(seed, base_is_prescribed=seed % 2 > 0)
    expected = random_state.inverse(PinocchioLoops(random_state.robot))
    inverse = random_state.solve(qdd=random_state.prescribed[random_state.independent])
    direct = random_state.solve(efforts=expected.efforts[random_state.independent])
    assert relative_error(inverse.efforts, expected.efforts[random_state.independent]) < 1e-6
    assert relative_error(direct.motion.accelerations, expected.accelerations) < 1e-6


def reachable_positions(linkage, rng, count):
    """(count, n) and (count, all joints): random positions of the independent joints and of all, at which it closes."""
    computed = []
    while len(computed) < count:
        q = rng.uniform(-3, 3, len(linkage.independent))
        try:
            computed.append((q, linkage.positions(q)))
        except ValueError:
            continue
    return tuple(map(np.array, zip(*computed, strict=True)))


@pytest.mark.parametrize("kind", LINKAGES)
@pytest.mark.parametrize("seed", range(20))
def test_both_models_of_linkages_agree_with_closed_forms(kind, seed):
    """1000 random states in all for each kind, as batches: friction, rotors and springs in all joints."""
    linkage = LINKAGES[kind](seed, friction=seed % 3 > 0, springs=seed % 2 > 0)
    dynamics = Dynamics(linkage.robot(linkage.independent), compiled=False)
    rng = np.random.default_rng([seed, 4])
    q, closed = reachable_positions(linkage, rng, 50)
    qd, qdd = rng.uniform(-3, 3, (2, *q.shape))
    closure = (
        dynamics.expand_positions(q) if kind == "four_bar" else dynamics.expand_positions(closed)
    )  # not every five-bar is reached from its reference positions
    turns = (closure - closed) / (2 * np.pi)  # closed forms give angles between -π and π
    assert np.abs(turns - np.round(turns)).max() < 1e-11
    states = list(zip(q, qd, qdd, strict=True))
    efforts, all_joints = (
        np.array([of(*state) for state in states]) for of in (linkage.inverse, linkage.accelerations)
    )
    q = closed  # springs count whole turns
    for k in range(len(q)):
        assert relative_error(dynamics.inverse(q[k], qd[k], qdd[k]), efforts[k]) < 1e-9
    assert relative_error(dynamics.inverse(q, qd, qdd), efforts) < 1e-9
    assert relative_error(dynamics.direct(q, qd, efforts), qdd) < 1e-9
    assert relative_error(dynamics.expand_accelerations(qdd, q, qd), all_joints) < 1e-9


@pytest.mark.parametrize("seed", range(30))
def test_terms_add_up_to_the_inverse_model(seed):
    """A q̈ + coriolis + gravity + friction + elasticity, joint rows, at a prescribed base acceleration; A is
    symmetric, and its kinetic energy is that of the bodies."""
    random_state = RandomState(seed, base_is_prescribed=True)
    dynamics, qd = random_state.dynamics, random_state.qd[random_state.independent]
    base = random_state.arguments.get("base")
    rows = 6 if random_state.robot.moving_base else 0
    moving = {"base": replace(base, acceleration=None)} if base else {}
    A = dynamics.inertia_matrix(random_state.q)
    assert relative_error(A, A.T) < 1e-12
    peer = MaximalCoordinates(random_state.robot)
    rates = np.concatenate([base.twist if base else [], qd])
    energy = peer.energy(
        random_state.q, random_state.qd, **{key: random_state.peer_arguments[key] for key in ("pose", "twist") if base}
    )
    assert abs(0.5 * rates @ A @ rates - energy.kinetic) < 1e-10 * energy.kinetic
    result = dynamics.solve(random_state.q, qd, qdd=random_state.prescribed[random_state.independent], base=base)
    accelerations = np.concatenate([base.acceleration if base else [], result.accelerations])
    terms = (
        A @ accelerations + dynamics.coriolis(random_state.q, qd, **moving) + dynamics.gravity(random_state.q, **moving)
    )
    passive_efforts = dynamics.friction(qd, random_state.q) + dynamics.elasticity(random_state.q, qd)
    total = terms[rows:] + passive_efforts
    assert np.abs(total - result.efforts).max() < 1e-9 * max(1, np.abs(terms).max(), np.abs(passive_efforts).max())


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(PROGRAM_STATES))
def test_compiled_programs_agree_with_the_recursions(seed):
    random_state = RandomState(seed, base_is_prescribed=seed % 2 > 0)
    dynamics, q, qd = random_state.dynamics, random_state.q, random_state.qd[random_state.independent]
    wrenches = random_state.arguments["external_wrenches"]
    expected = random_state.solve(qdd=random_state.prescribed[random_state.independent])
    base, moving = random_state.arguments.get("base"), []
    if base:
        moving = [base.twist, base.pose[:3, :3].T @ random_state.robot.gravity]
        moving += [] if base.acceleration is None else [base.acceleration]
    prescribed = base is not None and base.acceleration is not None
    for model, last, computed in (
        ("inverse", expected.accelerations, expected.efforts),
        ("direct", expected.efforts, expected.accelerations),
    ):
        program = dynamics.compile(model, wrenches=tuple(wrenches), prescribed_base=prescribed)
        given = [q, qd, last, *moving, *wrenches.values()]
        single = program.evaluate(*(np.ascontiguousarray(value) for value in given))
        batch_results = program.batch(*(np.tile(value, (11, 1)) for value in given))
        first, rows = (single[0], batch_results[0]) if isinstance(single, tuple) else (single, batch_results)
        assert relative_error(first, computed) < 1e-9
        assert relative_error(rows, np.tile(computed, (11, 1))) < 1e-9


@pytest.mark.parametrize("seed", range(40))
def test_closure_solver_closes_loops_in_batches_and_along_trajectories(seed):
    """Gaps of an independent measure below 1e-11, for batches with a seed and along trajectories without one."""
    looped = random_loops(seed)
    dynamics, rng = Dynamics(looped.robot, compiled=seed % 2 > 0), np.random.default_rng(seed)
    states = np.array([random_closed_state(looped.robot, looped.q, looped.dependents, rng, 0.1)[0] for _ in range(10)])
    near = states.copy()
    dependents = list(looped.dependents)
    near[:, dependents] += rng.uniform(-0.05, 0.05, (10, len(dependents)))
    computed = dynamics.expand_positions(near)
    assert max(np.abs(loop_gaps(looped.robot, q)).max() for q in computed) < 1e-11
    independent = [looped.robot.joint_numbers[name] for name in dynamics.joint_names]
    path = np.linspace(looped.q, states[0], 30)
    followed = dynamics.expand_trajectory(np.concatenate([looped.q[None], path]) if seed % 3 else path)
    assert max(np.abs(loop_gaps(looped.robot, q)).max() for q in followed) < 1e-11
    assert np.abs(followed[-1, independent] - states[0, independent]).max() < 1e-12


@pytest.mark.parametrize("seed", range(12))
def test_power_balance_of_a_motion(seed):
    """d/dt (kinetic + potential + elastic) = motors + wrenches - dissipation, to 1e-7 of the largest power."""
    random_state = RandomState(seed, moving_base=False, elastic=True)
    robot, dynamics, independent = random_state.robot, random_state.dynamics, random_state.independent
    peer = MaximalCoordinates(robot)
    inverse = random_state.solve(qdd=random_state.prescribed[independent])
    qdd = inverse.accelerations
    wrenches = random_state.peer_arguments["external_wrenches"]
    h = 3e-5

    def energy(t):
        """Along the motion of constant accelerations of the independent joints."""
        near = random_state.q.copy()
        x, v = (
            random_state.q[independent] + t * random_state.qd[independent] + t * t / 2 * qdd,
            random_state.qd[independent] + t * qdd,
        )
        near[independent] = x
        q = dynamics.expand_positions(near)
        return peer.energy(q, dynamics.expand_velocities(v, q))

    weights = {4: -1 / 280, 3: 4 / 105, 2: -1 / 5, 1: 4 / 5}  # of the central difference of eighth order
    rate = sum(w * (sum(energy(k * h)[:3]) - sum(energy(-k * h)[:3])) for k, w in weights.items()) / h
    terms = [
        inverse.efforts @ random_state.qd[independent],
        peer.power_of_wrenches(random_state.q, random_state.qd, wrenches),
        -energy(0).dissipation,
    ]
    assert all(term != 0 for term in terms)
    assert abs(rate - sum(terms)) < 1e-7 * max(map(abs, [rate, *terms]))


@pytest.mark.parametrize("seed", range(20))
def test_efforts_at_rest_are_the_gradient_of_the_potential(seed):
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
        displacement = h * np.eye(len(rest))[number]
        slope.append((potential(looped.q + displacement) - potential(looped.q - displacement)) / (2 * h))
    holding_efforts = dynamics.gravity(looped.q) + dynamics.elasticity(looped.q, rest[: len(independent)])
    assert np.abs(holding_efforts - slope).max() < 1e-6 * max(1, np.abs(slope).max())


def elastic_crank(linkage, start, rest):
    """Dynamics of a linkage without motor and friction, with a stiff spring at its first crank."""
    robot = linkage.robot(start)
    crank = replace(robot.joints[0], actuated=False, spring=Spring(1e5, rest))
    return Dynamics(replace(robot, joints=(crank, *robot.joints[1:])), compiled=False)


@pytest.mark.parametrize("seed", range(8))
def test_equilibrium_far_from_its_start_keeps_the_assembly_mode(seed):
    """A crank that rotates fully, pulled half a turn by its spring: a batch with wrenches, and one sample."""
    linkage = random_four_bar(seed, friction=False)
    dynamics = elastic_crank(linkage, 0.5, 0.5 + (-1) ** seed * 3)
    wrenches = {"rocker": np.array([[1.0, 2, 3, 0.1, 0.2, 0.3], [0, 0, 0, 0, 0, 0]])}
    computed = dynamics.equilibrium(dynamics.initial_joint_positions, external_wrenches=wrenches)
    peer, rest = MaximalCoordinates(dynamics.robot), np.zeros(4)
    for sample, q in enumerate(computed.joint_positions):
        turns = (q - linkage.positions(q[:1])) / (2 * np.pi)
        assert np.abs(q[0] - 0.5) > 2.5 and np.abs(turns - np.round(turns)).max() < 1e-11
        final = peer.direct(q, rest, rest, external_wrenches={3: wrenches["rocker"][sample]})
        start = peer.direct(dynamics.initial_joint_positions, rest, rest)
        assert np.abs(final.accelerations).max() < 1e-8 * np.abs(start.accelerations).max()
    assert computed.stable.all()
    single = dynamics.equilibrium(dynamics.initial_joint_positions)
    assert np.abs(single.joint_positions - computed.joint_positions[1]).max() < 1e-9


def test_equilibrium_beyond_a_dead_centre_is_refused_as_an_equilibrium():
    """A crank that cannot rotate fully, pulled past its dead centre: the message names no sample of the input."""
    linkage = replace(random_four_bar(1, friction=False), crank=0.6, coupler=0.5, rocker=0.4, ground=0.8)
    dynamics = elastic_crank(linkage, 0.5, 3.0)
    with pytest.raises(SingularModelError, match=r"no equilibrium was found.*loop 'four_bar'") as refused:
        dynamics.equilibrium(dynamics.initial_joint_positions)
    assert "at sample" not in str(refused.value)


@pytest.mark.parametrize("seed", range(10))
def test_minimal_frames_do_not_change_results(seed):
    random_state = RandomState(seed)
    minimal = Dynamics(minimal_frames(random_state.robot), compiled=False)
    expected = random_state.solve(qdd=random_state.prescribed[random_state.independent])
    qd = random_state.qd[random_state.independent]
    qdd = random_state.prescribed[random_state.independent]
    computed = minimal.solve(random_state.q, qd, qdd=qdd, **random_state.arguments)
    assert relative_error(computed.efforts, expected.efforts) < 1e-9
    assert relative_error(computed.reactions, expected.reactions) < 1e-7


@pytest.mark.slow
@settings(max_examples=60)
@given(st.integers(0, 500), st.integers(0, 2**32))
def test_rates_are_in_the_null_space_of_an_independent_jacobian(seed, rng_seed):
    looped = random_loops(seed % 30)
    dynamics = Dynamics(looped.robot, compiled=False)
    qd = np.random.default_rng(rng_seed).uniform(-5, 5, len(dynamics.joint_names))
    rates = dynamics.expand_velocities(qd, looped.q)
    assert (
        np.abs(loop_jacobian(looped.robot, dynamics.expand_positions(looped.q)) @ rates).max()
        < 1e-9 * np.abs(rates).max()
    )


@pytest.mark.parametrize("far", [1e200, 1.7e308])
def test_positions_that_overflow_are_refused(far):
    """Prismatic joints in loops: the positions of the loop ends overflow."""
    looped = random_loops(0, loops=2, kinds=("planar",), moving_base=False)
    robot, dynamics = looped.robot, Dynamics(looped.robot, compiled=False)
    assert any(robot.joints[number].prismatic for number in robot.joints_in_loops)
    all_joints = np.full(len(robot.joints), far)
    partial_seed = all_joints.copy()
    partial_seed[dynamics.all_joint_names.index(dynamics.dependent_joint_names[0])] = np.nan
    for q in (all_joints[: len(dynamics.joint_names)], all_joints, partial_seed):
        with pytest.raises(SingularModelError, match="does not close"):
            dynamics.expand_positions(q)


def test_positions_keep_their_whole_turns():
    """Springs depend on them: at independent joints, and at dependent joints with a seed."""
    linkage = random_four_bar(2, friction=False)
    dynamics = Dynamics(linkage.robot(linkage.independent), compiled=False)
    q = np.array([[0.3], [0.3 + 6 * np.pi], [0.3 - 40 * np.pi]])
    computed = dynamics.expand_positions(q)
    assert np.abs(computed[:, 0] - q[:, 0]).max() < 1e-15 and np.abs(computed[:, 1:] - computed[0, 1:]).max() < 1e-9
    shifted = computed[0] + 2 * np.pi * np.array([3, -5, 7, 1])
    assert np.abs(dynamics.expand_positions(shifted) - shifted).max() < 1e-12


@pytest.mark.parametrize("seed", range(5))
def test_mimic_joints_outside_of_loops_do_not_prevent_removal_of_turns(seed):
    """A gear of any ratio at the crank, and a prismatic joint elsewhere, both far away."""
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
    computed = dynamics.expand_positions(np.stack([q + 2000 * np.pi, 1e6 * q], axis=-1))
    turns = (computed[:, :4] - [linkage.positions(crank) for crank in q[:, None]]) / (2 * np.pi)
    assert np.abs(turns - np.round(turns)).max() < 1e-11
    np.testing.assert_allclose(computed[:, 4:], np.stack([0.37 * (q + 2000 * np.pi), 1e6 * q], axis=-1), rtol=1e-14)


def test_trajectory_beyond_a_dead_centre_is_refused_with_its_sample():
    linkage = replace(random_four_bar(1, friction=False), crank=0.6, coupler=0.5, rocker=0.4, ground=0.8)
    dynamics = Dynamics(linkage.robot(0.5), compiled=False)
    path = np.linspace(0.5, 2.5, 21)[:, None]
    reach = np.arccos((0.6**2 + 0.8**2 - 0.9**2) / (2 * 0.6 * 0.8))  # coupler and rocker on one line
    with pytest.raises(SingularModelError, match=f"at sample {int(np.sum(path < reach))}:"):
        dynamics.expand_trajectory(path)
    assert len(dynamics.expand_trajectory(path[path[:, 0] < reach])) == np.sum(path < reach)


def test_rates_that_overflow_are_refused():
    looped = random_loops(0)
    dynamics = Dynamics(looped.robot, compiled=False)
    large, rest = np.full(len(dynamics.joint_names), 1e308), np.zeros(len(dynamics.joint_names))
    with pytest.raises(InvalidInputError, match="not a finite number"):
        dynamics.expand_accelerations(rest, looped.q, large)
