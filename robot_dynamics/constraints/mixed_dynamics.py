"""Mixed dynamics: accelerations from forces at some joints, forces from accelerations at the others.

A tree with unknown accelerations takes the articulated-body recursion; a robot with dependent joints takes the equation
of motion projected onto the independent ones; known accelerations take the two-sweep inverse dynamics.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from robot_dynamics.array_checks import broadcast_result, refuse_overflow
from robot_dynamics.constraints.constrained_state import projection_matrix
from robot_dynamics.errors import SingularModelError
from robot_dynamics.newton_euler import articulated_body, linear
from robot_dynamics.newton_euler.composite import inertia_matrix
from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.kinematics import run_forward_pass
from robot_dynamics.newton_euler.linear import MIN_INERTIA_RATIO
from robot_dynamics.newton_euler.screw import BASE_ROWS, apply
from robot_dynamics.newton_euler.walker_orin import bias

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray
    from robot_dynamics.constraints.constrained_state import ConstrainedState
    from robot_dynamics.model.robot import Robot


class BaseMotion(Protocol):
    """Motion of the base in frame 0."""

    @property
    def twist(self) -> Array:
        """(..., 6)."""

    @property
    def acceleration(self) -> Array | None:
        """(..., 6), gravity subtracted; None where it is unknown."""


@dataclass(frozen=True, eq=False)
class RobotState:
    """State of a robot as the recursions take it.

    Attributes
    ----------
    constrained_state : ConstrainedState
    qd : ndarray, shape (..., all joints)
        Rates as `ConstrainedState.expand_rates` returns them.
    base : BaseMotion
    wrenches : dict of int to ndarray
        External wrenches jf_e (..., 6) by link number.
    batch : tuple of int
        Shape of the batch axes.
    joint_names : tuple of str
        Names of the independent joints.
    """

    constrained_state: ConstrainedState
    qd: Array
    base: BaseMotion
    wrenches: dict[int, Array]
    batch: tuple[int, ...]
    joint_names: tuple[str, ...]

    @property
    def q(self) -> Array:
        """Positions (..., all joints)."""
        return self.constrained_state.q

    @property
    def robot(self) -> Robot:
        """The Robot as the recursions take it, at positions `chart_q`."""
        return self.constrained_state.robot

    @property
    def chart_q(self) -> Array:
        """Positions (..., all joints) that belong to `robot`, `qd` and `expand_accelerations`."""
        return self.constrained_state.chart_q

    @property
    def has_dependent_joints(self) -> bool:
        """Whether some joints depend on others."""
        return len(self.joint_names) < len(self.robot.joints)

    @cached_property
    def drift(self) -> Array:
        """Accelerations (..., all joints) where those of the independent joints are zero."""
        return self.constrained_state.drift(self.qd)

    def expand_accelerations(self, qdd: Array) -> Array:
        """Accelerations (..., all joints) from those (..., n) of the independent joints."""
        accelerations: Array = self.constrained_state.expand_rates(qdd) + self.drift
        return accelerations

    def joint_motion(self, accelerations: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations (..., all joints), from those of `expand_accelerations`."""
        q = broadcast_result(self.q, self.batch)
        rates = broadcast_result(self.qd, self.batch)
        accelerations = broadcast_result(accelerations, self.batch)
        joint_accelerations = self.constrained_state.joint_accelerations(rates, accelerations)
        return q, self.constrained_state.joint_velocities(rates), joint_accelerations


class MixedSolution(NamedTuple):
    """Result of `solve_mixed_dynamics`.

    Attributes
    ----------
    accelerations : ndarray, shape (..., n)
        Of the independent joints.
    forces : ndarray, shape (..., all joints)
        Joint forces of the open tree, friction and springs not counted.
    base_acceleration : ndarray, shape (..., 6)
        Gravity subtracted.
    wrenches : ndarray, shape (..., 1 + all joints, 6)
        As in `inverse_dynamics`.
    """

    accelerations: Array
    forces: Array
    base_acceleration: Array
    wrenches: Array


