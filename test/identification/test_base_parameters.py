"""Base parameters by numbers: as many as the regressor has rank, enough for all efforts, the published ones where there
are some."""

import numpy as np
import pytest
from peers.four_bar import random_four_bar
from peers.loop_states import random_closed_state
from peers.maximal_coordinates import MaximalCoordinates
from peers.random_loops import random_loops
from peers.real_robots import real_urdf, without_inertials

from robot_dynamics import Base, Dynamics, load_robot
from robot_dynamics.identification.base_parameters import base_parameters
from robot_dynamics.identification.motions import random_motions
from robot_dynamics.newton_euler.regressor import parameters


def test_rx90_has_the_published_forty_and_its_frictions():
    found = base_parameters(Dynamics(load_robot("rx90"), compiled=False))
    inertial = [name for name in found.expressions if name[:2] not in ("Fv", "Fs")]
    assert len(inertial) == 40 and len(found.kept) == 52


def test_a_description_without_masses_has_the_same_base_parameters():
    """48 inertial ones of a Unitree Z1 with its gripper, and two of friction for each of its seven joints."""
    whole = real_urdf("z1")
    bare = without_inertials(whole)
    assert "<inertial>" in whole and "inertial" not in bare
    found, expected = (base_parameters(Dynamics(load_robot(text), compiled=False)) for text in (bare, whole))
    assert found.expressions == expected.expressions
    assert len([name for name in found.expressions if name[:2] not in ("Fv", "Fs")]) == 48 and len(found.kept) == 62


@pytest.mark.parametrize("seed", range(6))
def test_efforts_of_robots_with_loops_come_from_their_base_parameters(seed):
    """On closed states that the search for them has not seen; springs apart."""
    looped = random_loops(seed, elastic=False)
    robot, dynamics = looped.robot, Dynamics(looped.robot)
    found, rng = base_parameters(dynamics), np.random.default_rng(seed)
    q, qd = random_closed_state(robot, looped.q, looped.dependents, rng)
    independent = [robot.joint_numbers[name] for name in dynamics.joint_names]
    told = np.full(len(q), np.nan)
    told[independent] = rng.uniform(-3, 3, len(independent))
    base = Base(np.eye(4), *rng.uniform(-1, 1, (2, 6))) if robot.moving_base else None
    moving = {"twist": base.twist, "base_acceleration": base.acceleration} if base else {}
    expected = MaximalCoordinates(robot).inverse(q, qd, told, **moving).efforts[independent]
    Y = dynamics.regressor(q, qd[independent], told[independent], base=base)
    scale = max(1, np.abs(expected).max())
    assert np.abs((Y @ dynamics.parameters)[-len(expected) :] - expected).max() < 1e-8 * scale
    fewer = found.regressor(Y) @ found.values(dynamics.parameters)
    assert np.abs(fewer[-len(expected) :] - expected).max() < 1e-7 * scale
    motions = random_motions(dynamics, 60, seed=1)
    rows = dynamics.regressor(motions.q, motions.qd, motions.qdd, base=motions.base).reshape(-1, len(found.names))
    lengths = np.linalg.norm(rows, axis=0)
    rows = rows[:, lengths > 1e-10 * lengths.max()] / lengths[lengths > 1e-10 * lengths.max()]
    assert np.linalg.matrix_rank(rows, tol=1e-8) == len(found.kept)


def test_parameters_of_the_rocker_of_a_four_bar_join_those_of_crank_and_coupler():
    """The first moment along the rocker hangs, by the ratio of lengths, on crank and coupler: with the closure
    a e(φ₁) + b e(φ₂) = g + c e(φ₃), MX₃ e(φ₃) is MX₃/c times a e(φ₁) + b e(φ₂) less a constant."""
    linkage = random_four_bar(3)
    found = base_parameters(Dynamics(linkage.robot(linkage.independent), compiled=False))
    names = list(found.names)
    column = found.dependent.index(names.index("MX.rocker"))
    share = {names[kept]: found.K[row, column] for row, kept in enumerate(found.kept)}
    assert share["MX.crank"] == pytest.approx(linkage.crank / linkage.rocker, rel=1e-7)
    assert share["MX.coupler"] == pytest.approx(linkage.coupler / linkage.rocker, rel=1e-7)


def test_compiled_regressor_is_that_of_the_recursion():
    looped = random_loops(3, loops=1, kinds=("planar",), moving_base=True)
    dynamics = Dynamics(looped.robot, compiled=False)
    motions = random_motions(dynamics, 20)
    expected = dynamics.regressor(motions.q, motions.qd, motions.qdd, base=motions.base)
    R = np.swapaxes(motions.base.pose[:, :3, :3], 1, 2)
    gravity = R @ looped.robot.gravity
    program = dynamics.compile("regressor")
    found = program.batch(motions.q, motions.qd, motions.qdd, motions.base.twist, gravity, motions.base.acceleration)
    assert np.abs(found.reshape(expected.shape) - expected).max() < 1e-8 * np.abs(expected).max()
    assert np.abs(expected[:, 6:] @ parameters(looped.robot)).max() > 0
