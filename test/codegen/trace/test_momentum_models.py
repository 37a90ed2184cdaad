"""The program of the momentum agrees with Pinocchio on trees, and on all robots its derivative along a motion, by
complex steps, is the rate that it states for the efforts of the inverse model, which knows no momentum.

RANDOM_MOMENTA sets the number of random robots of each kind.
"""

import os
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from peers.complex_programs import directional_derivatives, evaluate
from peers.derivative_cases import random_state
from peers.frictions import with_random_friction
from peers.large_robots import LARGE_ROBOTS
from peers.pinocchio_model import PinocchioModel
from peers.random_loops import random_loops
from peers.random_platforms import random_platform
from peers.random_robots import random_states, random_urdf
from peers.real_robots import real_urdf
from peers.traced_models import shipped_robot

from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.codegen.jit.compiled_models import MODELS
from robot_dynamics.model.formats.urdf.reader import read_urdf

ROBOTS = int(os.environ.get("RANDOM_MOMENTA", "1"))
SLOW_ROBOTS = {"gough_stewart", "hexapod_stack", "orthoglide", "delta_wrist", "navaro"}
TOLERANCE = 1e-10


def along_motion(robot, state):
    """(momentum's derivative along the motion that the inverse model computes efforts for, rate of the program)."""
    dynamics = Dynamics(robot, compiled=False)
    inverse = MODELS["inverse"](robot)
    motion = {name: values[0] for name, values in evaluate(inverse, _rows(inverse, state)).items()}
    state = {**state, "efforts": motion["efforts"]}
    moved = {
        "q": dynamics.expand_velocities(state["qd"], state["q"]) if robot.loops else state["qd"],
        "qd": motion.get("accelerations", state["qdd"]),
    }
    if robot.moving_base:
        twist = state["twist"]
        moved["twist"] = motion["base_acceleration"] - np.r_[np.cross(twist[3:], twist[:3]), np.zeros(3)]
    program = MODELS["momentum"](robot)
    directions = {name: values[:, None] for name, values in moved.items()}
    derivative = directional_derivatives(program, {name: state[name] for name in program.inputs}, directions)
    return derivative["momentum"][:, 0], evaluate(program, _rows(program, state))["momentum_rate"][0]


def _rows(program, state):
    return {name: np.asarray(state[name])[None] for name in program.inputs}


def require_equal(actual, expected):
    assert actual.shape == expected.shape and np.isfinite(actual).all()
    assert np.abs(actual - expected).max() <= TOLERANCE * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW_ROBOTS))
        for name in shipped_robots()
        if name not in LARGE_ROBOTS or "EVERY_ROBOT" in os.environ
    ],
)
def test_shipped_robots(name):
    robot = shipped_robot(name)
    require_equal(*along_motion(robot, random_state(robot)))


@pytest.mark.parametrize("moving_base", [False, True])
@pytest.mark.parametrize("seed", range(ROBOTS))
def test_random_loops_with_springs_and_mimic_joints(seed, moving_base):
    looped = random_loops(seed, loops=1 + seed % 3, moving_base=moving_base)
    require_equal(*along_motion(looped.robot, random_state(looped.robot, seed, looped.q)))


@pytest.mark.parametrize("seed", range(ROBOTS))
def test_random_platforms(seed):
    robot = random_platform(("3-RPS", "3-UPU", "3-PRS", "6-UPS")[seed % 4], seed)
    require_equal(*along_motion(robot, random_state(robot, seed)))


@pytest.mark.parametrize("name", ["ur5e", "sr400", "manutec_r3", "free_flying_arm"])
def test_all_kinds_of_friction(name):
    """Also of the load: it follows from the efforts here, and from the motion in the inverse model."""
    robot = with_random_friction(shipped_robot(name), 2)
    require_equal(*along_motion(robot, random_state(robot, 2)))


@pytest.mark.parametrize(
    ("urdf", "moving_base"),
    [
        (shipped_robots()["panda"].read_text(), False),
        (real_urdf("tiago"), False),
        (real_urdf("solo12"), True),
        *((random_urdf(seed, 3 + 4 * (seed % 5)), seed % 2 == 1) for seed in range(2 + ROBOTS)),
    ],
)
def test_trees_against_the_coriolis_matrix_of_pinocchio(urdf, moving_base):
    """p = M v, and its rate without efforts is Cᵀ v - g, with armatures; mimic joints move by their columns."""
    robot = read_urdf(urdf, moving_base=moving_base)
    inertias = np.random.default_rng(0).uniform(0, 0.5, len(robot.joints))
    joints = [
        replace(joint.without_friction(), rotor_inertia=Ia) for joint, Ia in zip(robot.joints, inertias, strict=True)
    ]
    dynamics = Dynamics(replace(robot, joints=tuple(joints)))
    peer = PinocchioModel(urdf, dynamics.all_joint_names, moving_base, inertias)
    states = random_states(dynamics.robot, len(dynamics.joint_names), 1, 3)
    q, qd = states.q[0], states.qd[0]
    pose, twist, base = None, (), []
    if moving_base:
        pose, twist = states.base.pose[0], states.base.twist[0]
        base = [twist, pose[:3, :3].T @ dynamics.robot.gravity]
    program = dynamics.compile("momentum")
    momentum, rate = program.evaluate(q, qd, np.zeros_like(q), *base)
    P = np.eye(peer.base_size + len(robot.joints), peer.base_size + len(q))
    P[peer.base_size :, peer.base_size :] = dynamics.constrained_state(q).G
    all_q = dynamics.expand_positions(q)
    velocity = peer.vector(dynamics.expand_velocities(qd), twist)
    C = pin.computeCoriolisMatrix(peer.model, peer.data, peer.position(all_q, pose), velocity)
    require_equal(momentum, P.T @ peer.inertia_matrix(all_q) @ velocity[peer.rows])
    require_equal(rate, P.T @ ((C.T @ velocity)[peer.rows] - peer.gravity(all_q, pose)))


def test_program_is_small_and_fast_enough_for_a_sample_of_a_kilohertz():
    """It has less than twice the operations of the inverse model, where ∂(½ q̇ᵀ A q̇) has those of n models."""
    robot = shipped_robot("panda")
    ratio = sum(MODELS["momentum"](robot).operations) / sum(MODELS["inverse"](robot).operations)
    assert ratio < 2


@pytest.mark.parametrize("name", ["ur5e", "free_flying_arm"])
def test_grouped_parameters_have_the_same_momentum(name):
    robot = load_robot(name)
    state = random_state(robot)
    grouped, plain = (MODELS["momentum"](robot, group_parameters=grouped) for grouped in (True, False))
    for output, values in evaluate(plain, _rows(plain, state)).items():
        require_equal(evaluate(grouped, _rows(grouped, state))[output], values)
