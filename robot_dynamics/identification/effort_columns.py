"""What measured efforts are linear in: base parameters with frictions, offsets of joints, losses of coupled motors."""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.identification.base_parameters import BaseParameters, base_parameters
from robot_dynamics.question import Base
from robot_dynamics.replay.drives import LOSSES


@dataclass(frozen=True, eq=False)
class EffortColumns:
    """Columns of efforts of n joints: `names` (P,), first the base parameters, then offsets, then coupled losses.

    base: the BaseParameters; kept: (b,) numbers of those that have a column, in Dynamics.parameter_names.
    """

    dynamics: object
    drives: object
    base: BaseParameters
    kept: tuple
    names: tuple

    def __setstate__(self, state):
        """In another process, where the program of the regressor is not yet."""
        vars(self).update(state)
        self.dynamics.compile("regressor")

    def of(self, recording):
        """The columns of one recording: all have the same."""
        return self

    def efforts(self, motion):
        """(N, n) what the columns of a Motion make up: unfiltered efforts."""
        return motion.unfiltered

    def rows(self, motion):
        """(N, n, P) of a Motion."""
        return self.rows_at(motion.q, motion.qd, motion.qdd, motion.base)

    def rows_at(self, q, qd, qdd, base=None):
        """(N, n, P) of positions, velocities and accelerations (N, n), and a Base where it moves."""
        return self.rows_of(self.regressor(q, qd, qdd, base), qd, qdd)

    def regressor(self, q, qd, qdd, base=None):
        """Y (N, n, p) of Dynamics.parameter_names, less gravity where efforts exclude it."""
        Y = self.dynamics.regressor(q, qd, qdd, base=base)
        if self.drives.excludes_gravity:
            still = np.zeros_like(qd)
            rest = None if base is None else Base(base.pose, np.zeros(6), np.zeros(6))
            Y = Y - self.dynamics.regressor(q, still, still, base=rest)
        return Y[:, -qd.shape[1] :]  # of a moving base nobody measures the wrench

    def rows_of(self, Y, qd, qdd):
        """(N, n, P) of a regressor Y (N, n, p), velocities and accelerations (N, n)."""
        n = Y.shape[1]
        offsets = np.broadcast_to(np.eye(n), (len(Y), n, n))
        coupled = self.drives.coupling_columns(qd, qdd)
        return np.concatenate([Y[..., list(self.kept)], offsets, coupled], axis=-1)

    @property
    def inertial(self):
        """How many of the columns are inertial, rotors counted, and not friction."""
        return sum(not name.startswith(("Fv.", "Fs.")) for name in self.names[: len(self.kept)])

    @property
    def from_parameters(self):
        """(b, p): base parameters of all parameters of Dynamics.parameter_names."""
        matrix = np.zeros((len(self.kept), len(self.base.names)))
        rows = [self.base.kept.index(number) for number in self.kept]
        matrix[range(len(self.kept)), self.kept] = 1
        matrix[:, self.base.dependent] = self.base.K[rows]
        return matrix

    @property
    def expressions(self):
        """The names, base parameters as the sums that they are."""
        told = dict(zip(self.base.kept, self.base.expressions, strict=True))
        return tuple(told[number] for number in self.kept) + self.names[len(self.kept) :]


def effort_columns(dynamics, drives, *, rotor_inertia=True, compiled=True):
    """The EffortColumns of the robot of a Dynamics; rotor_inertia: whether rotors have columns of their own; compiled:
    whether the regressor is compiled now, as many samples need it.
    """
    base = base_parameters(dynamics, of_joints=True)
    kept = tuple(number for number in base.kept if rotor_inertia or not base.names[number].startswith("Ia."))
    names = [base.names[number] for number in kept] + [f"offset.{name}" for name in dynamics.joint_names]
    shorts = dict(zip(LOSSES, ("Ia", "Fv", "Fs"), strict=True))
    names += [f"{shorts[loss]}.{motor}" for motor in drives.couplings for loss in LOSSES]
    if compiled:
        dynamics.compile("regressor")  # now, rather than after the first pieces
    return EffortColumns(dynamics, drives, base, kept, tuple(names))
