"""Friction of all kinds in all models: against its definition at the loads of the robot without friction, inverse and
direct models against each other, terms, regressor, programs, generated C, flexible links."""

import ctypes
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from peers.frictions import all_friction, with_random_friction, without_friction
from peers.random_robots import random_states
from peers.real_robots import real_urdf

from robot_dynamics import Base, DescriptionError, Dynamics, InvalidInputError, Spring, load_robot
from robot_dynamics.codegen.emit.c_code import c_source
from robot_dynamics.codegen.trace import models
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.joint import Mimic

SAMPLES = 5
ROBOTS = ["ur5e", "manutec_r3", "sr400", "irb460", "four_bar", "free_flying_arm"]
CHANGES = {
    "Fva": ("viscous_asymmetry", 0.05),
    "Fsa": ("coulomb_asymmetry", 0.05),
    "Fst": ("stribeck_friction", 0.05),
    "mu": ("load_friction", 0.01),
}


def described(name):
    return read_urdf(real_urdf("hyq"), moving_base=True) if name == "hyq" else load_robot(name)


@pytest.fixture(scope="module", params=[*ROBOTS, "hyq"])
def pair(request):
    """Dynamics of a robot with friction of all kinds, and of the same one without friction."""
    robot = with_random_friction(described(request.param), 7)
    return Dynamics(robot, compiled=False), Dynamics(without_friction(robot), compiled=False)


def states_of(dynamics, seed=2):
    states = random_states(dynamics.robot, len(dynamics.joint_names), SAMPLES, seed)
    is_actuated = ~np.isin(dynamics.joint_names, dynamics.unactuated_joint_names)
    return states, states.qdd * is_actuated


def test_inverse_adds_friction_to_the_loads(pair):
    """Joints with load friction are independent of all others: their loads are the efforts without friction."""
    dynamics, frictionless = pair
    states, qdd = states_of(dynamics)
    arguments = {"base": states.base, "external_wrenches": states.wrenches}
    result = dynamics.solve(states.q, states.qd, qdd=qdd, **arguments)
    if dynamics.unactuated_joint_names:  # with friction these joints accelerate differently
        robot = replace(frictionless.robot, joints=tuple(with_motor(joint) for joint in frictionless.robot.joints))
        frictionless = Dynamics(robot, compiled=False)
        qdd = result.accelerations
    loads = np.zeros((SAMPLES, len(dynamics.robot.joints)))
    efforts = frictionless.inverse(states.q, states.qd, qdd, **arguments)
    numbers = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    loads[:, numbers] = efforts
    friction = all_friction(dynamics.robot, result.motion.velocities, loads)
    expected = efforts + dynamics.project_efforts(friction, states.q) + dynamics.elasticity(states.q, states.qd)
    expected[:, np.isin(dynamics.joint_names, dynamics.unactuated_joint_names)] = 0
    np.testing.assert_allclose(result.efforts, expected, rtol=1e-9, atol=1e-8 * np.abs(expected).max())
    assert np.abs(friction).max() > 0.1


def with_motor(joint):
    return replace(joint, spring=None, actuated=True) if joint.role == "elastic" else joint


def test_direct_returns_the_accelerations_of_the_inverse_model(pair):
    dynamics, _ = pair
    states, qdd = states_of(dynamics)
    arguments = {"base": states.base, "external_wrenches": states.wrenches}
    motion = dynamics.solve(states.q, states.qd, qdd=qdd, **arguments)
    back = dynamics.solve(states.q, states.qd, efforts=motion.efforts, **arguments)
    scale = np.abs(motion.accelerations).max()
    np.testing.assert_allclose(back.accelerations, motion.accelerations, atol=1e-8 * scale)
    np.testing.assert_allclose(back.reactions, motion.reactions, atol=1e-7 * np.abs(motion.reactions).max())


def test_friction_term_is_that_at_zero_acceleration(pair):
    dynamics, frictionless = pair
    states, _ = states_of(dynamics)
    q, qd, base = states.q, states.qd, states.base
    loads = np.zeros((SAMPLES, len(dynamics.robot.joints)))
    numbers = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    terms = frictionless.coriolis(q, qd, base=base) + frictionless.gravity(q, base=base)
    loads[:, numbers] = terms[:, -len(numbers) :]
    velocities = dynamics.expand_velocities(qd, q)
    expected = dynamics.project_efforts(all_friction(dynamics.robot, velocities, loads), q)
    actual = dynamics.friction(qd, q, base=base)
    np.testing.assert_allclose(actual, expected, atol=1e-9 * np.abs(expected).max())


