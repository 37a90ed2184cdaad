"""Modes of control: what the efforts are made of, and what happens without a reference."""

from typing import Literal, TypeAlias

ControlMode: TypeAlias = Literal[
    "gravity_compensation", "feedforward", "computed_torque", "pd_gravity", "adaptive_computed_torque"
]
NoReferenceAction: TypeAlias = Literal["gravity", "damp", "zero"]
FrictionVelocity: TypeAlias = Literal["reference", "measured"]

GRAVITY: Literal["gravity_compensation"] = "gravity_compensation"
FEEDFORWARD: Literal["feedforward"] = "feedforward"
COMPUTED_TORQUE: Literal["computed_torque"] = "computed_torque"
PD_GRAVITY: Literal["pd_gravity"] = "pd_gravity"
ADAPTIVE: Literal["adaptive_computed_torque"] = "adaptive_computed_torque"
FIXED_MODEL_MODES: tuple[ControlMode, ...] = (GRAVITY, FEEDFORWARD, COMPUTED_TORQUE, PD_GRAVITY)
"""Modes whose model does not change: those of robot_dynamics_control."""
MODES: tuple[ControlMode, ...] = (*FIXED_MODEL_MODES, ADAPTIVE)
NO_REFERENCE_ACTIONS: tuple[NoReferenceAction, ...] = ("gravity", "damp", "zero")
CollisionAction: TypeAlias = Literal["none", "hold", "retract", "gravity_compensation"]
COLLISION_ACTIONS: tuple[CollisionAction, ...] = ("none", "hold", "retract", "gravity_compensation")
REFERENCE: Literal["reference"] = "reference"
MEASURED: Literal["measured"] = "measured"
FRICTION_VELOCITIES: tuple[FrictionVelocity, ...] = (REFERENCE, MEASURED)
