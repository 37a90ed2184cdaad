"""Class `Dynamics`: the inverse and direct dynamic models of a robot, and access to its other models."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Literal, NoReturn, TypeAlias

from robot_dynamics.bound_model import BoundModel
from robot_dynamics.codegen.jit.compiled_models import (
    FRAME_MODEL_TRACERS,
    LOOP_MODELS,
    MODELS,
    CompiledModels,
    available_models,
)
from robot_dynamics.codegen.procedure.checked_models import BOUND_MODELS, CheckedModels
from robot_dynamics.codegen.procedure.closure_programs import ClosurePrograms, ProgramSwitch
from robot_dynamics.codegen.program_calls import evaluate_model, program_key
from robot_dynamics.constraints.closure_solver import ClosureSolver
from robot_dynamics.errors import InvalidInputError, SingularModelError, UnavailableModelError, describe_unknown_name
from robot_dynamics.flexible.elastodynamics import Elastodynamics
from robot_dynamics.flexible.flexible_arm import FlexibleArm
from robot_dynamics.inputs import Base
from robot_dynamics.joint_space.joint_dynamics import JointDynamics
from robot_dynamics.joint_space.motion_derivatives import MotionDerivatives
from robot_dynamics.joint_space.whole_body import WholeBody
from robot_dynamics.model.robot import Robot
from robot_dynamics.newton_euler.screw import BASE_ROWS
from robot_dynamics.notebook_display import notebook_html
from robot_dynamics.parallel.platform_dynamics import PlatformDynamics, Platforms
from robot_dynamics.results import DynamicsResult, Equilibrium

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.codegen.jit.compiled_models import RunnableProgram
    from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
    from robot_dynamics.codegen.jit.program_key import ProgramKey
    from robot_dynamics.codegen.jit.python_program import PythonProgram
    from robot_dynamics.inputs import ExternalWrenches
    from robot_dynamics.model.platform import Platform

__all__ = ["BASE_ROWS", "Base", "Dynamics", "DynamicsResult", "Equilibrium"]

ModelName: TypeAlias = Literal[
    "inverse",
    "direct",
    "inertia_matrix",
    "gravity",
    "coriolis",
    "bias",
    "friction",
    "regressor",
    "closure",
    "state_derivative",
    "inverse_derivatives",
    "direct_derivatives",
    "centre_of_mass",
    "centroidal_momentum_matrix",
    "centroidal_momentum_bias",
    "kinetic_energy",
    "momentum",
    "pose",
    "jacobian",
    "jacobian_in_base_axes",
    "bias_acceleration",
    "bias_acceleration_in_base_axes",
]
"""Models that `Dynamics.compile` compiles; closure and state_derivative only for robots with loops, the last five for a
frame."""

CheckedModelName: TypeAlias = Literal["inverse", "direct", "inertia_matrix", "gravity", "coriolis"]
"""Models that `Dynamics.bind` binds."""


MAX_CHECKED_ENTRIES = 600
"""Entries of derivatives up to which their checks are compiled too; compilation takes longer than it saves for more."""


class Dynamics(JointDynamics, MotionDerivatives):
    """Inverse and direct dynamics of a robot, for one sample or a batch.

    Parameters
    ----------
    robot : Robot
        As `load_robot` returns it.
    compiled : bool, default True
        Whether `inverse`, `direct`, `inertia_matrix`, `gravity`, `coriolis`, `regressor`, and the methods of `frame`
        and `whole_body`, change from the recursions to compiled programs after some time of use. Compilation runs in
        the background: only `compile` blocks. Results of programs and recursions differ in the last digits.

    Attributes
    ----------
    robot : Robot
    compiled : bool
    joint_names : tuple of str
        The n independent joints, branch by branch in the order of the description.
    all_joint_names : tuple of str
        All joints: the independent joints, and those that depend on them (mimic joints, joints that loops determine).
    dependent_joint_names : tuple of str
        Joints that loops determine.
    unactuated_joint_names : tuple of str
        Elastic and passive joints among `joint_names`. Their positions and velocities are part of the state; their
        accelerations are always a result and their efforts always zero, so that 0 or nan stands there in arguments.

    Raises
    ------
    InvalidInputError
        `robot` is not a Robot.
    DescriptionError
        The mobility of the loops does not fit the actuated joints.

    Notes
    -----
    **Arrays.** Joint vectors are (..., n) in the order of `joint_names`: one sample (n,) or a batch (N, n). `expand_*`,
    `project_efforts` and `embed_efforts` convert between independent joints and all joints. Units are SI. Efforts are
    those of the actuators at the joints. External wrenches are [force; torque] of the environment on a link, in the
    link frame at its origin. Accelerations are true (gravity is not subtracted) and classical, of the origin of the
    frame.

    **Loops.** Where the robot has loops, positions may also be (..., all joints). The positions of the dependent joints
    are then a seed of the closure solver and choose the assembly mode; nan leaves a joint out of the seed. Without a
    seed the loops close in the assembly mode of the initial positions of the description.

    **Errors.** Each method raises InvalidInputError for an argument that does not fit the robot, and SingularModelError
    where the loops do not close or are singular.

    Methods keep no state: each result depends on the arguments alone.
    """

    _repr_html_ = notebook_html

    def __init__(self, robot: Robot, *, compiled: bool = True) -> None:
        if not isinstance(robot, Robot):
            raise InvalidInputError(f"Dynamics takes a Robot, as load_robot returns it, not {robot!r:.60}")
        self._switch = ProgramSwitch(bool(compiled))
        self._programs = CompiledModels(robot)
        super().__init__(robot, ClosureSolver(robot, ClosurePrograms(robot, self._programs, self._switch)))
        self._checked_models = CheckedModels(robot, self._closure_solver.topology, self._programs)
        self.compiled = compiled

    def __repr__(self) -> str:
        return f"Dynamics({self.robot!r})"

    @property
    def compiled(self) -> bool:
        """Whether calls change to compiled programs; it can be assigned. Bound models stay compiled."""
        return self._switch.is_on

    @compiled.setter
    def compiled(self, compiled: bool) -> None:
        self._switch.is_on = bool(compiled)
        self._attempts = self._checked_models.attempts if compiled else {}

    def __reduce__(self) -> tuple[Callable[[Robot], Dynamics], tuple[Robot]]:
        """Copy and pickle without the programs: machine code belongs to this process."""
        return partial(Dynamics, compiled=self.compiled), (self.robot,)

    def compile(
        self,
        model: ModelName,
        *,
        wrenches: Sequence[str] = (),
        prescribed_base: bool = False,
        independent: Iterable[int] | None = None,
        frame: str | None = None,
    ) -> CompiledProgram | PythonProgram:
        """Return the compiled program of a model; compile it now if it does not exist yet.

        The program is the fastest way to compute a model from Python. Its attribute ``interface`` has the names and
        sizes of its inputs and outputs.

        Parameters
        ----------
        model : str
            inverse, direct, inertia_matrix, gravity, coriolis, bias, friction, regressor, inverse_derivatives,
            direct_derivatives or momentum; for a robot with loops also closure and state_derivative. With closure,
            calls that close loops from the positions of motors, or near a seed, are compiled as well. Of the whole
            robot, in the axes of frame 0: centre_of_mass, centroidal_momentum_matrix, centroidal_momentum_bias and
            kinetic_energy. Of a frame: pose in frame 0, jacobian and bias_acceleration in its axes;
            jacobian_in_base_axes and bias_acceleration_in_base_axes in those of frame 0.
        wrenches : sequence of str
            Names of the links on which external wrenches act.
        prescribed_base : bool
            Whether the acceleration of a moving base is an input, for inverse, direct and their derivatives.
        independent : iterable of int, optional
            Numbers of the joints to take as independent, for inertia_matrix, closure and state_derivative. Default:
            those of `joint_names`.
        frame : str, optional
            Name of the frame, for the models of a frame only.

        Returns
        -------
        CompiledProgram or PythonProgram
            ``evaluate(q, qd, qdd)`` takes one sample as buffers of float64 and returns a new array; with one more
            argument it writes into that argument. ``batch(q, qd, qdd, out=None, threads=1)`` takes arrays (N, n). The
            program refuses buffers that do not fit and does not check values: nan in gives nan out. Where no compiler
            is available the program runs as Python.

        Raises
        ------
        InvalidInputError
            The model or a link is unknown, or nothing in the robot moves.
        SingularModelError
            The model has no solution in any state.
        """
        if not (self.joint_names or self.robot.moving_base):
            raise InvalidInputError(f"{self.robot.name!r} has no joints: there is nothing to compile")
        if model not in MODELS | FRAME_MODEL_TRACERS:
            raise InvalidInputError(describe_unknown_name("model", model, MODELS | FRAME_MODEL_TRACERS))
        if model in MODELS and model not in available_models(self.robot):
            reason = "no loops to close" if model in LOOP_MODELS else "no mass that can move"
            raise InvalidInputError(f"{self.robot.name!r} has {reason}")
        if (frame is None) == (model in FRAME_MODEL_TRACERS):
            reason = "is that of a frame: give its name" if frame is None else "is not that of a frame: leave it out"
            raise InvalidInputError(f"{model} {reason}")
        for name in wrenches if frame is None else (*wrenches, frame):
            self.robot.frame(name)
        numbers = None if independent is None else tuple(independent)
        program = self._programs.get(model, tuple(wrenches), bool(prescribed_base), independent=numbers, frame=frame)
        if model == "closure" and numbers is None:
            self._closure_solver.procedures.compile("close_near", "close_from_reference")
        return program

    def bind(
        self,
        model: CheckedModelName,
        *,
        base: Base | None = None,
        external_wrenches: ExternalWrenches | None = None,
    ) -> BoundModel:
        """Bind a model to a base and external wrenches that do not change, for callers in a loop.

        The model is compiled now. Names are resolved and the constants are checked once; a call checks the rest in
        machine code.

        Parameters
        ----------
        model : str
            inverse, direct, inertia_matrix, gravity or coriolis.
        base : Base, optional
            State of the base, for a robot with a moving base only.
        external_wrenches : mapping of str to array_like, shape (6,), optional
            As `inverse`; for inverse and direct only.

        Returns
        -------
        BoundModel
            ``bound(q, qd, qdd)`` takes the joint arguments of the method of that name, and returns the same result.

        Raises
        ------
        InvalidInputError
            The model is unknown, or the constants do not fit the robot.
        SingularModelError
            The model has no solution in any state.
        """
        if model not in BOUND_MODELS:
            raise InvalidInputError(describe_unknown_name("model", model, BOUND_MODELS))
        return BoundModel(self, model, self._checked_models, base, external_wrenches)

    @cached_property
    def platform(self) -> PlatformDynamics:
        """Dynamics of a parallel robot in coordinates of its platform, or of all platforms together.

        Raises InvalidInputError for a robot without a platform.
        """
        if not self.robot.platforms:
            raise UnavailableModelError(f"{self.robot.name!r} has no platform: use the joints")
        return self._platform_dynamics(*self.robot.platforms)

    @cached_property
    def platforms(self) -> Platforms:
        """Mapping from link name to the PlatformDynamics of that platform alone, with the other joints as joints.

        An unknown link name raises InvalidInputError.
        """
        return Platforms(
            (link, self._platform_dynamics(platform))
            for link, platform in zip(self.robot.platform_links, self.robot.platforms, strict=True)
        )

    def _platform_dynamics(self, *platforms: Platform) -> PlatformDynamics:
        """Return the dynamics in coordinates of some platforms.

        It takes callables, since it cannot import this module.
        """
        return PlatformDynamics(self, platforms, self._make_closure_solver, partial(Dynamics, compiled=False))

    def _make_closure_solver(self, robot: Robot) -> ClosureSolver:
        """Return the closure solver of the robot, or of a variant of it."""
        if robot is self.robot:
            return self._closure_solver
        return ClosureSolver(robot, ClosurePrograms(robot, CompiledModels(robot), self._switch))

    @cached_property
    def whole_body(self) -> WholeBody:
        """Centre of mass, momentum and energy of all bodies of the robot together."""
        return WholeBody(self)

    @cached_property
    def elastodynamics(self) -> Elastodynamics:
        """Natural frequencies of a robot with flexible links or elastic joints, held by its motors and brakes.

        ``Elastodynamics(dynamics, held=[...])`` holds other joints.
        """
        return Elastodynamics(self)

    @cached_property
    def flexible_arm(self) -> FlexibleArm:
        """Inverse and direct dynamics of a robot without loops and with flexible links.

        The other models take all links as rigid.
        """
        return FlexibleArm(self)

    def _runnable_program(self, key: ProgramKey) -> RunnableProgram:
        """Return the program of a model, compiled now if it is not ready; as Python where nothing is compiled."""
        if not self.compiled:
            return self._programs.get_python(key)
        program = self._programs.get(*key)
        if sum(math.prod(shape) for _, shape in program.interface.outputs) <= MAX_CHECKED_ENTRIES:
            self._checked_models.prepare(program_key(key.name, self.robot, None, {}))
        return program

    def _refuse_singular_state(self, q: ArrayLike, qd: ArrayLike, options: dict[str, Any]) -> NoReturn:
        """Raise SingularModelError for a state without derivatives; that of the model itself if it is singular too."""
        self.solve(q, qd, **options)
        raise SingularModelError("the derivatives are not finite numbers here: is the pitch of a platform ±90°?")

    def _evaluate(
        self, model: str, arguments: Mapping[str, Array], recursion: Callable[[], Array], options: Mapping[str, object]
    ) -> Array:
        """Return the result of a model from its program if it is ready, else from the recursion."""
        wrenches = options.get("external_wrenches")
        if not (self.compiled and self.joint_names and isinstance(wrenches, Mapping | None)):
            return recursion()
        is_one_sample = all(argument.ndim == 1 for argument in arguments.values())
        if is_one_sample:
            frame: str | None = options.get("frame")  # type: ignore[assignment]  # a name of a frame
            key = program_key(model, self.robot, None, {}, frame)
            if self._programs.get_ready(*key) is not None:
                self._checked_models.prepare(key)
        return evaluate_model(self._programs, self.robot, model, arguments, options, recursion)
