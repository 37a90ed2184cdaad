"""Shipped robots with loops: they close within their limits and satisfy closed-form relations; their motion agrees with
its published source and with multipliers on maximal coordinates."""

from dataclasses import replace

import numpy as np
import pytest
from peers.loop_states import loop_gaps
from peers.maximal_coordinates import MaximalCoordinates
from peers.reachable import limits_of, reachable
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from robot_dynamics import Dynamics, SingularModelError, load_robot, shipped_robots
from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.model.joint import Spring

LOOPED = [name for name in shipped_robots() if load_robot(name).loops]
BARE = [
    name for name in LOOPED if not load_robot(name).platforms
]  # of the others parallel.test_shipped_platforms tests the others


def within_limits(dynamics, samples):
    return reachable(dynamics, samples, np.random.default_rng(0))


def joints(dynamics, values, names):
    return values[..., [dynamics.all_joint_names.index(name) for name in names.split()]]


def test_shipped_robots_include_each_kind_of_loop():
    assert {"sr400", "irb460", "four_bar", "five_bar", "bricard", "andrews_squeezer"} <= set(LOOPED)


@pytest.mark.parametrize("name", BARE)
def test_loops_close_far_from_singular_everywhere_within_the_limits(name):
    robot = load_robot(name, strict=True)
    dynamics = Dynamics(robot)
    q = dynamics.expand_positions(within_limits(dynamics, 1000))
    equations = loop_equations(robot, q)
    assert np.abs(equations.residual).max() < 1e-11
    dependent = [robot.joint_numbers[name] for name in dynamics.dependent_joint_names]
    assert np.linalg.cond(equations.jacobian[..., dependent]).max() < 1e3
    assert max(np.abs(loop_gaps(robot, sample)).max() for sample in q[:20]) < 1e-11


@pytest.mark.parametrize("name", LOOPED)
def test_initial_positions_are_closed_and_within_the_limits(name):
    robot = load_robot(name)
    dynamics = Dynamics(robot)
    initial = np.array([joint.initial_position for joint in robot.joints])
    q = joints(dynamics, initial, " ".join(dynamics.joint_names))
    lower, upper = limits_of(dynamics)
    assert np.all((lower <= q) & (q <= upper))
    np.testing.assert_allclose(dynamics.expand_positions(q), initial, atol=0.01)


@pytest.mark.parametrize("name", BARE)
def test_both_models_agree_with_multipliers_on_maximal_coordinates(name):
    robot = load_robot(name)
    dynamics, peer = Dynamics(robot, compiled=False), MaximalCoordinates(robot)
    independent = [robot.joint_numbers[name] for name in dynamics.joint_names]
    rng, count = np.random.default_rng(1), len(independent)
    for q in within_limits(dynamics, 10):
        qd, qdd = rng.uniform(-2, 2, (2, count))
        positions = dynamics.expand_positions(q)
        closed_state = positions, dynamics.expand_velocities(qd, positions)
        partial_seed = np.full(len(positions), np.nan)
        partial_seed[independent] = qdd
        result = dynamics.solve(positions, qd, qdd=qdd)
        computed = peer.inverse(*closed_state, partial_seed)
        scale = np.abs(result.efforts).max()
        np.testing.assert_allclose(result.efforts, computed.efforts[independent], rtol=1e-8, atol=1e-8 * scale)
        accelerated = peer.direct(*closed_state, computed.efforts)
        computed = dynamics.direct(positions, qd, result.efforts)
        np.testing.assert_allclose(computed, accelerated.accelerations[independent], rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("batch", [(0,), (0, 3), (3, 0)])
@pytest.mark.parametrize("name", ["five_bar", "sr400"])
def test_empty_batches_have_empty_results(name, batch, compiled):
    dynamics = Dynamics(load_robot(name), compiled=compiled)
    if compiled:
        for model in ("inverse", "direct", "gravity", "coriolis", "inertia_matrix", "closure"):
            dynamics.compile(model)
    count, joint_count = len(dynamics.joint_names), len(dynamics.all_joint_names)
    no_sample = np.zeros((*batch, count))
    for q in (no_sample, np.zeros((*batch, joint_count))):
        assert dynamics.expand_positions(q).shape == (*batch, joint_count)
        for computed in (
            dynamics.inverse(q, no_sample, no_sample),
            dynamics.direct(q, no_sample, no_sample),
            dynamics.gravity(q),
            dynamics.coriolis(q, no_sample),
            dynamics.friction(no_sample, q),
            dynamics.equilibrium(q).efforts,
        ):
            assert computed.shape == (*batch, count)
        assert dynamics.solve(q, no_sample, qdd=no_sample).reactions.shape == (*batch, 1 + joint_count, 6)
        assert dynamics.inertia_matrix(q).shape == (*batch, count, count)
        if len(batch) == 1:
            assert dynamics.expand_trajectory(q).shape == (*batch, joint_count)


@pytest.mark.slow
@pytest.mark.parametrize("name", LOOPED)
def test_partial_seed_chooses_the_assembly_mode(name):
    """Seeds of one or several joints in the initial mode; joints with a seed keep their positions."""
    dynamics, rng = Dynamics(load_robot(name), compiled=False), np.random.default_rng(3)
    looped = [dynamics.all_joint_names.index(joint) for joint in dynamics.dependent_joint_names]
    expected = dynamics.expand_positions(within_limits(dynamics, 40))
    partial_seed = expected.copy()
    for sample in partial_seed:
        sample[rng.choice(looped, rng.integers(1, len(looped)), replace=False)] = np.nan
    computed = dynamics.expand_positions(partial_seed)
    turns = (computed - expected) / (2 * np.pi)
    assert np.abs((computed - partial_seed)[~np.isnan(partial_seed)]).max() < 1e-9
    if name != "bricard":  # a seed of one of its joints may not determine the mode
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)


