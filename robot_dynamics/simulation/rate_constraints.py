"""Constraints on the rates of a robot: a base in a plane, rolling wheels, a driven base, prescribed joint motion.

With constraints C ν = 0 and C ν̇ = c, Gauss's principle of least constraint gives

    ν̇ = b + N (Nᵀ A N)⁻¹ Nᵀ A (ν̇_free - b),   C N = 0,   C b = c
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np
from scipy.linalg import null_space, qr

from robot_dynamics.procedures import solve
from robot_dynamics.simulation.wheels import RollingConstraints

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.plant import Plant
    from robot_dynamics.simulation.wheels import Wheel

BaseType: TypeAlias = Literal["fixed", "free", "planar"]
BASE_TYPES: tuple[BaseType, ...] = ("fixed", "free", "planar")
RANK_TOLERANCE = 1e-9
"""Singular value of constraints, relative to the largest, below which it is rounding."""
BASIS_ROUNDING = 1e-13
"""Entry of a basis below which it is rounding."""
DRIVE_COMPONENTS = (0, 5, 1)
"""Components of V0 that a drive controls, in order of priority: forward, turning, sideways."""


class ConstraintSolution(NamedTuple):
    """Constraints of one kind at one position.

    Attributes
    ----------
    N : ndarray, shape (6 + n, freedoms)
        Rates that satisfy the constraints.
    pseudoinverse : ndarray, shape (6 + n, rows)
        C⁺ of all rows: rolling, driven components of the twist, joints.
    driven_components : list of int
        Components of the twist that a drive controls.
    drift : ndarray, shape (rolling rows,)
        Ċ ν of the rolling rows.
    """

    N: Array
    pseudoinverse: Array
    driven_components: list[int]
    drift: Array


class RateConstraints:
    """Constraints on the rates of a Plant.

    Parameters
    ----------
    plant : Plant
    base : {"fixed", "free", "planar"}
        A planar base moves in the plane of its x and y axes.
    wheels : iterable of Wheel
        Wheels that carry a planar base.

    Raises
    ------
    DescriptionError
        The wheels do not fit the robot.
    InvalidInputError
        An axle is not parallel to the plane.
    """

    def __init__(self, plant: Plant, base: BaseType, wheels: Iterable[Wheel]) -> None:
        self._plant = plant
        self._is_fixed = base == "fixed"
        self._rolling: RollingConstraints | None = None
        if base == "planar":
            self._rolling = RollingConstraints(plant.dynamics.robot, wheels)
            self._rolling.constraint_rows(plant.dynamics.initial_joint_positions)  # raises where an axle is inclined
        has_constant_rows = self._rolling is None or (self._rolling.is_constant and plant.loops is None)
        self._is_constant = has_constant_rows or not (self._rolling and self._rolling.joints)
        self._constant_solutions: dict[tuple[bool, bool], ConstraintSolution] = {}

    def constrain_accelerations(
        self,
        q: Array,
        rates: Array,
        accelerations: Array,
        base_acceleration: Array | None = None,
        joint_accelerations: Array | None = None,
    ) -> Array:
        """ν̇ (6 + n,) with the constraints, from that of the unconstrained robot (6 + n,).

        base_acceleration: (6,) derivative of the twist that a drive gives to the base, as far as wheels allow it;
        joint_accelerations: (n,) of joints with prescribed motion.
        """
        if self._rolling is None and joint_accelerations is None:
            return accelerations
        if self._is_fixed and joint_accelerations is not None:
            return np.concatenate([np.zeros(6), joint_accelerations])
        is_driven = base_acceleration is not None
        N, pseudoinverse, driven_components, drift = self._solve(q, rates, is_driven, joint_accelerations is not None)
        right_side = [-drift]
        if base_acceleration is not None:
            right_side.append(base_acceleration[driven_components])
        if joint_accelerations is not None:
            right_side.append(joint_accelerations)
        prescribed = pseudoinverse @ np.concatenate(right_side)
        constrained: Array = constrain(self._plant.inertia_matrix(q), N, accelerations, prescribed)
        return constrained

    def project_onto_constraints(self, q: Array, rates: Array, keep_joint_rates: bool = False) -> Array:
        """The admissible rates (6 + n,) nearest to these by kinetic energy.

        keep_joint_rates: whether the rates of the joints stay as they are.
        """
        if self._rolling is None:
            return rates
        N, pseudoinverse, _, drift = self._solve(q, rates, False, keep_joint_rates)
        prescribed = np.zeros_like(rates)
        if keep_joint_rates:
            prescribed = pseudoinverse @ np.concatenate([np.zeros_like(drift), rates[6:]])
        constrained: Array = constrain(self._plant.inertia_matrix(q), N, rates, prescribed)
        return constrained

    def impulse_response(self, q: Array, rates: Array, joint_impulses: Array, is_driven: bool = False) -> Array:
        """Change of the rates (6 + n, k) for impulses (n, k) of joints. is_driven: whether a drive moves the base."""
        A = self._plant.inertia_matrix(q)
        if self._is_fixed:
            return np.concatenate([np.zeros((6, joint_impulses.shape[1])), solve(A, joint_impulses)])
        N = None if self._rolling is None else self._solve(q, rates, is_driven, False).N
        response: Array = joint_impulse_response(A, N, joint_impulses)
        return response

    def initial_rates(self, q: Array, rates: Array, has_base_motion: bool) -> Array:
        """Admissible rates (6 + n,) at the start of a simulation.

        has_base_motion: whether the motion of the base is an input, which the wheels follow; otherwise the base follows
        the joints.
        """
        if self._rolling is None:
            return rates
        C, _ = self._rows(q, rates)
        N = null_space(C)
        rate_joints = self._plant.rate_joints
        wheels = [6 + k for k in range(self._plant.size) if rate_joints[k] in self._rolling.joints]
        other_joints = [k for k in range(6, 6 + self._plant.size) if k not in wheels]
        inputs = [*driven_components(N), *other_joints] if has_base_motion else slice(6, None)
        admissible: Array = N @ np.linalg.lstsq(N[inputs], rates[inputs], rcond=None)[0]
        return admissible

    def residual(self, q: Array, rates: Array) -> Array:
        """C ν (m,): velocities [m/s, rad/s] that plane and wheels forbid."""
        return np.zeros(0) if self._rolling is None else self._rows(q, rates)[0] @ rates

    @property
    def is_constant(self) -> bool:
        """Whether the constraints are the same at all positions."""
        return self._is_constant

    def solution_at(self, q: Array, is_driven: bool) -> ConstraintSolution | None:
        """The constraints of plane and wheels at rest; None without them. is_driven: whether a drive moves the base."""
        return None if self._rolling is None else self._solve(q, np.zeros(6 + self._plant.size), is_driven, False)

    def _rows(self, q: Array, rates: Array) -> tuple[Array, Array]:
        """C (m, 6 + n) and Ċ ν (m,) of plane and wheels."""
        assert self._rolling is not None
        plant = self._plant
        joint_positions = q if plant.loops else plant.dynamics.expand_positions(q)
        G = plant.velocity_matrix(q)
        qd = G @ rates[6:]
        C, C_derivative = self._rolling.constraint_rows(joint_positions, qd)
        drift = C_derivative @ np.concatenate([rates[:6], qd])
        if plant.loops:
            drift = drift + C[:, 6:] @ plant.velocity_drift(q, qd)
        return np.concatenate([C[:, :6], C[:, 6:] @ G], axis=1), drift

    def _solve(self, q: Array, rates: Array, is_driven: bool, has_joint_motion: bool) -> ConstraintSolution:
        """The constraints at q; kept where they never change."""
        key = is_driven, has_joint_motion
        if self._is_constant and key in self._constant_solutions:
            return self._constant_solutions[key]
        unit = np.eye(6 + self._plant.size)
        C, drift = (unit[:0], np.zeros(0)) if self._rolling is None else self._rows(q, rates)
        components = driven_components(null_space(C)) if is_driven else []
        C = np.concatenate([C, unit[components], unit[6:] if has_joint_motion else unit[:0]])
        U, singular_values, V = np.linalg.svd(C)
        rank = int(np.sum(singular_values > RANK_TOLERANCE * singular_values[0]))
        pseudoinverse = (V[:rank].T / singular_values[:rank]) @ U[:, :rank].T
        solution = ConstraintSolution(sparse_basis(V[rank:].T), pseudoinverse, components, drift)
        if self._is_constant:
            self._constant_solutions[key] = solution
        return solution


def sparse_basis(N: Array) -> Array:
    """A basis of the columns of N (m, freedoms) in which as many rates as there are freedoms are the coordinates.

    Most of its entries are zeros and ones: products with it need few operations.
    """
    if not N.size:  # nothing can move: LAPACK before 3.11 refuses to factorise it
        return N
    _, _, order = qr(N.T, mode="economic", pivoting=True)
    rows = np.sort(order[: N.shape[1]])
    basis: Array = N @ np.linalg.inv(N[rows])
    basis[np.abs(basis) < BASIS_ROUNDING] = 0.0
    basis[rows] = np.eye(len(rows))
    return basis


def constrain(A: Any, N: Any, rates: Any, prescribed: Any) -> Any:
    """The rates (m,) nearest to these by kinetic energy that differ from the prescribed ones (m,) by N u."""
    forces = N.T @ (A @ (rates - prescribed))
    return prescribed + N @ solve(N.T @ A @ N, forces[:, None])[:, 0]


def joint_impulse_response(A: Any, N: Any, joint_impulses: Any) -> Any:
    """Change of the rates (6 + n, k) of a robot on a moving base for impulses (n, k) of its joints.

    N: (6 + n, freedoms) rates that the constraints allow; None without constraints.
    """
    impulses = np.concatenate([np.zeros((6, joint_impulses.shape[1])), joint_impulses])
    return solve(A, impulses) if N is None else N @ solve(N.T @ A @ N, N.T @ impulses)


def driven_components(N: Array) -> list[int]:
    """Components of the base twist that are independent for rates N u, N (6 + n, freedoms)."""
    components: list[int] = []
    for component in DRIVE_COMPONENTS:
        if np.linalg.matrix_rank(N[[*components, component]], tol=RANK_TOLERANCE) > len(components):
            components.append(component)
    return components
