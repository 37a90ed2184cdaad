"""Platforms at every attitude, through pitch ±90° of their coordinates: the same robot with frames in
which pitch is far from ±90° has the same motor positions, efforts and accelerations."""

from dataclasses import replace

import numpy as np
import pytest
from peers.maximal_coordinates import MaximalCoordinates
from peers.random_platforms import random_platform
from peers.reframed import pose_between, reframed, screw_of
from scipy.spatial.transform import Rotation

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.placement import placement
from robot_dynamics.newton_euler.regressor import parameter_names
from robot_dynamics.parallel.platform_dynamics import pose_from_coordinates

ALL = ("x", "y", "z", "yaw", "pitch", "roll")
SIZES = (0.0, 1e-12, 1e-9, 1e-6, 1e-3, 0.05, 1.0)  # distances from home, where pitch is ±90°


def turn(axis, degrees):
    return placement(Rotation.from_euler(axis, degrees, degrees=True).as_matrix())


NOTHING = np.eye(4)
# robot, base frame of the pose, frame of the platform, and free coordinates in these frames
CASES = {
    "6-UPS up": (lambda: random_platform("6-UPS", 0), NOTHING, turn("y", 90), ALL),
    "6-UPS down": (lambda: random_platform("6-UPS", 1), NOTHING, turn("y", -90) @ turn("x", 40), ALL),
    "6-UPS turned stand": (lambda: random_platform("6-UPS", 2), turn("z", 20) @ turn("y", -50),
                           turn("z", 20) @ turn("y", 40) @ turn("x", -30), ALL),
    "gough_stewart": (lambda: load_robot("gough_stewart"), NOTHING, turn("y", 90), ALL),
    "delta": (lambda: load_robot("delta"), NOTHING, turn("y", 90), ("x", "y", "z")),
    "delta_wrist": (lambda: load_robot("delta_wrist"), NOTHING, turn("y", -90), ("x", "y", "z")),
    "orthoglide": (lambda: load_robot("orthoglide"), NOTHING, turn("z", 30) @ turn("y", 90), ("x", "y", "z")),
    "3-UPU": (lambda: random_platform("3-UPU", 2), NOTHING, turn("y", 90), ("x", "y", "z")),
    "navaro in a plane through z": (lambda: load_robot("navaro"), turn("x", 90), turn("x", 90) @ turn("y", 90),
                                    ("x", "z", "pitch")),
    "3-RPS": (lambda: random_platform("3-RPS", 2), turn("y", -60), turn("y", 30), ("x", "pitch", "roll")),
    "3-PRS": (lambda: random_platform("3-PRS", 2), NOTHING, turn("y", 90), None),
}  # fmt: skip


class Pair:
    """old, new: Dynamics of the robot with its own and with new frames; q: (N, n) motor positions around home, where
    pitch in the new frames is ±90°, at decreasing distances; old_q, new_q: (N, all joints)."""

    def __init__(self, case, count=2):
        make, self.stand, self.own, self.free = CASES[case]
        robot = make()
        self.old = Dynamics(robot, compiled=False)
        self.new = Dynamics(reframed(robot, self.stand, self.own, self.free or ALL), compiled=False)
        rng = np.random.default_rng(5)
        self.n, self.m = ([d.robot.joint_numbers[name] for name in self.old.joint_names] for d in (self.old, self.new))
        home = self.old.initial_joint_positions[self.n]
        reach = np.where([self.old.robot.joints[k].prismatic for k in self.n], 0.04, 0.1)
        steps = [size * reach * rng.uniform(-1, 1, (count, len(home))) for size in SIZES]
        self.q = home + np.concatenate(steps)
        self.old_q, self.new_q = self.old.expand_positions(self.q), self.new.expand_positions(self.q)
        self.qd, self.qdd = rng.uniform(-1, 1, (2, *self.q.shape))

    def legs(self, values, dynamics):
        """Return the columns of all joints but those of the platform, in the order of the old robot."""
        names = [name for k, name in enumerate(self.old.all_joint_names) if k not in self.old.robot.platform.joints]
        return values[..., [dynamics.robot.joint_numbers[name] for name in names]]


@pytest.fixture(scope="module", params=CASES)
def pair(request):
    return Pair(request.param)


def near(actual, expected, tolerance=1e-9):
    scale = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(actual, expected, rtol=0, atol=tolerance * scale)


@pytest.mark.slow
def test_direct_geometry_at_every_attitude(pair):
    assert np.abs(np.abs(np.sin(pair.new.initial_joint_positions[pair.new.robot.platform.joints[4]])) - 1) < 1e-9
    near(pair.legs(pair.new_q, pair.new), pair.legs(pair.old_q, pair.old))
    old = pair.old.link_pose(pair.old.robot.platform_links[0], pair.old_q)
    new = pair.new.link_pose(pair.new.robot.platform_links[0], pair.new_q)
    near(new, old @ pair.own)
    near(pose_from_coordinates(pair.new_q[:, pair.new.robot.platform.joints]), pose_between(old, pair.stand, pair.own))
    near(pair.new.expand_positions(pair.new_q), pair.new_q)  # as a seed


