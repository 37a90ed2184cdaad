"""Numerical computation of base parameters: the fewest combinations of parameters that the joint efforts depend on.

For trees, the closed-form rules of `codegen.trace.parameter_grouping` group the parameters too. Loops couple the joints
and group further parameters; the numerical method finds them for every structure.

The parameters are those of `Dynamics.parameter_names`: ten of each moving link, then the rotor inertia and the viscous
and Coulomb friction of each joint, with the gravity of the description. The grouping depends on the geometry, on the
joint types, on the direction of gravity relative to the first axes, and on whether the base moves. It does not depend
on parameter values, limits or actuation, as long as all independent joints can move.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.codegen.trace.parameter_grouping import select_independent_columns
from robot_dynamics.constraints.constrained_state import projection_matrix
from robot_dynamics.identification.motion_samples import sample_loop_motions, sample_random_motions
from robot_dynamics.inputs import base_state
from robot_dynamics.newton_euler.regressor import regressor
from robot_dynamics.notebook_display import notebook_html

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics

MOTIONS_PER_PARAMETER = 3
MIN_MOTIONS = 60
MIN_COEFFICIENT = 1e-9
ROUNDING = 1e-11  # relative column length below which a parameter has no effect


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Grouping of the p parameters of a robot into b base parameters θ_independent + K θ_dependent.

    Attributes
    ----------
    names : tuple of str, length p
        Names of all parameters, as in `Dynamics.parameter_names`.
    independent : list of int, length b
        Indices of the parameters that represent the base parameters.
    dependent : list of int, length p - b
        Indices of the other parameters. Parameters without effect have zero columns in K.
    K : (b, p - b) array
        Contribution of each dependent parameter to each base parameter.
    gap : tuple of float, length 2
        Smallest singular value of the regressor that counts towards its rank, and the largest that does not. The
        columns have length 1, and both values are divided by the largest singular value.
    """

    _repr_html_ = notebook_html

    names: tuple[str, ...]
    independent: list[int]
    dependent: list[int]
    K: Array
    gap: tuple[float, float]

    def values(self, parameters: Array) -> Array:
        """Group parameters.

        Parameters
        ----------
        parameters : (..., p) array
            Values of all parameters, in SI units.

        Returns
        -------
        (..., b) array
            Values of the base parameters.
        """
        grouped: Array = parameters[..., self.independent] + parameters[..., self.dependent] @ self.K.T
        return grouped

    def regressor(self, Y: Array) -> Array:
        """Select the columns of a regressor that multiply the base parameters.

        Parameters
        ----------
        Y : (..., p) array
            Rows of the regressor of all parameters.

        Returns
        -------
        (..., b) array
            Rows of the regressor of the base parameters.
        """
        columns: Array = Y[..., self.independent]
        return columns

    @property
    def expressions(self) -> tuple[str, ...]:
        """Each base parameter as a sum, such as `ZZ.link_2 + 0.5 M.link_3`."""
        return tuple(self._expression(row, name) for row, name in enumerate(self.names[k] for k in self.independent))

    def _expression(self, row: int, name: str) -> str:
        terms = [name]
        for column, index in enumerate(self.dependent):
            factor = self.K[row, column]
            if abs(factor) > MIN_COEFFICIENT:
                size = "" if abs(abs(factor) - 1) < MIN_COEFFICIENT else f"{abs(factor):.6g} "
                terms.append(f"{'-' if factor < 0 else '+'} {size}{self.names[index]}")
        return " ".join(terms)


def compute_base_parameters(dynamics: Dynamics, seed: int = 0, *, joint_efforts_only: bool = False) -> BaseParameters:
    """Compute the base parameters of a robot from its regressor at random motions.

    Parameters
    ----------
    dynamics : Dynamics
        Dynamics of the robot.
    seed : int
        Seed of the random motions. The base parameters do not depend on it.
    joint_efforts_only : bool
        Ignore the wrench on a moving base, which recordings do not contain.

    Returns
    -------
    BaseParameters
        Grouping of the parameters.

    Raises
    ------
    DescriptionError
        If the loops of the robot cannot be closed.

    Notes
    -----
    The motions cover the whole range of the joints. With loops, they cover the range that can be reached without
    passing a position at which the mobility changes.

    Source: Gautier, "Numerical calculation of the base inertial parameters of robots" (1991).
    """
    names = dynamics.parameter_names
    samples = max(MIN_MOTIONS, MOTIONS_PER_PARAMETER * len(names) // max(1, len(dynamics.joint_names)))
    sample_regressor = _sample_loop_regressor if dynamics.robot.loops else _sample_tree_regressor
    Y = sample_regressor(dynamics, samples, seed)
    Y = Y[:, -len(dynamics.joint_names) :] if joint_efforts_only else Y
    Y = Y.reshape(-1, len(names))
    lengths = np.linalg.norm(Y, axis=0)
    effective = lengths > ROUNDING * lengths.max(initial=0)
    scale = np.where(effective, lengths, 1.0)  # makes parameters of different units comparable
    independent, dependent, K, gap = select_independent_columns(np.where(effective, Y / scale, 0.0))
    return BaseParameters(names, independent, dependent, K * scale[dependent] / scale[independent][:, None], gap)


def _sample_tree_regressor(dynamics: Dynamics, samples: int, seed: int) -> Array:
    """Compute Y (samples, n, p) at random motions. The six rows of a moving base come first."""
    motions = sample_random_motions(dynamics, samples, seed)
    return dynamics.regressor(motions.q, motions.qd, motions.qdd, base=motions.base)


def _sample_loop_regressor(dynamics: Dynamics, samples: int, seed: int) -> Array:
    """Compute Y (samples, n, p) for efforts along independent motions of the loops.

    There are as many independent motions as independent joints, but they are regular at dead points of motors too.
    """
    robot = dynamics.robot
    motions = sample_loop_motions(robot, samples, seed)
    base = base_state(robot, motions.base)
    assert base.acceleration is not None  # the random motions prescribe it
    Y = regressor(robot, motions.q, motions.qd, motions.qdd, base.twist, base.acceleration)
    P = projection_matrix(motions.directions, 6 if robot.moving_base else 0)
    projected: Array = np.swapaxes(P, -1, -2) @ Y
    return projected
