"""What measured efforts are linear in: base parameters with frictions, offsets of joints, losses of coupled motors."""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.identification.base_parameters import BaseParameters, compute_base_parameters
from robot_dynamics.inputs import Base
from robot_dynamics.recordings.drives import DRIVE_PARAMETERS


@dataclass(frozen=True, eq=False)
class IdentificationModel:
    """Columns of efforts of n joints: `names` (P,), first the base parameters, then offsets, then coupled losses.

    base: the BaseParameters; kept: (b,) numbers of those that have a column, in Dynamics.parameter_names.
    """

    dynamics: object
    drives: object
    base_parameters: BaseParameters
    parameter_indices: tuple
    names: tuple

    def __setstate__(self, state):
        """In another process, where the program of the regressor is not yet."""
        vars(self).update(state)
        self.dynamics.compile("regressor")

    def for_recording(self, recording):
        """The columns of one recording: all have the same."""
        return self

    def efforts(self, motion):
        """(N, n) what the columns of a Motion make up: unfiltered efforts."""
        return motion.unfiltered_efforts

    def motion_regressor(self, motion):
        """(N, n, P) of a Motion."""
        return self.regressor_at(motion.q, motion.qd, motion.qdd, motion.base)

    def regressor_at(self, q, qd, qdd, base=None):
        """(N, n, P) of positions, velocities and accelerations (N, n), and a Base where it moves."""
        return self.reduce_regressor(self.full_regressor(q, qd, qdd, base), qd, qdd)

    def full_regressor(self, q, qd, qdd, base=None):
        """Y (N, n, p) of Dynamics.parameter_names, less gravity where efforts exclude it."""
        Y = self.dynamics.regressor(q, qd, qdd, base=base)
        if self.drives.excludes_gravity:
            still = np.zeros_like(qd)
            rest = None if base is None else Base(base.pose, np.zeros(6), np.zeros(6))
            Y = Y - self.dynamics.regressor(q, still, still, base=rest)
        return Y[:, -qd.shape[1] :]  # of a moving base nobody measures the wrench

    def reduce_regressor(self, Y, qd, qdd):
        """(N, n, P) of a regressor Y (N, n, p), velocities and accelerations (N, n)."""
        n = Y.shape[1]
        offsets = np.broadcast_to(np.eye(n), (len(Y), n, n))
        coupled = self.drives.coupling_regressor(qd, qdd)
        return np.concatenate([Y[..., list(self.parameter_indices)], offsets, coupled], axis=-1)

    @property
    def inertial_count(self):
        """How many of the columns are inertial, rotors counted, and not friction."""
        return sum(not name.startswith(("Fv.", "Fs.")) for name in self.names[: len(self.parameter_indices)])

    @property
    def grouping_matrix(self):
        """(b, p): base parameters of all parameters of Dynamics.parameter_names."""
        matrix = np.zeros((len(self.parameter_indices), len(self.base_parameters.names)))
        rows = [self.base_parameters.independent.index(number) for number in self.parameter_indices]
        matrix[range(len(self.parameter_indices)), self.parameter_indices] = 1
        matrix[:, self.base_parameters.dependent] = self.base_parameters.K[rows]
        return matrix

    @property
    def expressions(self):
        """The names, base parameters as the sums that they are."""
        told = dict(zip(self.base_parameters.independent, self.base_parameters.expressions, strict=True))
        return tuple(told[number] for number in self.parameter_indices) + self.names[len(self.parameter_indices) :]


def build_identification_model(dynamics, drives, *, rotor_inertia=True, compiled=True):
    """The EffortColumns of the robot of a Dynamics; rotor_inertia: whether rotors have columns of their own; compiled:
    whether the regressor is compiled now, as many samples need it.
    """
    base = compute_base_parameters(dynamics, joint_efforts_only=True)
    kept = tuple(number for number in base.independent if rotor_inertia or not base.names[number].startswith("Ia."))
    names = [base.names[number] for number in kept] + [f"offset.{name}" for name in dynamics.joint_names]
    shorts = dict(zip(DRIVE_PARAMETERS, ("Ia", "Fv", "Fs"), strict=True))
    names += [f"{shorts[loss]}.{motor}" for motor in drives.coupling_ratios for loss in DRIVE_PARAMETERS]
    if compiled:
        dynamics.compile("regressor")  # now, rather than after the first pieces
    return IdentificationModel(dynamics, drives, base, kept, tuple(names))
