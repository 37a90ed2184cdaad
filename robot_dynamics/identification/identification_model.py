"""The linear model of measured efforts: base parameters with friction, joint offsets, and losses of coupled motors.

Terms of friction that the description does not have can be added (`friction_terms`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from robot_dynamics.identification.base_parameters import compute_base_parameters
from robot_dynamics.identification.friction_terms import friction_term_columns
from robot_dynamics.inputs import Base
from robot_dynamics.newton_euler.friction import FRICTION_PARAMETERS, LOAD_PARAMETER
from robot_dynamics.recordings.drives import DRIVE_PARAMETERS

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.identification.base_parameters import BaseParameters
    from robot_dynamics.identification.friction_terms import FrictionTerm
    from robot_dynamics.recordings.drives import Drives
    from robot_dynamics.recordings.joint_motions import Motion
    from robot_dynamics.recordings.recording import Recording

FRICTION_PREFIXES = tuple(f"{parameter}." for parameter in FRICTION_PARAMETERS)


class EffortModel(Protocol):
    """A model in which measured efforts (N, k) are linear in P parameters."""

    @property
    def dynamics(self) -> Dynamics:
        """Dynamics of the robot."""

    def for_recording(self, recording: Recording) -> EffortModel:
        """Return the model of one recording."""

    def efforts(self, motion: Motion) -> Array:
        """Compute the unfiltered efforts (N, k) on the left side of the linear equations."""

    def motion_regressor(self, motion: Motion) -> Array:
        """Compute the columns (N, k, P) of a motion."""


class JointEffortModel(EffortModel, Protocol):
    """An EffortModel whose parameters are those of an IdentificationModel."""

    @property
    def identification_model(self) -> IdentificationModel:
        """The model that names the parameters."""


@dataclass(frozen=True, eq=False)
class IdentificationModel:
    """Model of the efforts of n joints, linear in P parameters.

    names: (P,), first the base parameters, then the terms of friction, then the joint offsets, then the losses of
    coupled motors; parameter_indices: (b,) indices in Dynamics.parameter_names of the base parameters that have a
    column; terms: T terms of friction that the description does not have; load_values: (b,) values of the base
    parameters from which the loads of the joints are computed, None: loads are zero.
    """

    dynamics: Dynamics
    drives: Drives
    base_parameters: BaseParameters
    parameter_indices: tuple[int, ...]
    names: tuple[str, ...]
    terms: tuple[FrictionTerm, ...] = ()
    load_values: Array | None = None

    def __setstate__(self, state: dict[str, object]) -> None:
        """Restore the model in another process and compile its regressor there."""
        vars(self).update(state)
        self.dynamics.compile("regressor")

    @property
    def identification_model(self) -> IdentificationModel:
        """The model itself."""
        return self

    def for_recording(self, recording: Recording) -> IdentificationModel:
        """Return the model of one recording, which is the same for all recordings."""
        return self

    def efforts(self, motion: Motion) -> Array:
        """Return the unfiltered efforts (N, n) of a motion."""
        return motion.unfiltered_efforts

    def motion_regressor(self, motion: Motion) -> Array:
        """Compute the columns (N, n, P) of a motion."""
        return self.regressor_at(motion.q, motion.qd, motion.qdd, motion.base)

    def regressor_at(self, q: Array, qd: Array, qdd: Array, base: Base | None = None) -> Array:
        """Compute the columns (N, n, P) at positions, velocities and accelerations (N, n); base: if it moves."""
        return self.reduce_regressor(self.full_regressor(q, qd, qdd, base), qd, qdd)

    def full_regressor(self, q: Array, qd: Array, qdd: Array, base: Base | None = None) -> Array:
        """Compute Y (N, n, p) for all Dynamics.parameter_names, without gravity if the efforts exclude it."""
        Y: Array = self.dynamics.regressor(q, qd, qdd, base=base)
        if self.drives.excludes_gravity:
            zero = np.zeros_like(qd)
            base_at_rest = None if base is None else Base(base.pose, np.zeros(6), np.zeros(6))
            Y = Y - self.dynamics.regressor(q, zero, zero, base=base_at_rest)
        joint_rows: Array = Y[:, -qd.shape[1] :]  # recordings do not contain the wrench on a moving base
        return joint_rows

    def reduce_regressor(self, Y: Array, qd: Array, qdd: Array) -> Array:
        """Compute the columns (N, n, P) from a full regressor Y (N, n, p), velocities and accelerations (N, n)."""
        n = Y.shape[1]
        base_columns = Y[..., list(self.parameter_indices)]
        loads = np.zeros_like(qd) if self.load_values is None else base_columns @ (self.load_values * self._is_inertial)
        terms = friction_term_columns(self.terms, qd, loads)
        offsets = np.broadcast_to(np.eye(n), (len(Y), n, n))
        coupling = self.drives.coupling_regressor(qd, qdd)
        return np.concatenate([base_columns, terms, offsets, coupling], axis=-1)

    def with_terms(self, terms: Sequence[FrictionTerm], load_values: Array | None) -> IdentificationModel:
        """Return the model with these terms of friction in place of its own.

        load_values: (b,) values of the base parameters, for the loads of the joints.
        """
        b = len(self.parameter_indices)
        joints = self.dynamics.joint_names
        names = [f"{term.parameter}.{joints[term.joint]}" for term in terms]
        names = [*self.names[:b], *names, *self.names[self.robot_count :]]
        return replace(self, names=tuple(names), terms=tuple(terms), load_values=load_values)

    def select_parameters(self, selected: BoolArray) -> IdentificationModel:
        """Return the model without the base parameters and terms that are not among those selected (P,)."""
        b = len(self.parameter_indices)
        kept = np.array(selected)
        kept[self.robot_count :] = True
        return replace(
            self,
            parameter_indices=tuple(np.array(self.parameter_indices)[kept[:b]].tolist()),
            names=tuple(name for name, is_kept in zip(self.names, kept, strict=True) if is_kept),
            terms=tuple(term for term, is_kept in zip(self.terms, kept[b:], strict=False) if is_kept),
            load_values=None if self.load_values is None else self.load_values[kept[:b]],
        )

    @property
    def has_load_terms(self) -> bool:
        """Whether a term of friction depends on loads."""
        return any(term.parameter == LOAD_PARAMETER for term in self.terms)

    @property
    def robot_count(self) -> int:
        """Number b + T of base parameters and terms of friction, which come first and which a description contains."""
        return len(self.parameter_indices) + len(self.terms)

    @property
    def robot_names(self) -> tuple[str, ...]:
        """Names (p + T,) of the parameters of the description, then of the terms of friction."""
        return self.base_parameters.names + self.names[len(self.parameter_indices) : self.robot_count]

    @property
    def robot_parameters(self) -> Array:
        """Values (p + T,) of `robot_names` in the description, which does not have the terms."""
        return np.concatenate([self.dynamics.parameters, np.zeros(len(self.terms))])

    @property
    def _is_inertial(self) -> BoolArray:
        """Which base parameters (b,) are inertial: all but friction, rotor inertias included."""
        return np.array([not name.startswith(FRICTION_PREFIXES) for name in self.names[: len(self.parameter_indices)]])

    @property
    def inertial_count(self) -> int:
        """Number of base parameters that are inertial: all but friction, rotor inertias included."""
        return int(self._is_inertial.sum())

    @property
    def robot_grouping_matrix(self) -> Array:
        """(b + T, p + T) matrix that groups `robot_parameters` into the first parameters of the model."""
        b = len(self.parameter_indices)
        p = len(self.base_parameters.names)
        matrix = np.zeros((self.robot_count, p + len(self.terms)))
        matrix[:b, :p] = self.grouping_matrix
        matrix[b:, p:] = np.eye(len(self.terms))
        return matrix

    @property
    def grouping_matrix(self) -> Array:
        """(b, p) matrix that groups Dynamics.parameters into the base parameters that have a column."""
        matrix = np.zeros((len(self.parameter_indices), len(self.base_parameters.names)))
        rows = [self.base_parameters.independent.index(index) for index in self.parameter_indices]
        matrix[range(len(self.parameter_indices)), self.parameter_indices] = 1
        matrix[:, self.base_parameters.dependent] = self.base_parameters.K[rows]
        return matrix

    @property
    def expressions(self) -> tuple[str, ...]:
        """(P,) names, with each base parameter as a sum of parameters."""
        sums = dict(zip(self.base_parameters.independent, self.base_parameters.expressions, strict=True))
        return tuple(sums[index] for index in self.parameter_indices) + self.names[len(self.parameter_indices) :]


def build_identification_model(
    dynamics: Dynamics, drives: Drives, *, rotor_inertia: bool = True, compiled: bool = True
) -> IdentificationModel:
    """Build the identification model of a robot with its drives.

    rotor_inertia: whether rotors have parameters of their own; compiled: whether to compile the regressor now, which
    pays off for many samples.
    """
    base = compute_base_parameters(dynamics, joint_efforts_only=True)
    indices = tuple(index for index in base.independent if rotor_inertia or not base.names[index].startswith("Ia."))
    prefixes = dict(zip(DRIVE_PARAMETERS, ("Ia", "Fv", "Fs"), strict=True))
    names = [base.names[index] for index in indices]
    names += [f"offset.{name}" for name in dynamics.joint_names]
    names += [f"{prefixes[loss]}.{motor}" for motor in drives.coupling_ratios for loss in DRIVE_PARAMETERS]
    if compiled:
        dynamics.compile("regressor")
    return IdentificationModel(dynamics, drives, base, indices, tuple(names))
