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

from robot_dynamics.newton_euler import linear
from robot_dynamics.newton_euler.attitude import attitudes_of, between, chart_rates, charted, moved
from robot_dynamics.newton_euler.closure import CLOSED, LONGEST_STEP, newton
from robot_dynamics.newton_euler.composite import inertia_matrix
from robot_dynamics.newton_euler.configuration import ChartedConfiguration, Configuration
from robot_dynamics.newton_euler.least_squares import bordered, least_squares, partition
from robot_dynamics.newton_euler.loops import loop_equations, rows_of_loops
from robot_dynamics.newton_euler.mobility import CLOSES, closed_by, mobility
from robot_dynamics.newton_euler.screw import apply

LONGEST_STRIDE = 0.15  # [rad or characteristic lengths] on the way from the closed configuration that is known
FINER = 5  # times as many strides where these lead astray
MOST_STRIDES = 300
ITERATIONS_ON_THE_WAY = 3
BEND = 0.4  # of a stride: how far beside the end to which it points it may come
NO_BEND = (
    1e-3  # [rad or characteristic lengths] more, which is what strides leave open and rounding beside singular ones
)
HALVES = 30  # of the way to a dead centre
FARTHEST = 4.0  # times the last stride of a trajectory, how far ahead it points
CLOSED_ON_THE_WAY = 1e-4  # residual at which a stride has come far enough: the next one begins with an error anyway
BLOCKED = 0.01  # residual at which there is no way on


class Closed(NamedTuple):
    """Positions t (N, m) of the joints that follow no other one, and how well they close the loops.

    residual: (N, rows); quality: (N,) the least part of the squared length of a column of J_d that is its own, 0 where
    J_d is singular; placing: (N, dependent, dependent) as of `Coupling.step`; crossed: (N,) whether a singular position
    lies between them and where they were sought from; bent: (N,) whether the way to them had a bend within a stride, as
    where it turns into another branch at a singular one.
    """

    t: np.ndarray
    residual: np.ndarray
    quality: np.ndarray
    placing: np.ndarray
    crossed: np.ndarray
    bent: np.ndarray

    @property
    def closes(self):
        """(N,) whether the loops are closed."""
        return np.abs(self.residual).max(axis=-1, initial=0) <= CLOSES


