"""Closed positions in a chosen assembly mode: nearest to a seed, or the mode of the reference positions."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robot_dynamics.constraints.closure_search import close_by_moving
from robot_dynamics.constraints.newton_iteration import MAX_STEP, SHORT_STRIDE

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot_dynamics.array_types import Array
    from robot_dynamics.constraints.branch_tracker import BranchTracker, ClosureResult
    from robot_dynamics.constraints.topology import ConstraintTopology

    Path: TypeAlias = Callable[[BranchTracker, Array, Array], ClosureResult]
    """Leads from closed positions (N, m) to positions (N, n) of the independent joints."""

MAX_HALVINGS = 30
"""Halvings of the distance to a dead centre."""


def solve_closure(tracker: BranchTracker, q: Array, seed: Array | None) -> ClosureResult:
    """Closed positions for q (N, n), near a seed (N, dependent), or in the mode of the reference positions."""
    return solve_closure_from_reference(tracker, q) if seed is None else solve_closure_near_seed(tracker, q, seed)


def solve_closure_near_seed(tracker: BranchTracker, q: Array, seed: Array) -> ClosureResult:
    """Closed positions nearest to a seed.

    Parameters
    ----------
    tracker : BranchTracker
    q : ndarray, shape (N, n)
        Positions of the independent joints.
    seed : ndarray, shape (N, dependent)
        Approximate positions of the dependent joints, nan where unknown. A sample without any seed is closed as by
        `solve_closure_from_reference`.
    """
    topology = tracker.topology
    t = np.empty((len(q), len(topology.non_mimic_joints)))
    t[:, topology.independent_columns] = q
    t[:, topology.dependent_columns] = seed
    is_unknown = np.isnan(seed)
    is_partial = np.asarray(is_unknown.any(axis=-1))
    has_no_seed = np.asarray(is_unknown.all(axis=-1))
    if not is_partial.any():
        return tracker.project_onto_constraints(t)
    reference = solve_closure_from_reference(tracker, q[is_partial])
    is_usable = ~reference.has_crossed_singularity & reference.is_closed
    start = np.where(is_usable[:, None], reference.t, topology.reference_positions)
    t[is_partial] = _complete_seed(topology, t[is_partial], start)
    result = tracker.project_onto_constraints(t)
    result.assign_samples(has_no_seed, reference, has_no_seed[is_partial])
    return result


def _complete_seed(topology: ConstraintTopology, t: Array, start: Array) -> Array:
    """t (N, m) with its nan entries replaced.

    These joints move from `start` (N, m) to where the loops are nearest to closed while all others stay: so a seed of
    some joints chooses the assembly mode of all.
    """
    is_unknown = np.isnan(t)
    for pattern in np.unique(is_unknown, axis=0):
        samples = (is_unknown == pattern).all(axis=-1)
        moving = np.flatnonzero(pattern)
        max_step = MAX_STEP * topology.column_units[moving]
        begin = np.where(pattern, start[samples], t[samples])
        t[samples], _ = close_by_moving(
            topology.robot, topology.S, topology.offset, begin, moving, max_step, topology.attitudes
        )
    return t


def solve_closure_from_reference(tracker: BranchTracker, q: Array) -> ClosureResult:
    """Closed positions in the assembly mode of the reference positions, for q (N, n) of the independent joints.

    Paths lead from the reference positions to q, whole turns left out: first the straight path, then others for the
    samples that it leaves open or in another mode.
    """
    topology = tracker.topology
    target = _remove_turns(topology, q)
    start = np.broadcast_to(topology.reference_positions, (len(q), len(topology.non_mimic_joints)))
    result = _check_mode(tracker.follow_path(start, target))
    all_samples = np.ones(len(q), dtype=bool)
    paths = (
        (_follow_with_short_strides, all_samples),
        (_follow_by_halves, result.has_bend),
        (_follow_joint_by_joint, all_samples),
        (partial(_follow_joint_by_joint, is_reversed=True), all_samples),
    )
    for follow, is_candidate in paths:
        samples = np.flatnonzero(is_candidate & (result.has_crossed_singularity | ~result.is_closed))
        if not len(samples):
            continue
        trial = _check_mode(follow(tracker, start[samples], target[samples]))
        is_better = ~trial.has_crossed_singularity & trial.is_closed
        result.assign_samples(samples[is_better], trial, is_better)
    result.t[:, topology.independent_columns] = q
    return result


def _follow_with_short_strides(tracker: BranchTracker, start: Array, target: Array) -> ClosureResult:
    """The straight path with shorter strides."""
    return tracker.follow_path(start, target, SHORT_STRIDE)


def _follow_joint_by_joint(
    tracker: BranchTracker, start: Array, target: Array, is_reversed: bool = False
) -> ClosureResult:
    """A path that moves one independent joint after the other: around positions at which the loops cannot close."""
    joints = range(target.shape[1])
    has_bend = np.zeros(len(target), dtype=bool)
    for joint in reversed(joints) if is_reversed else joints:
        corner = start[:, tracker.topology.independent_columns]
        corner[:, joint] = target[:, joint]
        result = tracker.follow_path(start, corner)
        start = result.t
        has_bend = has_bend | result.has_bend
    return result._replace(has_bend=has_bend)


def _follow_by_halves(tracker: BranchTracker, start: Array, target: Array) -> ClosureResult:
    """The straight path in parts that halve the distance to the target: the path curves ever more at a dead centre."""
    first = start[:, tracker.topology.independent_columns]
    has_bend = np.zeros(len(target), dtype=bool)
    for fraction in (*0.5 ** np.arange(1, MAX_HALVINGS), 0.0):
        result = tracker.follow_path(start, target + fraction * (first - target), SHORT_STRIDE)
        start = result.t
        has_bend = has_bend | result.has_bend
    return result._replace(has_bend=has_bend)


def _check_mode(result: ClosureResult) -> ClosureResult:
    """The result with `has_crossed_singularity` set by the determinant and by bends."""
    has_crossed = ~(np.linalg.det(result.determinant_matrix) > 0) | result.has_bend
    return result._replace(has_crossed_singularity=has_crossed)


def _remove_turns(topology: ConstraintTopology, q: Array) -> Array:
    """q (N, n) without the whole turns by which revolute joints are away from the reference positions.

    Turns stay where both positions are within finite limits, which determine the direction. Joints that move no loop
    get their reference positions.
    """
    reference = topology.reference_positions[topology.independent_columns]
    lower, upper = topology.independent_limits
    is_limited = np.isfinite(upper - lower) & (lower <= reference) & (reference <= upper)
    is_inside = is_limited & (lower <= q) & (q <= upper)
    turns = np.round((q - reference) / (2 * np.pi))
    nearest = q - np.where(topology.is_periodic & ~is_inside, 2 * np.pi * turns, 0.0)
    return np.where([moved.any() for moved in topology.loop_joints_moved], nearest, reference)
