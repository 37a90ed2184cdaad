"""The NaVARo against the frequencies that Briot and Khalil print, and against an independent frame of beams."""

import numpy as np
import pytest
from peers.navaro import navaro_frame

from robot_dynamics import Dynamics, InvalidInputError, SingularModelError, load_robot
from robot_dynamics.flexible.elastodynamics import Elastodynamics
from robot_dynamics.parallel.platform_dynamics import pose_from_coordinates

POSES = {"a": (0, 0, -np.pi / 3), "b": (0, 0, 0), "c": (0, -0.135, 0), "d": (0, -0.21, 0)}
TABLE_2 = {  # Hz, as printed, of Cast3M and of the paper's model alike
    "a": (44.10, 44.10, 53.98, 60.63, 95.62),
    "b": (45.71, 45.71, 54.58, 65.35, 97.92),
    "c": (36.98, 49.31, 53.37, 67.28, 91.80),
    "d": (40.17, 50.32, 52.99, 67.36, 91.52),
}
ASKEW = [(0.05, 0.03, 0.2), (-0.04, -0.1, -0.7), (0.021, 0.067, -0.9), (-0.1, 0.02, 0.35)]


@pytest.fixture(scope="module")
def dynamics():
    return Dynamics(load_robot("navaro"))


def platform_pose(x, y, theta):
    return pose_from_coordinates(np.array([x, y, 0, theta, 0, 0]))


def test_frequencies_agree_with_table_2_of_the_paper(dynamics):
    """Table 2 of the paper; config/robots/navaro.yaml lists the inferred inputs."""
    for pose, printed in TABLE_2.items():
        actual = dynamics.elastodynamics.frequencies(pose=platform_pose(*POSES[pose]), count=5)
        assert np.abs(actual - printed).max() < 0.01, pose


def test_numbers_of_generalized_and_independent_coordinates(dynamics):
    """Section 4: 144, of which 90 are independent."""
    elastodynamics = dynamics.elastodynamics
    assert len(elastodynamics.coordinates) == len(set(elastodynamics.coordinates)) == 144
    matrices = elastodynamics.matrices(pose=platform_pose(*ASKEW[0]))
    assert matrices.mass.shape == matrices.stiffness.shape == (90, 90)
    assert matrices.expansion.shape == (144, 90)


@pytest.mark.parametrize("pose", [*POSES.values(), *ASKEW])
def test_all_frequencies_agree_with_a_frame_of_finite_elements(dynamics, pose):
    actual = dynamics.elastodynamics.frequencies(pose=platform_pose(*pose))
    expected = navaro_frame(*pose).frequencies()
    assert actual.shape == expected.shape == (90,)
    assert np.abs(actual / expected - 1).max() < 1e-8


def test_matrices_are_definite_and_modes_solve_the_eigenvalue_problem(dynamics):
    matrices = dynamics.elastodynamics.matrices(pose=platform_pose(*ASKEW[1]))
    result = dynamics.elastodynamics.natural_frequencies(pose=platform_pose(*ASKEW[1]))
    assert np.linalg.eigvalsh(matrices.mass).min() > 0
    assert np.linalg.eigvalsh(matrices.stiffness).min() > 0
    shapes = result.mode_shapes[:, list(matrices.independent)].T
    elastic_forces = matrices.stiffness @ shapes
    inertial_forces = matrices.mass @ shapes * (2 * np.pi * result.frequencies) ** 2
    assert np.abs(elastic_forces - inertial_forces).max() < 1e-7 * np.abs(elastic_forces).max()


@pytest.mark.parametrize("pose", [POSES["b"], *ASKEW[:2]])
def test_planar_variant_has_the_modes_in_the_plane(dynamics, pose):
    """r = 3 (eq. 10): motion in the plane is decoupled from the other motion."""
    pose = platform_pose(*pose)
    spatial = dynamics.elastodynamics.natural_frequencies(pose=pose)
    planar = Elastodynamics(dynamics, planar=True).frequencies(pose=pose)
    joints = {joint.name for joint in dynamics.robot.joints}
    in_plane = [name in joints or name.endswith((".x", ".y", ".rz")) for name in spatial.coordinates]
    sizes = np.abs(spatial.mode_shapes) / np.abs(spatial.mode_shapes).max(axis=-1, keepdims=True)
    chosen = sizes[:, in_plane].max(axis=-1) > sizes[:, np.logical_not(in_plane)].max(axis=-1)
    assert chosen.sum() == len(planar) == 51
    assert np.abs(planar / spatial.frequencies[chosen] - 1).max() < 1e-9


def test_batch_and_program_agree_with_single_samples_and_recursion(dynamics):
    poses = np.array([platform_pose(*pose) for pose in ASKEW])
    elastodynamics = Elastodynamics(dynamics)
    single = np.array([elastodynamics.frequencies(pose=pose) for pose in poses])
    assert np.abs(elastodynamics.frequencies(pose=poses) / single - 1).max() < 1e-9
    recursion = elastodynamics.matrices(pose=poses)
    pytest.importorskip("llvmlite")
    elastodynamics.compile()
    program = elastodynamics.matrices(pose=poses)
    for name in ("mass", "stiffness", "expansion"):
        expected = getattr(recursion, name)
        assert np.abs(getattr(program, name) - expected).max() < 1e-12 * np.abs(expected).max(), name
    assert np.abs(elastodynamics.frequencies(pose=poses, threads=2) / single - 1).max() < 1e-9
    assert np.abs(elastodynamics.matrices(pose=poses[0]).mass - recursion.mass[0]).max() < 1e-14


def test_program_has_fewer_operations_than_that_of_the_paper(dynamics):
    operations = dynamics.elastodynamics.operations
    assert operations.additions <= 36183
    assert operations.multiplications + operations.divisions <= 37341


def test_released_motors_leave_a_mechanism(dynamics):
    """With cranks and arms held the platform cannot move; with all of them free it has three rigid motions."""
    free = Elastodynamics(dynamics, held=[])
    result = free.natural_frequencies(pose=platform_pose(*ASKEW[0]))
    assert np.sum(result.frequencies == 0) == 3
    assert np.isfinite(result.frequencies).all()
    assert np.isfinite(result.mode_shapes).all()


def test_pose_out_of_reach_is_refused_with_the_remaining_gap(dynamics):
    with pytest.raises(SingularModelError, match=r"does not close.*apart"):
        dynamics.elastodynamics.frequencies(pose=platform_pose(0.6, 0, 0))


def test_stretched_leg_is_refused_as_singular(dynamics):
    """The distance from E to A is that of two stretched bars: a singular pose."""
    with pytest.raises(SingularModelError, match=r"singular|does not close"):
        dynamics.elastodynamics.frequencies(pose=platform_pose(0, 0.7 / np.sqrt(3) - 0.2027 - 0.42, 0))


def test_invalid_arguments_are_refused(dynamics):
    with pytest.raises(InvalidInputError, match="one of the two"):
        dynamics.elastodynamics.frequencies()
    with pytest.raises(InvalidInputError, match="count is 0"):
        dynamics.elastodynamics.frequencies(pose=platform_pose(0, 0, 0), count=0)
    with pytest.raises(InvalidInputError, match="unknown joint 'crank_4'"):
        Elastodynamics(dynamics, held=["crank_4"])