@dataclass(frozen=True, eq=False)
class Coupling:
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
    free: list
    chosen: np.ndarray
    placed: np.ndarray
    closed: np.ndarray | None
    rows: np.ndarray | None = None
    sense: int = 1
    attitudes: tuple = ()

    @property
    def independent(self):
        return [self.free[k] for k in self.chosen]

    @property
    def dependent(self):
        return [self.free[k] for k in self.placed]

    def seen_in(self, robot, shifts=0):
        """The same Coupling for the same robot with other frames or inertias, and positions that differ by shifts."""
        return replace(self, robot=robot, offset=self.offset + shifts)

    def oriented(self):
        """The same Coupling with `rows` and `sense`, found where the loops are known to be closed."""
        J = self._dependent_jacobian(self.closed)
        rows = qr(J.T, mode="r", pivoting=True)[1][: len(self.placed)]
        return replace(self, rows=rows, sense=-1 if np.linalg.det(J[rows]) < 0 else 1)

    def at(self, q, formed=True):
        """The Configuration at positions q (..., all joints) that close the loops. formed: whether by G, which costs
        less where there are few independent joints, where it is needed besides, and of numbers."""
        if not len(self.placed):
            return Configuration(self, q, None, None, formed=True)
        J = loop_equations(self.robot, q).jacobian @ self.S
        return Configuration(self, q, J, bordered(J[..., self.placed], self._partition), formed)

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
        chosen = np.array([self.free.index(number) for number in sorted(independent)], dtype=int)
        if np.array_equal(chosen, self.chosen):
            return self
        placed = np.setdiff1d(np.arange(len(self.free)), chosen)
        return replace(self, chosen=chosen, placed=placed).oriented()

    def pivoted(self, q):
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
        J = loop_equations(*charted(self.robot, q, self.attitudes, self.offset)).jacobian @ self.S * self._reach
        turned = [place for one in self.attitudes for place in one.places]  # angles of platforms, always dependent
        basis = np.linalg.qr(J[:, turned])[0]
        others = np.setdiff1d(np.arange(len(self.free)), turned)
        order = qr(J[:, others] - basis @ (basis.T @ J[:, others]), mode="r", pivoting=True)[1]
        independent = others[order[len(self.placed) - len(turned) :]]
        return tuple(self.free[k] for k in sorted(independent))

    def at_attitudes(self, q, formed=True):
        """As `at`, with rates and forces in the charts of the platforms' attitudes: also where pitch is ±90°."""
        if not self.attitudes:
            return self.at(q, formed)
        return ChartedConfiguration.of(self, q, self._partition, formed)

    def step(self, t):
        """(residual (..., rows), Newton's step (..., dependent), pivots, lengths, placing) of the loops at t (..., m).

        pivots and lengths (..., dependent) are those of the Bordered form of J_d. placing: (..., dependent, dependent)
        rows of J_d of which the determinant is positive where the loops are known to be closed. It does not change its
        sign without passing a singular position.
        """
        equations = self._equations(t)
        J = equations.jacobian @ self.S[:, self.placed]
        factors = bordered(J, self._partition)
        step = least_squares(factors, -equations.residual[..., None])[..., 0]
        signs = np.array([self.sense] + [1] * (len(self.rows) - 1))
        placing = J[..., self.rows, :] * signs[: len(self.rows), None]
        return equations.residual, step, factors.pivots, factors.lengths, placing

    def project(self, t, step=None, tolerance=CLOSED):
        """The Closed positions next to t (N, m), in which the independent joints stay where they are.

        step: as for `near`; tolerance: residual at which Newton's method ends.
        """
        return self._closed(t, step or self.step, tolerance)

    def _equations(self, t):
        """The LoopEquations at t (..., m), their Jacobian in the charts of the attitudes that the loops place."""
        q = t @ self.S.T + self.offset
        return loop_equations(*charted(self.robot, q, self._placed_attitudes, self.offset))

    @cached_property
    def _placed_attitudes(self):
        """Those of which the loops place yaw and roll."""
        return tuple(one for one in self.attitudes if {one.places[0], one.places[2]} <= {*self.placed})

    def _moved(self, t, step):
        """Positions (..., m) from t (..., m) by a step (..., dependent) of the joints that the loops place."""
        way = np.zeros_like(t)
        way[..., self.placed] = step
        there = moved(t, way, self._placed_attitudes)
        there[..., self.chosen] = t[..., self.chosen]
        return there

    def found(self, q, seed=None, step=None):
        """The Closed positions for q (N, n), `near` a seed (N, dependent), or without one `reached`."""
        return self.reached(q, step) if seed is None else self.near(q, seed, step)

    def near(self, q, seed, step=None):
        """The Closed positions nearest to a seed: q (N, n) of the independent joints, seed (N, dependent) of those that
        the loops place, nan where it says nothing of a joint; a sample of which it says nothing at all is `reached`.
        step: what computes `step`, this object's own if None."""
        t = np.empty((len(q), len(self.free)))
        t[:, self.chosen], t[:, self.placed] = q, seed
        silent = np.isnan(seed)
        open_, nothing_told = silent.any(axis=-1), silent.all(axis=-1)
        if not open_.any():
            return self._closed(t, step or self.step)
        start = self.reached(q[open_], step)
        usable = ~start.crossed & start.closes
        t[open_] = self._filled(t[open_], np.where(usable[:, None], start.t, self.closed))
        found = self._closed(t, step or self.step)
        for values, now in zip(found, start, strict=True):
            values[nothing_told] = now[nothing_told[open_]]
        return found

    def _filled(self, t, start):
        """t (N, m), some of it nan, with these joints moved from positions `start` (N, m) to where the loops are
        nearest to being closed while all others stay: so what is told of some chooses the assembly mode of all."""
        silent = np.isnan(t)
        for pattern in np.unique(silent, axis=0):
            alike, moving = (silent == pattern).all(axis=-1), np.flatnonzero(pattern)
            longest = LONGEST_STEP * self._reach[moving]
            begin = np.where(pattern, start[alike], t[alike])
            t[alike] = closed_by(self.robot, self.S, self.offset, begin, moving, longest, self.attitudes)[0]
        return t

    def reached(self, q, step=None):
        """The Closed positions in the assembly mode of those that are known, `closed`: whole turns of the independent
        joints left out, along the straight way from there to q (N, n), or around. step: as for `near`."""
        target, start = self._without_turns(q), np.broadcast_to(self.closed, (len(q), len(self.free)))
        found = self._in_mode(self.along(start, target, step))
        everyone, around = np.ones(len(q), dtype=bool), partial(self._joint_by_joint, backwards=True)
        for way, whose in (
            (self._straight, everyone),
            (self._by_halves, found.bent),
            (self._joint_by_joint, everyone),
            (around, everyone),
        ):
            again = np.flatnonzero(whose & (found.crossed | ~found.closes))
            if not len(again):
                continue
            other = self._in_mode(way(start[again], target[again], step))
            better = ~other.crossed & other.closes
            for values, now in zip(found, other, strict=True):
                values[again[better]] = now[better]
        found.t[:, self.chosen] = q
        return found

    def _straight(self, start, target, step):
        """`along`, with shorter strides."""
        return self.along(start, target, step, LONGEST_STRIDE / FINER)

    def _joint_by_joint(self, start, target, step, backwards=False):
        """As `along`, one independent joint after the other: around positions at which the loops cannot close."""
        places, bent = np.arange(target.shape[1]), False
        for place in places[::-1] if backwards else places:
            corner = start[:, self.chosen]
            corner[:, place] = target[:, place]
            found = self.along(start, corner, step)
            start, bent = found.t, bent | found.bent
        return found._replace(bent=bent)

    def _by_halves(self, start, target, step):
        """`along`, with strides that halve what is left: up to a dead centre, before which the way bends ever more."""
        first, bent = start[:, self.chosen], False
        for share in (*0.5 ** np.arange(1, HALVES), 0.0):
            found = self.along(start, target + share * (first - target), step, LONGEST_STRIDE / FINER)
            start, bent = found.t, bent | found.bent
        return found._replace(bent=bent)

    def _in_mode(self, found):
        return found._replace(crossed=~(np.linalg.det(found.placing) > 0) | found.bent)

    def along(self, t, q, step=None, longest=LONGEST_STRIDE, came=None):
        """The Closed positions at the end of the straight way from closed positions t (N, m) to q (N, n).

        Strides are at most `longest` [rad or characteristic lengths] but for MOST_STRIDES, and begin where the last one
        points to; the first where the way from positions `came` (N, m) to t points to, if told.
        """
        step, start = step or self.step, t[:, self.chosen]
        strides = np.ceil(np.abs((q - start) / self._reach[self.chosen]).max(initial=0) / longest)
        strides = max(1, int(min(strides, MOST_STRIDES)))
        before = self._back(t, (self._tangent_way(t, q) if came is None else self._ahead(came, t, q)) / strides)
        bent = np.zeros(len(t), dtype=bool)
        for share in np.linspace(0, 1, strides + 1)[1:-1]:
            ahead, before = self._on(before, t), t
            ahead[:, self.chosen] = start + share * (q - start)
            t, found = newton(step, ahead, self.placed, self._longest, ITERATIONS_ON_THE_WAY, CLOSED_ON_THE_WAY,
                              self._advance)  # fmt: skip
            blocked = np.abs(found[0]).max(axis=-1) > BLOCKED
            bent |= self._bend(before, ahead, t) | blocked  # which may close again, in any mode
            if blocked.all():
                break  # no sample gets through
        ahead = self._on(before, t)
        ahead[:, self.chosen] = q
        found = self._closed(ahead, step)
        return found._replace(bent=bent | self._bend(t, ahead, found.t))

    def continued(self, q, previous, velocities, step=None):
        """The Closed positions for q (N, n) on the branch that leads there from positions `previous` (N, all joints),
        in the direction of velocities (N, all joints) of this sample, or of the tangent where velocities is (N, 0).
        `crossed` tells of a bend."""
        t = previous[:, self.free]
        came = None
        if velocities.shape[-1]:
            charted_rates = chart_rates(previous, velocities, self._placed_attitudes, self.offset)
            rates, unit = charted_rates[:, self.free], self._reach[self.chosen]
            speed = np.linalg.norm(rates[:, self.chosen] / unit, axis=-1)
            distance = np.linalg.norm((q - t[:, self.chosen]) / unit, axis=-1)
            duration = np.divide(distance, speed, out=np.zeros(len(t)), where=speed > 0)
            came = self._back(t, duration[:, None] * rates)
        found = self.along(t, q, step, came=came)
        return found._replace(crossed=found.bent)

    def _tangent_way(self, t, q):
        """(N, m) the way from t to q (N, n) along the tangent."""
        way = np.zeros_like(t)
        way[:, self.chosen] = q - t[:, self.chosen]
        placed = replace(self, attitudes=self._placed_attitudes)
        rates = placed.at_attitudes(t @ self.S.T + self.offset).rates(way[:, self.chosen])
        way[:, self.placed] = rates[:, self.dependent]
        return np.nan_to_num(way)

    def _on(self, before, t):
        """(N, m) as far beyond t (N, m) as t is from `before`."""
        return moved(t, between(before, t, self._placed_attitudes), self._placed_attitudes)

    def _back(self, t, way):
        """(N, m) from where `way` (N, m) leads to t (N, m)."""
        return moved(t, -way, self._placed_attitudes)

    def _ahead(self, came, t, q):
        """(N, m) how far the way from `came` to t leads, if it goes on as it came as far as q (N, n) is away."""
        unit = self._reach[self.chosen]
        passed, left = (t - came)[:, self.chosen] / unit, (q - t[:, self.chosen]) / unit
        length = np.sum(passed**2, axis=-1)
        share = np.sum(passed * left, axis=-1) / np.where(length > 0, length, np.inf)
        return np.clip(share, -FARTHEST, FARTHEST)[:, None] * between(came, t, self._placed_attitudes)

    def _bend(self, before, ahead, t):
        """(N,) whether a stride from `before` that pointed to `ahead` has come to t far beside it."""
        ways = between(before, ahead, self._placed_attitudes), between(ahead, t, self._placed_attitudes)
        stride, beside = (np.abs(way / self._reach) for way in ways)
        return beside.max(axis=-1) > BEND * stride.max(axis=-1) + NO_BEND

    def _closed(self, t, step, tolerance=CLOSED):
        t, (residual, _, pivots, lengths, placing) = newton(
            step, t, self.placed, self._longest, closed=tolerance, advance=self._advance
        )
        nothing = np.zeros(len(t), dtype=bool)
        return Closed(t, residual, (pivots / lengths).min(axis=-1), placing, nothing, nothing)

    def _dependent_jacobian(self, t):
        """J_d (rows, dependent) at positions t (m,)."""
        return self._equations(t).jacobian @ self.S[:, self.placed]

    def condition(self, t):
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
            {*self.robot.way(loop.moved.link)} ^ {*self.robot.way(loop.closed_on.link)} for loop in self.robot.loops
        ]
        in_loops = np.array([self.S[sorted(way)][:, self.placed].any(axis=0) for way in ways])
        alone = in_loops & (in_loops.sum(axis=0) == 1)
        rows = [slice(*ends) for ends in pairwise(np.cumsum([0, *rows_of_loops(self.robot)]))]
        return partition(rows, [np.flatnonzero(columns) for columns in alone], len(self.placed))

    @cached_property
    def _reach(self):
        """(m,) what counts as much as a radian [rad or m] of each of the free joints."""
        return self.units_of_joints[self.free]

    @cached_property
    def units_of_joints(self):
        """(all joints,) what counts as much as a radian of each joint [rad or m]."""
        unit = self.robot.characteristic_length
        return np.array([unit if joint.prismatic else 1.0 for joint in self.robot.joints])

    @cached_property
    def _longest(self):
        """(dependent,) the longest step of each of the joints that the loops place."""
        return LONGEST_STEP * self._reach[self.placed]

    def _without_turns(self, q):
        """q with the whole turns taken off by which revolute joints are away from the configuration that is known; not
        where both are within their limits, which tell which way round leads there. Joints that move none of a loop stay
        where they are known."""
        known, (lower, upper) = self.closed[self.chosen], self._limits
        inside = np.isfinite(upper - lower) & (lower <= q) & (q <= upper) & (lower <= known) & (known <= upper)
        turns = np.round((q - known) / (2 * np.pi))
        near = q - np.where(self._come_back & ~inside, 2 * np.pi * turns, 0.0)
        return np.where([rows.any() for rows in self._moved_in_loops], near, known)

    @cached_property
    def _moved_in_loops(self):
        """For each independent joint, which joints of loops (joints,) it moves or leads."""
        looped = np.isin(np.arange(len(self.S)), list(self.robot.looped))
        return [looped & (self.S[:, k] != 0) for k in self.chosen]

    @cached_property
    def _come_back(self):
        """(n,) whether after a whole turn of an independent joint its loops are where they were."""
        turning = [not joint.prismatic for joint in self.robot.joints]
        return np.array([np.all(turning, where=rows) and not np.any(self.S[rows, k] % 1)
                for k, rows in zip(self.chosen, self._moved_in_loops, strict=True)], dtype=bool)  # fmt: skip

    @cached_property
    def _limits(self):
        """(2, n): lower and upper limits of the independent joints."""
        limits = [self.robot.joints[number].limits for number in self.independent]
        return np.array([(limit.lower, limit.upper) for limit in limits]).reshape(-1, 2).T