def solve_mixed_dynamics(
    state: RobotState, unknown: Collection[int], accelerations: Array, forces: Array
) -> MixedSolution:
    """Solve the unknown accelerations of a state and the joint forces.

    Parameters
    ----------
    state : RobotState
    unknown : collection of int
        Numbers, ascending, of the independent joints whose acceleration is unknown.
    accelerations : ndarray, shape (..., n)
        Read where they are known.
    forces : ndarray, shape (..., n)
        Without friction and springs; read where accelerations are unknown.

    Raises
    ------
    SingularModelError
        No inertia resists an unknown acceleration.
    """
    robot = state.robot
    base = state.base
    if state.has_dependent_joints and len(unknown):
        accelerations = _solve_projected(state, list(unknown), accelerations, forces)
        unknown = ()
    forward_pass = run_forward_pass(robot, state.chart_q, state.qd, base.twist, state.wrenches)
    all_accelerations = state.expand_accelerations(accelerations)
    if not len(unknown) and base.acceleration is not None:
        forces, wrenches = inverse_dynamics(robot, forward_pass, all_accelerations, base.acceleration)
        return MixedSolution(accelerations, forces, base.acceleration, wrenches)
    joints = range(len(robot.joints))
    known_accelerations = [None if j in unknown else all_accelerations[..., j : j + 1] for j in joints]
    known_forces = [forces[..., j : j + 1] if j in unknown else None for j in joints]
    solution = articulated_body.solve(robot, forward_pass, known_accelerations, known_forces, base.acceleration)
    _refuse_singular_bodies(robot, solution)
    if not state.has_dependent_joints:
        accelerations = solution.accelerations
    return MixedSolution(accelerations, solution.forces, solution.base_acceleration, solution.wrenches)


def _solve_projected(state: RobotState, unknown: Sequence[int], accelerations: Array, forces: Array) -> Array:
    """`solve_mixed_dynamics` for a robot with dependent joints: accelerations (..., n)."""
    robot = state.robot
    base = state.base
    G = state.constrained_state.G
    base_acceleration = np.zeros(6) if base.acceleration is None else base.acceleration
    H = bias(robot, state.chart_q, state.qd, base.twist, base_acceleration, state.wrenches, state.drift)
    if base.acceleration is not None:
        H = H[..., -len(robot.joints) :]
    solution, pivots, diagonal = solve_constrained_accelerations(
        robot, G, state.chart_q, unknown, accelerations, forces, H
    )
    names = tuple(state.joint_names[number] for number in reversed(unknown)) + BASE_ROWS
    for k, (pivot, name) in enumerate(zip(pivots, names, strict=False)):
        _refuse_singular(pivot, diagonal[..., k], name)
    return solution[..., -G.shape[-1] :]


def solve_constrained_accelerations(
    robot: Robot,
    G: ScalarArray,
    q: ScalarArray,
    unknown: Collection[int],
    accelerations: ScalarArray,
    forces: ScalarArray,
    bias: ScalarArray,
) -> tuple[ScalarArray, list[ScalarArray], ScalarArray]:
    """Solve the equation of motion of the independent joints, Gᵀ A G q̈ = Gᵀ (Γ - H), for unknown accelerations.

    Parameters
    ----------
    robot : Robot
    G : ndarray, shape (..., joints, n)
    q : ndarray, shape (..., joints)
    unknown : collection of int
        Numbers, ascending, of the independent joints whose acceleration is unknown.
    accelerations : ndarray, shape (..., n)
        Read where they are known.
    forces : ndarray, shape (..., n)
        Gᵀ Γ, read where accelerations are unknown.
    bias : ndarray, shape (..., joints) or (..., 6 + joints)
        H with the drift; with six rows of a moving base in front where its acceleration is unknown.

    Returns
    -------
    accelerations : ndarray, shape (..., n) or (..., 6 + n)
        q̈, or [V̇0; q̈] with a moving base.
    pivots : list of ndarray
        Pivots of the matrix of the unknown rows, which is positive definite where all are positive.
    diagonal : ndarray, shape (..., k)
        Its diagonal, to compare the pivots with.

    Notes
    -----
    Source: Khalil, section 4 (A_c and H_c by Walker and Orin); section 6, second row of the general form, where only
    some accelerations are unknown.
    """
    rows = bias.shape[-1]
    base = rows - G.shape[-2]
    A = inertia_matrix(robot, q)[..., -rows:, -rows:]
    if G.shape[-2] > G.shape[-1]:
        P = projection_matrix(G, base)
        transposed = np.swapaxes(P, -1, -2)
        A = transposed @ A @ P
        bias = apply(transposed, bias)
    size = A.shape[-1]
    # from the tips to the base, so that the zeros between branches stay zero in the factors
    unknown_rows = np.array([*(base + number for number in reversed([*unknown])), *range(base)], dtype=int)
    is_known = np.ones(size, dtype=int)
    is_known[unknown_rows] = 0
    no_base = np.zeros((*accelerations.shape[:-1], base), dtype=int)
    prescribed = is_known * np.concatenate([no_base, accelerations], axis=-1)
    applied = np.concatenate([np.zeros((*forces.shape[:-1], base), dtype=int), forces], axis=-1)
    net_forces = applied - bias - (A @ prescribed[..., None])[..., 0]
    A = A[..., unknown_rows[:, None], unknown_rows]
    factors = linear.factor(A)
    solved = linear.solve(factors, net_forces[..., unknown_rows])
    index_of = {row: index for index, row in enumerate(unknown_rows)}
    entries = [solved[..., index_of[row]] if row in index_of else prescribed[..., row] for row in range(size)]
    return np.stack(np.broadcast_arrays(*entries), axis=-1), factors[1], np.diagonal(A, axis1=-2, axis2=-1)