def test_regressor_times_parameters_is_the_inverse_model(pair):
    dynamics, _ = pair
    joints = [replace(joint, spring=None, actuated=joint.role != "passive") for joint in dynamics.robot.joints]
    dynamics = Dynamics(replace(dynamics.robot, joints=tuple(joints)), compiled=False)
    states, qdd = states_of(dynamics)
    base = None
    if dynamics.robot.moving_base:
        base = replace(states.base, acceleration=np.random.default_rng(1).uniform(-2, 2, (SAMPLES, 6)))
    efforts = dynamics.inverse(states.q, states.qd, qdd, base=base)
    Y = dynamics.regressor(states.q, states.qd, qdd, base=base)
    rows = (Y @ dynamics.parameters)[:, -efforts.shape[-1] :]
    np.testing.assert_allclose(rows, efforts, atol=1e-9 * np.abs(efforts).max())


@pytest.mark.parametrize("parameter", CHANGES)
def test_columns_of_the_regressor_are_differences_of_the_inverse_model(parameter):
    robot = with_random_friction(load_robot("ur5e"), 9)
    dynamics = Dynamics(robot, compiled=False)
    states, qdd = states_of(dynamics)
    Y = dynamics.regressor(states.q, states.qd, qdd)
    field, change = CHANGES[parameter]
    for number, joint in enumerate(robot.joints):
        change *= 1 if field == "load_friction" or getattr(joint, field) < 0 else -1
        joints = list(robot.joints)
        joints[number] = replace(joint, **{field: getattr(joint, field) + change})
        other = Dynamics(replace(robot, joints=tuple(joints)), compiled=False)
        inverse = [model.inverse(states.q, states.qd, qdd) for model in (dynamics, other)]
        column = Y[..., dynamics.parameter_names.index(f"{parameter}.{joint.name}")]
        np.testing.assert_allclose((inverse[1] - inverse[0]) / change, column, atol=1e-9)
        assert np.abs(column).max() > 1e-4
        change = abs(change)


def test_parameters_follow_those_of_links_and_only_where_joints_have_them():
    plain = Dynamics(load_robot("ur5e"), compiled=False)
    robot = with_random_friction(plain.robot, 1, joints=[3])
    names = Dynamics(robot, compiled=False).parameter_names
    first, name = len(plain.parameter_names), robot.joints[3].name
    assert names[:first] == plain.parameter_names
    assert names[first:] == tuple(f"{key}.{name}" for key in ("Fva", "Fsa", "Fst", "mu"))


def test_compiled_models_agree_with_the_recursions():
    robot = with_random_friction(load_robot("ur5e"), 4)
    dynamics = Dynamics(robot, compiled=False)
    states, qdd = states_of(dynamics)
    q, qd = states.q, states.qd
    efforts = dynamics.inverse(q, qd, qdd)
    expected = {
        "inverse": ((q, qd, qdd), efforts),
        "direct": ((q, qd, efforts), qdd),
        "friction": ((q, qd), dynamics.friction(qd, q)),
        "regressor": ((q, qd, qdd), dynamics.regressor(q, qd, qdd)),
    }
    for model, (arguments, values) in expected.items():
        np.testing.assert_allclose(dynamics.compile(model).batch(*arguments), values, rtol=1e-9, atol=1e-9)


@pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler is here")
@pytest.mark.parametrize("model", ["inverse", "direct", "friction"])
def test_generated_c_agrees_with_the_recursions(tmp_path, model):
    robot = with_random_friction(load_robot("ur5e"), 4)
    dynamics = Dynamics(robot, compiled=False)
    states, qdd = states_of(dynamics)
    efforts = dynamics.inverse(states.q, states.qd, qdd)
    header, source = c_source(getattr(models, f"{model}_model")(robot), joint_names=dynamics.joint_names)
    (tmp_path / f"{model}.h").write_text(header)
    (tmp_path / f"{model}.c").write_text(source)
    library = tmp_path / f"{model}.so"
    command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-fPIC", "-shared", f"{model}.c", "-o", str(library)]
    subprocess.run([*command, "-lm"], cwd=tmp_path, check=True, timeout=100)
    function = getattr(ctypes.CDLL(str(library)), model)
    pointer = ctypes.POINTER(ctypes.c_double)
    for k in range(SAMPLES):
        last, expected = {
            "inverse": ([qdd[k]], efforts[k]),
            "direct": ([efforts[k]], qdd[k]),
            "friction": ([], dynamics.friction(states.qd[k], states.q[k])),
        }[model]
        arrays = [np.ascontiguousarray(array) for array in (states.q[k], states.qd[k], *last, np.zeros(6))]
        function(*(array.ctypes.data_as(pointer) for array in arrays))
        np.testing.assert_allclose(arrays[-1], expected, rtol=1e-9, atol=1e-9)