def coupling(robot):
    """The Coupling of a robot. Raises DescriptionError where its loops and motors do not fit together."""
    joints = len(robot.joints)
    free = [number for number, (leader, _, _) in enumerate(robot.leaders) if leader == number]
    column = {number: place for place, number in enumerate(free)}
    S, offset = np.zeros((joints, len(free))), np.zeros(joints)
    for number, (leader, multiplier, shift) in enumerate(robot.leaders):
        S[number, column[leader]] = multiplier
        offset[number] = shift
    if not robot.loops:
        return Coupling(robot, S, offset, free, np.arange(len(free)), np.zeros(0, dtype=int), None)
    with np.errstate(all="ignore"):  # ends half a turn apart: what does not close is refused
        placed, closed = mobility(robot, S, offset, free)
    chosen = np.setdiff1d(np.arange(len(free)), placed)
    return Coupling(robot, S, offset, free, chosen, placed, closed, attitudes=attitudes_of(robot, free)).oriented()


def projection(G, base_rows):
    """From rows of all joints to rows of the independent ones (..., base + joints, base + n), the rows of a moving base
    in front kept, for G (..., joints, n)."""
    if not base_rows:
        return G
    matrix = np.zeros((*G.shape[:-2], base_rows + G.shape[-2], base_rows + G.shape[-1]), dtype=G.dtype)
    matrix[..., :base_rows, :base_rows] = np.eye(base_rows, dtype=int)
    matrix[..., base_rows:, base_rows:] = G
    return matrix


def coupled_accelerations(robot, G, q, unknown, accelerations, forces, bias):
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
        P = projection(G, base)
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
