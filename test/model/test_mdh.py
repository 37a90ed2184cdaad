"""MDH parameters against Khalil's formula, and from any placement; minimal frames against published tables; roll, pitch
and yaw."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from peers.real_robots import REAL_ROBOTS, real_urdf
from scipy.spatial.transform import Rotation

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.mdh import MDHParameters, mdh_from_placement, placement_from_mdh
from robot_dynamics.model.mdh_table import build_mdh_table
from robot_dynamics.model.minimal_frames import minimal_frames, snap_angles
from robot_dynamics.model.placement import placement, roll_pitch_yaw, rotation_from_roll_pitch_yaw

angles = st.floats(-7, 7) | st.sampled_from([k * math.pi / 4 for k in range(-8, 9)]) | st.floats(-1e-6, 1e-6)
lengths = st.floats(-2, 2) | st.just(0.0) | st.floats(-1e-9, 1e-9)


def product(rows):
    matrix = np.eye(4)
    for row in rows:
        matrix = matrix @ placement_from_mdh(row)
    return matrix


@given(angles, lengths, angles, lengths, angles, lengths)
def test_placement_is_the_product_of_the_six_elementary_ones(gamma, b, alpha, d, theta, r):
    def turned(axis, angle):
        return placement(Rotation.from_euler(axis, angle).as_matrix())

    def moved(x, z):
        return placement(translation=[x, 0, z])

    expected = turned("z", gamma) @ moved(0, b) @ turned("x", alpha) @ moved(d, 0) @ turned("z", theta) @ moved(0, r)
    np.testing.assert_allclose(
        placement_from_mdh(MDHParameters(gamma, b, alpha, d, theta, r)), expected, rtol=0, atol=1e-14
    )


def test_serial_row_is_the_matrix_of_khalil():
    """j-1Tj of a simple chain as printed with the description of the method (γ = b = 0)."""
    alpha, d, theta, r = 0.3, 0.4, -1.1, 0.25
    ca, sa, ct, st_ = math.cos(alpha), math.sin(alpha), math.cos(theta), math.sin(theta)
    expected = [
        [ct, -st_, 0, d],
        [ca * st_, ca * ct, -sa, -r * sa],
        [sa * st_, sa * ct, ca, r * ca],
        [0, 0, 0, 1],
    ]
    np.testing.assert_allclose(placement_from_mdh(MDHParameters(0, 0, alpha, d, theta, r)), expected, atol=1e-15)


@given(angles, angles, angles, lengths, lengths, lengths)
def test_placement_is_one_row_or_two(first, second, third, x, y, z):
    matrix = placement(Rotation.from_euler("zxz", [first, second, third]).as_matrix(), [x, y, z])
    rows = mdh_from_placement(matrix)
    assert len(rows) <= 2 and all(abs(row.gamma) <= math.pi / 2 + 1e-14 for row in rows)
    np.testing.assert_allclose(product(rows), matrix, rtol=0, atol=2e-13)


@pytest.mark.parametrize("exponent", range(-16, -1))
@pytest.mark.parametrize("opposite", [False, True])
def test_nearly_parallel_axes_keep_full_precision(exponent, opposite):
    """One row would lose 4e-9 m at 1e-8 rad, because b and r are huge and cancel."""
    rng = np.random.default_rng(exponent + 20)
    for _ in range(50):
        tilt = 10.0**exponent * rng.uniform(1, 10) + (math.pi if opposite else 0)
        turn = Rotation.from_euler("zxz", [rng.uniform(-3, 3), tilt, rng.uniform(-3, 3)]).as_matrix()
        matrix = placement(turn, rng.uniform(-1, 1, 3))
        rows = mdh_from_placement(matrix)
        assert max(abs(number) for row in rows for number in (row.b, row.r)) < 200
        np.testing.assert_allclose(product(rows), matrix, rtol=0, atol=1e-12)


def test_frames_of_the_panda_are_those_of_its_manufacturer():
    """α, d (their a) and r (their d) of the table in Franka's documentation; joints have no offsets there."""
    rows = [row.parameters for row in build_mdh_table(minimal_frames(load_robot("panda")))][:7]
    published = [
        (0, 0, 0.333),
        (-math.pi / 2, 0, 0),
        (math.pi / 2, 0, 0.316),
        (math.pi / 2, 0.0825, 0),
        (-math.pi / 2, -0.0825, 0.384),
        (math.pi / 2, 0, 0),
        (math.pi / 2, 0.088, 0),
    ]
    for row, (alpha, d, r) in zip(rows, published, strict=True):
        np.testing.assert_allclose(row, (0, 0, alpha, d, 0, r), atol=1e-12)


