"""Models with all checks in machine code: for callers that compute one sample after the other."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from robot_dynamics.codegen.jit.background_compilation import BackgroundCompilation
from robot_dynamics.codegen.jit.compiled_program import STATUS, CompiledProgram
from robot_dynamics.codegen.jit.program_key import DERIVATIVE_MODELS, SOLVING_MODELS
from robot_dynamics.codegen.program_calls import program_key
from robot_dynamics.codegen.trace.fingerprint import fingerprint
from robot_dynamics.constraints.sample_closure import SampleClosure
from robot_dynamics.errors import CompilationError, SingularModelError
from robot_dynamics.newton_euler.linear import MIN_INERTIA_RATIO
from robot_dynamics.procedures import is_finite, largest, magnitude, procedure, select

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.codegen.jit.compiled_models import CompiledModels
    from robot_dynamics.codegen.jit.program_key import ProgramKey
    from robot_dynamics.codegen.procedure.kernels import Kernel
    from robot_dynamics.constraints.topology import ConstraintTopology
    from robot_dynamics.model.robot import Robot

Attempt: TypeAlias = "Callable[..., Array | None]"
"""Computes a model from arrays (size,); None where the arrays do not fit or the result is not valid."""

BOUND_MODELS = ("inverse", "direct", "inertia_matrix", "gravity", "coriolis")
"""Models that Dynamics binds."""

CHECKED_MODELS = (*BOUND_MODELS, *DERIVATIVE_MODELS)
"""Models that Dynamics computes in this way. Derivatives by all arguments are the columns of one result."""


class CheckedModels:
    """The checked models of one robot, compiled in the background.

    Parameters
    ----------
    robot : Robot
    topology : ConstraintTopology
    programs : CompiledModels
        Where the straight-line programs come from.

    Attributes
    ----------
    attempts : dict of str to tuple of callable
        By model, the functions to try one after the other. Models that are not ready are missing.
    """

    def __init__(self, robot: Robot, topology: ConstraintTopology, programs: CompiledModels) -> None:
        self.attempts: dict[str, tuple[Attempt, ...]] = {}
        self._robot = robot
        self._topology = topology
        self._programs = programs
        self._compilations: dict[str, BackgroundCompilation[tuple[Attempt, ...]]] = {}

    def prepare(self, model: str) -> None:
        """Compile a checked model in the background, unless that is done already."""
        if model in self._compilations or model not in CHECKED_MODELS or self._robot.moving_base:
            return
        key = program_key(model, self._robot, None, {})
        compilation = BackgroundCompilation(
            partial(_compile_attempts, self._robot, self._topology, self._programs, key),
            np.inf,
            f"the checked model {model} of {self._robot.name!r}",
            expected_errors=(SingularModelError, CompilationError),
            prepare=partial(self.attempts.__setitem__, model),
        )
        self._compilations[model] = compilation
        compilation.start()

    def compile(self, key: ProgramKey) -> tuple[Attempt, ...]:
        """The functions that compute a model with a base and external wrenches, compiled now.

        They take the inputs of the program of that key. Empty where nothing compiles. Raises SingularModelError where
        the model has no solution in any state.
        """
        try:
            return _compile_attempts(self._robot, self._topology, self._programs, key)
        except CompilationError:
            return ()


def _compile_attempts(
    robot: Robot, topology: ConstraintTopology, programs: CompiledModels, key: ProgramKey
) -> tuple[Attempt, ...]:
    """The functions that compute a model: for a robot with loops from positions of all joints, and of the motors."""
    from robot_dynamics.codegen.jit.procedure_code import compile_procedure
    from robot_dynamics.codegen.procedure.kernels import Kernel
    from robot_dynamics.codegen.procedure.procedure_text import ProcedureInterface

    program = programs.get(*key)
    closure = programs.get("closure") if robot.loops else None
    if not isinstance(program, CompiledProgram) or not isinstance(closure, CompiledProgram | None):
        return ()
    kernels = [Kernel("model", program)]
    if closure is not None:
        kernels.append(Kernel("closure", closure))
    checked = CheckedModel(key.name, topology, *kernels)
    variants: dict[str, tuple[Callable[..., Any], int]] = {"closed": (checked.evaluate, len(topology.independent))}
    if closure is not None:
        variants = {
            "near": (checked.evaluate_near, len(robot.joints)),
            "motors": (checked.evaluate_from_motors, len(topology.independent)),
        }
    _, *other_inputs = program.interface.inputs.items()
    name, shape = checked.result
    attempts = []
    for variant, (function, size) in variants.items():
        interface = ProcedureInterface({"q": size, **dict(other_inputs)}, {name: shape, STATUS: (1,)})
        cache_key = fingerprint(robot, "checked", key, variant)
        compiled = compile_procedure(f"{key.name}_{variant}", function, interface, kernels, cache_key)
        assert compiled.attempt is not None
        attempts.append(compiled.attempt)
    return tuple(attempts)


class CheckedModel:
    """Procedures that compute a model and its status, which is zero where the result is valid.

    Parameters
    ----------
    name : str
        Name of the model.
    topology : ConstraintTopology
    model : Kernel
        With the inputs of the model, positions first.
    closure : Kernel, optional
        The model `closure` of a robot with loops.
    """

    def __init__(self, name: str, topology: ConstraintTopology, model: Kernel, closure: Kernel | None = None) -> None:
        self._model = model
        self._outputs = [name for name, _ in model.interface.outputs]
        joints = [topology.robot.joints[number] for number in topology.independent]
        # columns of accelerations or efforts, which unactuated joints do not take
        self._refused: list[int] = []
        if name in SOLVING_MODELS:
            self._refused = [column for column, joint in enumerate(joints) if not joint.actuated]
        self._closure: Any = None if closure is None else SampleClosure(topology, closure)
        # numbers of the outputs of which the columns are the result
        self._parts = [k for k, output in enumerate(self._outputs) if k == 0 or output.startswith("by_")]

    @property
    def result(self) -> tuple[str, tuple[int, ...]]:
        """Name and shape of the result."""
        (name, shape), *others = [self._model.interface.outputs[k] for k in self._parts]
        if not others:
            return name, shape
        return self._model.interface.name, (shape[0], shape[1] + sum(columns for _, (_, columns) in others))

    @procedure
    def evaluate(self, q: Any, *others: Any) -> Any:
        """Result and status at positions q that close the loops."""
        results = self._model(q, *others)
        if len(self._outputs) == 1:
            results = (results,)
        result = results[0]
        if len(self._parts) > 1:
            result = np.concatenate([results[k] for k in self._parts], axis=1)
        is_valid = is_finite(result)
        for argument in (q, *others):  # a result may not depend on all of them
            is_valid = is_valid & is_finite(argument)
        if self._outputs[-1] == "diagonal":
            margin = largest(MIN_INERTIA_RATIO * magnitude(results[-1]) - results[-2])
            is_valid = is_valid & (margin < 0)
        for column in self._refused:
            is_valid = is_valid & (others[1][column] == 0)
        return result, np.array([select(is_valid, 0.0, 1.0)])

    @procedure
    def evaluate_near(self, q: Any, *others: Any) -> Any:
        """Result and status where the loops close nearest to positions q (all joints,)."""
        closed = self._closure.close_near(q)
        result, status = self.evaluate(self._closure.joint_positions(closed.t), *others)
        return result, status + closed.status

    @procedure
    def evaluate_from_motors(self, q: Any, *others: Any) -> Any:
        """Result and status where the loops close from positions q (n,) of the independent joints."""
        closed = self._closure.close_from_reference(q)
        result, status = self.evaluate(self._closure.joint_positions(closed.t), *others)
        return result, status + closed.status
