"""How all joints of a robot follow from the independent ones: mimic joints and gears, and the loops.

    q_all = S t + offset,   t the joints that follow no other one
    q̇_all = G q̇,   q̈_all = G q̈ + drift,   Γ = Gᵀ Γ_all

Without loops G = S and the drift is zero. Loops place some of the joints t, the dependent ones, with J from
`loop_equations`: J_d ṫ_d = -J_i q̇, and J_d ẗ_d = -J_i q̈ - J̇ q̇ (Khalil, sections 2.2 and 4).
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import qr

from robot_dynamics.constraints.attitude_charts import (
    attach_charts,
    chart_rates,
    displace,
    displacement,
    find_attitude_joints,
)
from robot_dynamics.constraints.least_squares import factor_bordered, least_squares, partition
from robot_dynamics.constraints.loop_equations import equations_per_loop, loop_equations
from robot_dynamics.constraints.mobility import CLOSURE_TOLERANCE, close_by_moving, find_dependent_columns
from robot_dynamics.constraints.newton_iteration import MAX_STEP, NEWTON_TOLERANCE, iterate_newton
from robot_dynamics.constraints.state import ChartedConstrainedState, ConstrainedState
from robot_dynamics.newton_euler import linear
from robot_dynamics.newton_euler.composite import inertia_matrix
from robot_dynamics.newton_euler.screw import apply

MAX_STRIDE = 0.15  # [rad or characteristic lengths] on the way from the closed configuration that is known
STRIDE_REFINEMENT = 5  # times as many strides where these lead astray
MAX_STRIDES = 300
MAX_PATH_ITERATIONS = 3
MAX_RELATIVE_DEVIATION = 0.4  # of a stride: how far beside the end to which it points it may come
MAX_ABSOLUTE_DEVIATION = (
    1e-3  # [rad or characteristic lengths] more, which is what strides leave open and rounding beside singular ones
)
MAX_STRIDE_HALVINGS = 30  # of the way to a dead centre
MAX_EXTRAPOLATION = 4.0  # times the last stride of a trajectory, how far ahead it points
PATH_TOLERANCE = 1e-4  # residual at which a stride has come far enough: the next one begins with an error anyway
OPEN_RESIDUAL = 0.01  # residual at which there is no way on


class ClosureResult(NamedTuple):
    """Positions t (N, m) of the joints that follow no other one, and how well they close the loops.

    residual: (N, rows); quality: (N,) the least part of the squared length of a column of J_d that is its own, 0 where
    J_d is singular; placing: (N, dependent, dependent) as of `Coupling.step`; crossed: (N,) whether a singular position
    lies between them and where they were sought from; bent: (N,) whether the way to them had a bend within a stride, as
    where it turns into another branch at a singular one.
    """

    t: np.ndarray
    residual: np.ndarray
    quality: np.ndarray
    determinant_matrix: np.ndarray
    has_crossed_singularity: np.ndarray
    has_bend: np.ndarray

    @property
    def is_closed(self):
        """(N,) whether the loops are closed."""
        return np.abs(self.residual).max(axis=-1, initial=0) <= CLOSURE_TOLERANCE


@dataclass(frozen=True, eq=False)
class ConstraintTopology:
    """What `coupling` finds out of a robot.

    S (joints, m), offset (joints,): from the joints `free` (numbers) that follow no other one. independent, dependent:
    numbers of joints; among the free ones they have places in the columns of S, `chosen` and `placed`. closed (m,):
    positions of the free joints at which the loops are closed; rows: as many rows of J_d, independent there; sense: the
    sign of their determinant there. attitudes: of the platforms, those that have a chart.

    Where the loops place yaw and roll of a platform, J_d and the steps of Newton's method are in the chart at its
    attitude, and the determinant too: it is zero at singular positions alone, and not where pitch is ±90°.
    """

    robot: object
    S: np.ndarray
    offset: np.ndarray
    non_mimic_joints: list
    independent_columns: np.ndarray
    dependent_columns: np.ndarray
    reference_positions: np.ndarray | None
    determinant_rows: np.ndarray | None = None
    determinant_sign: int = 1
    attitudes: tuple = ()

    @property
    def independent(self):
        return [self.non_mimic_joints[k] for k in self.independent_columns]

    @property
    def dependent(self):
        return [self.non_mimic_joints[k] for k in self.dependent_columns]

    def with_robot(self, robot, shifts=0):
        """The same Coupling for the same robot with other frames or inertias, and positions that differ by shifts."""
        return replace(self, robot=robot, offset=self.offset + shifts)

    def with_determinant_sign(self):
        """The same Coupling with `rows` and `sense`, found where the loops are known to be closed."""
        J = self._dependent_jacobian(self.reference_positions)
        rows = qr(J.T, mode="r", pivoting=True)[1][: len(self.dependent_columns)]
        return replace(self, determinant_rows=rows, determinant_sign=-1 if np.linalg.det(J[rows]) < 0 else 1)

    def state_at(self, q, uses_G=True):
        """The Configuration at positions q (..., all joints) that close the loops. formed: whether by G, which costs
        less where there are few independent joints, where it is needed besides, and of numbers."""
        if not len(self.dependent_columns):
            return ConstrainedState(self, q, None, None, uses_G=True)
        J = loop_equations(self.robot, q).jacobian @ self.S
        return ConstrainedState(self, q, J, factor_bordered(J[..., self.dependent_columns], self._partition), uses_G)

    def with_independent(self, independent):
        """The same loops with other independent joints.

        Parameters
        ----------
        independent : sequence of int
            Numbers of joints, as many as `independent` has, none of them a mimic joint. Joints that no loop moves
            must stay among them.

        Returns
        -------
        Coupling
            This object itself where the joints are the same.
        """
        chosen = np.array([self.non_mimic_joints.index(number) for number in sorted(independent)], dtype=int)
        if np.array_equal(chosen, self.independent_columns):
            return self
        placed = np.setdiff1d(np.arange(len(self.non_mimic_joints)), chosen)
        return replace(self, independent_columns=chosen, dependent_columns=placed).with_determinant_sign()

    def select_independent(self, q):
        """The joints that are independent after pivoting at q: the loops place those that they place best.

        The constraint Jacobian is factorized with column pivoting; its first columns are the dependent joints. Source:
        Wehage and Haug, Generalized coordinate partitioning, Journal of Mechanical Design 104 (1982), with a QR
        factorization in place of their Gaussian elimination.

        Parameters
        ----------
        q : ndarray, shape (all joints,)
            Positions that close the loops.

        Returns
        -------
        tuple of int
            Numbers of the independent joints, ascending.
        """
        J = loop_equations(*attach_charts(self.robot, q, self.attitudes, self.offset)).jacobian @ self.S * self._reach
        turned = [place for one in self.attitudes for place in one.columns]  # angles of platforms, always dependent
        basis = np.linalg.qr(J[:, turned])[0]
        others = np.setdiff1d(np.arange(len(self.non_mimic_joints)), turned)
        order = qr(J[:, others] - basis @ (basis.T @ J[:, others]), mode="r", pivoting=True)[1]
        independent = others[order[len(self.dependent_columns) - len(turned) :]]
        return tuple(self.non_mimic_joints[k] for k in sorted(independent))

    def charted_state_at(self, q, uses_G=True):
        """As `at`, with rates and forces in the charts of the platforms' attitudes: also where pitch is ±90°."""
        if not self.attitudes:
            return self.state_at(q, uses_G)
        return ChartedConstrainedState.of(self, q, self._partition, uses_G)

    def newton_step(self, t):
        """(residual (..., rows), Newton's step (..., dependent), pivots, lengths, placing) of the loops at t (..., m).

        pivots and lengths (..., dependent) are those of the Bordered form of J_d. placing: (..., dependent, dependent)
        rows of J_d of which the determinant is positive where the loops are known to be closed. It does not change its
        sign without passing a singular position.
        """
        equations = self._equations(t)
        J = equations.jacobian @ self.S[:, self.dependent_columns]
        factors = factor_bordered(J, self._partition)
        step = least_squares(factors, -equations.residual[..., None])[..., 0]
        signs = np.array([self.determinant_sign] + [1] * (len(self.determinant_rows) - 1))
        determinant_matrix = J[..., self.determinant_rows, :] * signs[: len(self.determinant_rows), None]
        return equations.residual, step, factors.pivots, factors.squared_norms, determinant_matrix

    def project_onto_constraints(self, t, step=None, tolerance=NEWTON_TOLERANCE):
        """The Closed positions next to t (N, m), in which the independent joints stay where they are.

        step: as for `near`; tolerance: residual at which Newton's method ends.
        """
        return self._closed(t, step or self.newton_step, tolerance)

    def _equations(self, t):
        """The LoopEquations at t (..., m), their Jacobian in the charts of the attitudes that the loops place."""
        q = t @ self.S.T + self.offset
        return loop_equations(*attach_charts(self.robot, q, self._placed_attitudes, self.offset))

    @cached_property
    def _placed_attitudes(self):
        """Those of which the loops place yaw and roll."""
        return tuple(one for one in self.attitudes if {one.columns[0], one.columns[2]} <= {*self.dependent_columns})

    def _moved(self, t, step):
        """Positions (..., m) from t (..., m) by a step (..., dependent) of the joints that the loops place."""
        way = np.zeros_like(t)
        way[..., self.dependent_columns] = step
        there = displace(t, way, self._placed_attitudes)
        there[..., self.independent_columns] = t[..., self.independent_columns]
        return there

    def solve_closure(self, q, seed=None, step=None):
        """The Closed positions for q (N, n), `near` a seed (N, dependent), or without one `reached`."""
        return (
            self.solve_closure_from_reference(q, step) if seed is None else self.solve_closure_near_seed(q, seed, step)
        )

    def solve_closure_near_seed(self, q, seed, step=None):
        """The Closed positions nearest to a seed: q (N, n) of the independent joints, seed (N, dependent) of those that
        the loops place, nan where it says nothing of a joint; a sample of which it says nothing at all is `reached`.
        step: what computes `step`, this object's own if None."""
        t = np.empty((len(q), len(self.non_mimic_joints)))
        t[:, self.independent_columns], t[:, self.dependent_columns] = q, seed
        silent = np.isnan(seed)
        open_, nothing_told = silent.any(axis=-1), silent.all(axis=-1)
        if not open_.any():
            return self._closed(t, step or self.newton_step)
        start = self.solve_closure_from_reference(q[open_], step)
        usable = ~start.has_crossed_singularity & start.is_closed
        t[open_] = self._filled(t[open_], np.where(usable[:, None], start.t, self.reference_positions))
        found = self._closed(t, step or self.newton_step)
        for values, now in zip(found, start, strict=True):
            values[nothing_told] = now[nothing_told[open_]]
        return found

    def _filled(self, t, start):
        """t (N, m), some of it nan, with these joints moved from positions `start` (N, m) to where the loops are
        nearest to being closed while all others stay: so what is told of some chooses the assembly mode of all."""
        silent = np.isnan(t)
        for pattern in np.unique(silent, axis=0):
            alike, moving = (silent == pattern).all(axis=-1), np.flatnonzero(pattern)
            longest = MAX_STEP * self._reach[moving]
            begin = np.where(pattern, start[alike], t[alike])
            t[alike] = close_by_moving(self.robot, self.S, self.offset, begin, moving, longest, self.attitudes)[0]
        return t

    def solve_closure_from_reference(self, q, step=None):
        """The Closed positions in the assembly mode of those that are known, `closed`: whole turns of the independent
        joints left out, along the straight way from there to q (N, n), or around. step: as for `near`."""
        target, start = (
            self._without_turns(q),
            np.broadcast_to(self.reference_positions, (len(q), len(self.non_mimic_joints))),
        )
        found = self._in_mode(self.follow_path(start, target, step))
        everyone, around = np.ones(len(q), dtype=bool), partial(self._joint_by_joint, backwards=True)
        for way, whose in (
            (self._straight, everyone),
            (self._by_halves, found.has_bend),
            (self._joint_by_joint, everyone),
            (around, everyone),
        ):
            again = np.flatnonzero(whose & (found.has_crossed_singularity | ~found.is_closed))
            if not len(again):
                continue
            other = self._in_mode(way(start[again], target[again], step))
            better = ~other.has_crossed_singularity & other.is_closed
            for values, now in zip(found, other, strict=True):
                values[again[better]] = now[better]
        found.t[:, self.independent_columns] = q
        return found

    def _straight(self, start, target, step):
        """`along`, with shorter strides."""
        return self.follow_path(start, target, step, MAX_STRIDE / STRIDE_REFINEMENT)

    def _joint_by_joint(self, start, target, step, backwards=False):
        """As `along`, one independent joint after the other: around positions at which the loops cannot close."""
        places, has_bend = np.arange(target.shape[1]), False
        for place in places[::-1] if backwards else places:
            corner = start[:, self.independent_columns]
            corner[:, place] = target[:, place]
            found = self.follow_path(start, corner, step)
            start, has_bend = found.t, has_bend | found.has_bend
        return found._replace(has_bend=has_bend)

    def _by_halves(self, start, target, step):
        """`along`, with strides that halve what is left: up to a dead centre, before which the way bends ever more."""
        first, has_bend = start[:, self.independent_columns], False
        for share in (*0.5 ** np.arange(1, MAX_STRIDE_HALVINGS), 0.0):
            found = self.follow_path(start, target + share * (first - target), step, MAX_STRIDE / STRIDE_REFINEMENT)
            start, has_bend = found.t, has_bend | found.has_bend
        return found._replace(has_bend=has_bend)

    def _in_mode(self, found):
        return found._replace(has_crossed_singularity=~(np.linalg.det(found.determinant_matrix) > 0) | found.has_bend)

    def follow_path(self, t, q, step=None, longest=MAX_STRIDE, previous_positions=None):
        """The Closed positions at the end of the straight way from closed positions t (N, m) to q (N, n).

        Strides are at most `longest` [rad or characteristic lengths] but for MOST_STRIDES, and begin where the last one
        points to; the first where the way from positions `came` (N, m) to t points to, if told.
        """
        step, start = step or self.newton_step, t[:, self.independent_columns]
        strides = np.ceil(np.abs((q - start) / self._reach[self.independent_columns]).max(initial=0) / longest)
        strides = max(1, int(min(strides, MAX_STRIDES)))
        before = self._back(
            t,
            (self._tangent_way(t, q) if previous_positions is None else self._ahead(previous_positions, t, q))
            / strides,
        )
        has_bend = np.zeros(len(t), dtype=bool)
        for share in np.linspace(0, 1, strides + 1)[1:-1]:
            ahead, before = self._on(before, t), t
            ahead[:, self.independent_columns] = start + share * (q - start)
            t, found = iterate_newton(step, ahead, self.dependent_columns, self._longest, MAX_PATH_ITERATIONS, PATH_TOLERANCE,
                              self._advance)  # fmt: skip
            blocked = np.abs(found[0]).max(axis=-1) > OPEN_RESIDUAL
            has_bend |= self._bend(before, ahead, t) | blocked  # which may close again, in any mode
            if blocked.all():
                break  # no sample gets through
        ahead = self._on(before, t)
        ahead[:, self.independent_columns] = q
        found = self._closed(ahead, step)
        return found._replace(has_bend=has_bend | self._bend(t, ahead, found.t))

    def continue_branch(self, q, previous, velocities, step=None):
        """The Closed positions for q (N, n) on the branch that leads there from positions `previous` (N, all joints),
        in the direction of velocities (N, all joints) of this sample, or of the tangent where velocities is (N, 0).
        `crossed` tells of a bend."""
        t = previous[:, self.non_mimic_joints]
        previous_positions = None
        if velocities.shape[-1]:
            charted_rates = chart_rates(previous, velocities, self._placed_attitudes, self.offset)
            rates, unit = charted_rates[:, self.non_mimic_joints], self._reach[self.independent_columns]
            speed = np.linalg.norm(rates[:, self.independent_columns] / unit, axis=-1)
            distance = np.linalg.norm((q - t[:, self.independent_columns]) / unit, axis=-1)
            duration = np.divide(distance, speed, out=np.zeros(len(t)), where=speed > 0)
            previous_positions = self._back(t, duration[:, None] * rates)
        found = self.follow_path(t, q, step, previous_positions=previous_positions)
        return found._replace(has_crossed_singularity=found.has_bend)

    def _tangent_way(self, t, q):
        """(N, m) the way from t to q (N, n) along the tangent."""
        way = np.zeros_like(t)
        way[:, self.independent_columns] = q - t[:, self.independent_columns]
        placed = replace(self, attitudes=self._placed_attitudes)
        rates = placed.charted_state_at(t @ self.S.T + self.offset).expand_rates(way[:, self.independent_columns])
        way[:, self.dependent_columns] = rates[:, self.dependent]
        return np.nan_to_num(way)

    def _on(self, before, t):
        """(N, m) as far beyond t (N, m) as t is from `before`."""
        return displace(t, displacement(before, t, self._placed_attitudes), self._placed_attitudes)

    def _back(self, t, way):
        """(N, m) from where `way` (N, m) leads to t (N, m)."""
        return displace(t, -way, self._placed_attitudes)

    def _ahead(self, previous_positions, t, q):
        """(N, m) how far the way from `came` to t leads, if it goes on as it came as far as q (N, n) is away."""
        unit = self._reach[self.independent_columns]
        passed, left = (
            (t - previous_positions)[:, self.independent_columns] / unit,
            (q - t[:, self.independent_columns]) / unit,
        )
        length = np.sum(passed**2, axis=-1)
        share = np.sum(passed * left, axis=-1) / np.where(length > 0, length, np.inf)
        return np.clip(share, -MAX_EXTRAPOLATION, MAX_EXTRAPOLATION)[:, None] * displacement(
            previous_positions, t, self._placed_attitudes
        )

    def _bend(self, before, ahead, t):
        """(N,) whether a stride from `before` that pointed to `ahead` has come to t far beside it."""
        ways = displacement(before, ahead, self._placed_attitudes), displacement(ahead, t, self._placed_attitudes)
        stride, beside = (np.abs(way / self._reach) for way in ways)
        return beside.max(axis=-1) > MAX_RELATIVE_DEVIATION * stride.max(axis=-1) + MAX_ABSOLUTE_DEVIATION

    def _closed(self, t, step, tolerance=NEWTON_TOLERANCE):
        t, (residual, _, pivots, lengths, determinant_matrix) = iterate_newton(
            step, t, self.dependent_columns, self._longest, tolerance=tolerance, advance=self._advance
        )
        nothing = np.zeros(len(t), dtype=bool)
        return ClosureResult(t, residual, (pivots / lengths).min(axis=-1), determinant_matrix, nothing, nothing)

    def _dependent_jacobian(self, t):
        """J_d (rows, dependent) at positions t (m,)."""
        return self._equations(t).jacobian @ self.S[:, self.dependent_columns]

    def condition_number(self, t):
        """The condition number of J_d at positions t (m,), infinite where J_d is no finite matrix."""
        J = self._dependent_jacobian(t)
        return float(np.linalg.cond(J)) if np.isfinite(J).all() else np.inf

    @property
    def _advance(self):
        return self._moved if self._placed_attitudes else None

    @cached_property
    def _partition(self):
        """How J_d falls into the rows of loops, and the columns of joints that no other loop has."""
        ways = [
            {*self.robot.path_to_base(loop.moved.link)} ^ {*self.robot.path_to_base(loop.closed_on.link)}
            for loop in self.robot.loops
        ]
        in_loops = np.array([self.S[sorted(way)][:, self.dependent_columns].any(axis=0) for way in ways])
        alone = in_loops & (in_loops.sum(axis=0) == 1)
        rows = [slice(*ends) for ends in pairwise(np.cumsum([0, *equations_per_loop(self.robot)]))]
        return partition(rows, [np.flatnonzero(columns) for columns in alone], len(self.dependent_columns))

    @cached_property
    def _reach(self):
        """(m,) what counts as much as a radian [rad or m] of each of the free joints."""
        return self.joint_units[self.non_mimic_joints]

    @cached_property
    def joint_units(self):
        """(all joints,) what counts as much as a radian of each joint [rad or m]."""
        unit = self.robot.characteristic_length
        return np.array([unit if joint.prismatic else 1.0 for joint in self.robot.joints])

    @cached_property
    def _longest(self):
        """(dependent,) the longest step of each of the joints that the loops place."""
        return MAX_STEP * self._reach[self.dependent_columns]

    def _without_turns(self, q):
        """q with the whole turns taken off by which revolute joints are away from the configuration that is known; not
        where both are within their limits, which tell which way round leads there. Joints that move none of a loop stay
        where they are known."""
        known, (lower, upper) = self.reference_positions[self.independent_columns], self._limits
        inside = np.isfinite(upper - lower) & (lower <= q) & (q <= upper) & (lower <= known) & (known <= upper)
        turns = np.round((q - known) / (2 * np.pi))
        near = q - np.where(self._come_back & ~inside, 2 * np.pi * turns, 0.0)
        return np.where([rows.any() for rows in self._moved_in_loops], near, known)

    @cached_property
    def _moved_in_loops(self):
        """For each independent joint, which joints of loops (joints,) it moves or leads."""
        looped = np.isin(np.arange(len(self.S)), list(self.robot.joints_in_loops))
        return [looped & (self.S[:, k] != 0) for k in self.independent_columns]

    @cached_property
    def _come_back(self):
        """(n,) whether after a whole turn of an independent joint its loops are where they were."""
        turning = [not joint.prismatic for joint in self.robot.joints]
        return np.array([np.all(turning, where=rows) and not np.any(self.S[rows, k] % 1)
                for k, rows in zip(self.independent_columns, self._moved_in_loops, strict=True)], dtype=bool)  # fmt: skip

    @cached_property
    def _limits(self):
        """(2, n): lower and upper limits of the independent joints."""
        limits = [self.robot.joints[number].limits for number in self.independent]
        return np.array([(limit.lower, limit.upper) for limit in limits]).reshape(-1, 2).T


