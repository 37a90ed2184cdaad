"""Base parameters: the fewest combinations of inertial and friction parameters that efforts depend on, by numbers.

For trees the closed-form rules of `symbolic.base_parameters` find them too; loops tie joints together, so that more
parameters become one, which numbers tell whatever the structure.

All parameters of `Dynamics.parameter_names` count: ten of each link that moves, then rotor inertia, viscous and Coulomb
friction of each joint, with the gravity that the description has. How many of them become one depends on the geometry,
on which joints turn or slide, on the direction of gravity beside the first axes, and on whether the base moves; values
of the parameters, limits and motors have no part in it, as long as a motion of all independent joints is left.
"""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.codegen.trace.parameter_grouping import select_independent_columns
from robot_dynamics.constraints.topology import projection_matrix
from robot_dynamics.identification.motion_samples import sample_loop_motions, sample_random_motions
from robot_dynamics.inputs import base_state
from robot_dynamics.newton_euler.regressor import regressor

MOTIONS_PER_PARAMETER = 3
MIN_MOTIONS = 60
MIN_COEFFICIENT = 1e-9
ROUNDING = 1e-11  # a column this much shorter than the longest one has no effect


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Which parameters of a robot are seen together.

    names: (p,) of all parameters, as Dynamics.parameter_names; kept, dependent: numbers of them; K (kept, dependent):
    the base parameters are θ_kept + K θ_dependent; gap: the least singular value of the regressor that counts, and the
    largest that does not, as parts of the largest of all, its columns having length 1.
    """

    names: tuple
    independent: list
    dependent: list
    K: np.ndarray
    gap: tuple

    def values(self, parameters):
        """The base parameters (..., b) of parameters (..., p)."""
        return parameters[..., self.independent] + parameters[..., self.dependent] @ self.K.T

    def regressor(self, Y):
        """The columns (..., b) of a regressor (..., p) that go with `values`."""
        return Y[..., self.independent]

    @property
    def expressions(self):
        """Each base parameter as a sum, such as `ZZ.link_2 + 0.5 M.link_3`."""
        return tuple(self._expression(row, name) for row, name in enumerate(self.names[k] for k in self.independent))

    def _expression(self, row, name):
        told = [name]
        for column, number in enumerate(self.dependent):
            factor = self.K[row, column]
            if abs(factor) > MIN_COEFFICIENT:
                size = "" if abs(abs(factor) - 1) < MIN_COEFFICIENT else f"{abs(factor):.6g} "
                told.append(f"{'-' if factor < 0 else '+'} {size}{self.names[number]}")
        return " ".join(told)


def compute_base_parameters(dynamics, seed=0, *, joint_efforts_only=False):
    """The BaseParameters of the robot of a Dynamics, from its regressor at random motions of its whole range.

    of_joints: those that efforts of joints depend on, where the wrench on a moving base is not measured; seed: of the
    motions, on which the parameters do not depend. Parameters without any effect are in none of them. With loops,
    motions are of the whole range that they reach without passing a position at which their mobility changes.
    """
    names = dynamics.parameter_names
    samples = max(MIN_MOTIONS, MOTIONS_PER_PARAMETER * len(names) // max(1, len(dynamics.joint_names)))
    rows = _rows_with_loops if dynamics.robot.loops else _rows
    Y = rows(dynamics, samples, seed)
    Y = Y[:, -len(dynamics.joint_names) :] if joint_efforts_only else Y
    Y = Y.reshape(-1, len(names))
    lengths = np.linalg.norm(Y, axis=0)
    seen = lengths > ROUNDING * lengths.max(initial=0)
    scale = np.where(seen, lengths, 1.0)  # so that parameters of different units compare
    independent, dependent, K, gap = select_independent_columns(np.where(seen, Y / scale, 0.0))
    return BaseParameters(names, independent, dependent, K * scale[dependent] / scale[independent][:, None], gap)


def _rows(dynamics, samples, seed):
    """Y (samples, n, p) of random motions, the rows of a moving base first."""
    motions = sample_random_motions(dynamics, samples, seed)
    return dynamics.regressor(motions.q, motions.qd, motions.qdd, base=motions.base)


def _rows_with_loops(dynamics, samples, seed):
    """As `_rows`, for efforts along independent motions in the place of independent joints: as many as these are, but
    regular at dead points of motors too."""
    robot, motions = dynamics.robot, sample_loop_motions(dynamics.robot, samples, seed)
    base = base_state(robot, motions.base)
    Y = regressor(robot, motions.q, motions.qd, motions.qdd, base.twist, base.acceleration)
    P = projection_matrix(motions.directions, 6 if robot.moving_base else 0)
    return np.swapaxes(P, -1, -2) @ Y
