"""Maps of natural frequencies over poses of a platform."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.notebook_display import notebook_html
from robot_dynamics.parallel.pose_map import check_dynamics, complete_coordinates, evaluate_over_grid

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, BoolArray, ScalarArray
    from robot_dynamics.dynamics import Dynamics


@dataclass(frozen=True, eq=False)
class FrequencyMap:
    """Natural frequencies of a parallel robot over a grid of poses; `frequency_map` returns it.

    Attributes
    ----------
    axes : dict of str to array_like, shape (k,)
        Coordinates of the grid [m or rad], in the order of the dimensions (...) below.
    reachable : ndarray of bool, shape (...)
        Whether the legs reach the pose.
    frequencies : (..., m)
        [Hz], ascending; nan where the legs do not reach the pose.
    fixed_coordinates : dict of str to float
        The other free coordinates [m or rad].
    """

    _repr_html_ = notebook_html

    axes: dict[str, ArrayLike]
    reachable: BoolArray
    frequencies: Array
    fixed_coordinates: dict[str, float] = field(default_factory=dict)


def frequency_map(
    dynamics: Dynamics,
    axes: Mapping[str, ArrayLike],
    fixed_coordinates: Mapping[str, float] | None = None,
    count: int = 5,
    threads: int = 1,
    progress: Callable[[float], object] | None = None,
) -> FrequencyMap:
    """Compute the lowest natural frequencies of a parallel robot over a grid of poses.

    The program of the matrices is compiled first, where there is one.

    Parameters
    ----------
    dynamics : Dynamics
        Of a robot with one platform.
    axes : mapping of str to array_like, shape (k,)
        Values of the coordinates of the grid [m or rad], such as ``{"x": linspace(-0.1, 0.1, 41)}``.
    fixed_coordinates : mapping of str to float, optional
        Values of the other free coordinates. Default: those of the initial positions.
    count : int
        Number of frequencies.
    threads : int
        Number of threads.
    progress : callable, optional
        Called with the completed fraction, 0 to 1.

    Returns
    -------
    FrequencyMap

    Raises
    ------
    InvalidInputError
        The robot has no platform or several; a coordinate is unknown, not free, or both varied and fixed.
    """
    check_dynamics(dynamics)
    elastodynamics = dynamics.elastodynamics
    elastodynamics.compile_if_possible()

    def evaluate(poses: Array) -> tuple[ScalarArray, ...]:
        q, reachable = dynamics.platform.reach(poses)
        frequencies = np.full((len(poses), count), np.nan)
        if reachable.any():
            of_reachable = elastodynamics.frequencies(q[reachable], count=count, threads=threads)
            frequencies[reachable, : of_reachable.shape[-1]] = of_reachable
        return reachable, frequencies

    reachable, frequencies = evaluate_over_grid(dynamics, axes, fixed_coordinates, evaluate, progress)
    return FrequencyMap(dict(axes), reachable, frequencies, complete_coordinates(dynamics, axes, fixed_coordinates))