def build_topology(robot):
    """The Coupling of a robot. Raises DescriptionError where its loops and motors do not fit together."""
    joints = len(robot.joints)
    free = [number for number, (leader, _, _) in enumerate(robot.mimic_relations) if leader == number]
    column = {number: place for place, number in enumerate(free)}
    S, offset = np.zeros((joints, len(free))), np.zeros(joints)
    for number, (leader, multiplier, shift) in enumerate(robot.mimic_relations):
        S[number, column[leader]] = multiplier
        offset[number] = shift
    if not robot.loops:
        return ConstraintTopology(robot, S, offset, free, np.arange(len(free)), np.zeros(0, dtype=int), None)
    with np.errstate(all="ignore"):  # ends half a turn apart: what does not close is refused
        placed, closed = find_dependent_columns(robot, S, offset, free)
    chosen = np.setdiff1d(np.arange(len(free)), placed)
    return ConstraintTopology(
        robot, S, offset, free, chosen, placed, closed, attitudes=find_attitude_joints(robot, free)
    ).with_determinant_sign()


def projection_matrix(G, base_rows):
    """From rows of all joints to rows of the independent ones (..., base + joints, base + n), the rows of a moving base
    in front kept, for G (..., joints, n)."""
    if not base_rows:
        return G
    matrix = np.zeros((*G.shape[:-2], base_rows + G.shape[-2], base_rows + G.shape[-1]), dtype=G.dtype)
    matrix[..., :base_rows, :base_rows] = np.eye(base_rows, dtype=int)
    matrix[..., base_rows:, base_rows:] = G
    return matrix


