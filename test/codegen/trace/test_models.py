"""The traced models agree with the recursions to 1e-12 on shipped, real and random robots: with fixed and moving base,
prescribed and free; elastic, passive and mimic joints; external wrenches."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from peers.frictions import with_random_friction
from peers.random_robots import digits_left, random_states, random_urdf
from peers.real_robots import real_urdf
from peers.traced_models import shipped_program, shipped_robot

from robot_dynamics import Base, Dynamics, Spring, load_robot, shipped_robots
from robot_dynamics.codegen.jit.compiled_models import MODELS
from robot_dynamics.codegen.jit.python_functions import python_function
from robot_dynamics.codegen.trace import models
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.newton_euler import regressor
from robot_dynamics.newton_euler.friction import has_load_friction


def error(actual, expected):
    actual, expected = np.asarray(actual), np.asarray(expected)
    return np.abs(actual - expected).max(initial=0) / max(np.abs(expected).max(initial=0), 1e-6)


def with_drives(robot, seed):
    """The robot with rotor inertias and friction and, for odd seeds, some elastic or passive joints."""
    rng = np.random.default_rng(seed)
    joints = []
    for joint in robot.joints:
        unactuated = seed % 2 and joint.mimic is None and rng.random() < 0.3
        spring = Spring(*rng.uniform(1, 50, 3)) if rng.random() < 0.5 else None
        rotor, viscous, coulomb = rng.uniform(0.1, 1, 3)
        joints.append(
            replace(
                joint,
                rotor_inertia=rotor,
                viscous_friction=viscous,
                coulomb_friction=coulomb,
                actuated=not unactuated,
                spring=spring,
            )
        )
    return replace(robot, joints=tuple(joints))


def with_all_friction(robot, seed):
    """The robot of `with_drives` with friction of all kinds."""
    return with_random_friction(with_drives(robot, seed), seed)


def base_arguments(robot, base):
    """Twist and gravity in the base frame, arguments of the programs of a moving base."""
    if base is None:
        return ()
    return base.twist, np.asarray(base.pose)[:3, :3].T @ robot.gravity


def trace_model(robot, model, **options):
    return MODELS[model](robot, **options)


def check(robot, seed, samples=3, tolerance=1e-12, trace=None):
    """Compare the programs with the recursions; `trace(model, **options)` returns the program of a model."""
    trace = trace or partial(trace_model, robot)
    dynamics = Dynamics(robot, compiled=False)
    count = len(dynamics.joint_names)
    states = random_states(robot, count, samples, seed)
    qdd = states.qdd.copy()
    qdd[:, [dynamics.joint_names.index(name) for name in dynamics.unactuated_joint_names]] = 0
    prescribed_options = [False, True] if robot.moving_base else [False]
    # test_generated_code has the programs of parallel robots without wrenches, which take seconds
    for wrenched in (False, True) if not robot.platforms else (True,):
        names = tuple(states.wrenches) if wrenched else ()
        for is_prescribed in prescribed_options:
            options = {"wrenches": names} if names else {}
            options |= {"prescribed_base": True} if is_prescribed else {}
            inverse, direct = (python_function(trace(model, **options)) for model in ("inverse", "direct"))
            for k in range(samples):
                base = None
                extra = ()
                if robot.moving_base:
                    acceleration = np.random.default_rng(k).uniform(-2, 2, 6) if is_prescribed else None
                    base = Base(states.base.pose[k], states.base.twist[k], acceleration)
                    extra = (*base_arguments(robot, base), *([acceleration] if is_prescribed else []))
                wrenches = {name: states.wrenches[name][k] for name in names}
                arguments = (*extra, *wrenches.values())
                q, qd = states.q[k], states.qd[k]
                expected = dynamics.solve(q, qd, qdd=qdd[k], base=base, external_wrenches=wrenches)
                results = as_list(inverse(q, qd, qdd[k], *arguments))
                condition = max(1, np.linalg.cond(dynamics.inertia_matrix(q)) / 1e4)
                solved = bool(dynamics.unactuated_joint_names) or (robot.moving_base and not is_prescribed)
                assert error(results.pop(0), expected.efforts) < tolerance * (condition if solved else 1)
                if dynamics.unactuated_joint_names:
                    assert error(results.pop(0), expected.accelerations) < tolerance * condition
                if robot.moving_base and not is_prescribed:
                    assert error(results.pop(0), expected.base_acceleration) < tolerance * condition
                assert not results
                expected_direct = dynamics.solve(q, qd, efforts=expected.efforts, base=base, external_wrenches=wrenches)
                results = as_list(direct(q, qd, expected.efforts, *arguments))
                rounding = digits_left(dynamics.inertia_matrix(q), expected.efforts, expected_direct.accelerations)
                assert error(results[0], expected_direct.accelerations) < max(tolerance * condition, rounding)
                if robot.moving_base and not is_prescribed:
                    assert error(results[1], expected_direct.base_acceleration) < tolerance * condition
    check_terms(robot, trace, dynamics, states, samples, tolerance)


def check_friction(robot, seed, tolerance=1e-12):
    """Compare the programs of friction and of the regressor with the recursions."""
    dynamics = Dynamics(robot, compiled=False)
    states = random_states(robot, len(dynamics.joint_names), 3, seed)
    friction, regressor = (python_function(trace_model(robot, model)) for model in ("friction", "regressor"))
    for k in range(3):
        motion, acceleration, arguments = (states.q[k], states.qd[k]), None, ()
        base = base_in_motion = None
        if robot.moving_base:
            acceleration = np.random.default_rng(k).uniform(-2, 2, 6)
            base = Base(states.base.pose[k], states.base.twist[k])
            base_in_motion = replace(base, acceleration=acceleration)
            arguments = base_arguments(robot, base)
        expected = dynamics.friction(states.qd[k], states.q[k], base=base)
        results = friction(*motion, *(arguments if has_load_friction(robot) else ()))
        assert error(results, expected) < tolerance
        Y = dynamics.regressor(*motion, states.qdd[k], base=base_in_motion)
        results = regressor(*motion, states.qdd[k], *arguments, *([acceleration] if robot.moving_base else []))
        assert error(np.reshape(results, Y.shape), Y) < tolerance


def as_list(results):
    """The results of a program, one array or several, as a list."""
    return [np.array(results)] if isinstance(results[0], float) else [np.array(result) for result in results]


def check_terms(robot, trace, dynamics, states, samples, tolerance):
    A, gravity, coriolis = (python_function(trace(model)) for model in ("inertia_matrix", "gravity", "coriolis"))
    frame = robot.frames[-1].name
    pose = python_function(models.pose_model(robot, frame))
    for k in range(samples):
        q, qd = states.q[k], states.qd[k]
        base = Base(states.base.pose[k], states.base.twist[k]) if robot.moving_base else None
        base_twist, base_gravity = ([argument] for argument in base_arguments(robot, base)) if base else ([], [])
        expected = dynamics.inertia_matrix(q)
        assert error(np.array(A(q)).reshape(expected.shape), expected) < tolerance
        assert error(gravity(q, *base_gravity), dynamics.gravity(q, base=base)) < tolerance
        assert error(coriolis(q, qd, *base_twist), dynamics.coriolis(q, qd, base=base)) < tolerance
        expected = dynamics.link_pose(frame, q, base=Base() if robot.moving_base else None)
        assert error(np.array(pose(q)).reshape(4, 4), expected) < tolerance


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped_robots())
def test_models_of_shipped_robots_agree_with_the_recursions(name):
    check(shipped_robot(name), seed=2, trace=partial(shipped_program, name))


@pytest.mark.slow
@pytest.mark.parametrize("moving_base", [False, True], ids=["fixed", "moving"])
@pytest.mark.parametrize("name", ["panda", "baxter", "hyq", "z1"])
def test_models_of_real_robots_agree_with_the_recursions(name, moving_base):
    check(with_drives(read_urdf(real_urdf(name), moving_base=moving_base), 2), seed=3, samples=2, tolerance=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(30))
def test_models_of_random_trees_with_elastic_and_passive_joints_agree_with_the_recursions(seed):
    robot = read_urdf(random_urdf(seed, joints=1 + seed % 8), moving_base=bool(seed % 3 == 0))
    check(with_drives(robot, seed), seed, tolerance=1e-11)


@pytest.mark.parametrize("moving_base", [False, True], ids=["fixed", "moving"])
def test_regressor_times_parameters_is_the_inverse_model(moving_base):
    robot = with_drives(read_urdf(random_urdf(5, joints=6), moving_base=moving_base), 2)
    robot = replace(robot, joints=tuple(replace(joint, spring=None) for joint in robot.joints))
    computed = python_function(models.regressor_model(robot))
    states = random_states(robot, 6, 3, 1)
    dynamics = Dynamics(robot, compiled=False)
    for k in range(3):
        acceleration = np.random.default_rng(k).uniform(-2, 2, 6)
        base = Base(states.base.pose[k], states.base.twist[k], acceleration) if moving_base else None
        arguments = (*base_arguments(robot, base), acceleration) if moving_base else ()
        Y = np.array(computed(states.q[k], states.qd[k], states.qdd[k], *arguments))
        theta = regressor.parameters(robot)
        rows = Y.reshape(-1, len(theta)) @ theta
        expected = dynamics.solve(states.q[k], states.qd[k], qdd=states.qdd[k], base=base)
        assert error(rows[-6:], expected.efforts) < 1e-12
        if moving_base:
            assert error(rows[:6], expected.reactions[0]) < 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_models_of_random_trees_with_all_friction_agree_with_the_recursions(seed):
    robot = with_all_friction(read_urdf(random_urdf(seed), moving_base=seed >= 2), seed)
    check(robot, seed)
    check_friction(robot, seed)


@pytest.mark.parametrize("name", ["ur5e", "free_flying_arm", "four_bar", "manutec_r3"])
def test_models_of_shipped_robots_with_all_friction_agree_with_the_recursions(name):
    robot = with_random_friction(load_robot(name), 5)
    assert has_load_friction(robot) or name == "four_bar"
    check(robot, 5)
    check_friction(robot, 5)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sr400", "irb460", "delta_wrist"])
def test_models_of_shipped_loops_with_load_friction_outside_agree_with_the_recursions(name):
    robot = with_random_friction(load_robot(name), 5)
    assert has_load_friction(robot)
    check(robot, 5, tolerance=1e-11)
    check_friction(robot, 5, tolerance=1e-11)


def test_grouped_parameters_make_programs_smaller():
    robot = load_robot("panda")
    small, large = (
        models.direct_model(robot, group_parameters=group_parameters).operations for group_parameters in (True, False)
    )
    assert small.multiplications < large.multiplications and small.additions < large.additions