def test_direct_model_of_flexible_links_returns_the_accelerations_of_the_inverse_model():
    text = """
robot: bending
materials:
  alloy: {youngs_modulus: 70e9, poissons_ratio: 0.33, density: 2700}
sections:
  bar: {circle: {diameter: 0.03}}
joints:
  - joint: shoulder
    link: arm
    mdh: {alpha: pi/2}
    viscous_friction: 0.4
    viscous_asymmetry: -0.2
    coulomb_friction: 0.5
    stribeck_friction: 0.3
    stribeck_velocity: 0.2
    load_friction: 0.2
    beams: [{to: [1, 0, 0], section: bar, material: alloy, elements: 2}]
"""
    dynamics = Dynamics(load_robot(text))
    arm, rigid = dynamics.flexible_arm, Dynamics(without_friction(dynamics.robot)).flexible_arm
    e, ed = 1e-3 * np.random.default_rng(3).uniform(-1, 1, (2, len(arm.elastic_coordinate_names)))
    for velocity in (0.7, -0.7):
        result = arm.inverse([0.3], [velocity], [1.5], e, ed)
        load = rigid.inverse([0.3], [velocity], [1.5], e, ed).efforts
        expected = load + all_friction(dynamics.robot, np.array([velocity]), load)
        np.testing.assert_allclose(result.efforts, expected, rtol=1e-12)
        back = arm.direct([0.3], [velocity], result.efforts, e, ed)
        np.testing.assert_allclose(back.accelerations, [1.5], rtol=1e-9)
        np.testing.assert_allclose(back.elastic_accelerations, result.elastic_accelerations, rtol=1e-7)


def test_friction_under_load_needs_positions_and_the_base():
    arm = Dynamics(with_random_friction(load_robot("ur5e"), 1))
    with pytest.raises(InvalidInputError, match="give q"):
        arm.friction(np.ones(6))
    flying = Dynamics(with_random_friction(load_robot("free_flying_arm"), 1))
    with pytest.raises(InvalidInputError, match="base"):
        flying.friction(np.ones(6), np.zeros(6))
    with pytest.raises(InvalidInputError, match="acceleration of the base"):
        flying.friction(np.ones(6), np.zeros(6), base=Base(acceleration=np.zeros(6)))
    plain = Dynamics(load_robot("ur5e"))
    with pytest.raises(InvalidInputError, match="fixed"):
        plain.friction(np.ones(6), base=Base())


REFUSED = {
    "viscous asymmetry": ({"viscous_friction": 1.0, "viscous_asymmetry": -1.1}, "viscous_asymmetry -1.1 is larger"),
    "Coulomb asymmetry": ({"coulomb_friction": 1.0, "coulomb_asymmetry": 1.1}, "coulomb_asymmetry 1.1 is larger"),
    "asymmetry at rest": (
        {"coulomb_friction": 1.0, "coulomb_asymmetry": 0.6, "stribeck_friction": -0.5, "stribeck_velocity": 0.1},
        "coulomb_asymmetry 0.6 is larger than the dry friction 0.5",
    ),
    "negative at rest": (
        {"coulomb_friction": 1.0, "stribeck_friction": -1.5, "stribeck_velocity": 0.1},
        "have a negative sum",
    ),
    "no Stribeck velocity": ({"stribeck_friction": 0.5}, "stribeck_velocity 0 is not above zero"),
    "negative Stribeck velocity": ({"stribeck_velocity": -0.5}, "stribeck_velocity -0.5 is not above zero"),
    "not finite": ({"stribeck_velocity": np.nan}, "stribeck_velocity is not finite"),
    "negative load friction": ({"load_friction": -0.1}, "load_friction -0.1 is negative"),
    "all of the load": ({"load_friction": 1.0}, "load_friction 1 is not below 1"),
    "load of a spring": ({"load_friction": 0.1, "spring": Spring(10.0)}, "it has a spring"),
    "elastic": ({"load_friction": 0.1, "actuated": False, "spring": Spring(10.0)}, "it is elastic"),
    "passive": ({"load_friction": 0.1, "actuated": False}, "it is passive"),
    "mimic": ({"load_friction": 0.1, "mimic": Mimic("shoulder_pan_joint")}, "it is mimic"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_friction_that_no_joint_has_is_refused(case):
    robot = load_robot("ur5e")
    changes, reason = REFUSED[case]
    changes = {"viscous_friction": 0.0, "coulomb_friction": 0.0} | changes
    joints = [*robot.joints[:2], replace(robot.joints[2], **changes), *robot.joints[3:]]
    with pytest.raises(DescriptionError, match=reason) as refusal:
        replace(robot, joints=tuple(joints))
    assert robot.joints[2].name in str(refusal.value)


def test_load_friction_of_joints_that_share_their_load_is_refused():
    robot = load_robot("four_bar")
    joints = (replace(robot.joints[0], load_friction=0.1), *robot.joints[1:])
    with pytest.raises(DescriptionError, match="no load of its own: it is in a loop"):
        replace(robot, joints=joints)
    robot = load_robot("ur5e")
    follower = replace(robot.joints[3], mimic=Mimic(robot.joints[1].name))
    joints = list(robot.joints)
    joints[1] = replace(joints[1], load_friction=0.1)
    joints[3] = follower
    with pytest.raises(DescriptionError, match=r"mimic joints \(wrist_1_joint\)"):
        replace(robot, joints=tuple(joints))
