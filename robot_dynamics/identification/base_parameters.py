"""Base parameters: the fewest combinations of inertial and friction parameters that efforts depend on, by numbers.

For trees the closed-form rules of `symbolic.base_parameters` find them too; loops tie joints together, so that more
parameters become one, which numbers tell whatever the structure.
"""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.identification.motions import random_motions
from robot_dynamics.symbolic.base_parameters import independent_columns

MOTIONS_PER_PARAMETER = 3
SMALLEST_COEFFICIENT = 1e-9
ROUNDING = 1e-11  # a column this much shorter than the longest one has no effect


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Which parameters of a robot are seen together.

    names: (p,) of all parameters, as Dynamics.parameter_names; kept, dependent: numbers of them; K (kept, dependent):
    the base parameters are θ_kept + K θ_dependent.
    """

    names: tuple
    kept: list
    dependent: list
    K: np.ndarray

    def values(self, parameters):
        """The base parameters (..., b) of parameters (..., p)."""
        return parameters[..., self.kept] + parameters[..., self.dependent] @ self.K.T

    def regressor(self, Y):
        """The columns (..., b) of a regressor (..., p) that go with `values`."""
        return Y[..., self.kept]

    @property
    def expressions(self):
        """Each base parameter as a sum, such as `ZZ.link_2 + 0.5 M.link_3`."""
        return tuple(self._expression(row, name) for row, name in enumerate(self.names[k] for k in self.kept))

    def _expression(self, row, name):
        told = [name]
        for column, number in enumerate(self.dependent):
            factor = self.K[row, column]
            if abs(factor) > SMALLEST_COEFFICIENT:
                size = "" if abs(abs(factor) - 1) < SMALLEST_COEFFICIENT else f"{abs(factor):.6g} "
                told.append(f"{'-' if factor < 0 else '+'} {size}{self.names[number]}")
        return " ".join(told)


def base_parameters(dynamics, seed=0, *, of_joints=False):
    """The BaseParameters of the robot of a Dynamics, from its regressor at random motions within its limits.

    of_joints: those that efforts of joints depend on, where the wrench on a moving base is not measured.
    Parameters without any effect are in none of them. Raises SingularModelError where loops hardly ever close.
    """
    names = dynamics.parameter_names
    samples = max(20, MOTIONS_PER_PARAMETER * len(names) // max(1, len(dynamics.joint_names)))
    motions = random_motions(dynamics, samples, seed)
    Y = dynamics.regressor(motions.q, motions.qd, motions.qdd, base=motions.base)
    Y = Y[:, -motions.qd.shape[1] :] if of_joints else Y
    lengths = np.linalg.norm(Y.reshape(-1, len(names)), axis=0)
    seen = lengths > ROUNDING * lengths.max(initial=0)
    scale = np.where(seen, lengths, 1.0)  # so that parameters of different units compare
    kept, dependent, K = independent_columns(np.where(seen, Y.reshape(-1, len(names)) / scale, 0.0))
    return BaseParameters(names, kept, dependent, K * scale[dependent] / scale[kept][:, None])
