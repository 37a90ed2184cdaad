"""Compiled models of a simulated robot: its accelerations from efforts, wrenches and gravity, and its inertia.

Rates are ν = [V0; q̇] (6 + n,): the twist of the base in the base frame, and the velocities of the independent joints.
ν̇ are their derivatives. The six of a fixed base are zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Literal

import numpy as np

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.inputs import Base
from robot_dynamics.simulation.base_motion import rates_derivative
from robot_dynamics.simulation.branch import evaluate_on_branch
from robot_dynamics.simulation.constrained_motion import ConstrainedMotion

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
    from robot_dynamics.codegen.jit.python_program import PythonProgram
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.simulation.constrained_motion import LoopCoordinates

    Program = CompiledProgram | PythonProgram

NO_GRAVITY = np.zeros(3)
NO_TWIST = np.zeros(6)


class Plant:
    """The compiled models of a robot.

    Parameters
    ----------
    dynamics : Dynamics
        Of the robot without the friction that acts as impulses.
    wrench_links : iterable of str
        Names of the links that external wrenches act on.

    Attributes
    ----------
    size : int
        Number n of the independent joints.
    loops : ConstrainedMotion or None
        None for a robot without loops.
    rate_joints : list of int
        Numbers of the joints whose velocities are rates.
    takes_all_joints : bool
        Whether the programs take positions of all joints, and not only those of Dynamics.joint_names.
    """

    def __init__(self, dynamics: Dynamics, wrench_links: Iterable[str]) -> None:
        robot = dynamics.robot
        self.dynamics = dynamics
        self.size = len(self.dynamics.joint_names)
        self.loops = ConstrainedMotion(self.dynamics) if robot.loops else None
        self._joint_indices = [robot.joint_numbers[name] for name in dynamics.joint_names]
        self.rate_joints = self._joint_indices
        self.takes_all_joints = bool(robot.loops) or dynamics.joint_names == dynamics.all_joint_names
        self._has_moving_base = robot.moving_base
        self._wrench_links: tuple[str, ...] | None = None
        self._programs: dict[tuple[int, ...] | None, tuple[Program, list[Array]]] = {}
        self._inertia_programs: dict[tuple[int, ...] | None, Program] = {}
        self._G: Array | None = None if self.loops else self.dynamics.expand_velocities(np.eye(self.size)).T
        self._coordinates: LoopCoordinates | None = None
        self._direction: Array | None = None
        length = robot.characteristic_length
        joint_units = [length if joint.prismatic else 1.0 for joint in robot.joints]
        self._units = np.array([length] * 3 + [1.0] * 3 + joint_units)
        self.set_wrench_links(wrench_links)

    @property
    def units(self) -> Array:
        """Change of each rate (6 + n,) that counts as much as one radian [rad or m]."""
        return self._units[[0, 1, 2, 3, 4, 5, *(6 + number for number in self.rate_joints)]]

    def program_positions(self, joint_positions: Array) -> Array:
        """Positions as the programs take them, from positions (all joints,)."""
        return joint_positions if self.takes_all_joints else joint_positions[self._joint_indices]

    @property
    def independent(self) -> tuple[int, ...] | None:
        """Numbers of the joints that rates belong to; None without loops."""
        return None if self._coordinates is None else self._coordinates.independent

    @property
    def wrench_links(self) -> tuple[str, ...]:
        """Names of the links that external wrenches act on, in the order of the arguments of the model."""
        return self._wrench_links or ()

    def set_wrench_links(self, links: Iterable[str]) -> None:
        """Let external wrenches act on the named links."""
        links = tuple(links)
        if links == self._wrench_links:
            return
        self._wrench_links = links
        self._programs = {}
        if self.loops is None:
            self._use_program("direct", None)
        elif self._coordinates is not None and self._direction is not None:
            self.use_coordinates(self._coordinates, self._direction)

    def use_coordinates(self, coordinates: LoopCoordinates, velocities: Array) -> None:
        """Use other coordinates of a robot with loops for rates from now on.

        velocities: (all joints,), the direction of motion at singular positions.
        """
        self._coordinates = coordinates
        self._direction = velocities
        self.rate_joints = list(coordinates.independent)
        self._use_program("state_derivative", coordinates.independent)

    def _use_program(self, model: Literal["direct", "state_derivative"], independent: tuple[int, ...] | None) -> None:
        if independent not in self._programs:
            program = self.dynamics.compile(model, wrenches=self.wrench_links, independent=independent)
            outputs = [np.empty(shape) for _, shape in program.interface.outputs]
            self._programs[independent] = program, outputs
        self._program, self._outputs = self._programs[independent]

    def unconstrained_accelerations(
        self, q: Array, rates: Array, gravity: Array, efforts: Array, wrenches: Sequence[Array]
    ) -> tuple[Array, Array]:
        """Accelerations of a robot whose base moves freely or is fixed.

        Parameters
        ----------
        q : ndarray
            Positions as the programs take them: (all joints,) of a robot with loops, else (n,).
        rates : ndarray, shape (6 + n,)
        gravity : ndarray, shape (3,)
            In the base frame [m/s²].
        efforts : ndarray
            Joint efforts (n,), of a robot with loops (all joints,).
        wrenches : sequence of ndarray, shape (6,)
            One for each of wrench_links, in the frame of the link.

        Returns
        -------
        velocities : ndarray
            Velocities of q; those of platform angles are rates in the charts of the attitudes.
        accelerations : ndarray, shape (6 + n,)
            ν̇.
        """
        twist = rates[:6]
        base = (twist, gravity) if self._has_moving_base else ()
        self._program.evaluate(q, rates[6:], efforts, *base, *wrenches, *self._outputs)
        velocities = rates[6:]
        outputs = self._outputs
        if self.loops is not None:
            velocities = outputs[0].copy()
            outputs = outputs[1:]
        if base:
            return velocities, rates_derivative(twist, outputs[1], outputs[0])
        return velocities, np.concatenate([NO_TWIST, outputs[0]])

    def velocities(self, coordinates: LoopCoordinates, q: Array, rates: Array, direction: Array) -> Array:
        """Velocities (all joints,) of a robot with loops at rates (6 + n,).

        q: (all joints,) positions that close the loops; coordinates: those in use, with the quality at q; direction:
        velocities (all joints,) shortly before, for singular positions.
        """
        loops = self._require_loops()
        no_efforts = np.zeros(len(q))
        no_wrenches = [np.zeros(6)] * len(self.wrench_links)

        def velocities_at(q: Array) -> Array:
            chart_rates, _ = self.unconstrained_accelerations(q, rates, NO_GRAVITY, no_efforts, no_wrenches)
            return loops.attitudes.joint_velocities(q, chart_rates)

        return evaluate_on_branch(loops, velocities_at, coordinates, q, direction)

    def initial_velocities(self, coordinates: LoopCoordinates, q: Array, rates: Array) -> Array:
        """Velocities (all joints,) of a robot with loops that starts at q (all joints,) with rates (6 + n,).

        No motion has led to q: the direction is that of the tangent.
        """
        loops = self._require_loops()
        chart_rates = loops.constrained_state(coordinates, q).expand_rates(rates[6:])
        return self.velocities(coordinates, q, rates, loops.attitudes.joint_velocities(q, chart_rates))

    def joint_accelerations(self, q: Array, velocities: Array, rates_derivative: Array) -> Array:
        """Accelerations (n,) of Dynamics.joint_names of a robot with loops, from ν̇ (6 + n,) in the coordinates in use.

        q, velocities: (all joints,).
        """
        loops = self._require_loops()

        def accelerations_at(q: Array) -> Array:
            state = loops.constrained_state(self._coordinates_in_use, q)
            drift = state.drift(state.expand_rates(velocities[self.rate_joints]))
            accelerations: Array = state.expand_rates(rates_derivative[6:]) + drift
            return accelerations

        return self._smooth(accelerations_at, q)[[*loops.default_independent]]

    def velocity_matrix(self, q: Array) -> Array:
        """G (all joints, n), from the rates of the independent joints to the velocities of all joints.

        Velocities of platform angles are rates in the charts of the attitudes.
        """
        if self._G is not None:
            return self._G
        loops = self._require_loops()
        return self._smooth(lambda q: loops.constrained_state(self._coordinates_in_use, q).G, q)

    def velocity_drift(self, q: Array, velocities: Array) -> Array:
        """Ġ q̇ (all joints,) at velocities (all joints,) of a robot with loops."""
        loops = self._require_loops()
        return self._smooth(lambda q: loops.constrained_state(self._coordinates_in_use, q).drift(velocities), q)

    def inertia_matrix(self, q: Array) -> Array:
        """A (6 + n, 6 + n), or (n, n) of a robot on a fixed base."""
        if self.independent not in self._inertia_programs:
            program = self.dynamics.compile("inertia_matrix", independent=self.independent)
            self._inertia_programs[self.independent] = program
        return self._smooth(self._inertia_programs[self.independent].evaluate, q)

    def raise_if_singular(self, q: Array, rates: Array, efforts: Array) -> None:
        """Raise SingularModelError where the model has no accelerations at rates (6 + n,) of Dynamics.joint_names."""
        base = Base(twist=rates[:6]) if self._has_moving_base else None
        if self.loops is not None:
            efforts = efforts[[*self.loops.default_independent]]
        with suppress(InvalidInputError):  # not finite: the caller raises
            self.dynamics.direct(q, rates[6:], efforts, base=base)

    def _smooth(self, function: Callable[[Array], Array], q: Array) -> Array:
        """function(q), interpolated along the branch at singular positions of loops."""
        if self.loops is None or self._coordinates is None or self._direction is None:
            return function(q)
        return evaluate_on_branch(self.loops, function, self._coordinates, q, self._direction)

    @property
    def _coordinates_in_use(self) -> LoopCoordinates:
        assert self._coordinates is not None
        return self._coordinates

    def _require_loops(self) -> ConstrainedMotion:
        assert self.loops is not None
        return self.loops
