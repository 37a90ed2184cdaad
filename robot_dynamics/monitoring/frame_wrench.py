"""Wrench of the environment at a named frame from external torques of the joints, by least squares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, BoolArray
    from robot_dynamics.dynamics import Dynamics

WrenchKind: TypeAlias = Literal["wrench", "force"]
"""Six components, or a force at the origin of the frame without a torque."""

LENGTH = 0.3
"""Length [m] by which torques are divided where they are compared with forces: about the lever of a wrist."""

MAX_CONDITION = 100.0
"""Ratio of singular values beyond which a direction counts as undetermined."""

MAX_UNDETERMINED_PART = 0.05
"""Part of a component in undetermined directions beyond which its value is not reported."""

COMPONENTS = ("force x", "force y", "force z", "torque x", "torque y", "torque z")


@dataclass(frozen=True, eq=False)
class FrameWrench:
    """A wrench and how well the joints determine it.

    Attributes
    ----------
    wrench : ndarray, shape (6,)
        [force; torque] of the environment on the link [N, N m], in the frame at its origin; nan for components that
        the joints do not determine.
    condition : float
        Ratio of the largest to the smallest singular value of the equations, torques divided by `LENGTH` and joints by
        their scales; inf where a direction has no effect on any joint.
    unexplained : float
        RMS of the external torques beside those of the wrench, divided by their scales; zero where as many joints as
        components are determined.
    """

    wrench: Array
    condition: float
    unexplained: float

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the components that the joints do not determine."""
        return tuple(name for name, value in zip(COMPONENTS, self.wrench, strict=True) if np.isnan(value))


class WrenchEstimator:
    """Solves Jᵀ f = τ_ext for the wrench f at one frame, by least squares of the torques divided by their scales.

    The rows of a moving base are not used: the ground acts on them too.

    Parameters
    ----------
    dynamics : Dynamics
        The Jacobian is compiled now.
    frame : str
        Name of the frame.
    kind : {"wrench", "force"}
        What is solved for.
    scales : array_like, shape (n,), optional
        Accuracies of the external torques, above zero. Default: 1.

    Raises
    ------
    InvalidInputError
        The frame is unknown or no joint moves it.
    """

    def __init__(
        self, dynamics: Dynamics, frame: str, kind: WrenchKind = "wrench", scales: ArrayLike | None = None
    ) -> None:
        robot = dynamics.robot
        if robot.frame(frame).link == 0:
            raise InvalidInputError(f"frame {frame!r} is fixed to the base: no joint torque depends on a wrench there")
        self.frame = frame
        self.kind = kind
        n = len(dynamics.joint_names)
        weights = np.ones(n) if scales is None else 1 / np.asarray(scales, dtype=float)
        self._weights: Array = np.where(np.isfinite(weights), weights, 0.0)
        self._jacobian = dynamics.compile("jacobian", frame=frame)
        self._columns = slice(6 if robot.moving_base else 0, None)
        self._components = slice(0, 3 if kind == "force" else 6)
        self._units = np.array([1.0] * 3 + [LENGTH] * 3)[self._components]

    def estimate(self, positions: Array, torques: Array) -> FrameWrench:
        """The wrench at program positions, as `MomentumBalance` has them, and external torques (n,) of the joints."""
        J = self._jacobian.evaluate(positions)[self._components, self._columns]
        equations = (J * self._units[:, None]).T * self._weights[:, None]  # of [force; torque / LENGTH]
        right_side = torques * self._weights
        U, singular_values, Vt = np.linalg.svd(equations, full_matrices=False)
        largest = float(singular_values[0])
        is_determined: BoolArray = singular_values * MAX_CONDITION > largest if largest else singular_values > 0
        Vt, U = Vt[is_determined], U[:, is_determined]
        coordinates = U.T @ right_side
        solution = (coordinates / singular_values[is_determined]) @ Vt
        undetermined_part = np.sqrt(np.maximum(0.0, 1 - np.sum(Vt**2, axis=0)))
        wrench = np.zeros(6)
        wrench[self._components] = np.where(undetermined_part <= MAX_UNDETERMINED_PART, solution * self._units, np.nan)
        size = len(self._units)
        smallest = float(singular_values[-1]) if len(singular_values) == size else 0.0
        condition = largest / smallest if smallest > largest * np.finfo(float).eps else np.inf
        rest = right_side - U @ coordinates
        freedom = np.count_nonzero(self._weights) - np.count_nonzero(is_determined)
        unexplained = float(np.sqrt(rest @ rest / freedom)) if freedom > 0 else 0.0
        return FrameWrench(wrench, condition, unexplained)
