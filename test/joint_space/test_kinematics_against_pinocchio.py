"""Kinematics of frames, momentum and energy agree with Pinocchio to 1e-12 (relative, max-norm) on shipped, real and
random trees, base fixed and moving, by recursions and by compiled programs, in batches and sample by sample."""

from dataclasses import replace

import numpy as np
import pytest
from peers.pinocchio_kinematics import body_state, frame_state
from peers.pinocchio_model import PinocchioModel
from peers.random_robots import random_states, random_urdf
from peers.real_robots import real_urdf

from robot_dynamics import Base, Dynamics, shipped_robots
from robot_dynamics.codegen.jit.program_key import FRAME_MODELS, WHOLE_BODY_MODELS
from robot_dynamics.model.formats.urdf.reader import read_urdf

STATES = 2
TOLERANCE = 1e-12

ROBOTS = [
    *((shipped_robots()[name].read_text(), moves) for name, moves in [("panda", False), ("ur5e", True)]),
    *((real_urdf(name), moves) for name, moves in [("panda", False), ("tiago", False), ("solo12", True)]),
    (real_urdf("talos_reduced"), True),
    *((random_urdf(seed, joints), seed % 2 == 0) for seed, joints in [(0, 7), (1, 12), (2, 5), (3, 20), (4, 9)]),
]


def assert_close(actual, expected):
    assert actual.shape == expected.shape
    scale = max(1.0, np.abs(expected).max(initial=0))
    np.testing.assert_allclose(actual, expected, rtol=0, atol=TOLERANCE * scale)


class Case:
    """A robot with random states, and Pinocchio's results for sample k: joints of Pinocchio move by G of the mimics."""

    def __init__(self, urdf, moving_base, compiled, seed=0):
        robot = read_urdf(urdf, moving_base=moving_base)
        rng = np.random.default_rng(seed)
        inertias = rng.uniform(0, 0.5, len(robot.joints))
        joints = [replace(joint, rotor_inertia=Ia) for joint, Ia in zip(robot.joints, inertias, strict=True)]
        self.dynamics = Dynamics(replace(robot, joints=tuple(joints)), compiled=compiled)
        self.peer = PinocchioModel(urdf, self.dynamics.all_joint_names, moving_base, inertias)
        states = random_states(robot, len(self.dynamics.joint_names), STATES, seed)
        self.q, self.qd, self.qdd, self.base = states.q, states.qd, states.qdd, states.base
        self.frames = [frame.name for frame in robot.frames]
        self.frames = [str(name) for name in rng.choice(self.frames, size=min(4, len(self.frames)), replace=False)]
        self.accelerated = self.base
        if moving_base:
            self.accelerated = Base(self.base.pose, self.base.twist, rng.uniform(-1, 1, (STATES, 6)))
        base = self.dynamics._base_size()
        n, count = len(self.dynamics.all_joint_names), len(self.dynamics.joint_names)
        self.columns = np.eye(base + n, base + count)
        self.columns[base:, base:] = self.dynamics.constrained_state(self.q[0]).G

    def of_sample(self, k, function, *arguments):
        dynamics, base = self.dynamics, self.accelerated
        moved = () if base is None else (base.pose[k], base.twist[k], base.acceleration[k])
        rates = (dynamics.expand_velocities(self.qd[k]), dynamics.expand_accelerations(self.qdd[k]))
        return function(self.peer, *arguments, dynamics.expand_positions(self.q[k]), *rates, *moved)

    def base_of(self, base, k):
        if base is None:
            return None
        return Base(base.pose[k], base.twist[k], None if base.acceleration is None else base.acceleration[k])


def check_frames(case, axes, name, k, q, qd, qdd, base, accelerated):
    frame = case.dynamics.frame(name)
    expected = case.of_sample(k, frame_state, name, axes)
    assert_close(frame.pose(q, base=base), expected.pose)
    assert_close(frame.jacobian(q, axes=axes, base=base), expected.jacobian @ case.columns)
    assert_close(frame.twist(q, qd, axes=axes, base=base), expected.twist)
    assert_close(frame.bias_acceleration(q, qd, axes=axes, base=base), expected.bias)
    assert_close(frame.acceleration(q, qd, qdd, axes=axes, base=accelerated), expected.acceleration)