def test_frames_of_the_ur5e_have_the_lengths_of_its_manufacturer():
    """d1, a2, a3, d4, d5 of Universal Robots' table; d6 lies beyond the last frame."""
    rows = [row.parameters for row in build_mdh_table(minimal_frames(load_robot("ur5e")))]
    assert all(row.gamma == row.b == 0 for row in rows)
    np.testing.assert_allclose([row.r for row in rows], [0.1625, 0, 0, 0.1333, 0.0997, 0], atol=1e-12)
    np.testing.assert_allclose([row.d for row in rows], [0, 0, 0.425, 0.3922, 0, 0], atol=1e-12)


def bent(angle):
    """A chain of three axes, the second one this far from parallel to the others [rad], the third meant at π/2."""
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k - 1}"/><child link="l{k}"/><axis xyz="0 0 1"/>'
        f'<origin xyz="0.3 0.1 0.2" rpy="{rpy}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for k, rpy in ((1, "0 0 0"), (2, f"{angle!r} 0 0"), (3, "1.5708 0 0"))
    )
    links = "".join(
        f'<link name="l{k}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
        "</inertial></link>"
        for k in range(4)
    )
    return read_urdf(f'<robot name="bent">{links}{joints}</robot>')


def test_angles_are_not_snapped_by_default():
    robot = bent(2e-5)
    kept = build_mdh_table(minimal_frames(robot))
    assert len(kept) == 4 and kept[1].joint is None  # the second axis takes two rows
    assert [row.parameters.alpha for row in kept][2:] == pytest.approx([2e-5, 1.5708], abs=1e-12)
    rows = build_mdh_table(minimal_frames(snap_angles(robot, 1e-4)))
    assert [row.parameters.alpha for row in rows] == [0, 0, math.pi / 2]
    assert len(build_mdh_table(minimal_frames(snap_angles(robot, 1e-5)))) == 4
    moved = np.abs(
        Dynamics(snap_angles(robot, 1e-4)).gravity([0.1, 0.2, 0.3]) - Dynamics(robot).gravity([0.1, 0.2, 0.3])
    )
    assert 1e-6 < moved.max() < 1e-2


@pytest.mark.parametrize("name", REAL_ROBOTS)
def test_snapping_moves_frames_of_a_real_robot_within_the_tolerance(name):
    """Each placement turns by at most the tolerance about each of three axes, and does not shift."""
    robot, tolerance = read_urdf(real_urdf(name)), 1e-3
    moved = snap_angles(robot, tolerance)
    for before, after in zip((*robot.joints, *robot.frames), (*moved.joints, *moved.frames), strict=True):
        turn = Rotation.from_matrix(before.placement[:3, :3].T @ after.placement[:3, :3])
        assert turn.magnitude() <= 3 * tolerance
        np.testing.assert_array_equal(before.placement[:3, 3], after.placement[:3, 3])


@given(st.integers(-6, 6), st.integers(-6, 6), st.integers(-6, 6), st.floats(-9e-4, 9e-4), st.floats(-9e-4, 9e-4))
def test_snapping_restores_multiples_of_15_degrees(first, second, third, off, more):
    meant = Rotation.from_euler("zxz", np.array([first, second, third]) * np.pi / 12)
    rotation = (meant * Rotation.from_rotvec([off, more, -off])).as_matrix()
    robot = bent(0.0)
    joint = replace(robot.joints[1], placement=placement(rotation, [0.1, 0.2, 0.3]))
    robot = replace(robot, joints=(robot.joints[0], joint, robot.joints[2]))
    turn = meant.inv() * Rotation.from_matrix(snap_angles(robot, 1e-2).joints[1].placement[:3, :3])
    assert turn.magnitude() < 1e-2


@given(angles, angles, angles)
def test_roll_pitch_yaw_is_exact_even_where_pitch_is_a_right_angle(roll, pitch, yaw):
    for tilt in (pitch, math.pi / 2 + pitch * 1e-9, -math.pi / 2):
        rotation = Rotation.from_euler("xyz", [roll, tilt, yaw]).as_matrix()
        np.testing.assert_allclose(rotation_from_roll_pitch_yaw(roll, tilt, yaw), rotation, rtol=0, atol=4e-15)
        again = Rotation.from_euler("xyz", roll_pitch_yaw(rotation)).as_matrix()
        np.testing.assert_allclose(again, rotation, rtol=0, atol=4e-15)
