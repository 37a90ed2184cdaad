"""The linear model of the efforts that a payload adds to those of a robot whose model without load is trusted.

Left side: measured efforts minus those of the model without load. Columns: the ten inertial parameters of the payload
in the frame of the link that carries it, then what else may differ from the model: viscous friction, Coulomb friction
and offset of each joint, which change with temperature. With recordings without the payload, all parameters of the
robot take the place of friction and offsets: they are common to the recordings with and without payload, so that
errors of the model that appear in both do not count as payload.

Friction that grows with the load of a joint grows with the payload too. The model is therefore that of the robot with
an estimate of the payload, whose columns times the estimate are added to the left side again.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.dynamics import Dynamics
from robot_dynamics.model.inertia import Inertia, symmetric_matrix
from robot_dynamics.model.robot import attach_payload
from robot_dynamics.newton_euler.regressor import LINK_PARAMETERS, link_parameters

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.identification.identification_model import IdentificationModel
    from robot_dynamics.inputs import Base
    from robot_dynamics.recordings.joint_motions import Motion
    from robot_dynamics.recordings.recording import Recording

PAYLOAD_COUNT = len(LINK_PARAMETERS)


def to_parameters(inertia: Inertia) -> Array:
    """LINK_PARAMETERS (10,) of an inertia."""
    return np.array(link_parameters(inertia), dtype=float)


def to_inertia(parameters: Array) -> Inertia:
    """The inertia with LINK_PARAMETERS (10,)."""
    return Inertia(float(parameters[9]), parameters[6:9], symmetric_matrix(*parameters[:6]))


def parameter_transformation(placement: Array) -> Array:
    """Matrix (10, 10) that maps LINK_PARAMETERS in frame j to those in frame i, for the placement iTj (4, 4)."""
    columns = [to_parameters(to_inertia(unit).transformed_by(placement)) for unit in np.eye(PAYLOAD_COUNT)]
    return np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class PayloadModel:
    """Model of the efforts of n joints that a payload adds, linear in P parameters.

    Attributes
    ----------
    model : IdentificationModel
        Model of the robot with the estimated payload; without it in the first pass.
    link : str
        Frame that carries the payload, and in which its parameters are given.
    estimate : (10,) array
        LINK_PARAMETERS of the estimated payload, zero in the first pass.
    empty_recordings : frozenset of str
        Names of the recordings without payload.
    empty_model : IdentificationModel
        Model of the robot without payload, for these recordings.
    recording_name : str or None
        Name of this recording.
    """

    model: IdentificationModel
    link: str
    empty_model: IdentificationModel
    estimate: Array = field(default_factory=lambda: np.zeros(PAYLOAD_COUNT))
    empty_recordings: frozenset[str] = frozenset()
    recording_name: str | None = None

    @property
    def dynamics(self) -> Dynamics:
        """Dynamics of the robot with the estimated payload."""
        return self.model.dynamics

    @property
    def names(self) -> tuple[str, ...]:
        """(P,) names of the parameters: those of the payload first."""
        payload = tuple(f"{key}.{self.link}" for key in LINK_PARAMETERS)
        if self.empty_recordings:
            return payload + self.model.names
        return payload + tuple(f"{key}.{name}" for key in ("Fv", "Fs", "offset") for name in self.dynamics.joint_names)

    def for_recording(self, recording: Recording) -> PayloadModel:
        """Return the model of one recording."""
        return replace(self, recording_name=recording.name)

    def with_estimate(self, estimate: Array) -> PayloadModel:
        """Return the model of the robot with an estimate (10,) of the payload."""
        robot = attach_payload(self.empty_model.dynamics.robot, self.link, to_inertia(estimate))
        return replace(self, model=replace(self.empty_model, dynamics=Dynamics(robot)), estimate=estimate)

    def efforts(self, motion: Motion) -> Array:
        """Measured, unfiltered efforts (N, n) minus those of the robot without payload."""
        model = self.empty_model if self._is_empty else self.model
        Y = model.full_regressor(motion.q, motion.qd, motion.qdd, motion.base)
        efforts = motion.unfiltered_efforts - Y @ model.dynamics.parameters
        efforts = efforts - model.drives.drive_efforts(motion.qd, motion.qdd)
        return efforts if self._is_empty else efforts + self._payload_columns(Y) @ self.estimate

    def motion_regressor(self, motion: Motion) -> Array:
        """Compute the columns (N, n, P) of a motion."""
        Y = self.model.full_regressor(motion.q, motion.qd, motion.qdd, motion.base)
        payload = self._payload_columns(Y) * (not self._is_empty)
        if self.empty_recordings:
            return np.concatenate([payload, self.model.reduce_regressor(Y, motion.qd, motion.qdd)], axis=-1)
        joints = np.eye(motion.qd.shape[1])
        curves = (motion.qd, np.sign(motion.qd), np.ones_like(motion.qd))
        return np.concatenate([payload, *(curve[..., None] * joints for curve in curves)], axis=-1)

    def payload_regressor_at(self, q: Array, qd: Array, qdd: Array, base: Base | None = None) -> Array:
        """Compute the columns (N, n, 10) of the payload at positions, velocities and accelerations (N, n)."""
        return self._payload_columns(self.empty_model.full_regressor(q, qd, qdd, base))

    @property
    def _is_empty(self) -> bool:
        return self.recording_name in self.empty_recordings

    def _payload_columns(self, Y: Array) -> Array:
        """Columns (N, n, 10) of the payload from a full regressor Y (N, n, p)."""
        robot = self.dynamics.robot
        frame = robot.frame(self.link)
        first = self.dynamics.parameter_names.index(f"XX.{robot.links[frame.link].name}")
        columns: Array = Y[..., first : first + PAYLOAD_COUNT] @ parameter_transformation(frame.placement)
        return columns
