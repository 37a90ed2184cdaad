"""Rollouts in other processes, as those of a Dask cluster: one task for a range of simulations."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

TASK_STEPS = 2**17  # steps of all simulations of a task: some tenths of a second, and some 10 MB of results
MIN_TASK_SAMPLES = 8  # simulations that the machine code advances at once


def distribute_rollouts(
    executor: Executor,
    simulate_range: Callable[[int, Array, Array, Array, Array], Array],
    q: Array,
    qd: Array,
    efforts: Array,
    inertias: Array,
    progress: Callable[[float], object] | None,
) -> Array:
    """Simulate ranges of N simulations as tasks of an executor.

    The ranges depend on the numbers of simulations and steps only, and no simulation on the others: the results are
    those of one process, bit for bit.

    Parameters
    ----------
    executor : its processes simulate.
    simulate_range : a function that can be pickled: positions and velocities (2, M, T + 1, n) of M simulations, from
        the number of the first one, their initial positions and velocities (M, n), efforts (M, T, n) or (T, n), and
        inertias (M, 10 k).
    q, qd : (N, n) initial positions and velocities.
    efforts : (N, T, n), or (T, n) of all simulations.
    inertias : (N, 10 k) of the links whose inertias differ.
    progress : called with the part that is done, from 0 to 1, after every task; the tasks end in their order.

    Returns
    -------
    (2, N, T + 1, n)
    """
    samples, size = q.shape
    steps = efforts.shape[-2]
    count = max(MIN_TASK_SAMPLES, TASK_STEPS // max(1, steps))
    ranges = [slice(first, min(first + count, samples)) for first in range(0, samples, count)]
    parts = [efforts[rows] if efforts.ndim == 3 and len(efforts) > 1 else efforts for rows in ranges]
    recorded = np.empty((2, samples, steps + 1, size))
    results = executor.map(
        simulate_range,
        [rows.start for rows in ranges],
        [q[rows] for rows in ranges],
        [qd[rows] for rows in ranges],
        parts,
        [inertias[rows] for rows in ranges],
    )
    for rows, result in zip(ranges, results, strict=True):
        recorded[:, rows] = result
        if progress is not None:
            progress(rows.stop / samples)
    return recorded