def check_whole_body(case, k, q, qd, rates, base):
    body = case.dynamics.whole_body
    expected = case.of_sample(k, body_state)
    assert_close(body.centre_of_mass(q, base=base), expected.centre)
    assert_close(body.centre_of_mass_velocity(q, qd, base=base), expected.velocity)
    assert_close(body.centre_of_mass_jacobian(q, base=base), expected.jacobian @ case.columns)
    assert_close(body.centroidal_momentum(q, qd, base=base), expected.momentum)
    matrix = body.centroidal_momentum_matrix(q, base=base)
    bias = body.centroidal_momentum_bias(q, qd, base=base)
    assert_close(matrix, expected.matrix @ case.columns)
    assert_close(bias, expected.bias)
    assert_close(matrix @ rates + bias, expected.rate)
    assert_close(body.kinetic_energy(q, qd, base=base), np.array(expected.kinetic))
    assert_close(body.gravitational_energy(q, base=base), np.array(expected.potential))


def accelerations_of(case, k):
    """[base acceleration; q̈] of sample k."""
    return np.concatenate([() if case.base is None else case.accelerated.acceleration[k], case.qdd[k]])


@pytest.mark.parametrize("urdf, moving_base", ROBOTS)
def test_recursions_agree_with_pinocchio(urdf, moving_base):
    case = Case(urdf, moving_base, compiled=False)
    for k in range(STATES):
        sample = case.q[k], case.qd[k]
        base, accelerated = (case.base_of(given, k) for given in (case.base, case.accelerated))
        check_whole_body(case, k, *sample, accelerations_of(case, k), base)
        for name in case.frames:
            for axes in ("frame", "world"):
                check_frames(case, axes, name, k, *sample, case.qdd[k], base, accelerated)


@pytest.mark.parametrize("urdf, moving_base", [ROBOTS[2], ROBOTS[6]])
def test_compiled_programs_agree_with_pinocchio(urdf, moving_base):
    case = Case(urdf, moving_base, compiled=True)
    case.frames = case.frames[:1]
    for model in FRAME_MODELS:
        case.dynamics.compile(model, frame=case.frames[0])
    for model in WHOLE_BODY_MODELS:
        case.dynamics.compile(model)
    base, accelerated = (case.base_of(given, 0) for given in (case.base, case.accelerated))
    check_whole_body(case, 0, case.q[0], case.qd[0], accelerations_of(case, 0), base)
    for axes in ("frame", "world"):
        check_frames(case, axes, case.frames[0], 0, case.q[0], case.qd[0], case.qdd[0], base, accelerated)


@pytest.mark.parametrize("compiled", [False, True])
def test_batches_are_samples_side_by_side(compiled):
    case = Case(*ROBOTS[6], compiled=compiled)
    frame, body = case.dynamics.frame(case.frames[1]), case.dynamics.whole_body
    if compiled:
        case.dynamics.compile("jacobian_in_base_axes", frame=frame.name)
        case.dynamics.compile("kinetic_energy")
    jacobians = frame.jacobian(case.q, axes="world", base=case.base)
    accelerations = frame.acceleration(case.q, case.qd, case.qdd, axes="world", base=case.accelerated)
    energies = body.kinetic_energy(case.q, case.qd, base=case.base)
    biases = body.centroidal_momentum_bias(case.q, case.qd, base=case.base)
    centres = body.centre_of_mass(case.q[0], base=case.base)  # one posture, a batch of bases
    for k in range(STATES):
        base, accelerated = (case.base_of(given, k) for given in (case.base, case.accelerated))
        sample = case.q[k], case.qd[k]
        assert_close(jacobians[k], frame.jacobian(case.q[k], axes="world", base=base))
        assert_close(accelerations[k], frame.acceleration(*sample, case.qdd[k], axes="world", base=accelerated))
        assert_close(energies[k], np.asarray(body.kinetic_energy(*sample, base=base)))
        assert_close(biases[k], body.centroidal_momentum_bias(*sample, base=base))
        assert_close(centres[k], body.centre_of_mass(case.q[0], base=base))