def solve_constrained_accelerations(robot, G, q, unknown, accelerations, forces, bias):
    """(accelerations, pivots, diagonal): [V̇0; q̈] (..., 6 + n) of a moving base and the independent joints, or q̈
    (..., n) alone; and what tells whether the matrix that gave them was positive definite: its pivots, a list, beside
    its diagonal (..., k).

    G: (..., joints, n); q: (..., joints) of all joints; unknown: numbers of the independent joints whose acceleration
    is unknown; accelerations: (..., n), those that are known; forces: (..., n) on the independent ones, Gᵀ Γ, those
    that count where the acceleration is unknown; bias: H (..., joints) with the drift in it, or with the six rows of a
    moving base in front where its acceleration is unknown.

    The rows of the unknown accelerations of Gᵀ A G q̈ = Gᵀ (Γ - H): Khalil, section 4 (A_c and H_c by Walker and
    Orin); and section 6, second row of the general form, where only some are unknown.
    """
    rows = bias.shape[-1]
    base = rows - G.shape[-2]
    A = inertia_matrix(robot, q)[..., -rows:, -rows:]
    if G.shape[-2] > G.shape[-1]:
        P = projection_matrix(G, base)
        transposed = np.swapaxes(P, -1, -2)
        A, bias = transposed @ A @ P, apply(transposed, bias)
    size = A.shape[-1]
    # from the tips to the base: so the zeros between branches stay zero in the factors
    sought = np.array([*(base + number for number in reversed(unknown)), *range(base)], dtype=int)
    known = np.ones(size, dtype=int)
    known[sought] = 0
    given = known * np.concatenate([np.zeros((*accelerations.shape[:-1], base), dtype=int), accelerations], axis=-1)
    pushes = np.concatenate([np.zeros((*forces.shape[:-1], base), dtype=int), forces], axis=-1)
    push = pushes - bias - (A @ given[..., None])[..., 0]
    A = A[..., sought[:, None], sought]
    factors = linear.factor(A)
    solved = linear.solve(factors, push[..., sought])
    place = {row: number for number, row in enumerate(sought)}
    found = [given[..., row] if row not in place else solved[..., place[row]] for row in range(size)]
    return np.stack(np.broadcast_arrays(*found), axis=-1), factors[1], np.diagonal(A, axis1=-2, axis2=-1)
