"""Maps of natural frequencies over poses of a platform."""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.parallel.pose_map import evaluate_over_grid


@dataclass(frozen=True, eq=False)
class FrequencyMap:
    """axes: {coordinate: (k,) values [m or rad]}, in the order of the dimensions of what follows.

    reached: (...) whether the legs reach the pose; frequencies: (..., m) [Hz], nan where they do not.
    """

    axes: dict
    reachable: np.ndarray
    frequencies: np.ndarray


def frequency_map(dynamics, axes, fixed_coordinates=None, count=5, threads=1, progress=None):
    """The FrequencyMap of a parallel robot over a grid: its first `count` frequencies.

    axes: {coordinate: values} of the grid, such as {"x": linspace(-0.1, 0.1, 41)}; at: {coordinate: value} of the
    others, where the robot begins if left out; threads: how many share the work; progress: is called with the share
    that is done. The program of the matrices is compiled first, where there can be one.

    Raises QuestionError for coordinates that the platform has not.
    """
    elastodynamics = dynamics.elastodynamics
    elastodynamics.compile_if_possible()

    def part(poses):
        q, reachable = dynamics.platform.reach(poses)
        found = np.full((len(poses), count), np.nan)
        if reachable.any():
            some = elastodynamics.frequencies(q[reachable], count=count, threads=threads)
            found[reachable, : some.shape[-1]] = some
        return reachable, found

    return FrequencyMap(dict(axes), *evaluate_over_grid(dynamics, axes, fixed_coordinates, part, progress))
