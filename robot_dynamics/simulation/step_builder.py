"""Builds the procedures of steps of a simulation from its plant, friction, base and ground."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
from robot_dynamics.codegen.procedure.kernels import Kernel
from robot_dynamics.constraints.sample_closure import SampleClosure
from robot_dynamics.errors import CompilationError
from robot_dynamics.simulation.compiled_loop_steps import CompiledLoopSteps
from robot_dynamics.simulation.compiled_steps import StepEnvironment
from robot_dynamics.simulation.compiled_tree_steps import CompiledTreeSteps
from robot_dynamics.simulation.ground_contact import GroundContact, PlantKinematics
from robot_dynamics.simulation.varied_inertias import VARIED_MODELS, make_kernel

if TYPE_CHECKING:
    from robot_dynamics.simulation.compiled_steps import CompiledSteps
    from robot_dynamics.simulation.friction_impulses import ImpulsiveFriction
    from robot_dynamics.simulation.ground import Ground
    from robot_dynamics.simulation.plant import Plant
    from robot_dynamics.simulation.rate_constraints import BaseType, RateConstraints


class StepBuilder:
    """Builds CompiledSteps.

    Parameters
    ----------
    plant : Plant
    base : {"fixed", "free", "planar"}
    constraints : RateConstraints
    friction : ImpulsiveFriction
    ground : Ground or None
    drive_time : float
        Time [s] in which a driven base comes 63 % nearer to its reference twist.
    step : float
        Length of a step [s].

    Attributes
    ----------
    varied_links : tuple of int
        Links whose inertias are inputs of the procedures.
    """

    def __init__(
        self,
        plant: Plant,
        base: BaseType,
        constraints: RateConstraints,
        friction: ImpulsiveFriction,
        ground: Ground | None,
        drive_time: float,
        step: float,
    ) -> None:
        self._plant = plant
        self._base: BaseType = base
        self._constraints = constraints
        self._friction = friction
        self._ground = ground
        self._drive_time = drive_time
        self._step = step
        self.varied_links: tuple[int, ...] = ()
        self._kinematics = None if ground is None else PlantKinematics(plant, ground.points)

    def with_varied_links(self, links: tuple[int, ...]) -> StepBuilder:
        """The same, of procedures that take inertias of some links as inputs."""
        builder = copy(self)
        builder.varied_links = links
        return builder

    @property
    def wrench_links(self) -> tuple[str, ...]:
        """Names of the links that external wrenches act on."""
        return self._plant.wrench_links

    @property
    def has_pose(self) -> bool:
        """Whether states have the pose of the base."""
        return self._base != "fixed" or self._ground is not None

    @property
    def is_supported(self) -> bool:
        """Whether machine code takes steps: not of steered wheels, and not without joints."""
        return self._plant.size > 0 and self._constraints.is_constant

    def fingerprint_values(self, independent: tuple[int, ...] | None, is_driven: bool) -> list[Any]:
        """All on which the code depends."""
        friction, q = self._friction, self._initial_positions
        constraints = [self._constraints.solution_at(q, driven) for driven in {False, is_driven}]
        return [
            self._plant.dynamics.robot,
            self.varied_links,
            independent,
            self.wrench_links,
            self._base,
            [list(solution) for solution in constraints if solution is not None],
            [friction.joints, friction.frictional_joints, friction.viscous_gains, friction.viscous_asymmetries],
            self._ground,
            [self._drive_time, self._step],
        ]

    def build(self, independent: tuple[int, ...] | None, is_driven: bool) -> tuple[CompiledSteps, list[Kernel]]:
        """The procedures, and the kernels that they call.

        Parameters
        ----------
        independent : tuple of int or None
            Numbers of the independent joints of a robot with loops; None without loops.
        is_driven : bool
            Whether a drive moves the base.

        Raises
        ------
        CompilationError
            A model runs as Python, or machine code does not support the coordinates.
        """
        plant = self._plant
        inertia_matrix = self._kernel("inertia_matrix", independent)
        kernels = [inertia_matrix]
        contact = None
        if self._ground is not None and self._kinematics is not None:
            frames = self._kinematics.of_coordinates(independent).program
            kernels.append(_kernel("frames", frames))
            contact = self._contact(self._ground, kernels[-1])
        plane = self._constraints.solution_at(self._initial_positions, False)
        drive = self._constraints.solution_at(self._initial_positions, True) if is_driven else None
        gravity = np.asarray(plant.dynamics.robot.gravity, dtype=float)
        wrench_count = len(self.wrench_links)
        environment = StepEnvironment(self._base, gravity, wrench_count, contact, plane, drive, self._drive_time)
        units = plant.units if self._base != "fixed" else plant.units[6:]
        if independent is None:
            direct = self._kernel("direct", None, self.wrench_links)
            G = plant.velocity_matrix(self._initial_positions)
            joint_shares = np.ascontiguousarray(G[self._friction.joints].T)
            tree_steps = CompiledTreeSteps(
                direct, inertia_matrix, self._friction, joint_shares, units, environment, self._step
            )
            return tree_steps, [direct, *kernels]
        assert plant.loops is not None
        topology = plant.loops.topology_of(independent)
        if topology.attitudes != topology.dependent_attitudes:
            raise CompilationError("an angle of a platform is an independent coordinate")
        joint_units = topology.joint_units[[*independent]]
        units = np.concatenate([units[: len(units) - plant.size], joint_units])
        state_derivative = self._kernel("state_derivative", independent, self.wrench_links)
        closure = self._kernel("closure", independent)
        loop_steps = CompiledLoopSteps(
            topology,
            SampleClosure(topology, closure),
            state_derivative,
            inertia_matrix,
            self._friction,
            units,
            environment,
            self._step,
        )
        return loop_steps, [state_derivative, closure, *kernels]

    @property
    def _initial_positions(self) -> Any:
        """Positions of the description, as the programs take them."""
        return self._plant.program_positions(self._plant.dynamics.initial_joint_positions)

    def _kernel(self, name: str, independent: tuple[int, ...] | None, wrenches: tuple[str, ...] = ()) -> Kernel:
        """Kernel of a model. Raises CompilationError where it runs as Python."""
        if self.varied_links and name in VARIED_MODELS:
            return make_kernel(self._plant.dynamics.robot, name, self.varied_links, independent)
        program = self._plant.dynamics.compile(name, wrenches=wrenches, independent=independent)  # type: ignore[arg-type]
        return _kernel(name, program)

    def _contact(self, ground: Ground, frames: Kernel) -> GroundContact:
        robot = self._plant.dynamics.robot

        def kinematics(q: Any, rates: Any) -> tuple[Any, Any, Any]:
            rotations, positions, velocities = (
                frames(q, rates[6:], rates[:6]) if robot.moving_base else frames(q, rates)
            )
            return rotations, positions, velocities

        return GroundContact(ground, self.wrench_links, kinematics, robot.characteristic_length)


def _kernel(name: str, program: Any) -> Kernel:
    if not isinstance(program, CompiledProgram):
        raise CompilationError(f"the model {name} runs as Python")
    return Kernel(name, program)
