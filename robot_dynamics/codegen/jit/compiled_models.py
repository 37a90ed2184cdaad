"""The models of one robot as programs that run: traced and compiled when they are needed, each once."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import TYPE_CHECKING, Any, TypeAlias

from robot_dynamics.codegen.jit.background_compilation import BackgroundCompilation
from robot_dynamics.codegen.jit.compiled_program import CompiledProgram, compile_program, load_program
from robot_dynamics.codegen.jit.program_key import FRAME_MODELS, SOLVING_MODELS, WHOLE_BODY_MODELS, ProgramKey
from robot_dynamics.codegen.trace.fingerprint import fingerprint
from robot_dynamics.errors import CompilationError, SingularModelError
from robot_dynamics.model.robot_warnings import find_singular_joints
from robot_dynamics.newton_euler.centroid import moving_mass
from robot_dynamics.optional_packages import install_hint

if TYPE_CHECKING:
    from robot_dynamics.codegen.jit.python_program import PythonProgram
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.model.robot import Robot

    RunnableProgram: TypeAlias = CompiledProgram | PythonProgram
    """A program that can be called."""

__all__ = ["FRAME_MODEL_TRACERS", "LOOP_MODELS", "MODELS", "CompiledModels", "available_models"]

logger = logging.getLogger(__name__)


def _model_tracer(name: str) -> Callable[..., Program]:
    """The function of codegen.trace.models that traces a model, imported when it is called.

    Programs come from the cache in most processes: then nothing is traced.
    """

    def trace(robot: Robot, *arguments: Any, **options: Any) -> Program:
        from robot_dynamics.codegen.trace import models

        program: Program = getattr(models, f"{name}_model")(robot, *arguments, **options)
        return program

    return trace


MODELS: dict[str, Callable[..., Program]] = {
    name: _model_tracer(name)
    for name in (
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
        "momentum",
        *WHOLE_BODY_MODELS,
    )
}
"""The function that traces each model of the robot."""

FRAME_MODEL_TRACERS: dict[str, Callable[..., Program]] = {name: _model_tracer(name) for name in FRAME_MODELS}
"""The function that traces each model of a frame."""

LOOP_MODELS = ("closure", "state_derivative")
"""Models that only robots with loops have."""

COMPILE_THRESHOLD = 0.05
"""Time spent on a model by the recursions [s] after which it is compiled in the background."""

MAX_PROGRAMS = 24
"""Programs of one robot compiled in the background, and as many of its frames; a limit for callers whose external
wrenches keep changing links, or who read many frames."""


MASS_MODELS = ("centre_of_mass", "centroidal_momentum_matrix", "centroidal_momentum_bias")
"""Models that only robots with a mass have that can move."""


def available_models(robot: Robot) -> dict[str, Callable[..., Program]]:
    """The entries of MODELS that a robot has."""
    missing = (() if robot.loops else LOOP_MODELS) + (() if moving_mass(robot) else MASS_MODELS)
    return {name: model for name, model in MODELS.items() if name not in missing}


class CompiledModels:
    """The programs of one robot, selected by the fields of a ProgramKey.

    Parameters
    ----------
    robot : Robot
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._compilations: dict[ProgramKey, BackgroundCompilation[RunnableProgram]] = {}
        self._background_count = dict.fromkeys((True, False), 0)  # of frames, and of other models
        self._python_programs: dict[ProgramKey, PythonProgram] = {}

    @property
    def ready_keys(self) -> tuple[ProgramKey, ...]:
        """The keys of the programs that are ready."""
        return tuple(key for key, compilation in self._compilations.copy().items() if compilation.program is not None)

    def get(
        self,
        name: str,
        wrenches: tuple[str, ...] = (),
        prescribed_base: bool = False,
        with_pivots: bool = False,
        independent: tuple[int, ...] | None = None,
        frame: str | None = None,
    ) -> RunnableProgram:
        """The program of a model, compiled now if it is not ready.

        Parameters
        ----------
        name, wrenches, prescribed_base, with_pivots, independent, frame
            See ProgramKey.

        Returns
        -------
        CompiledProgram or PythonProgram
            A PythonProgram where nothing compiles.

        Raises
        ------
        SingularModelError
            If nothing with inertia resists some motion, whatever the state.
        """
        key = ProgramKey(name, tuple(wrenches), prescribed_base, with_pivots, independent, frame)
        return self._compilation(key).get()

    def get_python(self, key: ProgramKey) -> PythonProgram:
        """The program of a model, run as Python. Raises SingularModelError as `get`."""
        from robot_dynamics.codegen.jit.python_program import PythonProgram  # seldom needed

        program = self._python_programs.get(key)
        if program is None:
            program = PythonProgram(_trace_model(self._robot, key.name, _model_options(key)))
            self._python_programs[key] = program
        return program

    def get_ready(
        self,
        name: str,
        wrenches: tuple[str, ...] = (),
        prescribed_base: bool = False,
        with_pivots: bool = False,
        independent: tuple[int, ...] | None = None,
        frame: str | None = None,
    ) -> RunnableProgram | None:
        """The program of a model if it is ready, else None."""
        key = ProgramKey(name, tuple(wrenches), prescribed_base, with_pivots, independent, frame)
        compilation = self._compilations.get(key)
        return None if compilation is None else compilation.program

    def record_time(
        self,
        seconds: float,
        name: str,
        wrenches: tuple[str, ...] = (),
        prescribed_base: bool = False,
        with_pivots: bool = False,
        independent: tuple[int, ...] | None = None,
        frame: str | None = None,
    ) -> None:
        """Add time that a model took without a program [s]; compile it in the background once that is worthwhile."""
        key = ProgramKey(name, tuple(wrenches), prescribed_base, with_pivots, independent, frame)
        compilation = self._compilation(key)
        is_frame = frame is not None
        if not compilation.is_started and self._background_count[is_frame] < MAX_PROGRAMS:
            compilation.record_time(seconds)
            self._background_count[is_frame] += compilation.is_started

    def _compilation(self, key: ProgramKey) -> BackgroundCompilation[RunnableProgram]:
        compilation = self._compilations.get(key)
        if compilation is None:
            created = BackgroundCompilation(
                partial(_compile_model, self._robot, key),
                COMPILE_THRESHOLD,
                f"the model {key.name} of {self._robot.name!r}",
                expected_errors=(SingularModelError,),  # the recursions raise it too, and name the joint
                prepare=_compile_batch,
            )
            compilation = self._compilations.setdefault(key, created)
        return compilation


