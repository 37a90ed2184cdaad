"""Search for positions that close the loops of a robot, from the initial positions of its description and others.

The search ends where it has enough closed positions, after MAX_ATTEMPTS start positions, or where it has spent
MAX_SEARCH_WORK. The work is counted, not timed: the same description is always accepted, or always refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from robot_dynamics.constraints.attitude_charts import attach_charts, attitudes_within, displace
from robot_dynamics.constraints.loop_equations import AXES_HINT, RANK_TOLERANCE, equations_per_loop, loop_equations
from robot_dynamics.constraints.newton_iteration import CLOSURE_TOLERANCE, MAX_STEP, iterate_newton
from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.newton_euler.screw import apply

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.constraints.attitude_charts import AttitudeJoints
    from robot_dynamics.model.robot import Robot

NEARLY_CLOSED_RESIDUAL = 1e-3
"""Residual below which inexact dimensions may keep a loop open."""
MAX_ATTEMPTS = 60
"""Start positions from which closing the loops is tried."""
EXTRA_POSITIONS = 4
"""Closed positions, besides the first, that are sought."""
NEAR_SPREAD = 0.3
"""Largest distance [rad or characteristic lengths] of start positions from closed ones."""
FAR_SPREAD = 2.0
"""Largest distance [rad or characteristic lengths] of start positions from the initial ones."""
BLOCK_SIZES = (4, 16, MAX_ATTEMPTS)
"""Start positions that are tried together as long as the loops do not close: few at first, which often suffice."""
MAX_BLOCK_ENTRIES = 4_000_000
"""Entries of the Jacobians of start positions that are tried together, for the memory that they take."""

MAX_SEARCH_WORK = 2e9
"""Work of a search; a unit is about one nanosecond. A Gough-Stewart platform takes 8 % of it."""
JOINT_WORK = 25_000
"""Work for each joint in a loop at an evaluation of the loop equations, for any number of samples."""
JOINTS_OF_CHART = 5
"""Joints in loops that take as long as the chart of a platform."""
ENTRY_WORK = 60
"""Work for each entry of the Jacobian of a sample."""
DECOMPOSITION_WORK = 0.6
"""Work for each entry of the Jacobian of a sample, times the smaller one of its numbers of rows and columns."""
PRODUCT_WORK = 0.1
"""Work for each entry of the Jacobian of a sample, times the number of joints."""


class _WorkSpentError(Exception):
    """A search has spent its work."""


class SearchWork:
    """The work that a search has spent.

    Parameters
    ----------
    robot : Robot
    limit : float
        Largest work.

    Attributes
    ----------
    spent : float
    joints_in_loops : int
        Number of joints in loops, those of several loops several times.
    equations : int
        Number of loop equations.
    """

    def __init__(self, robot: Robot, limit: float = MAX_SEARCH_WORK) -> None:
        self.joints_in_loops = sum(len(robot.joints_in_loop(loop)) for loop in robot.loops)
        self.equations = sum(equations_per_loop(robot))
        self.spent = 0.0
        self._limit = limit
        self._joints = len(robot.joints)
        self._evaluation_work = JOINT_WORK * (self.joints_in_loops + JOINTS_OF_CHART * len(robot.platforms))

    def spend(self, moving: int, samples: int) -> None:
        """Count an evaluation of samples with a number of moving joints. Raises _WorkSpentError at the limit."""
        entry_work = ENTRY_WORK + DECOMPOSITION_WORK * min(self.equations, moving) + PRODUCT_WORK * self._joints
        self.spent += self._evaluation_work + samples * self.equations * moving * entry_work
        if self.spent > self._limit:
            raise _WorkSpentError


@dataclass(frozen=True, eq=False)
class _Search:
    """A search for closed positions. Attributes as the arguments of `find_closed_positions`; units: (m,)."""

    robot: Robot
    S: Array
    offset: Array
    attitudes: Sequence[AttitudeJoints]
    columns: Sequence[int]
    passive_columns: Sequence[int]
    units: Array
    work: SearchWork

    def start_positions(self, attempts: range, center: Array, spread: float, directions: Array) -> Array:
        """Start positions (attempts, m) around a center (m,); directions: (MAX_ATTEMPTS, columns), -1 to 1."""
        starts = np.tile(center, (len(attempts), 1))
        starts[:, self.columns] += self.units[self.columns] * spread * directions[attempts.start : attempts.stop]
        return starts

    def close(self, attempts: range, starts: Array) -> Iterator[tuple[Array, Array]]:
        """Yield the end (m,) and the residual (rows,) of each attempt: with even numbers passive joints move alone."""
        ends = np.empty_like(starts)
        residuals = np.empty((len(starts), self.work.equations))
        for parity, moving in enumerate((self.passive_columns, self.columns)):
            selected = slice((parity - attempts.start) % 2, None, 2)
            if not len(starts[selected]):
                continue
            ends[selected], residuals[selected] = close_by_moving(
                self.robot,
                self.S,
                self.offset,
                starts[selected],
                moving,
                MAX_STEP * self.units[moving],
                self.attitudes,
                partial(self.work.spend, len(moving)),
            )
        yield from zip(ends, residuals, strict=True)


def find_closed_positions(
    robot: Robot,
    S: Array,
    offset: Array,
    initial: Array,
    columns: Sequence[int],
    passive_columns: Sequence[int],
    units: Array,
    attitudes: Sequence[AttitudeJoints],
    work: SearchWork | None = None,
) -> list[Array]:
    """Find positions t (m,) that close the loops, the first one from the initial positions if these lead there.

    Parameters
    ----------
    robot : Robot
    S : ndarray, shape (joints, m)
    offset : ndarray, shape (joints,)
        Joint positions are S t + offset.
    initial : ndarray, shape (m,)
        Initial positions.
    columns, passive_columns : sequence of int
        Columns of S of the joints in loops, and of the unactuated ones among them.
    units : ndarray, shape (m,)
        Change of each joint that counts as one radian.
    attitudes : sequence of AttitudeJoints
    work : SearchWork, optional

    Raises
    ------
    DescriptionError
        No positions were found within the limits.
    """
    work = work or SearchWork(robot)
    search = _Search(robot, S, offset, attitudes, columns, passive_columns, units, work)
    directions = np.zeros((MAX_ATTEMPTS, len(columns)))  # the first two attempts start at the initial positions
    directions[2:] = np.random.default_rng(0).uniform(-1, 1, (MAX_ATTEMPTS - 2, len(columns)))
    largest_block = max(1, MAX_BLOCK_ENTRIES // (work.equations * len(robot.joints)))
    positions: list[Array] = []
    nearest: Array | None = None
    sizes = iter(BLOCK_SIZES)
    attempt = 0
    try:
        while attempt < MAX_ATTEMPTS and len(positions) <= EXTRA_POSITIONS:
            size = 1 if attempt < 2 else EXTRA_POSITIONS if positions else next(sizes, MAX_ATTEMPTS)
            attempts = range(attempt, min(attempt + min(size, largest_block), MAX_ATTEMPTS))
            spread, center = (NEAR_SPREAD, positions[0]) if positions and attempt > 1 else (FAR_SPREAD, initial)
            is_first = not positions
            for t, residual in search.close(attempts, search.start_positions(attempts, center, spread, directions)):
                attempt += 1
                if np.abs(residual).max() <= CLOSURE_TOLERANCE:
                    positions.append(t)
                elif nearest is None or np.abs(residual).max() < np.abs(nearest).max():
                    nearest = residual
                if (is_first and positions) or len(positions) > EXTRA_POSITIONS:
                    break  # the next ones start near the first
    except _WorkSpentError:
        if not positions:
            _refuse_work(robot, work, attempt, nearest)
    if not positions:
        assert nearest is not None
        _refuse_open(robot, nearest)
    return positions


def _refuse_work(robot: Robot, work: SearchWork, attempts: int, nearest: Array | None) -> NoReturn:
    """Raise the DescriptionError of a search that has spent its work after a number of attempts."""
    place = ""
    if nearest is not None:
        name, distance, angle = find_widest_loop(robot, nearest)
        place = f"; at best the ends of loop {name!r} stay {distance:.3g} m and {angle:.3g} rad apart"
    raise DescriptionError(
        f"robot {robot.name!r}: its loops were not closed within the limit of work: {len(robot.loops)} loops with "
        f"{work.equations} equations and {work.joints_in_loops} joints (those of several loops counted for each) leave "
        f"{attempts} of {MAX_ATTEMPTS} start positions{place}. Give initial_position to their joints near where they "
        "are closed, or describe fewer loops"
    )


def _refuse_open(robot: Robot, residual: Array) -> NoReturn:
    """Raise the DescriptionError of loops that stay open, with their least residual (rows,)."""
    name, distance, angle = find_widest_loop(robot, residual)
    cut_loops = {robot.loops[number].name for number in cut_joints(robot)}
    hint = "give initial_position to their joints near where they are closed, and check lengths and placements"
    if angle > distance / robot.characteristic_length and name in cut_loops:
        hint = f"{AXES_HINT}, and give initial_position to their joints near where they are closed"
    if np.abs(residual).max() < NEARLY_CLOSED_RESIDUAL:
        hint = "axes that are meant to be parallel must be so to the last digit: write pi/2 for 1.5708, or snap them"
    raise DescriptionError(
        f"robot {robot.name!r}: its loops cannot be closed: the ends of loop {name!r} stay {distance:.3g} m and "
        f"{angle:.3g} rad apart; {hint}"
    )


def find_widest_loop(robot: Robot, residual: Array) -> tuple[str, float, float]:
    """Name of the loop with the largest residual, and the distance [m] and angle [rad] between its ends.

    residual: (rows,), not finite for ends that are half a turn apart.
    """
    residual = np.nan_to_num(residual, nan=np.inf, posinf=np.inf, neginf=-np.inf)
    length = robot.characteristic_length
    first_row = 0
    loops: list[tuple[float, str, float, float]] = []
    for loop, rows in zip(robot.loops, equations_per_loop(robot), strict=True):
        part = residual[first_row : first_row + rows]
        first_row += rows
        distance = float(length * np.linalg.norm(part[:3]))
        angle = float(2 * np.arctan(np.linalg.norm(part[3:]) / 2))
        loops.append((float(np.abs(part).max()), loop.name, distance, angle))
    return max(loops)[1:]


def close_by_moving(
    robot: Robot,
    S: Array,
    offset: Array,
    t: Array,
    moving: Sequence[int] | IntArray,
    max_step: Array,
    attitudes: Sequence[AttitudeJoints] = (),
    on_evaluation: Callable[[int], None] | None = None,
) -> tuple[Array, Array]:
    """Close the loops as far as possible by steps of least length of some joints, the others locked.

    Parameters
    ----------
    robot : Robot
    S : ndarray, shape (joints, m)
    offset : ndarray, shape (joints,)
    t : ndarray, shape (N, m)
        Start positions.
    moving : sequence of int
        Columns of the joints that move.
    max_step : ndarray, shape (moving,)
        Longest step of each of them.
    attitudes : sequence of AttitudeJoints
        Of the robot.
    on_evaluation : callable, optional
        Called before each evaluation of the loop equations with the number of samples; it may raise.

    Returns
    -------
    t : ndarray, shape (N, m)
    residual : ndarray, shape (N, rows)
    """
    t, (residual, _) = iterate_newton(
        _least_norm_step(robot, S, offset, moving, attitudes_within(attitudes, moving), on_evaluation),
        t,
        moving,
        max_step,
        advance=_advance_columns(moving, attitudes_within(attitudes, moving)),
    )
    return t, residual


def _least_norm_step(
    robot: Robot,
    S: Array,
    offset: Array,
    moving: Sequence[int] | IntArray,
    attitudes: Sequence[AttitudeJoints],
    on_evaluation: Callable[[int], None] | None,
) -> Callable[[Array], tuple[Array, Array]]:
    """Evaluates the residual (..., rows) and the step (..., moving) of least length at positions t (..., m)."""

    moving_S = S[:, moving]

    def evaluate(t: Array) -> tuple[Array, Array]:
        if on_evaluation is not None:
            on_evaluation(1 if t.ndim == 1 else len(t))
        equations = loop_equations(*attach_charts(robot, t @ S.T + offset, attitudes, offset))
        J = np.nan_to_num(equations.jacobian @ moving_S, posinf=0, neginf=0)
        pseudo_inverse = np.linalg.pinv(J, rcond=RANK_TOLERANCE)
        return equations.residual, -apply(pseudo_inverse, equations.residual)

    return evaluate


def _advance_columns(
    moving: Sequence[int] | IntArray, attitudes: Sequence[AttitudeJoints]
) -> Callable[[Array, Array], Array]:
    """Adds a step (..., moving) to positions (..., m), in the charts of attitudes."""

    def advance(t: Array, step: Array) -> Array:
        full_step = np.zeros_like(t)
        full_step[..., moving] = step
        end = displace(t, full_step, attitudes)
        locked = np.setdiff1d(np.arange(t.shape[-1]), moving)
        end[..., locked] = t[..., locked]
        return end

    return advance