def test_sample_without_seed_in_a_batch_is_closed_as_alone():
    """Beside a sample whose apex is on the other side."""
    dynamics = Dynamics(load_robot("five_bar"), compiled=False)
    looped = [dynamics.all_joint_names.index(joint) for joint in dynamics.dependent_joint_names]
    for q in within_limits(dynamics, 10):
        first_mode = dynamics.expand_positions(q)
        no_seed, second_mode = first_mode.copy(), second_mode_of(dynamics, first_mode, looped)
        no_seed[looped] = np.nan
        computed = dynamics.expand_positions([no_seed, second_mode, no_seed])
        np.testing.assert_allclose(computed, [first_mode, second_mode, first_mode], atol=1e-11)


def second_mode_of(dynamics, first_mode, looped):
    """Positions in another assembly mode, the same of the independent joints."""
    second_mode = first_mode.copy()
    for start in np.random.default_rng(0).uniform(-3, 3, (50, len(looped))):
        second_mode[looped] = start
        try:
            computed = dynamics.expand_positions(second_mode)
        except SingularModelError:
            continue
        if np.abs((computed - first_mode + np.pi) % (2 * np.pi) - np.pi).max() > 0.1:
            return computed
    raise AssertionError("no second assembly mode was found")


def test_sr400_closes_as_in_its_table():
    """theta3 = pi/2 - theta2 + theta7, theta8 = theta2 - theta7, theta9 = pi - theta2 + theta7, by hand."""
    dynamics = Dynamics(load_robot("sr400"))
    q = dynamics.expand_positions(within_limits(dynamics, 1000))
    theta2, theta7 = joints(dynamics, q, "joint_2 joint_7").T
    expected = np.stack([np.pi / 2 - theta2 + theta7, theta2 - theta7, np.pi - theta2 + theta7], axis=-1)
    np.testing.assert_allclose(joints(dynamics, q, "joint_3 joint_8 joint_9"), expected, rtol=0, atol=1e-12)
    rates = dynamics.expand_velocities([0, 1, 0, 0, 0, 3], q)
    np.testing.assert_allclose(
        joints(dynamics, rates, "joint_3 joint_8 joint_9"), np.tile([2, -2, 2], (1000, 1)), rtol=0, atol=1e-12
    )


def test_irb460_keeps_its_wrist_level_and_its_passive_joints_are_linear():
    dynamics = Dynamics(load_robot("irb460"))
    q = dynamics.expand_positions(within_limits(dynamics, 1000))
    arm, crank = joints(dynamics, q, "joint_2 joint_3").T
    for names, expected in {
        "elbow drive_pin": crank - arm,
        "drive_rod": arm - crank,
        "lower_rod": arm,
        "triangle lower_pin": -arm,
        "upper_rod": crank,
        "wrist upper_pin": -crank,
    }.items():
        for name in names.split():
            np.testing.assert_allclose(joints(dynamics, q, name)[:, 0], expected, rtol=0, atol=1e-12)
    flange = dynamics.link_pose("flange", q)
    np.testing.assert_allclose(flange[:, :3, 2], np.tile([0, 0, -1], (1000, 1)), rtol=0, atol=1e-12)
    reach = 0.26 + 0.945 * np.sin(arm) + 1.025 * np.cos(crank) + 0.225
    np.testing.assert_allclose(np.hypot(flange[:, 0, 3], flange[:, 1, 3]), reach, rtol=0, atol=1e-12)


