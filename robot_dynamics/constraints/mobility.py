"""Which joints of a robot with loops are free, and which ones the loops place then.

The mobility is the number of joints in loops less the rank of the loops' equations, found by numbers where the loops
are closed: planar loops have redundant equations, others by their geometry. Passive joints of loops depend on the
others. Where that leaves too few, elastic ones do; motors never.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import qr

from robot_dynamics.constraints.attitude_charts import attach_charts, displace, find_attitude_joints
from robot_dynamics.constraints.loop_equations import equations_per_loop, loop_equations
from robot_dynamics.constraints.newton_iteration import MAX_STEP, iterate_newton
from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.cut_joints import cut_joints

RANK_TOLERANCE = 1e-6  # singular values below this part of the largest one count as none
CLOSURE_TOLERANCE = 1e-11  # residual at which a loop is closed [characteristic lengths, rad]
NEARLY_CLOSED_RESIDUAL = 1e-3  # and at which it may be meant to be
MAX_GOOD_CONDITION = 1e3
MAX_ATTEMPTS = 60  # configurations from which closing the loops is tried
AXES_HINT = (
    "the axis of the joint at which a loop is cut is z of both its frames and points the same way: turn them by rpy"
)
EXTRA_CONFIGURATIONS = 4  # configurations beside the first in which the rank is taken


class MobilityResult(NamedTuple):
    """dependent: places, among the joints that follow no other one, of those that the loops place; t (m,): positions
    of the joints that follow no other one, at which the loops are closed and far from singular."""

    dependent: np.ndarray
    t: np.ndarray


def find_dependent_columns(robot, S, offset, free):
    """The Mobility of a robot with loops, whose joint positions are S t + offset, t those of the joints `free`.

    Raises DescriptionError where the loops cannot be closed, and where joints with motor, and elastic ones, are not as
    many as the mobility or depend on each other.
    """
    looped = [k for k in range(len(free)) if any(row in robot.joints_in_loops for row in np.flatnonzero(S[:, k]))]
    found = _closed_configurations(robot, S, offset, free, looped)
    attitudes = find_attitude_joints(robot, free)
    of_rank = [_jacobian(robot, S, offset, t, attitudes) for t in found]
    ranks = [np.linalg.matrix_rank(J, tol=RANK_TOLERANCE * np.linalg.norm(J, 2)) for J in of_rank]
    passive = [k for k in looped if not robot.joints[free[k]].actuated]
    jacobians = [_jacobian(robot, S, offset, t, _within(attitudes, passive)) for t in found]
    best, refused = [], None
    for t, J, rank in zip(found, jacobians, ranks, strict=True):
        if rank == max(ranks):
            try:
                dependent = _dependent(robot, free, looped, J, rank)
            except DescriptionError as error:  # which may be so at this configuration alone
                refused = refused or error
                continue
            best.append((np.linalg.cond(J[:, dependent]) if len(dependent) else 1.0, t, dependent))
    if not best:
        raise refused
    condition, t, dependent = next(
        (one for one in best if one[0] < MAX_GOOD_CONDITION), min(best, key=lambda one: one[0])
    )
    if condition > 1 / RANK_TOLERANCE:
        _refuse(robot, free, looped, max(ranks), "the joints that no motor drives are not placed by them")
    return MobilityResult(dependent, t)


def _closed_configurations(robot, S, offset, free, looped):
    """Positions t of joints at which the loops are closed: the first from the initial positions, if they lead there."""
    attitudes = find_attitude_joints(robot, free)
    unit, slides = robot.characteristic_length, np.array([robot.joints[number].prismatic for number in free])
    reach = np.where(slides, unit, 1.0)
    passive = [k for k in looped if not robot.joints[free[k]].actuated]
    start = np.array([robot.joints[number].initial_position for number in free])
    chance = np.random.default_rng(0)
    found, nearest = [], None
    for attempt in range(MAX_ATTEMPTS):
        t, moving = start.copy(), passive if attempt % 2 == 0 else looped
        if attempt > 1:  # near what was found, else anywhere
            spread = 0.3 if found else 2.0
            t[looped] = (found[0] if found else start)[looped] + reach[looped] * chance.uniform(
                -spread, spread, len(looped)
            )
        (t,), (left,) = close_by_moving(robot, S, offset, t[None], moving, MAX_STEP * reach[moving], attitudes)
        if np.abs(left).max() <= CLOSURE_TOLERANCE:
            found.append(t)
        elif nearest is None or np.abs(left).max() < np.abs(nearest).max():
            nearest = left
        if len(found) > EXTRA_CONFIGURATIONS:
            break
    if not found:
        _refuse_open(robot, nearest)
    return found


def close_by_moving(robot, S, offset, t, moving, max_step, attitudes=()):
    """(t (N, m), residual (N, rows)) with the loops closed as far as steps of least length of the joints `moving` do
    it, from t (N, m), where all others stay. longest: as for `newton`; attitudes: of the robot."""
    attitudes = _within(attitudes, moving)

    def evaluate(t):
        equations = loop_equations(*attach_charts(robot, t @ S.T + offset, attitudes, offset))
        J = np.nan_to_num((equations.jacobian @ S)[..., moving], posinf=0, neginf=0)
        return equations.residual, -(np.linalg.pinv(J, rcond=RANK_TOLERANCE) @ equations.residual[..., None])[..., 0]

    def advance(t, step):
        way = np.zeros_like(t)
        way[..., moving] = step
        there, still = displace(t, way, attitudes), np.setdiff1d(np.arange(t.shape[-1]), moving)
        there[..., still] = t[..., still]
        return there

    t, (residual, _) = iterate_newton(evaluate, t, moving, max_step, advance=advance)
    return t, residual


def _jacobian(robot, S, offset, t, attitudes):
    """The loops' Jacobian (rows, m) at t (m,), in the charts of attitudes."""
    return loop_equations(*attach_charts(robot, S @ t + offset, attitudes, offset)).jacobian @ S


