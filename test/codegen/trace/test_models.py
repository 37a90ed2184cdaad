"""The traced models give what the recursions give, to 1e-12, on robots that ship, real ones and random ones: fixed and
moving base, told and free, elastic, passive and mimic joints, wrenches."""

from dataclasses import replace

import numpy as np
import pytest
from peers.random_robots import digits_left, random_states, random_urdf
from peers.real_robots import real_urdf

from robot_dynamics import Base, Dynamics, Spring, load_robot, shipped_robots
from robot_dynamics.codegen.jit.python_functions import python_function
from robot_dynamics.codegen.trace import models
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.newton_euler import regressor


def error(found, expected):
    found, expected = np.asarray(found), np.asarray(expected)
    return np.abs(found - expected).max(initial=0) / max(np.abs(expected).max(initial=0), 1e-6)


def drives(robot, seed):
    """The robot with rotors and frictions, and where seed is odd some joints elastic or passive."""
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


def in_base(robot, base):
    """twist and gravity in the base frame, as the programs of a moving base take them."""
    if base is None:
        return ()
    return base.twist, np.asarray(base.pose)[:3, :3].T @ robot.gravity


def check(robot, seed, samples=3, tolerance=1e-12):
    dynamics = Dynamics(robot)
    count = len(dynamics.joint_names)
    states = random_states(robot, count, samples, seed)
    qdd = states.qdd.copy()
    qdd[:, [dynamics.joint_names.index(name) for name in dynamics.unactuated_joint_names]] = 0
    prescribed_base = [False, True] if robot.moving_base else [False]
    # without wrenches those of parallel robots, which take seconds, are in test_generated_code
    for wrenched in (False, True) if not robot.platforms else (True,):
        names = list(states.wrenches) if wrenched else []
        for is_told in prescribed_base:
            inverse, direct = (
                python_function(model(robot, wrenches=names, prescribed_base=is_told))
                for model in (models.inverse_model, models.direct_model)
            )
            for k in range(samples):
                base, extra = None, ()
                if robot.moving_base:
                    acceleration = np.random.default_rng(k).uniform(-2, 2, 6) if is_told else None
                    base = Base(states.base.pose[k], states.base.twist[k], acceleration)
                    extra = (*in_base(robot, base), *([acceleration] if is_told else []))
                wrenches = {name: states.wrenches[name][k] for name in names}
                arguments = (*extra, *wrenches.values())
                q, qd = states.q[k], states.qd[k]
                expected = dynamics.solve(q, qd, qdd=qdd[k], base=base, external_wrenches=wrenches)
                results = as_list(inverse(q, qd, qdd[k], *arguments))
                condition = max(1, np.linalg.cond(dynamics.inertia_matrix(q)) / 1e4)
                solved = bool(dynamics.unactuated_joint_names) or (robot.moving_base and not is_told)
                assert error(results.pop(0), expected.efforts) < tolerance * (condition if solved else 1)
                if dynamics.unactuated_joint_names:
                    assert error(results.pop(0), expected.accelerations) < tolerance * condition
                if robot.moving_base and not is_told:
                    assert error(results.pop(0), expected.base_acceleration) < tolerance * condition
                assert not results
                pushed = dynamics.solve(q, qd, efforts=expected.efforts, base=base, external_wrenches=wrenches)
                results = as_list(direct(q, qd, expected.efforts, *arguments))
                lost = digits_left(dynamics.inertia_matrix(q), expected.efforts, pushed.accelerations)
                assert error(results[0], pushed.accelerations) < max(tolerance * condition, lost)
                if robot.moving_base and not is_told:
                    assert error(results[1], pushed.base_acceleration) < tolerance * condition
    check_terms(robot, dynamics, states, samples, tolerance)


def as_list(results):
    """The results of a program, one array or several."""
    return [np.array(results)] if isinstance(results[0], float) else [np.array(result) for result in results]


def check_terms(robot, dynamics, states, samples, tolerance):
    A, gravity, coriolis = (
        python_function(model(robot))
        for model in (models.inertia_matrix_model, models.gravity_model, models.coriolis_model)
    )
    frame = robot.frames[-1].name
    pose = python_function(models.pose_model(robot, frame))
    for k in range(samples):
        q, qd = states.q[k], states.qd[k]
        base = Base(states.base.pose[k], states.base.twist[k]) if robot.moving_base else None
        twist, down = in_base(robot, base) or ((), ())
        moving = ([twist], [down]) if robot.moving_base else ([], [])
        expected = dynamics.inertia_matrix(q)
        assert error(np.array(A(q)).reshape(expected.shape), expected) < tolerance
        assert error(gravity(q, *moving[1]), dynamics.gravity(q, base=base)) < tolerance
        assert error(coriolis(q, qd, *moving[0]), dynamics.coriolis(q, qd, base=base)) < tolerance
        expected = dynamics.link_pose(frame, q, base=Base() if robot.moving_base else None)
        assert error(np.array(pose(q)).reshape(4, 4), expected) < tolerance


@pytest.mark.parametrize("name", shipped_robots())
def test_models_of_robots_that_ship(name):
    check(load_robot(name), seed=2)


@pytest.mark.parametrize("moving_base", [False, True], ids=["fixed", "moving"])
@pytest.mark.parametrize("name", ["panda", "baxter", "hyq", "z1"])
def test_models_of_real_robots(name, moving_base):
    check(drives(read_urdf(real_urdf(name), moving_base=moving_base), 2), seed=3, samples=2, tolerance=1e-11)


@pytest.mark.parametrize("seed", range(30))
def test_models_of_random_trees_with_elastic_and_passive_joints(seed):
    robot = read_urdf(random_urdf(seed, joints=1 + seed % 8), moving_base=bool(seed % 3 == 0))
    check(drives(robot, seed), seed, tolerance=1e-11)


@pytest.mark.parametrize("moving_base", [False, True], ids=["fixed", "moving"])
def test_regressor_times_parameters_is_the_inverse_model(moving_base):
    robot = drives(read_urdf(random_urdf(5, joints=6), moving_base=moving_base), 2)
    robot = replace(robot, joints=tuple(replace(joint, spring=None) for joint in robot.joints))
    computed = python_function(models.regressor_model(robot))
    states = random_states(robot, 6, 3, 1)
    dynamics = Dynamics(robot)
    for k in range(3):
        prescribed_base = np.random.default_rng(k).uniform(-2, 2, 6)
        base = Base(states.base.pose[k], states.base.twist[k], prescribed_base) if moving_base else None
        arguments = (*in_base(robot, base), prescribed_base) if moving_base else ()
        Y = np.array(computed(states.q[k], states.qd[k], states.qdd[k], *arguments))
        theta = regressor.parameters(robot)
        rows = Y.reshape(-1, len(theta)) @ theta
        expected = dynamics.solve(states.q[k], states.qd[k], qdd=states.qdd[k], base=base)
        assert error(rows[-6:], expected.efforts) < 1e-12
        if moving_base:
            assert error(rows[:6], expected.reactions[0]) < 1e-12


def test_gathering_makes_programs_smaller_and_leaves_their_results():
    robot = load_robot("panda")
    small, large = (
        models.inverse_model(robot, group_parameters=group_parameters).operations for group_parameters in (True, False)
    )
    assert small.multiplications < large.multiplications and small.additions < large.additions
