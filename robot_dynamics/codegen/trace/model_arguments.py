"""Arguments that models of a moving base have besides those of the joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_dynamics.newton_euler.friction import has_load_friction

if TYPE_CHECKING:
    from robot_dynamics.model.robot import Robot

MOVING_BASE_ARGUMENTS = ("twist", "gravity")
BASE_ARGUMENTS = {
    "inverse": MOVING_BASE_ARGUMENTS,
    "direct": MOVING_BASE_ARGUMENTS,
    "state_derivative": MOVING_BASE_ARGUMENTS,
    "bias": MOVING_BASE_ARGUMENTS,
    "regressor": MOVING_BASE_ARGUMENTS,
    "inverse_derivatives": MOVING_BASE_ARGUMENTS,
    "direct_derivatives": MOVING_BASE_ARGUMENTS,
    "gravity": ("gravity",),
    "coriolis": ("twist",),
    "frames": ("twist",),
    "bias_acceleration": ("twist",),
    "bias_acceleration_in_base_axes": ("twist",),
    "centroidal_momentum_bias": ("twist",),
    "kinetic_energy": ("twist",),
    "momentum": MOVING_BASE_ARGUMENTS,
}
"""Additional arguments of each model where the base moves."""


def base_argument_names(model: str, robot: Robot) -> tuple[str, ...]:
    """Names of the arguments of a model of a robot that describe the state of its base."""
    if not robot.moving_base:
        return ()
    if model == "friction" and has_load_friction(robot):
        return MOVING_BASE_ARGUMENTS
    return BASE_ARGUMENTS.get(model, ())