def test_bricard_closes_as_threefold_symmetric_linkages_do():
    """cos φ + cos ψ + cos φ cos ψ = 0 for the angles between rods at joints next to each other: what is known of such
    linkages in closed form, where each axis is normal to the next."""
    dynamics = Dynamics(load_robot("bricard"))
    q = dynamics.expand_positions(within_limits(dynamics, 1000))
    np.testing.assert_allclose(q[:, 2::2] - q[:, :1], 0, atol=1e-12)
    np.testing.assert_allclose(q[:, 3::2] - q[:, 1:2], 0, atol=1e-12)
    phi, psi = np.cos(q[:, 0] - np.pi / 2), np.cos(q[:, 1] - np.pi / 2)
    np.testing.assert_allclose(phi + psi + phi * psi, 0, atol=1e-12)


def test_bricard_falls_as_in_exudyn():
    """Let go for 1 s. Exudyn's test of the same mechanism (TestModels/bricardMechanism.py) expects 4.172189649307425
    after 1000 steps: the length of all displacements of its bodies' origins and Euler parameters, and the number of
    degrees of freedom, that of redundant equations and an eigenvalue, taken to be 1, 1 and 0 here. Rods thicker by 1 %
    would change it by 7e-5."""
    dynamics = Dynamics(load_robot("bricard"))
    motion = solve_ivp(
        lambda _, x: [x[1], dynamics.direct(x[:1], x[1:], [0])[0]], (0, 1), [0, 0], "DOP853", rtol=1e-9, atol=1e-9
    )
    displaced = []
    for number, edge in enumerate(EDGES, start=1):
        before, after = (dynamics.link_pose(f"rod_{number}", [q]) for q in (0.0, motion.y[0, -1]))
        displaced.append(after[:3, 3] - before[:3, 3])
        rotated = in_benchmark(after) * in_benchmark(before).inv() * edge
        parameters = rotated.as_quat() * np.sign(rotated.as_quat() @ edge.as_quat())
        displaced.append(parameters - edge.as_quat())
    assert np.linalg.norm(np.concatenate(displaced)) == pytest.approx(4.172189649307425 - 2, abs=5e-6)


# the orientations in which Exudyn's rods begin, in the axes of the benchmark, whose y points upwards
EDGES = [Rotation.from_euler(axis, angle, degrees=True)
         for axis, angle in (("z", 0), ("z", -90), ("y", -90), ("z", 180), ("z", 90))]  # fmt: skip


def in_benchmark(pose):
    return Rotation.from_matrix(np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) @ pose[:3, :3])


SQUEEZER = "beta theta gamma phi delta omega epsilon"


def spring_of_the_squeezer(dynamics, q):
    """Wrench of the spring of Andrews' mechanism on the frame `spring`, in its axes."""
    pose = dynamics.link_pose("spring", q)
    displacement = np.array([0.014, 0.072, 0]) - pose[:3, 3]
    force = 4530 * (1 - 0.07785 / np.linalg.norm(displacement)) * displacement
    return {"spring": [*(pose[:3, :3].T @ force), 0, 0, 0]}


def solve_squeezer(dynamics, q, qd):
    """DynamicsResult of Andrews' mechanism under its motor and its spring."""
    q = dynamics.expand_positions(q)
    return dynamics.solve(q, qd, efforts=[0.033], external_wrenches=spring_of_the_squeezer(dynamics, q))


def test_squeezer_has_the_published_initial_accelerations():
    """Initial positions and accelerations printed in the Test Set for IVP Solvers, problem Andrews."""
    dynamics = Dynamics(load_robot("andrews_squeezer"))
    result = solve_squeezer(dynamics, [-0.0617138900142764496], [0])
    published = [-0.0617138900142764496, 0, 0.455279819163070380, 0.222668390165885885, 0.487364979543842550,
                 -0.222668390165885885, 1.23054744454982119]  # fmt: skip
    np.testing.assert_allclose(joints(dynamics, result.motion.positions, SQUEEZER), published, rtol=0, atol=1e-14)
    published = [14222.4439199541138706, -10666.8329399655854, 0, 0, 0, 0, 0]
    np.testing.assert_allclose(
        joints(dynamics, result.motion.accelerations, SQUEEZER), published, rtol=1e-12, atol=1e-7
    )


