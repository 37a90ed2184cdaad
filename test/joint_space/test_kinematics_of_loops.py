"""Kinematics of frames, momentum and energy of robots with loops and platforms: central differences of poses, sums over
links, virtual work, conservation of momentum and balance of power."""

from functools import cache

import numpy as np
import pytest
from peers.link_motion import link_motion
from peers.random_loops import random_loops
from peers.reachable import reachable
from scipy.spatial.transform import Rotation

from robot_dynamics import Base, Dynamics, load_robot
from robot_dynamics.codegen.jit.program_key import FRAME_MODELS, WHOLE_BODY_MODELS
from robot_dynamics.codegen.jit.python_program import PythonProgram
from robot_dynamics.codegen.trace.kinematic_models import (
    bias_acceleration_model,
    centroidal_momentum_bias_model,
    jacobian_model,
)
from robot_dynamics.constraints.attitude_charts import virtual_links
from robot_dynamics.joint_space.frame_states import FrameStates

SHIPPED = ("four_bar", "delta_wrist", "gough_stewart")
RANDOM = (3, 8, 11, 12)  # seeds
MOVING = (8, 12)  # with a moving base, the first one with an elastic joint
STEP = 1e-4  # [s] of central differences


class Motion:
    """A robot and its motion through one random state with constant accelerations: of a moving base the twist changes
    with the acceleration that its freedom gives it.
    """

    def __init__(self, key, compiled=False):
        self.rng = np.random.default_rng(7)
        if isinstance(key, str):
            robot = load_robot(key)
            self.dynamics = Dynamics(robot, compiled=compiled)
            self.q = self.dynamics.expand_positions(reachable(self.dynamics, 1, self.rng)[0])
        else:
            looped = random_loops(key, moving_base=key in MOVING, elastic=key == MOVING[0])
            robot, self.q = looped.robot, looped.q
            self.dynamics = Dynamics(robot, compiled=compiled)
        dynamics, n = self.dynamics, len(self.dynamics.joint_names)
        self.robot = robot
        self.independent = [robot.joint_numbers[name] for name in dynamics.joint_names]
        self.qd = self.rng.uniform(-1, 1, n)
        self.base = None
        if robot.moving_base:
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = Rotation.random(random_state=3).as_matrix(), self.rng.uniform(-1, 1, 3)
            self.base = Base(pose, self.rng.uniform(-1, 1, 6))
        wanted = self.rng.uniform(-1, 1, n)
        wanted[[dynamics.joint_names.index(name) for name in dynamics.unactuated_joint_names]] = 0
        self.result = dynamics.solve(self.q, self.qd, qdd=wanted, base=self.base)
        self.qdd = self.result.accelerations
        self.accelerated = self.base
        if robot.moving_base:
            self.accelerated = Base(self.base.pose, self.base.twist, self.result.base_acceleration)

    def at(self, time):
        """(q of all joints, qd, base) at a time [s]; the pose of the base stays."""
        previous = np.array(self.q)
        q = self.q[self.independent] + self.qd * time + 0.5 * self.qdd * time**2
        previous[self.independent] = q
        base = self.base
        if base is not None:
            v, omega = np.split(np.asarray(base.twist), 2)
            derivative = self.result.base_acceleration - np.concatenate([np.cross(omega, v), np.zeros(3)])
            base = Base(base.pose, base.twist + derivative * time)
        return self.dynamics.expand_positions(previous), self.qd + self.qdd * time, base


@cache
def motion_of(key):
    return Motion(key)


def frames_of(robot, rng, count=3):
    names = [frame.name for frame in robot.frames]
    chosen = {str(name) for name in rng.choice(names, size=min(count, len(names)), replace=False)}
    return sorted(chosen | {robot.links[number].name for number in virtual_links(robot)})


