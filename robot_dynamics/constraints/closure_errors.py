"""Errors for samples whose loops do not close, with the loop, its distances and a remedy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.constraints.closure_search import NEARLY_CLOSED_RESIDUAL, find_widest_loop
from robot_dynamics.constraints.newton_iteration import CLOSURE_TOLERANCE, MIN_QUALITY
from robot_dynamics.errors import SingularModelError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from robot_dynamics.array_types import BoolArray, IntArray
    from robot_dynamics.constraints.branch_tracker import ClosureResult
    from robot_dynamics.constraints.topology import ConstraintTopology


def is_valid(result: ClosureResult) -> BoolArray:
    """(N,) whether the loops are closed, regular, and in the assembly mode that was sought."""
    return result.is_closed & (result.quality > MIN_QUALITY) & ~result.has_crossed_singularity


def refuse_open(
    topology: ConstraintTopology, result: ClosureResult, numbers: Sequence[int] | IntArray, many: bool = False
) -> None:
    """Raise SingularModelError for the first sample whose loops are open or singular.

    numbers: of the samples, for messages; many: whether they name the sample.
    """
    valid = is_valid(result)
    if valid.all():
        return
    sample = int(np.argmin(valid))
    robot = topology.robot
    residual = float(np.abs(result.residual[sample]).max())
    location = f" at sample {numbers[sample]}" if many else ""
    with np.errstate(all="ignore"):
        condition = f"(condition number {topology.condition_number(result.t[sample]):.3g})"
        name, distance, angle = find_widest_loop(robot, result.residual[sample])
    if not residual <= CLOSURE_TOLERANCE:
        hint = ". These positions are out of reach; if they are not, give positions of all joints near the solution"
        if residual < NEARLY_CLOSED_RESIDUAL:
            hint = "; if it is meant to close there, its axes or lengths are not exact"
        raise SingularModelError(
            f"loop {name!r} does not close{location}: its ends stay {distance:.3g} m and {angle:.3g} rad apart "
            f"{condition}{hint}"
        )
    if not result.quality[sample] > MIN_QUALITY:
        dependent = ", ".join(robot.joints[number].name for number in topology.dependent)
        raise SingularModelError(
            f"loop {name!r} is singular{location}: it closes (residual {residual:.2g}), but does not determine "
            f"{dependent} {condition}"
        )
    raise SingularModelError(
        f"the loops close{location} in another assembly mode than at the initial positions {condition}: a singular "
        "position lies between, or nearly. Give the positions of all joints, near the intended ones"
    )