def _compile_batch(program: RunnableProgram) -> None:
    if isinstance(program, CompiledProgram):
        program.compile_batch()


def _compile_model(robot: Robot, key: ProgramKey) -> RunnableProgram:
    """The program of a model, from the cache or compiled; as Python where nothing compiles."""
    started = time.perf_counter()
    options = _model_options(key)
    trace = cache(partial(_trace_model, robot, key.name, options))
    cache_key = fingerprint(robot, key.name, options)
    program: RunnableProgram
    try:
        program = (cache_key and load_program(cache_key, trace)) or compile_program(trace(), key=cache_key)
    except CompilationError as error:
        _warn_once(str(error))
        from robot_dynamics.codegen.jit.python_program import PythonProgram  # seldom needed

        program = PythonProgram(trace())
    seconds = time.perf_counter() - started
    logger.debug("%s of %r: %s, ready in %.3f s", key.name, robot.name, program.interface.operations, seconds)
    return program


def _model_options(key: ProgramKey) -> dict[str, object]:
    """The keyword arguments of the function that traces the model."""
    options: dict[str, object] = {}
    if key.name in SOLVING_MODELS:
        options = {
            "wrenches": key.wrenches,
            "prescribed_base": key.prescribed_base,
            "with_pivots": key.with_pivots,
        }
    elif key.name == "state_derivative":
        options = {"wrenches": key.wrenches}
    if key.independent is not None:
        options["independent"] = key.independent
    if key.frame is not None:
        options["frame"] = key.frame
    return options


def _trace_model(robot: Robot, name: str, options: Mapping[str, object]) -> Program:
    try:
        return (MODELS | FRAME_MODEL_TRACERS)[name](robot, **options)
    except ZeroDivisionError:
        reason = f"{name}: nothing with inertia resists some motion, whatever the state"
        raise SingularModelError("; ".join([reason, *find_singular_joints(robot)])) from None


_logged_warnings: set[str] = set()


def _warn_once(reason: str) -> None:
    if reason not in _logged_warnings:
        _logged_warnings.add(reason)
        hint = install_hint("llvmlite")
        logger.warning("models run as Python, slower than compiled: %s: %s", reason, hint)
