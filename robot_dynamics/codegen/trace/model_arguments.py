"""Arguments that models of a moving base have besides those of the joints."""

MOVING_BASE_ARGUMENTS = ("twist", "gravity")
BASE_ARGUMENTS = {
    "inverse": MOVING_BASE_ARGUMENTS,
    "direct": MOVING_BASE_ARGUMENTS,
    "state_derivative": MOVING_BASE_ARGUMENTS,
    "bias": MOVING_BASE_ARGUMENTS,
    "regressor": MOVING_BASE_ARGUMENTS,
    "gravity": ("gravity",),
    "coriolis": ("twist",),
    "frames": ("twist",),
}
"""Additional arguments of each model where the base moves."""
