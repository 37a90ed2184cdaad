"""Each condition of a path that SampleClosure follows: where it alone is violated, the closure has a status.

The loop equations are replaced by functions with known solutions, so that all other conditions hold.
"""

import numpy as np
import pytest

from robot_dynamics import load_robot
from robot_dynamics.constraints.closure_solver import ClosureSolver
from robot_dynamics.constraints.closure_step import NewtonStep
from robot_dynamics.constraints.newton_iteration import MAX_STRIDE
from robot_dynamics.constraints.sample_closure import MAX_SAMPLE_STRIDES, SampleClosure


@pytest.fixture(scope="module")
def topology():
    return ClosureSolver(load_robot("gough_stewart")).topology


class KnownLoops:
    """Loop equations of a platform that keeps its place, or moves by a known displacement.

    Parameters
    ----------
    topology : ConstraintTopology
    length : float
        Of the path of the first leg, in units of its joint.

    Attributes
    ----------
    displacement, residual, pivot : callable
        Of the joints t (m,); of the equations; of J_d. Functions of the place on the path, 0 to 1.
    determinant_matrix : ndarray, shape (2, 2)
    """

    def __init__(self, topology, length):
        self._topology = topology
        self._closure = SampleClosure(topology, self._newton_step)
        self._closure._tangent[topology.dependent_columns] = 0
        self._start = topology.reference_positions
        self._length = length * topology.column_units[topology.independent_columns[0]]
        self.displacement = lambda place: np.zeros(len(self._start))
        self.residual = lambda place: 0.0
        self.pivot = lambda place: 1.0
        self.determinant_matrix = np.eye(2)

    def _newton_step(self, t):
        columns = self._topology.dependent_columns
        leg = self._topology.independent_columns[0]
        place = (t - self._start)[leg] / self._length
        step = (self._start + self.displacement(place) - t)[columns]
        ones = np.ones(len(step))
        return NewtonStep(-step + self.residual(place), step, self.pivot(place) * ones, ones, self.determinant_matrix)

    def is_closed(self):
        """Whether SampleClosure closes the loops at the end of the path."""
        return self._closure.close_from_reference(self._target).status == 0

    def is_followed(self):
        """The same for paths with bends, as `sample_continuation` follows them."""
        direction = np.zeros(len(self._start))
        *_, is_regular = self._closure._follow_path(self._start, direction, self._target, MAX_STRIDE, True)
        return is_regular

    @property
    def _target(self):
        target = self._start[self._topology.independent_columns].copy()
        target[0] += self._length
        return target


def between(begin, end):
    """1 at places from `begin` to `end`, 0 elsewhere."""
    return lambda place: float(begin <= place <= end)


def jump_of_a_leg(topology):
    """(m,) a displacement of one dependent joint that is no angle of the platform."""
    angles = {column for attitude in topology.dependent_attitudes for column in attitude.columns}
    column = next(column for column in topology.dependent_columns if column not in angles)
    jump = np.zeros(len(topology.reference_positions))
    jump[column] = 0.3 * topology.column_units[column]
    return jump


def tilt(topology):
    """(m,) a displacement of one radian of the pitch of the platform."""
    displacement = np.zeros(len(topology.reference_positions))
    displacement[topology.dependent_attitudes[0].columns[1]] = 1.0
    return displacement


@pytest.fixture
def loops(topology):
    known = KnownLoops(topology, 3.0)
    assert known.is_closed()
    return known


def test_a_path_on_which_the_loops_do_not_close_is_refused(loops):
    """Newton's method ends there without a change of t, and closes the loops at the target."""
    loops.residual = between(0.3, 0.6)
    assert not loops.is_closed()


def test_a_path_to_a_target_at_which_the_loops_do_not_close_is_refused(loops):
    loops.residual = between(0.9999, 1.1)
    assert not loops.is_closed()


def test_a_path_that_leaves_its_branch_and_returns_is_refused(loops, topology):
    jump = jump_of_a_leg(topology)
    loops.displacement = lambda place: jump * between(0.3, 0.6)(place)
    assert not loops.is_closed()


def test_a_path_that_leaves_its_branch_with_its_last_stride_is_refused(loops, topology):
    jump = jump_of_a_leg(topology)
    loops.displacement = lambda place: jump * between(0.9999, 1.1)(place)
    assert not loops.is_closed()


def test_a_path_through_a_steep_pitch_is_refused(topology):
    """The pitch grows slowly up to 75 degrees, and becomes small again."""
    loops = KnownLoops(topology, 12.0)
    pitch = tilt(topology)
    loops.displacement = lambda place: np.radians(50) * np.sin(np.pi * place) ** 2 * pitch
    assert loops.is_closed()
    loops.displacement = lambda place: np.radians(75) * np.sin(np.pi * place) ** 2 * pitch
    assert not loops.is_closed()


@pytest.mark.parametrize("strides", [3, 5])  # the pitch is steep before the last stride; before another one
def test_a_path_with_a_stride_that_begins_at_a_steep_pitch_is_refused(topology, strides):
    loops = KnownLoops(topology, (strides - 0.5) * MAX_STRIDE)
    pitch = tilt(topology)
    loops.displacement = lambda place: np.radians(10) * strides * place * pitch
    assert loops.is_followed()
    loops.displacement = lambda place: np.radians(45) * strides * place * pitch
    assert not loops.is_followed()


def test_a_path_of_more_than_100_strides_is_refused(topology):
    assert KnownLoops(topology, 0.99 * MAX_SAMPLE_STRIDES * MAX_STRIDE).is_closed()
    assert not KnownLoops(topology, 1.01 * MAX_SAMPLE_STRIDES * MAX_STRIDE).is_closed()


def test_a_target_at_which_the_loops_do_not_determine_all_joints_is_refused(loops):
    loops.pivot = lambda place: 1.0 - between(0.9999, 1.1)(place)
    assert not loops.is_closed()


def test_a_target_in_another_assembly_mode_is_refused(loops):
    loops.determinant_matrix = np.diag([1.0, -1.0])
    assert not loops.is_closed()
