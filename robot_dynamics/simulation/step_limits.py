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

MAX_SUBSTEPS = 256
"""Number of parts into which a step may be divided."""

MAX_CONTACT_SUBSTEPS = 65536
"""Number of parts into which a step may be divided where a point meets the ground."""

MAX_RELATIVE_ERROR = 1e-2
"""Relative error of the shortest parts from which the step fails."""

STEP_GROWTH_THRESHOLD = 1e-3
"""Error, relative to the tolerance, below which the next part is twice as long."""

ROUNDING_SHARE = 1e-9
"""Share of a step that is rounding."""

RECORDED_STEPS = 50
"""Steps of one call that records all of them."""
