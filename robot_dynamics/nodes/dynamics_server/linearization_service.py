"""The service for derivatives of the dynamic models, and for the linear state space, at a single state."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.base import read_base_point
from robot_dynamics.nodes.codecs.fields import require_empty, to_float_array
from robot_dynamics.nodes.codecs.joint_order import match_joints
from robot_dynamics.nodes.codecs.joint_trajectories import PointFields
from robot_dynamics.nodes.codecs.joint_values import read_accelerations, read_efforts, read_positions, read_velocities
from robot_dynamics.nodes.codecs.wrenches import read_wrenches
from robot_dynamics.nodes.dynamics_server.point_terms import term_names, term_rows
from robot_dynamics.nodes.dynamics_server.point_work import StepWork

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.inputs import Base
    from robot_dynamics_interfaces.srv import Linearize

MAX_LINK_SETS = 24
"""Sets of links with external wrenches that programs are compiled for, of one robot."""

_compiled_link_sets: WeakKeyDictionary[Dynamics, set[tuple[str, ...]]] = WeakKeyDictionary()
"""Links with external wrenches for which the programs of a robot are compiled."""


def handle_linearize(
    request: Linearize.Request, response: Linearize.Response, dynamics: Dynamics, namespace: str
) -> StepWork:
    """Linearize.srv: derivatives of the dynamic models, and the linear state space, at one state.

    The programs of a robot are compiled beside the executor for its first request.
    """
    work = _Linearization(request, response, dynamics, namespace)
    steps = [work.solve, work.add_state_space, work.add_direct_derivatives, work.add_inverse_derivatives]
    return StepWork(steps, _preparation(dynamics, work.base, tuple(work.wrenches)))


class _Linearization:
    """The checked request, and the steps of its response.

    Attributes
    ----------
    base : state of a moving base; None: it is fixed.
    wrenches : {link: (6,)} external wrenches, in the order of the names.
    """

    def __init__(
        self, request: Linearize.Request, response: Linearize.Response, dynamics: Dynamics, namespace: str
    ) -> None:
        self._dynamics = dynamics
        self._response = response
        self._order = match_joints(request.joint_names, dynamics, namespace)
        require_empty(request.base, "accelerations", "base", "the base is free")
        state = request.state
        if bool(len(state.effort)) == bool(len(state.accelerations)):
            which = "both effort and accelerations" if len(state.effort) else "neither effort nor accelerations"
            raise InvalidInputError(f"state has {which}: give one of them, the service computes the other")
        fields = PointFields([state], location="state")
        positions = read_positions(fields, self._order)
        velocities = np.zeros((1, len(dynamics.joint_names)))
        if len(state.velocities):
            velocities = read_velocities(fields, self._order, positions)
        self._q: Array = positions[0]
        self._qd: Array = velocities[0]
        self._efforts: Array | None = None
        self._accelerations: Array | None = None
        if len(state.effort):
            self._efforts = read_efforts(fields, self._order, positions)[0]
        else:
            self._accelerations = read_accelerations(fields, self._order, positions, velocities)[0]
        self.base: Base | None = read_base_point(request.base, dynamics.robot, at_rest=True)
        wrenches = read_wrenches(request.external_wrenches, [0], dynamics.robot, namespace)
        self.wrenches: dict[str, Array] = {link: wrenches[link][0] for link in sorted(wrenches)}

    def solve(self) -> None:
        """Compute the efforts or the accelerations that the request leaves out."""
        result = self._dynamics.solve(
            self._q,
            self._qd,
            qdd=self._accelerations,
            efforts=self._efforts,
            base=self.base,
            external_wrenches=self.wrenches,
        )
        order = self._order.independent_order
        accelerations = result.accelerations[order]
        if result.base_acceleration is not None:
            accelerations = np.concatenate([result.base_acceleration, accelerations])
        self._efforts = result.efforts
        unactuated = [name in self._dynamics.unactuated_joint_names for name in self._dynamics.joint_names]
        self._accelerations = np.where(unactuated, 0.0, result.accelerations)  # the inverse model solves for these
        response = self._response
        response.joint_names = term_names(self._order)
        response.accelerations = to_float_array(accelerations)
        response.efforts = to_float_array(result.efforts[order])

    def add_state_space(self) -> None:
        """Add the matrices of the linear state space."""
        efforts = self._efforts
        assert efforts is not None, "solve comes first"
        linear = self._dynamics.linearize(self._q, self._qd, efforts, base=self.base, external_wrenches=self.wrenches)
        rows = term_rows(self._order)
        states = np.concatenate([rows, len(linear.A) // 2 + rows])
        inputs = [name for name in self._response.joint_names if name in linear.input_names]
        columns = np.array([linear.input_names.index(name) for name in inputs], dtype=int)
        self._response.input_names = inputs
        self._response.a = to_float_array(linear.A[states[:, None], states])
        self._response.b = to_float_array(linear.B[states[:, None], columns])

    def add_direct_derivatives(self) -> None:
        """Add the derivatives of the accelerations."""
        efforts = self._efforts
        assert efforts is not None, "solve comes first"
        result = self._dynamics.direct_derivatives(
            self._q, self._qd, efforts, base=self.base, external_wrenches=self.wrenches
        )
        rows = term_rows(self._order)[:, None]
        response = self._response
        response.acceleration_by_positions = to_float_array(result.positions[rows, rows.T])
        response.acceleration_by_velocities = to_float_array(result.velocities[rows, rows.T])
        response.acceleration_by_efforts = to_float_array(result.efforts[rows, self._order.independent_order])

    def add_inverse_derivatives(self) -> None:
        """Add the derivatives of the efforts."""
        accelerations = self._accelerations
        assert accelerations is not None, "solve comes first"
        result = self._dynamics.inverse_derivatives(
            self._q, self._qd, accelerations, base=self.base, external_wrenches=self.wrenches
        )
        rows = term_rows(self._order)[:, None]
        response = self._response
        response.effort_by_positions = to_float_array(result.positions[rows, rows.T])
        response.effort_by_velocities = to_float_array(result.velocities[rows, rows.T])
        response.effort_by_accelerations = to_float_array(result.accelerations[rows, rows.T])
        response.success = True


def _preparation(dynamics: Dynamics, base: Base | None, links: tuple[str, ...]) -> Callable[[], None] | None:
    """Return what compiles the programs of a robot with wrenches on links; None where they are compiled.

    Raises InvalidInputError where there are too many of them.
    """
    compiled = _compiled_link_sets.setdefault(dynamics, set())
    if links in compiled or not (dynamics.joint_names or dynamics.robot.moving_base):
        return None
    if len(compiled) >= MAX_LINK_SETS:
        raise InvalidInputError(
            f"external_wrenches: requests named {MAX_LINK_SETS} different sets of links, and each needs a program of "
            "its own. Name the same links in each request, with zeros where nothing acts"
        )
    return partial(_compile, dynamics, base, links)


def _compile(dynamics: Dynamics, base: Base | None, links: tuple[str, ...]) -> None:
    dynamics._compile_derivatives(base, links)
    _compiled_link_sets[dynamics].add(links)
