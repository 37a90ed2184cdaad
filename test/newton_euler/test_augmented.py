"""Augmented bodies (Renaud), composite bodies and the regressor against the two-sweep inverse model."""

from dataclasses import replace

import numpy as np
import pytest
from peers.random_chains import random_chain, with_symbols
from peers.random_robots import random_urdf

from robot_dynamics import load_robot
from robot_dynamics.codegen.jit.python_functions import python_function
from robot_dynamics.codegen.trace.parameter_grouping import group_inertial_parameters
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.newton_euler import augmented, composite, inverse, regressor, walker_orin
from robot_dynamics.newton_euler.kinematics import run_forward_pass

AT_REST = np.array([0, 0, 9.81, 0, 0, 0])


def relative_error(forces_of_model, expected):
    return np.abs(forces_of_model - expected).max(initial=0) / max(np.abs(expected).max(initial=0), 1e-9)


def reference(robot, q, qd, qdd, twist, acceleration, wrenches):
    return inverse.inverse_dynamics(robot, run_forward_pass(robot, q, qd, twist, wrenches), qdd, acceleration)


@pytest.mark.parametrize("seed", range(100))
def test_augmented_bodies_on_random_chains_in_numbers_and_symbols(seed):
    robot = random_chain(seed)
    rng = np.random.default_rng(seed)
    q, qd, qdd, tip = rng.uniform(-2, 2, (4, 5, 6))
    expected, _ = reference(robot, q, qd, qdd, np.zeros(6), AT_REST, {6: tip})
    forces_of_model, _ = augmented.inverse_dynamics(robot, q, qd, qdd, np.zeros(6), AT_REST, {6: tip})
    assert relative_error(forces_of_model, expected) < 1e-12

    trace = Trace()
    symbolic, values = with_symbols(robot, trace)
    arguments = [trace.input(name, 6) for name in ("q", "qd", "qdd", "tip")]
    forces, _ = augmented.inverse_dynamics(symbolic, *arguments[:3], np.zeros(6), AT_REST, {6: arguments[3]})
    program = build_program(trace, "inverse", dict.fromkeys(("q", "qd", "qdd", "tip"), 6), {"efforts": forces})
    computed = python_function(program, {name: values[name] for name in program.parameters})
    traced = np.array([computed(*sample) for sample in zip(q, qd, qdd, tip, strict=True)])
    assert relative_error(traced, expected) < 1e-12


@pytest.mark.parametrize("moving_base", [False, True], ids=["fixed", "moving"])
@pytest.mark.parametrize("seed", range(40))
def test_augmented_bodies_of_trees_moving_bases_and_grouped_parameters(seed, moving_base):
    """Forces and the wrench on the base, A, and Y θ, with wrenches on the tip and on the base."""
    robot = read_urdf(random_urdf(seed), moving_base=moving_base)
    rng = np.random.default_rng(seed)
    count = len(robot.joints)
    drives = [replace(joint, rotor_inertia=float(rng.uniform(0, 1))) for joint in robot.joints]
    robot = replace(robot, joints=tuple(drives))
    q, qd, qdd = rng.uniform(-2, 2, (3, 4, count))
    twist, acceleration, tip, ground = rng.uniform(-2, 2, (4, 4, 6))
    if not moving_base:  # parameters grouped into the link of a first joint would act on a rotating base
        twist, acceleration = np.zeros((4, 6)), np.tile(AT_REST, (4, 1))
    motion = (q, qd, qdd, twist, acceleration)
    wrenches = {count: tip, 0: ground}
    expected, reactions = reference(robot, *motion, wrenches)
    A = walker_orin.inertia_matrix(robot, q)
    for same in (robot, group_inertial_parameters(robot)):
        forces, base = augmented.inverse_dynamics(same, *motion, wrenches)
        assert relative_error(forces, expected) < 1e-11
        if moving_base or same is robot:  # grouping changes the wrench on the ground
            assert relative_error(base, reactions[:, 0]) < 1e-11
        assert relative_error(composite.inertia_matrix(same, q), A) < 1e-11
    free, reactions = reference(robot, *motion, {})
    rows = np.concatenate([reactions[:, 0], free], axis=-1) if moving_base else free
    Y = regressor.regressor(robot, *motion)
    assert Y.shape == (4, rows.shape[-1], len(regressor.parameter_names(robot)))
    assert relative_error(Y @ regressor.parameters(robot), rows) < 1e-12


def test_regressor_of_the_rx90_has_the_published_rank():
    """40 base inertial parameters, rotors counted and gravity along the first axis."""
    robot = load_robot("rx90")
    motion = np.random.default_rng(0).uniform(-3, 3, (3, 200, 6))
    Y = regressor.regressor(robot, *motion, np.zeros(6), AT_REST)
    inertial = [k for k, name in enumerate(regressor.parameter_names(robot)) if name[:2] not in ("Fv", "Fs")]
    assert np.linalg.matrix_rank(Y[..., inertial].reshape(-1, len(inertial)), tol=1e-8) == 40