@pytest.mark.slow
def test_squeezer_has_the_published_final_state():
    """Its state at 0.03 s, after two and a half turns, as printed in the Test Set for IVP Solvers, problem Andrews."""
    dynamics = Dynamics(load_robot("andrews_squeezer"))

    def direct(_, x):
        q = dynamics.expand_positions(x[:1])
        wrench = spring_of_the_squeezer(dynamics, q)
        return [x[1], dynamics.direct(q, x[1:], [0.033], external_wrenches=wrench)[0]]

    start = [-0.0617138900142764496, 0]
    beta, rate = solve_ivp(direct, (0, 0.03), start, "DOP853", rtol=1e-9, atol=1e-9).y[:, -1]
    motion = solve_squeezer(dynamics, [beta], [rate]).motion
    published = [0.1581077119629904e2, -0.1575637105984298e2, 0.4082224013073101e-1, -0.5347301163226948,
                 0.5244099658805304, 0.5347301163226948, 0.1048080741042263e1]  # fmt: skip
    turns = (joints(dynamics, motion.positions, SQUEEZER) - published) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-7)
    published = [0.1139920302151208e4, -0.1424379294994111e4, 0.1103291221937134e2, 0.1929337464421385e2,
                 0.5735699284790808, -0.1929337464421385e2, 0.3231791658026955]  # fmt: skip
    np.testing.assert_allclose(joints(dynamics, motion.velocities, SQUEEZER), published, rtol=1e-6)
    published = [-0.2463176316945196e5, 0.5185037701610329e5, 0.3241025686413781e6, 0.5667493645176213e6,
                 0.1674362929479361e5, -0.5667493645176222e6, 0.9826520791458422e4]  # fmt: skip
    np.testing.assert_allclose(joints(dynamics, motion.accelerations, SQUEEZER), published, rtol=1e-4)


def natural_accelerations(points, rates, bars, applied_forces):
    """Accelerations (p, 2) of the points of a linkage of thin bars, in natural coordinates as its source has it.

    points, rates: (p, 2) x and z, the first and the last fixed; bars: (point, point, mass); pushes: {point: force}.
    """
    count = len(points)
    M, forces, rows, right = np.zeros((count, count)), np.zeros((count, 2)), [], []
    for i, j, mass in bars:
        M[np.ix_([i, j], [i, j])] += mass / 6 * np.array([[2, 1], [1, 2]])
        forces[[i, j], 1] -= mass * 9.81 / 2
        row = np.zeros((count, 2))
        row[i], row[j] = points[i] - points[j], points[j] - points[i]
        rows.append(row.ravel())
        right.append(-np.sum((rates[i] - rates[j]) ** 2))
    for fixed in (0, count - 1):
        for axis in range(2):
            row = np.zeros((count, 2))
            row[fixed, axis] = 1
            rows.append(row.ravel())
            right.append(0.0)
    for point, force in applied_forces.items():
        forces[point] += force
    J, M = np.array(rows), np.kron(M, np.eye(2))
    system = np.block([[M, J.T], [J, np.zeros((len(J), len(J)))]])
    return np.linalg.solve(system, [*forces.ravel(), *right])[: 2 * count].reshape(count, 2)


LINKAGES = {  # frames whose origins the points are, with a place along x; the bars between them, by mass; the cranks
    "four_bar": (("crank", 0), ("crank", 2), ("rocker", 5), ("rocker", 0)),
    "five_bar": (("left_crank", 0), ("left_crank", 0.5), ("tool", 0), ("right_crank", 0.5), ("right_crank", 0)),
}
MASSES = {"four_bar": (2, 8, 5), "five_bar": (3, 1, 2, 3)}