def compute_link_wrenches(
    state: RobotState, accelerations: Array, base_acceleration: Array, tree_efforts: Array
) -> Array:
    """Link wrenches of a motion, with the wrenches that the ends of the loops exert on each other.

    Parameters
    ----------
    state : RobotState
    accelerations : ndarray, shape (..., all joints)
    base_acceleration : ndarray, shape (..., 6)
        Gravity subtracted.
    tree_efforts : ndarray, shape (..., all joints)
        Efforts that the open tree requires, friction and springs counted. The loops exert those of the dependent
        joints.

    Returns
    -------
    ndarray, shape (..., 1 + all joints, 6)
        As in `inverse_dynamics`.
    """
    wrenches = dict(state.wrenches)
    for link, wrench in state.constrained_state.loop_wrenches(tree_efforts):
        wrenches[link] = wrenches.get(link, 0) - wrench
    forward_pass = run_forward_pass(state.robot, state.chart_q, state.qd, state.base.twist, wrenches)
    return inverse_dynamics(state.robot, forward_pass, accelerations, base_acceleration)[1]


def _refuse_singular_bodies(robot: Robot, solution: articulated_body.Solution) -> None:
    """Raise SingularModelError where an acceleration of an articulated-body Solution is rounding.

    From the leaves to the base, in the order of the recursion: the first singular joint is the cause of the next ones.
    """
    backward_pass = solution.backward_pass
    for j in range(len(robot.joints), 0, -1):
        pivot = backward_pass.apparent_inertias[j]
        if pivot is not None:
            joint = robot.joints[j - 1]
            # compares masses where the joint slides, moments of inertia where it turns
            block = slice(0, 3) if joint.prismatic else slice(3, 6)
            diagonal = np.diagonal(backward_pass.articulated_inertias[j][..., block, block], axis1=-2, axis2=-1)
            _refuse_singular(pivot, diagonal.max(axis=-1, keepdims=True), f"joint {joint.name!r}")
    for k, pivot in enumerate(solution.base_pivots):
        _refuse_singular(pivot, backward_pass.articulated_inertias[0][..., k, k], BASE_ROWS[k])


def _refuse_singular(pivot: Array, scale: Array, name: str) -> None:
    """Raise SingularModelError where a pivot (...) is rounding beside the inertia `scale` (...)."""
    if np.isnan(pivot).any():
        refuse_overflow()
    if not np.all(pivot > MIN_INERTIA_RATIO * np.abs(scale)):
        raise SingularModelError(
            f"nothing with inertia resists {name} (inertia {np.min(pivot):.3g}). "
            "Give the links that it moves a mass and an inertia, or the joint a rotor inertia; or lock the joint "
            "(options locked and lock_massless)"
        )
