"""Calls of compiled programs by Dynamics: the arguments of a program, and its first result."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.array_checks import require_finite
from robot_dynamics.codegen.jit.program_key import SOLVING_MODELS, ProgramKey
from robot_dynamics.codegen.trace.model_arguments import BASE_ARGUMENTS
from robot_dynamics.inputs import base_state, common_batch_shape
from robot_dynamics.newton_euler.linear import MIN_INERTIA_RATIO

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.codegen.jit.compiled_models import CompiledModels, RunnableProgram
    from robot_dynamics.inputs import Base
    from robot_dynamics.model.robot import Robot


def evaluate_model(
    programs: CompiledModels,
    robot: Robot,
    model: str,
    joint_arguments: Mapping[str, Array],
    options: Mapping[str, object],
    recursion: Callable[[], Array],
) -> Array:
    """The first result of a model, by its program if that is ready, else by the recursion.

    Parameters
    ----------
    programs : CompiledModels
    robot : Robot
    model : str
        Name of the model.
    joint_arguments : mapping of str to (..., n)
        Checked values, in the order of the program's inputs.
    options : mapping
        `base` and `external_wrenches` as passed to Dynamics; empty if the model does not depend on them.
    recursion : callable
        Computes the result without a program. It is also called where the program's result is not finite or the state
        is singular, to raise the error that says why.

    Returns
    -------
    (..., *shape)
    """
    base: Base | None = options.get("base")  # type: ignore[assignment]  # base_arguments checks it
    wrenches: Mapping[str, ArrayLike] = options.get("external_wrenches") or {}  # type: ignore[assignment]  # as above
    key = program_key(model, robot, base, wrenches)
    program = programs.get_ready(*key)
    if program is None:
        started = time.perf_counter()
        result = recursion()
        programs.record_time(time.perf_counter() - started, *key)
        return result
    arguments = [
        *joint_arguments.values(),
        *base_arguments(model, robot, options, base),
        *wrench_arguments(robot, wrenches),
    ]
    computed = run_program(program, arguments, common_batch_shape(*arguments))
    return recursion() if computed is None else computed


def program_key(model: str, robot: Robot, base: Base | None, wrenches: Mapping[str, ArrayLike]) -> ProgramKey:
    """The key in CompiledModels of the program that computes a model for a base and external wrenches."""
    if model not in SOLVING_MODELS:
        return ProgramKey(model)
    prescribed_base = robot.moving_base and getattr(base, "acceleration", None) is not None
    solves = (
        model.startswith("direct")
        or (robot.moving_base and not prescribed_base)
        or any(not joint.actuated for joint in robot.joints)
    )
    return ProgramKey(model, tuple(wrenches), prescribed_base, solves)


def base_arguments(model: str, robot: Robot, options: Mapping[str, object], base: Base | None) -> list[Array]:
    """The arguments of a model that describe the base: twist (..., 6), gravity (..., 3), acceleration (..., 6).

    Raises InvalidInputError if the base does not fit the robot.
    """
    if not options or (base is None and not robot.moving_base):
        return []
    state = base_state(robot, base)
    if not robot.moving_base:
        return []
    values = {"twist": state.twist, "gravity": state.gravity}
    arguments = [values[name] for name in BASE_ARGUMENTS[model]]
    if model in (*SOLVING_MODELS, "regressor") and state.acceleration is not None:
        arguments.append(state.true_acceleration(state.acceleration))
    return arguments


def wrench_arguments(robot: Robot, wrenches: Mapping[str, ArrayLike]) -> list[Array]:
    """The arrays (..., 6) of external wrenches, in their order. Raises InvalidInputError if one is not finite."""
    return [
        require_finite(f"external wrench on {name!r}", wrench, 6, "force and torque components")
        for name, wrench in wrenches.items()
    ]


def run_program(program: RunnableProgram, arguments: Sequence[Array], batch: tuple[int, ...]) -> Array | None:
    """The first result (*batch, ...) of a program; None where it is not finite or the state is singular."""
    results = run_all_outputs(program, arguments, batch, checked=1)
    return None if results is None else results[0]


def run_all_outputs(
    program: RunnableProgram, arguments: Sequence[Array], batch: tuple[int, ...], checked: int | None = None
) -> list[Array] | None:
    """The results (*batch, ...) of a program.

    Parameters
    ----------
    program : CompiledProgram or PythonProgram
    arguments : sequence of (..., size)
    batch : tuple of int
        Batch shape of all arguments together.
    checked : int, optional
        Number of results that must be finite. Default: all but those that reveal singular states.

    Returns
    -------
    list of arrays or None
        Without those that reveal singular states. None where one is not finite, where the state is singular, and for
        a batch without samples.
    """
    if batch == ():
        results = program.evaluate(*(np.ascontiguousarray(argument) for argument in arguments))
    else:
        samples = int(np.prod(batch))
        if not samples:
            return None
        results = program.batch(*(_as_rows(argument, batch, samples) for argument in arguments))
    results = results if isinstance(results, tuple) else (results,)
    outputs = program.interface.outputs
    has_pivots = outputs[-1][0] == "diagonal"
    count = len(results) - 2 * has_pivots
    if not all(np.isfinite(result).all() for result in results[: count if checked is None else checked]):
        return None
    if has_pivots and not (results[-2] > MIN_INERTIA_RATIO * np.abs(results[-1])).all():
        return None
    return [result.reshape(*batch, *shape) for result, (_, shape) in zip(results[:count], outputs, strict=False)]


def _as_rows(argument: Array, batch: tuple[int, ...], samples: int) -> Array:
    """An argument (*batch, size) as (samples, size); unchanged if it is (size,), the same for all samples."""
    if argument.ndim == 1:
        return argument
    size = argument.shape[-1]
    return np.ascontiguousarray(np.broadcast_to(argument, (*batch, size))).reshape(samples, size)