@pytest.mark.parametrize("name", LINKAGES)
def test_accelerations_of_linkages_agree_with_natural_coordinates(name):
    """Point masses and distances, as MBDE-MATLAB has them: no angle of a passive joint is in it."""
    dynamics = Dynamics(load_robot(name))
    count = len(dynamics.joint_names)
    bars = [(k, k + 1, mass) for k, mass in enumerate(MASSES[name])]
    cranks = [(0, 1), (len(bars), len(bars) - 1)][:count]

    def places(q):
        partial_seed = [(dynamics.link_pose(frame, q), x) for frame, x in LINKAGES[name]]
        return np.array([(pose[:3, 3] + x * pose[:3, 0])[[0, 2]] for pose, x in partial_seed])

    rng = np.random.default_rng(2)
    for q in within_limits(dynamics, 10):
        qd, efforts = rng.uniform(-2, 2, count), rng.uniform(-50, 50, count)
        points, h = places(q), 1e-4
        rates = (
            (8 * (places(q + h * qd) - places(q - h * qd)) - places(q + 2 * h * qd) + places(q - 2 * h * qd)) / 12 / h
        )
        arms = [points[end] - points[pivot] for pivot, end in cranks]
        applied_forces = {end: effort * np.array([-arm[1], arm[0]]) / (arm @ arm)
                  for (_, end), effort, arm in zip(cranks, efforts, arms, strict=True)}  # fmt: skip
        computed = natural_accelerations(points, rates, bars, applied_forces)
        turning = [(arm[0] * a[1] - arm[1] * a[0]) / (arm @ arm)
                   for arm, a in zip(arms, (computed[end] for _, end in cranks), strict=True)]  # fmt: skip
        np.testing.assert_allclose(dynamics.direct(q, qd, efforts), turning, rtol=1e-8, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", LOOPED)
def test_power_balance_along_a_trajectory(name):
    """d/dt (kinetic + potential + elastic) = motors + wrench - dissipation, to 1e-7 of the peak power; with friction
    and springs in all joints, passive ones too, and a wrench on the last body."""
    robot = load_robot(name)
    unit = sum(link.inertia.mass for link in robot.links) * robot.characteristic_length**2
    drives = {"viscous_friction": 2 * unit, "coulomb_friction": unit}
    alone = {number for one in robot.platforms for number in one.joints}  # coordinates, no joints that could rub
    joints = [
        joint
        if number in alone
        else replace(joint, **drives, spring=Spring(5 * unit, 0.1, unit), initial_position=joint.initial_position)
        for number, joint in enumerate(robot.joints)
    ]
    robot = replace(robot, joints=tuple(joints))
    rubs = np.array([joint.coulomb_friction > 0 for joint in robot.joints])
    dynamics, peer = Dynamics(robot), MaximalCoordinates(robot)
    lower, upper = limits_of(dynamics)
    middle, reach = (lower + upper) / 2, (upper - lower) / 8
    if robot.platforms:  # legs go only where the platform can be
        independent = [robot.joint_numbers[name] for name in dynamics.joint_names]
        middle, reach = dynamics.initial_joint_positions[independent], (upper - lower) / 40
    phases = np.arange(len(middle))
    carrier = max(k for k, link in enumerate(robot.links) if link.inertia.mass > 0)
    link, wrench = robot.links[carrier].name, unit * np.array([3.0, -2, 4, 1, 2, -1])

    def state(t):
        turns = np.asarray(t)[..., None] + phases
        qd, qdd = reach * np.cos(turns), -reach * np.sin(turns)
        closed_state = dynamics.expand_positions(middle + reach * np.sin(turns))
        return closed_state, dynamics.expand_velocities(qd, closed_state), qd, qdd

    h, weights = 4e-3, {4: -1 / 280, 3: 4 / 105, 2: -1 / 5, 1: 4 / 5}
    places, shares = [0, *weights, *(-k for k in weights)], [0, *weights.values(), *(-w for w in weights.values())]
    times = np.linspace(0.1, 6.1, 12)
    before, after = (np.round(state(times + side * 5 * h)[1], 9) for side in (-1, 1))
    # where a joint turns round dry friction is not smooth over the difference
    times = times[~np.any((np.sign(before) != np.sign(after)) & rubs, axis=1)]
    positions, rates, qd, qdd = state(times[:, None] + h * np.array(places))
    efforts = dynamics.inverse(positions[:, 0], qd[:, 0], qdd[:, 0], external_wrenches={link: wrench})
    terms = []
    for number in range(len(times)):
        energies = [peer.energy(*state) for state in zip(positions[number], rates[number], strict=True)]
        stored = sum(share / h * sum(energy[:3]) for share, energy in zip(shares, energies, strict=True))
        q, velocities = positions[number, 0], rates[number, 0]
        given = peer.power_of_wrenches(q, velocities, {carrier: wrench_in_frame(robot, carrier, wrench)})
        terms.append([stored, -efforts[number] @ qd[number, 0], -given, energies[0].dissipation])
    terms = np.array(terms)
    assert len(terms) > 5 and np.all(np.abs(terms).max(axis=0) > 0)
    assert np.abs(terms.sum(axis=1)).max() < 1e-7 * np.abs(terms).max()


def wrench_in_frame(robot, number, wrench):
    """A wrench in the frame of a link's name, expressed in frame j of the link at its origin."""
    T = robot.frame(robot.links[number].name).placement
    force, torque = T[:3, :3] @ wrench[:3], T[:3, :3] @ wrench[3:]
    return np.concatenate([force, torque + np.cross(T[:3, 3], force)])
