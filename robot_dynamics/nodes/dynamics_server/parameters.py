"""Parameters of the node dynamics_server, besides those of the robot."""

from __future__ import annotations

from robot_dynamics.nodes.parameters import ParameterSpec, by_name

PARAMETERS = by_name(
    ParameterSpec(
        "max_points",
        200_000,
        "largest number of points in a request; requests with more are refused",
        lower_bound=1,
    ),
    ParameterSpec(
        "request_timeout",
        60.0,
        "time after which a request that is not complete is refused [s]",
        lower_bound=0.0,
        is_bound_excluded=True,
    ),
)
