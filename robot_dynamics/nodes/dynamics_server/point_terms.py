"""Terms of the dynamic model at the points of a request."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.model.joint_friction import FRICTION_COEFFICIENTS, has_value
from robot_dynamics.newton_euler.screw import BASE_ROWS

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.inputs import Base
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.nodes.codecs.joint_order import JointOrder

TERMS = ("inertia_matrix", "coriolis", "gravity", "friction", "elasticity")
"""Terms of the dynamic model, fields of the responses."""


def term_rows(order: JointOrder) -> IntArray:
    """Return the rows of the terms in the order of the request; those of a moving base come first."""
    rows = order.independent_order
    return np.concatenate([np.arange(6), rows + 6]) if order.dynamics.robot.moving_base else rows


def term_names(order: JointOrder) -> list[str]:
    """Return the names of these rows."""
    names = [order.dynamics.joint_names[row] for row in order.independent_order]
    return [*BASE_ROWS, *names] if order.dynamics.robot.moving_base else names


def compute_terms(dynamics: Dynamics, terms: Sequence[str], q: Array, qd: Array, base: Base | None) -> dict[str, Array]:
    """Return {term: (..., rows)} at points (..., n), (..., rows, rows) of the inertia matrix.

    Raises RobotDynamicsError.
    """
    return {term: _compute_term(dynamics, term, q, qd, base) for term in terms}


def _compute_term(dynamics: Dynamics, term: str, q: Array, qd: Array, base: Base | None) -> Array:
    if term == "inertia_matrix":
        return dynamics.inertia_matrix(q)
    if term == "coriolis":
        return dynamics.coriolis(q, qd, base=base)
    if term == "gravity":
        return dynamics.gravity(q, base=base)
    if term == "friction":
        has_friction = _has_friction(dynamics.robot)
        values = dynamics.friction(qd, q, base=base) if has_friction else np.zeros_like(qd)
    else:
        values = dynamics.elasticity(q, qd) if _has_springs(dynamics.robot) else np.zeros_like(qd)
    if not dynamics.robot.moving_base:
        return values
    return np.concatenate([np.zeros((*values.shape[:-1], 6)), values], axis=-1)


@lru_cache(maxsize=16)
def _has_friction(robot: Robot) -> bool:
    return any(has_value(getattr(joint, name)) for joint in robot.joints for name in FRICTION_COEFFICIENTS)


@lru_cache(maxsize=16)
def _has_springs(robot: Robot) -> bool:
    return any(joint.spring is not None for joint in robot.joints)