def _within(attitudes, places):
    """Those of which yaw and roll have places among these."""
    return tuple(one for one in attitudes if {one.columns[0], one.columns[2]} <= {*places})


def _dependent(robot, free, looped, J, rank):
    """Places of the joints that depend on the others: passive ones of loops, then elastic ones, in the order in which
    they are best eliminated."""
    joints = [robot.joints[number] for number in free]
    chosen = [k for k in looped if not joints[k].actuated and joints[k].spring is None]
    elastic = [k for k in looped if not joints[k].actuated and joints[k].spring is not None]
    if np.linalg.matrix_rank(J[:, chosen], tol=RANK_TOLERANCE * np.linalg.norm(J, 2)) < len(chosen):
        told = f"with {_driven_names(joints, looped)} held, passive joints can still move"
        _refuse(robot, free, looped, rank, f"{told} {_controlled(joints, looped, J, rank)}")
    if len(chosen) < rank and elastic:
        basis = np.linalg.qr(J[:, chosen])[0] if chosen else np.zeros((len(J), 0))
        rest = J[:, elastic] - basis @ (basis.T @ J[:, elastic])
        triangle, order = qr(rest, mode="r", pivoting=True)
        enough = np.abs(np.diag(triangle)) > RANK_TOLERANCE * np.linalg.norm(J, 2)
        chosen += [elastic[k] for k in order[: len(enough)][enough]]
    if len(chosen) < rank:
        told = f"{_driven_names(joints, looped)} cannot move independently"
        _refuse(robot, free, looped, rank, f"{told} {_controlled(joints, looped, J, rank)}")
    # those of one loop first, which are eliminated first
    of_loops = np.split(J != 0, np.cumsum(equations_per_loop(robot))[:-1])
    return np.array(sorted(chosen, key=lambda k: (sum(rows[:, k].any() for rows in of_loops), k)), dtype=int)


def _driven_names(joints, looped):
    names = [repr(joints[k].name) for k in looped if joints[k].role in ("actuated", "elastic")]
    return ", ".join(names) if names else "no joint"


def _controlled(joints, looped, J, rank):
    """How many of the independent motions end where motors are held, and elastic joints: the rank of their control."""
    loose = [k for k in looped if joints[k].role not in ("actuated", "elastic")]
    left = len(loose) - np.linalg.matrix_rank(J[:, loose], tol=RANK_TOLERANCE * np.linalg.norm(J, 2))
    return f"(they control {len(looped) - rank - left} of {len(looped) - rank} motions: the rank of their Jacobian)"


def _refuse(robot, free, looped, rank, what):
    """Raise the DescriptionError of a choice of motors that does not fit the loops."""
    joints = [robot.joints[number] for number in free]
    motors = sum(joints[k].actuated for k in looped)
    mobility = len(looped) - rank
    names = ", ".join(repr(joints[k].name) for k in looped)
    right = f"Of these joints {mobility} that move independently are to be actuated or elastic, the others passive"
    if not mobility:
        right = f"Closed like this nothing moves: a joint is missing, or an axis is wrong; {AXES_HINT}"
    raise DescriptionError(
        f"robot {robot.name!r}: the joints of its loops ({names}) have mobility {mobility} and {motors} motors: "
        f"{what}. {right}"
    )


def _refuse_open(robot, residual):
    name, distance, angle = find_widest_loop(robot, residual)
    cut = {robot.loops[number].name for number in cut_joints(robot)}
    hint = "give initial_position to their joints near where they are closed, and check lengths and placements"
    if angle > distance / robot.characteristic_length and name in cut:
        hint = f"{AXES_HINT}, and give initial_position to their joints near where they are closed"
    if np.abs(residual).max() < NEARLY_CLOSED_RESIDUAL:
        hint = "axes that are meant to be parallel must be so to the last digit: write pi/2 for 1.5708, or snap them"
    raise DescriptionError(
        f"robot {robot.name!r}: its loops cannot be closed: of loop {name!r} the ends stay {distance:.3g} m and "
        f"{angle:.3g} rad apart; {hint}"
    )


def find_widest_loop(robot, residual):
    """(name of the loop that is open widest, distance [m], angle [rad] between its ends), for a residual (rows,).

    Of ends that are half a turn apart the residual is no number.
    """
    residual = np.nan_to_num(residual, nan=np.inf, posinf=np.inf, neginf=-np.inf)
    unit, start, told = robot.characteristic_length, 0, []
    for loop, rows in zip(robot.loops, equations_per_loop(robot), strict=True):
        part = residual[start : start + rows]
        start += rows
        told.append((np.abs(part).max(), loop.name, unit * np.linalg.norm(part[:3]),
                     2 * np.arctan(np.linalg.norm(part[3:]) / 2)))  # fmt: skip
    return max(told)[1:]
