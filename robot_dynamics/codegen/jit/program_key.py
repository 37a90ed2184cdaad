"""What selects a program of a robot."""

from typing import NamedTuple

DERIVATIVE_MODELS = ("inverse_derivatives", "direct_derivatives")
"""Models whose outputs are derivatives."""

SOLVING_MODELS = ("inverse", "direct", *DERIVATIVE_MODELS)
"""Models that take external wrenches and the acceleration of the base, and may solve for accelerations."""


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
    """

    name: str
    wrenches: tuple[str, ...] = ()
    prescribed_base: bool = False
    with_pivots: bool = False
    independent: tuple[int, ...] | None = None