@pytest.mark.parametrize("key", [*SHIPPED, *(seed for seed in RANDOM if seed not in MOVING)])
def test_twists_and_accelerations_are_differences_of_poses(key):
    motion = motion_of(key)
    dynamics = motion.dynamics
    (q_before, *_), (q_after, *_) = motion.at(-STEP), motion.at(STEP)
    for name in frames_of(motion.robot, motion.rng):
        frame = dynamics.frame(name)
        before, pose, after = (frame.pose(q) for q in (q_before, motion.q, q_after))
        points = [matrix[:3, 3] for matrix in (before, pose, after)]
        turned = [Rotation.from_matrix(matrix[:3, :3] @ pose[:3, :3].T).as_rotvec() for matrix in (before, after)]
        twist = np.concatenate([points[2] - points[0], turned[1] - turned[0]]) / (2 * STEP)
        of_origin, of_axes = points[2] - 2 * points[1] + points[0], turned[1] + turned[0]
        acceleration = np.concatenate([of_origin, of_axes]) / STEP**2
        actual = frame.acceleration(motion.q, motion.qd, motion.qdd, axes="world")
        np.testing.assert_allclose(frame.twist(motion.q, motion.qd, axes="world"), twist, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(actual, acceleration, rtol=1e-4, atol=1e-4)
        turn = np.kron(np.eye(2), pose[:3, :3].T)
        own = frame.acceleration(motion.q, motion.qd, motion.qdd)
        np.testing.assert_allclose(own, turn @ actual, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("key", [*SHIPPED, *RANDOM])
def test_momentum_energy_and_twists_are_sums_over_links(key):
    motion = motion_of(key)
    dynamics, robot = motion.dynamics, motion.robot
    qd = dynamics.expand_velocities(motion.qd, motion.q)
    links = link_motion(robot, motion.q, qd, *((motion.base.pose, motion.base.twist) if motion.base else ()))
    masses, centres, spins, kinetic = [], [], [], 0.0
    for number in range(0 if robot.moving_base else 1, len(robot.links)):
        inertia, pose, V = robot.links[number].inertia, links.poses[number], links.velocities[number]
        R = pose[:3, :3]
        moments, second = R @ inertia.first_moments, R @ inertia.second_moments @ R.T
        masses.append(inertia.mass)
        centres.append(inertia.mass * pose[:3, 3] + moments)
        P = inertia.mass * V[:3] + np.cross(V[3:], moments)
        L = second @ V[3:] + np.cross(moments, V[:3])
        spins.append((P, L + np.cross(pose[:3, 3], P)))
        kinetic += 0.5 * (V[:3] @ P + V[3:] @ L)
    kinetic += 0.5 * sum(joint.rotor_inertia * rate**2 for joint, rate in zip(robot.joints, qd, strict=True))
    centre = np.sum(centres, axis=0) / np.sum(masses)
    P, L = np.sum(spins, axis=0)
    momentum = np.concatenate([P, L - np.cross(centre, P)])
    body, base = dynamics.whole_body, motion.base
    scale = 1e-11 * max(1, np.abs(momentum).max(), kinetic)
    np.testing.assert_allclose(body.mass, np.sum(masses), rtol=1e-14)
    np.testing.assert_allclose(body.centre_of_mass(motion.q, base=base), centre, rtol=0, atol=1e-12)
    np.testing.assert_allclose(body.centroidal_momentum(motion.q, motion.qd, base=base), momentum, rtol=0, atol=scale)
    np.testing.assert_allclose(body.kinetic_energy(motion.q, motion.qd, base=base), kinetic, rtol=0, atol=scale)
    expected = -robot.gravity @ np.sum(centres, axis=0)
    np.testing.assert_allclose(body.gravitational_energy(motion.q, base=base), expected, rtol=1e-11)
    for name in frames_of(robot, motion.rng):
        found = robot.frame(name)
        V = links.velocities[found.link]
        arm = links.poses[found.link][:3, :3] @ found.placement[:3, 3]
        twist = np.concatenate([V[:3] + np.cross(V[3:], arm), V[3:]])
        actual = dynamics.frame(name).twist(motion.q, motion.qd, axes="world", base=base)
        np.testing.assert_allclose(actual, twist, rtol=0, atol=1e-11 * max(1, np.abs(twist).max()))


@pytest.mark.parametrize("key", [*SHIPPED, *RANDOM[2:]])
def test_virtual_work_of_an_external_wrench(key):
    """The wrench changes efforts, and the reaction of a base with prescribed acceleration, by -Jᵀ w."""
    motion = motion_of(key)
    dynamics, base = motion.dynamics, motion.accelerated
    assert not dynamics.unactuated_joint_names  # the wrench would accelerate them
    without = dynamics.solve(motion.q, motion.qd, qdd=motion.qdd, base=base)
    for name in frames_of(motion.robot, motion.rng):
        wrench = motion.rng.uniform(-10, 10, 6)
        loaded = dynamics.solve(motion.q, motion.qd, qdd=motion.qdd, base=base, external_wrenches={name: wrench})
        change = loaded.efforts - without.efforts
        if motion.robot.moving_base:
            change = np.concatenate([loaded.reactions[0] - without.reactions[0], change])
        expected = -dynamics.frame(name).jacobian(motion.q).T @ wrench
        np.testing.assert_allclose(change, expected, rtol=0, atol=1e-9 * max(1, np.abs(without.efforts).max()))


def test_momentum_of_a_free_robot_with_loops_changes_by_gravity_alone():
    motion = motion_of(MOVING[0])
    body, base = motion.dynamics.whole_body, motion.base
    accelerations = np.concatenate([motion.result.base_acceleration, motion.qdd])
    matrix = body.centroidal_momentum_matrix(motion.q, base=base)
    rate = matrix @ accelerations + body.centroidal_momentum_bias(motion.q, motion.qd, base=base)
    expected = np.concatenate([body.mass * motion.robot.gravity, np.zeros(3)])
    np.testing.assert_allclose(rate, expected, rtol=0, atol=1e-9 * np.abs(matrix @ accelerations).max())


@pytest.mark.parametrize("key", [*SHIPPED, *RANDOM])
def test_energy_grows_by_the_power_of_the_motors(key):
    motion = motion_of(key)
    dynamics, body, base = motion.dynamics, motion.dynamics.whole_body, motion.base

    def stored(time):
        q, qd, base = motion.at(time)
        return body.kinetic_energy(q, qd, base=base) + body.elastic_energy(q)

    weight = body.mass * motion.robot.gravity
    growth = (stored(STEP) - stored(-STEP)) / (2 * STEP)
    growth -= weight @ body.centre_of_mass_velocity(motion.q, motion.qd, base=base)
    damping = dynamics.elasticity(motion.q, motion.qd) - dynamics.elasticity(motion.q, np.zeros_like(motion.qd))
    losses = dynamics.friction(motion.qd, motion.q, base=base) + damping
    power = motion.qd @ (motion.result.efforts - losses)
    scale = max(1.0, np.abs(motion.qd * motion.result.efforts).max())
    np.testing.assert_allclose(growth, power, rtol=0, atol=1e-5 * scale)


def test_many_frames_at_one_state_are_those_frames():
    motion = motion_of("gough_stewart")
    names = frames_of(motion.robot, motion.rng)
    for axes in ("frame", "world"):
        states = FrameStates(motion.dynamics, motion.q, motion.qd, axes, None)
        for name in names:
            state = states.of(name)
            frame = motion.dynamics.frame(name)
            assert_rows(state.pose, frame.pose(motion.q))
            assert_rows(state.jacobian, frame.jacobian(motion.q, axes=axes))
            assert_rows(state.twist, frame.twist(motion.q, motion.qd, axes=axes))
            assert_rows(state.bias_acceleration, frame.bias_acceleration(motion.q, motion.qd, axes=axes))


def test_compiled_programs_of_a_robot_with_loops_agree_with_the_recursions():
    motion, compiled = motion_of("four_bar"), Dynamics(load_robot("four_bar"))
    name = "rocker"
    for model in FRAME_MODELS:
        compiled.compile(model, frame=name)
    for model in WHOLE_BODY_MODELS:
        compiled.compile(model)
    for axes in ("frame", "world"):
        assert_same(motion, compiled, lambda dynamics, q, qd, axes=axes: (
            dynamics.frame(name).jacobian(q, axes=axes), dynamics.frame(name).bias_acceleration(q, qd, axes=axes)
        ))  # fmt: skip
    assert_same(motion, compiled, lambda dynamics, q, qd: (
        dynamics.frame(name).pose(q),
        dynamics.whole_body.centre_of_mass(q),
        dynamics.whole_body.centroidal_momentum_matrix(q),
        dynamics.whole_body.centroidal_momentum_bias(q, qd),
        dynamics.whole_body.kinetic_energy(q, qd),
    ))  # fmt: skip


def test_programs_of_a_moving_base_and_of_charts_agree_with_the_recursions():
    """As Python: these programs take long to compile."""
    motion = motion_of(MOVING[1])
    name = motion.robot.frames[-1].name
    q, qd, twist = motion.q, motion.qd, np.asarray(motion.base.twist)
    expected = motion.dynamics.frame(name).bias_acceleration(q, qd, base=motion.base)
    assert_rows(PythonProgram(bias_acceleration_model(motion.robot, name)).evaluate(q, qd, twist), expected)
    motion = motion_of("gough_stewart")
    dynamics, q, qd = motion.dynamics, motion.q, motion.qd
    expected = dynamics.whole_body.centroidal_momentum_bias(q, qd)
    assert_rows(PythonProgram(centroidal_momentum_bias_model(motion.robot)).evaluate(q, qd), expected)
    for link in (motion.robot.platform_links[0], motion.robot.links[min(virtual_links(motion.robot))].name):
        expected = dynamics.frame(link).jacobian(q)
        assert_rows(PythonProgram(jacobian_model(motion.robot, link)).evaluate(q), expected)


def assert_same(motion, compiled, function):
    expected = function(motion.dynamics, motion.q, motion.qd)
    for actual, value in zip(function(compiled, motion.q, motion.qd), expected, strict=True):
        assert_rows(actual, value)


def assert_rows(actual, expected):
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-10 * max(1, np.abs(expected).max()))