@pytest.mark.slow
def test_trajectory_passes_steep_attitudes(pair):
    home = pair.old.initial_joint_positions[pair.n]
    for q in pair.q[-2:]:
        path = home + np.linspace(-1, 1, 13)[:, None] * (q - home)
        old, new = pair.old.expand_trajectory(path), pair.new.expand_trajectory(path)
        near(pair.legs(new, pair.new), pair.legs(old, pair.old))


@pytest.mark.slow
def test_both_models_at_every_attitude(pair):
    old = pair.old.inverse(pair.old_q, pair.qd, pair.qdd)
    new = pair.new.solve(pair.new_q, pair.qd, qdd=pair.qdd)
    near(new.efforts, old)
    near(
        pair.legs(new.motion.velocities, pair.new), pair.legs(pair.old.expand_velocities(pair.qd, pair.old_q), pair.old)
    )
    accelerations = pair.old.expand_accelerations(pair.qdd, pair.old_q, pair.qd)
    near(pair.legs(new.motion.accelerations, pair.new), pair.legs(accelerations, pair.old))
    near(pair.new.direct(pair.new_q, pair.qd, old), pair.qdd, 1e-7)
    near(pair.new.inertia_matrix(pair.new_q), pair.old.inertia_matrix(pair.old_q))
    near(pair.new.gravity(pair.new_q), pair.old.gravity(pair.old_q))
    near(pair.new.coriolis(pair.new_q, pair.qd), pair.old.coriolis(pair.old_q, pair.qd))
    wrench = {pair.old.robot.platform_links[0]: np.array([1.0, 2, 3, 0.4, 0.5, 0.6])}
    turned = {pair.old.robot.platform_links[0]: screw_of(np.array([1.0, 2, 3, 0.4, 0.5, 0.6]), pair.own)}
    loaded = pair.new.solve(pair.new_q, pair.qd, efforts=old, external_wrenches=turned)
    near(loaded.accelerations, pair.old.direct(pair.old_q, pair.qd, old, external_wrenches=wrench), 1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("pair", ["6-UPS up", "delta", "3-RPS"], indirect=True)
def test_compiled_models_at_every_attitude(pair):
    programs = {name: pair.new.compile(name) for name in ("inverse", "direct")}
    efforts = pair.old.inverse(pair.old_q, pair.qd, pair.qdd)
    near(programs["inverse"].batch(pair.new_q, pair.qd, pair.qdd), efforts)
    near(programs["direct"].batch(pair.new_q, pair.qd, efforts), pair.qdd, 1e-7)


def virtual_columns(robot):
    """Return the columns of links between the rotational coordinates of the platform, and of these joints."""
    turning = robot.platform.joints[3:]
    names = {robot.joints[k].name for k in turning} | {robot.links[k + 1].name for k in turning[:2]}
    return [k for k, name in enumerate(parameter_names(robot)) if name.partition(".")[2] in names]


def check_regressor(pair, Y):
    """Check that the regressor gives the efforts of `inverse` without springs."""
    efforts = pair.old.inverse(pair.old_q, pair.qd, pair.qdd)
    springs = pair.old.elasticity(pair.old_q, pair.qd)
    near(Y @ pair.new.parameters, efforts - springs)
    assert np.isfinite(Y).all()
    assert not pair.new.parameters[virtual_columns(pair.new.robot)].any()


def test_regressor_at_every_attitude(pair):
    check_regressor(pair, pair.new.regressor(pair.new_q, pair.qd, pair.qdd))


def test_regressor_columns_of_legs_do_not_depend_on_platform_frames(pair):
    """Columns of legs and their joints do not depend on the frames of the platform."""
    old = pair.old.regressor(pair.old_q, pair.qd, pair.qdd)
    new = pair.new.regressor(pair.new_q, pair.qd, pair.qdd)
    platform = {pair.old.robot.joints[k].name for k in pair.old.robot.platform.joints}
    platform |= {pair.old.robot.links[k + 1].name for k in pair.old.robot.platform.joints}
    names = [name for name in pair.old.parameter_names if name.partition(".")[2] not in platform]
    for name in names:
        near(new[..., pair.new.parameter_names.index(name)], old[..., pair.old.parameter_names.index(name)])


@pytest.mark.slow
@pytest.mark.parametrize("pair", ["gough_stewart", "3-RPS"], indirect=True)
def test_compiled_regressor_at_every_attitude(pair):
    program = pair.new.compile("regressor")
    Y = program.batch(pair.new_q, pair.qd, pair.qdd)
    check_regressor(pair, Y)
    expected = pair.new.regressor(pair.new_q, pair.qd, pair.qdd)
    kept = np.setdiff1d(np.arange(Y.shape[-1]), virtual_columns(pair.new.robot))
    near(Y[..., kept], expected[..., kept])
    regular = np.abs(np.cos(pair.new_q[:, pair.new.robot.platform.joints[4]])) > 1e-3  # where the regularisation ends
    assert regular.any()
    near(Y[regular], expected[regular])


def test_regressor_columns_of_links_between_the_angles():
    """Columns of bodies, rotors and friction at the angles agree with a robot that has them, and therefore no chart."""
    robot = load_robot("gough_stewart")
    dynamics, angles = Dynamics(robot, compiled=False), robot.platform.joints[3:]
    rng = np.random.default_rng(2)
    joints = [replace(joint, rotor_inertia=0.1, viscous_friction=0.2, coulomb_friction=0.3) if k in angles else joint
              for k, joint in enumerate(robot.joints)]  # fmt: skip
    links = list(robot.links)
    for k in angles[:2]:
        points = rng.uniform(-0.1, 0.1, (6, 3))  # of 1 kg each
        moments = np.sum(points**2) * np.eye(3) - points.T @ points
        links[k + 1] = replace(links[k + 1], inertia=Inertia(6.0, points.sum(axis=0), moments))
    heavy = Dynamics(replace(robot, joints=tuple(joints), links=tuple(links)), compiled=False)
    numbers = [robot.joint_numbers[name] for name in dynamics.joint_names]
    q = dynamics.expand_positions(
        dynamics.initial_joint_positions[numbers] + rng.uniform(-0.02, 0.02, (20, len(numbers)))
    )
    rates = rng.uniform(-1, 1, (2, 20, len(numbers)))
    Y, expected = dynamics.regressor(q, *rates), heavy.regressor(q, *rates)
    np.testing.assert_allclose(Y, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(Y @ heavy.parameters, heavy.inverse(q, *rates), rtol=1e-9, atol=1e-9)


def test_efforts_agree_with_maximal_coordinates(pair):
    peer = MaximalCoordinates(pair.old.robot)
    for k in range(0, len(pair.q), 2):
        prescribed = np.full(len(pair.old_q[k]), np.nan)
        prescribed[pair.n] = pair.qdd[k]
        expected = peer.inverse(pair.old_q[k], pair.old.expand_velocities(pair.qd[k], pair.old_q[k]), prescribed)
        result = pair.new.solve(pair.new_q[k], pair.qd[k], qdd=pair.qdd[k])
        near(result.efforts, expected.efforts[pair.n], 1e-8)


def platform_of(pair):
    if pair.free is None:
        pytest.skip("no three of these coordinates determine the legs")
    return pair.old.platform, pair.new.platform


@pytest.mark.slow
def test_platform_methods_at_every_attitude(pair):
    """Inverse geometry, Jacobian, both models, and the twist and acceleration of a motion."""
    old, new = platform_of(pair)
    poses = pair.old.platform.pose(pair.old_q)
    poses_in_frames = pose_between(poses, pair.stand, pair.own)
    near(new.pose(pair.new_q), poses_in_frames)
    near(new.jacobian(pair.new_q), np.swapaxes(screw_of(np.swapaxes(old.jacobian(pair.old_q), 1, 2), pair.own), 1, 2))
    options = {"other_joints": None}
    if new.other_joint_names:
        options["other_joints"] = [values[:, [pair.new.joint_names.index(name) for name in new.other_joint_names]]
                        for values in (pair.q, pair.qd, pair.qdd)]  # fmt: skip
    for joints in (
        new.joint_positions(poses_in_frames, seed=pair.new_q),
        new.joint_positions(poses_in_frames, **options),
    ):
        near(pair.legs(joints, pair.new), pair.legs(pair.old_q, pair.old))
        near(pose_from_coordinates(joints[:, pair.new.robot.platform.joints]), poses_in_frames)
    motion = pair.old.solve(pair.old_q, pair.qd, qdd=pair.qdd).motion
    twist, acceleration = screw_of(old.twist(motion), pair.own), screw_of(old.acceleration(motion), pair.own)
    result = pair.new.solve(pair.new_q, pair.qd, qdd=pair.qdd)
    near(new.twist(result.motion), twist)
    near(new.acceleration(result.motion), acceleration)
    efforts = new.inverse(poses_in_frames, twist, acceleration, seed=pair.new_q, **options)
    near(efforts, result.efforts)
    near(new.direct(poses_in_frames, twist, efforts, seed=pair.new_q, **options), acceleration, 1e-7)
    assert new.reach(poses_in_frames)[1].all()
    assert np.isfinite(new.condition_number(pair.new_q)).all()
