"""Settings of a controller: mode, gains, limits, times."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.control.modes import REFERENCE
from robot_dynamics.control.natural_adaptation import AdaptationSettings

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.control.modes import ControlMode, FrictionVelocity, NoReferenceAction


@dataclass(frozen=True, eq=False)
class Settings:
    """Settings of the controller of some joints.

    Parameters
    ----------
    mode : {"gravity_compensation", "feedforward", "computed_torque", "pd_gravity", "adaptive_computed_torque"}
        Control law. The last one needs a ControlLaw with `adaptive`, and kd above zero.
    kp, kd : ndarray, shape (joints,)
        Gains of the position error [1/s²] and of the velocity error [1/s].
    limits : ndarray, shape (joints,)
        Maximum magnitude of the efforts [N m or N].
    without_reference : {"gravity", "damp", "zero"}
        Efforts without a reference: gravity compensation, gravity compensation and damping, or zero.
    state_timeout : float
        Age at which a state is stale [s].
    reference_timeout : float
        Duration for which a point of a stream is valid [s].
    ramp_time : float
        Duration of transitions, and of the decay of the efforts to zero after a fault [s].
    deadline : float
        Latency from a state to its efforts that is late [s].
    deadline_misses : int
        Number of late efforts in a row that are a fault.
    friction_velocity : {"reference", "measured"}
        Velocity at which computed_torque compensates friction.
    adaptation : AdaptationSettings
        Of the mode adaptive_computed_torque.
    """

    mode: ControlMode
    kp: Array
    kd: Array
    limits: Array
    without_reference: NoReferenceAction = "damp"
    state_timeout: float = 0.02
    reference_timeout: float = 0.1
    ramp_time: float = 0.1
    deadline: float = 0.005
    deadline_misses: int = 10
    friction_velocity: FrictionVelocity = REFERENCE
    adaptation: AdaptationSettings = field(default_factory=AdaptationSettings)

    def equals(self, settings: Settings) -> bool:
        """Whether other settings are the same."""
        return all(np.array_equal(getattr(self, item.name), getattr(settings, item.name)) for item in fields(self))
