"""From what is asked of Dynamics to the arguments of a program, and from its results to the answer."""

import time

import numpy as np

from robot_dynamics.codegen.trace.models import BASE_ARGUMENTS
from robot_dynamics.inputs import base_state, common_batch_shape, require_finite
from robot_dynamics.results import MIN_INERTIA_RATIO


def evaluate_model(programs, robot, model, given, question, recursion):
    """The first result of a model: of its program where it is ready, else of the recursion.

    programs: CompiledModels; given: {argument: (..., n)}, checked; question: what `base` and `external_wrenches` are,
    empty where they have no part in the model. What a program gives that is not finite, or singular, is asked of the
    recursion, which tells why.
    """
    base, wrenches = question.get("base"), question.get("external_wrenches") or {}
    key = program_key(model, robot, base, wrenches)
    program = programs.get_ready(*key)
    if program is None:
        started = time.perf_counter()
        found = recursion()
        programs.record_time(time.perf_counter() - started, *key)
        return found
    arguments = [*given.values(), *base_arguments(model, robot, question, base), *wrench_arguments(robot, wrenches)]
    found = run_program(program, arguments, common_batch_shape(*arguments))
    return recursion() if found is None else found


def program_key(model, robot, base, wrenches):
    """What CompiledModels knows the program by that answers a question."""
    if model not in ("inverse", "direct"):
        return (model,)
    prescribed_base = robot.moving_base and getattr(base, "acceleration", None) is not None
    solves = (
        model == "direct"
        or (robot.moving_base and not prescribed_base)
        or any(not joint.actuated for joint in robot.joints)
    )
    return model, tuple(wrenches), prescribed_base, solves


def base_arguments(model, robot, question, base):
    """The arguments (..., 6) and (..., 3) that a model has of the base: twist, gravity, acceleration. Checked."""
    if not question or (base is None and not robot.moving_base):
        return []
    state = base_state(robot, base)
    if not robot.moving_base:
        return []
    values = {"twist": state.twist, "gravity": state.gravity}
    arguments = [values[name] for name in BASE_ARGUMENTS[model]]
    if model in ("inverse", "direct", "regressor") and state.acceleration is not None:
        arguments.append(state.true_acceleration(state.acceleration))
    return arguments


def wrench_arguments(robot, wrenches):
    """The arrays (..., 6) of external wrenches, in their order."""
    return [require_finite(f"external wrench on {name!r}", wrench, 6, "force and torque components")
            for name, wrench in wrenches.items()]  # fmt: skip


def run_program(program, arguments, batch):
    """The first result (*batch, ...) of a program, None where it is not finite or the state is singular."""
    if batch == ():
        results = program.evaluate(*(np.ascontiguousarray(argument) for argument in arguments))
    else:
        samples = int(np.prod(batch))
        if not samples:
            return None
        results = program.batch(*(_rows(argument, batch, samples) for argument in arguments))
    results = results if isinstance(results, tuple) else (results,)
    outputs = program.interface.outputs
    if not np.isfinite(results[0]).all():
        return None
    if outputs[-1][0] == "diagonal" and not (results[-2] > MIN_INERTIA_RATIO * np.abs(results[-1])).all():
        return None
    return results[0].reshape(*batch, *outputs[0][1])


def _rows(argument, batch, samples):
    """(samples, size), or (size,) where all samples have the same."""
    if argument.ndim == 1:
        return argument
    size = argument.shape[-1]
    return np.ascontiguousarray(np.broadcast_to(argument, (*batch, size))).reshape(samples, size)
