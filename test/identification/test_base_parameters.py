"""Numerical base parameters: their number is the rank of the regressor, they determine all efforts, and their counts
agree with published ones."""

import os
from dataclasses import replace

import numpy as np
import pytest
from peers.four_bar import random_four_bar
from peers.large_robots import each_robot
from peers.loop_states import random_closed_state
from peers.maximal_coordinates import MaximalCoordinates
from peers.random_loops import random_loops
from peers.real_robots import real_urdf, without_inertials
from peers.scanned import rank_of_efforts

from robot_dynamics import Base, Dynamics, Robot, load_robot
from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.identification.base_parameters import compute_base_parameters
from robot_dynamics.identification.motion_samples import sample_loop_motions, sample_random_motions
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.loading import shipped_robots
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh
from robot_dynamics.model.robot import Frame, Link
from robot_dynamics.newton_euler.regressor import parameters

SEEDS = int(os.environ.get("SEEDS", "2"))


def test_rx90_has_the_published_forty_inertial_parameters():
    base = compute_base_parameters(Dynamics(load_robot("rx90"), compiled=False))
    inertial = [name for name in base.expressions if name[:2] not in ("Fv", "Fs")]
    assert len(inertial) == 40 and len(base.independent) == 52


def test_a_description_without_masses_has_the_same_base_parameters():
    """A Unitree Z1 with gripper has 48 inertial base parameters, and two of friction for each of its seven joints."""
    whole = real_urdf("z1")
    bare = without_inertials(whole)
    assert "<inertial>" in whole and "inertial" not in bare
    result, expected = (compute_base_parameters(Dynamics(load_robot(text), compiled=False)) for text in (bare, whole))
    assert result.expressions == expected.expressions
    assert (
        len([name for name in result.expressions if name[:2] not in ("Fv", "Fs")]) == 48
        and len(result.independent) == 62
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_base_parameters_of_loops_determine_the_efforts(seed):
    """The closed states are independent of the random motions of the computation; springs are excluded."""
    looped = random_loops(seed, elastic=False)
    robot, dynamics = looped.robot, Dynamics(looped.robot)
    grouping, rng = compute_base_parameters(dynamics), np.random.default_rng(seed)
    q, qd = random_closed_state(robot, looped.q, looped.dependents, rng)
    independent = [robot.joint_numbers[name] for name in dynamics.joint_names]
    accelerations = np.full(len(q), np.nan)
    accelerations[independent] = rng.uniform(-3, 3, len(independent))
    base = Base(np.eye(4), *rng.uniform(-1, 1, (2, 6))) if robot.moving_base else None
    base_motion = {"twist": base.twist, "base_acceleration": base.acceleration} if base else {}
    expected = MaximalCoordinates(robot).inverse(q, qd, accelerations, **base_motion).efforts[independent]
    Y = dynamics.regressor(q, qd[independent], accelerations[independent], base=base)
    scale = max(1, np.abs(expected).max())
    assert np.abs((Y @ dynamics.parameters)[-len(expected) :] - expected).max() < 1e-8 * scale
    grouped_efforts = grouping.regressor(Y) @ grouping.values(dynamics.parameters)
    assert np.abs(grouped_efforts[-len(expected) :] - expected).max() < 1e-7 * scale
    motions = sample_random_motions(dynamics, 60, seed=1)
    rows = dynamics.regressor(motions.q, motions.qd, motions.qdd, base=motions.base).reshape(-1, len(grouping.names))
    lengths = np.linalg.norm(rows, axis=0)
    rows = rows[:, lengths > 1e-10 * lengths.max()] / lengths[lengths > 1e-10 * lengths.max()]
    assert np.linalg.matrix_rank(rows, tol=1e-8) == len(grouping.independent)


@pytest.mark.slow
@pytest.mark.parametrize("name", each_robot(shipped_robots()))
def test_rank_by_another_way_of_sampling_agrees_at_every_seed(name):
    """The peer samples states along lines of the motors or at poses of the platform, without random walks."""
    dynamics = Dynamics(load_robot(name))
    rank, gap = rank_of_efforts(dynamics, max(60, 3 * len(dynamics.parameter_names) // len(dynamics.joint_names)), 5)
    assert gap > 1e4  # smaller if the states do not cover the range
    results = [compute_base_parameters(dynamics, seed) for seed in range(SEEDS)]
    assert [len(result.independent) for result in results] == [rank] * SEEDS
    for result in results:
        assert result.independent == results[0].independent and result.gap[0] > 1e4 * result.gap[1]
        # the smallest singular value of the rank bounds the accuracy of the coefficients
        assert np.abs(result.K - results[0].K).max(initial=0) < 1e-13 / result.gap[0] * max(
            1.0, np.abs(result.K).max(initial=0)
        )


@pytest.mark.parametrize("name", ["bricard", "andrews_squeezer"])
def test_base_parameters_of_loops_determine_efforts_over_the_whole_range(name):
    """The trajectory follows a turn of the motor from the initial position; the computation uses random walks."""
    dynamics = Dynamics(load_robot(name))
    base, rng = compute_base_parameters(dynamics, 1), np.random.default_rng(3)
    start = dynamics.initial_joint_positions[dynamics.robot.joint_numbers[dynamics.joint_names[0]]]
    q = dynamics.expand_trajectory(start + np.linspace(0, 0.9, 40)[:, None])
    Y = dynamics.regressor(q, *rng.uniform(-3, 3, (2, len(q), 1)))
    for _ in range(3):  # arbitrary parameters
        theta = rng.normal(size=len(base.names))
        expected = Y @ theta
        assert np.abs(base.regressor(Y) @ base.values(theta) - expected).max() < 1e-6 * np.abs(expected).max()


H = np.pi / 2
STANFORD = "RRPRRR", [(0, 0, 0), (-H, 0, 0.15), (H, 0, 0.4), (0, 0, 0), (-H, 0, 0), (H, 0, 0)]
SEVEN = "RRRRRRR", [(0, 0, 0.36), (-H, 0, 0), (H, 0, 0.42), (H, 0, 0), (-H, 0, 0.4), (-H, 0, 0), (H, 0, 0.126)]
SCARA = "RRPR", [(0, 0, 0), (0, 0.35, 0), (0, 0.3, 0), (0, 0, 0)]


def serial(kinds, rows, gravity=(0.0, 0.0, -9.81), moving_base=False):
    """A serial arm; kinds: revolute (R) or prismatic (P) for each joint; rows: (alpha, d, r) of each joint."""
    joints = [Joint(f"joint_{j}", j - 1, kind == "P", placement_from_mdh(MDHParameters(alpha=alpha, d=d, r=r)))
              for j, (kind, (alpha, d, r)) in enumerate(zip(kinds, rows, strict=True), start=1)]  # fmt: skip
    links = [Link(name, Inertia()) for name in ("base", *(f"link_{j}" for j in range(1, len(joints) + 1)))]
    frames = tuple(Frame(link.name, number, np.eye(4)) for number, link in enumerate(links))
    return Robot("arm", tuple(links), tuple(joints), frames, moving_base=moving_base, gravity=np.array(gravity))


@pytest.mark.parametrize(
    ("robot", "bodies", "with_rotors"),
    [
        # 7 N - 4 β - 2 for N revolute joints, the first β of them about parallel vertical axes: Mayeda, Yoshida and
        # Osuka, "Base parameters of manipulator dynamic models", IEEE Trans. Robotics and Automation 6 (3), 1990, with
        # 36 for the Puma 560; 7 N - 4 β if gravity is not along the first axis
        (lambda: load_robot("puma560"), 36, None),
        (lambda: load_robot("ur5e"), 36, None),
        (lambda: serial(*SEVEN), 43, None),
        (lambda: serial(*SEVEN, gravity=(3.0, 1.0, -9.0)), 45, None),
        (lambda: serial("RR", [(0, 0, 0), (0, 0.3, 0)]), 4, None),
        (lambda: serial("RR", [(0, 0, 0), (0, 0.3, 0)], gravity=(0.0, -9.81, 0.0)), 6, None),
        # 43: Gaz, Cognetti, Oliva, Robuffo Giordano and De Luca, "Dynamic identification of the Franka Emika Panda
        # robot with retrieval of feasible parameters", IEEE Robotics and Automation Letters 4 (4), 2019
        (lambda: load_robot("panda"), 43, None),
        # 40 with rotors: Khalil, "Dynamic modeling of robots using recursive Newton-Euler techniques", RX-90
        (lambda: load_robot("rx90"), 36, 40),
        # 7 n_r + 4 n_p - 4, and 2 less if the first joint axis is vertical: closed-form rules of Gautier
        # and Khalil, "Direct calculation of minimum set of inertial parameters of serial robots", IEEE Trans. Robotics
        # and Automation 6 (3), 1990, with the Stanford arm as an example
        (lambda: serial(*STANFORD), 33, None),
        (lambda: serial(*STANFORD, gravity=(0.0, -9.81, 0.0)), 35, None),
        # parallel vertical axes: one moment of inertia and two first moments of each revolute link, and the mass of the
        # prismatic link, less the first moments of the first link, by the same rules
        (lambda: serial(*SCARA), 8, None),
        (lambda: serial("RRRP", SCARA[1]), 8, None),
        # free-flying: ten of the whole robot, 7 of each revolute and 4 of each prismatic joint; Ayusawa, Venture and
        # Nakamura, "Identifiability and identification of inertial parameters using the underactuated base-link
        # dynamics for legged multibody systems", Int. J. Robotics Research 33 (3), 2014
        (lambda: serial(*SEVEN, moving_base=True), 7 * 7 + 10, None),
        (lambda: serial(*STANFORD, moving_base=True), 7 * 5 + 4 + 10, None),
        (lambda: load_robot("free_flying_arm"), 7 * 6 + 10, None),
    ],
)
def test_numbers_of_base_parameters_agree_with_the_literature(robot, bodies, with_rotors):
    """Inertial parameters of links are counted, rotors only if the source includes them, frictions never."""
    robot = robot()
    dynamics = Dynamics(robot, compiled=False)
    for seed in range(3):
        base = compute_base_parameters(dynamics, seed)
        kinds = [base.names[number].partition(".")[0] for number in base.independent]
        assert kinds.count("Fv") == kinds.count("Fs") == len(robot.joints)
        assert len(kinds) - sum(map(kinds.count, ("Ia", "Fv", "Fs"))) == bodies
        if with_rotors is not None:
            assert len(kinds) - 2 * len(robot.joints) == with_rotors


@pytest.mark.slow
def test_loop_motions_stay_closed_within_limits_and_in_their_branch():
    """The coupler of a parallelogram keeps its direction; in the antiparallelogram branch it would turn."""
    for name in ("sr400", "delta_wrist", "bricard"):
        robot = load_robot(name)
        motions = sample_loop_motions(robot, 200, seed=4)
        equations = loop_equations(robot, motions.q, motions.qd)
        assert np.abs(equations.residual).max() < 1e-10
        velocity = (equations.jacobian @ motions.qd[..., None])[..., 0]
        acceleration = (equations.jacobian @ motions.qdd[..., None])[..., 0] + equations.drift
        assert np.abs(velocity).max() < 1e-9 and np.abs(acceleration).max() < 1e-8 * np.abs(motions.qdd).max()
        limits = np.array([(joint.limits.lower, joint.limits.upper) for joint in robot.joints]).T
        assert ((motions.q >= limits[0] - 1e-12) & (motions.q <= limits[1] + 1e-12)).all()
    for mode in (1, -1):
        linkage = replace(random_four_bar(3), crank=0.2, rocker=0.2, coupler=0.4, ground=0.4, mode=mode)
        q = sample_loop_motions(linkage.robot(np.array([1.0])), 500).q
        turned = np.cos(q[:, 0] + q[:, 1])  # angle of the coupler to the ground
        parallel = abs(linkage.link_angles(np.array([1.0]))[1]) < 1e-9
        assert (np.ptp(turned) < 1e-9) == parallel
        assert np.ptp(q[:, 0]) > 2.7  # of half a turn between the flat positions


@pytest.mark.parametrize("seed", range(8))
def test_loop_motions_cover_the_range_of_a_four_bar_and_its_dead_points(seed):
    """The law of cosines gives the range of the crank, at whose ends coupler and rocker are stretched or folded. A
    crank with a limited range returns in the other assembly mode."""
    rng = np.random.default_rng(seed)
    while True:
        crank, coupler, rocker, ground = rng.uniform(0.3, 0.9, 4)
        diagonals = np.clip([abs(coupler - rocker), coupler + rocker], abs(crank - ground), crank + ground)
        first, last = np.arccos((crank**2 + ground**2 - diagonals**2) / (2 * crank * ground))
        flat = min(abs(crank + rocker - coupler - ground), abs(crank + coupler - rocker - ground),
                   abs(crank + ground - rocker - coupler))  # fmt: skip
        if last - first > 0.5 and flat > 0.05:
            break
    linkage = replace(random_four_bar(seed), crank=crank, coupler=coupler, rocker=rocker, ground=ground)
    start = np.array([(first + last) / 2])
    q = sample_loop_motions(linkage.robot(start), 1000).q
    turned = np.abs(np.angle(np.exp(1j * q[:, 0])))
    assert first - 1e-9 <= turned.min() < first + 0.05 * (last - first) + 1e-9
    assert last - 0.05 * (last - first) - 1e-9 < turned.max() <= last + 1e-9
    sides = set()
    for row in q[::10]:
        for mode in (1, -1):
            with np.errstate(invalid="ignore"):  # rounding at dead points
                angles = replace(linkage, mode=mode).joint_angles(row[:1])
            if np.abs(np.exp(1j * angles) - np.exp(1j * row[: len(angles)])).max() < 1e-6:
                sides.add(mode)
    dead = first > 1e-6 or last < np.pi - 1e-6
    assert sides == ({1, -1} if dead else {linkage.mode})


def test_rocker_parameters_are_grouped_with_those_of_crank_and_coupler():
    """The first moment along the rocker is grouped with those of crank and coupler by ratios of lengths: with
    a e(φ₁) + b e(φ₂) = g + c e(φ₃), MX₃ e(φ₃) is MX₃/c times a e(φ₁) + b e(φ₂) less a constant."""
    linkage = random_four_bar(3)
    base = compute_base_parameters(Dynamics(linkage.robot(linkage.independent), compiled=False))
    names = list(base.names)
    column = base.dependent.index(names.index("MX.rocker"))
    share = {names[kept]: base.K[row, column] for row, kept in enumerate(base.independent)}
    assert share["MX.crank"] == pytest.approx(linkage.crank / linkage.rocker, rel=1e-7)
    assert share["MX.coupler"] == pytest.approx(linkage.coupler / linkage.rocker, rel=1e-7)


@pytest.mark.slow
def test_compiled_regressor_agrees_with_the_recursion():
    looped = random_loops(3, loops=1, kinds=("planar",), moving_base=True)
    dynamics = Dynamics(looped.robot, compiled=False)
    motions = sample_random_motions(dynamics, 20)
    expected = dynamics.regressor(motions.q, motions.qd, motions.qdd, base=motions.base)
    R = np.swapaxes(motions.base.pose[:, :3, :3], 1, 2)
    gravity = R @ looped.robot.gravity
    program = dynamics.compile("regressor")
    result = program.batch(motions.q, motions.qd, motions.qdd, motions.base.twist, gravity, motions.base.acceleration)
    assert np.abs(result.reshape(expected.shape) - expected).max() < 1e-8 * np.abs(expected).max()
    assert np.abs(expected[:, 6:] @ parameters(looped.robot)).max() > 0
