"""What selects a program of a robot."""

from typing import NamedTuple

DERIVATIVE_MODELS = ("inverse_derivatives", "direct_derivatives")
"""Models whose outputs are derivatives."""

SOLVING_MODELS = ("inverse", "direct", *DERIVATIVE_MODELS)
"""Models that take external wrenches and the acceleration of the base, and may solve for accelerations."""

PAYLOAD_MODELS = ("inverse", "direct", "inertia_matrix", "gravity", "coriolis", "bias")
"""Models that take the inertias of payloads as arguments."""

FRAME_MODELS = (
    "pose",
    "jacobian",
    "jacobian_in_base_axes",
    "bias_acceleration",
    "bias_acceleration_in_base_axes",
)
"""Models of the motion of a named frame."""

WHOLE_BODY_MODELS = ("centre_of_mass", "centroidal_momentum_matrix", "centroidal_momentum_bias", "kinetic_energy")
"""Models of all bodies together."""


class ProgramKey(NamedTuple):
    """The model and the options that select a program of a robot.

    Attributes
    ----------
    name : str
        A name in MODELS.
    wrenches : tuple of str
        Links on which external wrenches act.
    prescribed_base : bool
        Whether the acceleration of the base is an input.
    with_pivots : bool
        Whether the outputs that reveal singular states are computed too.
    independent : tuple of int or None
        Numbers of the independent joints; None for those of Dynamics.
    frame : str or None
        Name of the frame, for the models in FRAME_MODELS.
    """

    name: str
    wrenches: tuple[str, ...] = ()
    prescribed_base: bool = False
    with_pivots: bool = False
    independent: tuple[int, ...] | None = None
    frame: str | None = None


def attempt_name(model: str, frame: str | None) -> str:
    """Name of a model, or of a model of a frame, by which its checked programs are found."""
    return model if frame is None else f"{model} of {frame}"
