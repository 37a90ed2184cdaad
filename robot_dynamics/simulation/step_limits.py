"""Limits of a step that hold in machine code and in Python."""

MIN_RATE_SCALE = 1.0
"""Least rate [rad/s or characteristic lengths/s] that errors are compared with."""

TOLERANCE = 1e-7
"""Relative error of a part of a step. The estimate is of order 4: the error of the method is far smaller."""

NEAR_SINGULAR_QUALITY = 1e-2
"""Quality of coordinates below which each stage of a step is put on the constraints."""

DEGRADATION_RATIO = 0.1
"""Ratio of the quality to its best value at which a set of coordinates is compared with others."""

MAX_TRAVEL = 0.1
"""Longest travel of a joint of loops in a part of a step elsewhere [rad or characteristic lengths]."""

MAX_CORRECTION = 5e-3
"""Correction of positions after a part of a step that is accepted [rad or characteristic lengths]."""

RECORDED_STEPS = 50
"""Steps of one call that records all of them."""
