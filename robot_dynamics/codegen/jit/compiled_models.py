"""The models of one robot as programs that run: traced and compiled when they are asked for, each once."""

import logging
import time
from functools import cache, partial
from threading import Lock

import numpy as np

from robot_dynamics.codegen.jit.background import run_in_background
from robot_dynamics.codegen.jit.compiled_program import CompiledProgram, compile_program, load_program
from robot_dynamics.codegen.jit.python_functions import python_batch, python_function
from robot_dynamics.codegen.trace import models
from robot_dynamics.codegen.trace.fingerprint import fingerprint
from robot_dynamics.errors import CompilationError, SingularModelError

logger = logging.getLogger(__name__)

MODELS = {
    "inverse": models.inverse_model,
    "direct": models.direct_model,
    "inertia_matrix": models.inertia_matrix_model,
    "gravity": models.gravity_model,
    "coriolis": models.coriolis_model,
    "bias": models.bias_model,
    "friction": models.friction_model,
    "regressor": models.regressor_model,
    "closure": models.closure_model,
    "state_derivative": models.state_derivative_model,
}
LOOP_MODELS = ("closure", "state_derivative")  # models that only a robot with loops has
COMPILE_THRESHOLD = 0.05  # seconds that a model is computed by the recursions before it is worth compiling
MAX_PROGRAMS = 24  # of one robot: questions with ever other wrenches do not fill the memory


def available_models(robot):
    """Those of MODELS that a robot has."""
    return {name: model for name, model in MODELS.items() if robot.loops or name not in LOOP_MODELS}


class PythonProgram:
    """A Program run as Python, with the entries of a CompiledProgram: where nothing compiles."""

    def __init__(self, program):
        self.program, self.interface = program, program.interface
        self._one, self._many = python_function(program), python_batch(program)

    def evaluate(self, *arguments):
        """As CompiledProgram.evaluate: results, or None where outputs to write into are given."""
        inputs, outputs = arguments[: len(self.program.inputs)], arguments[len(self.program.inputs) :]
        results = self._one(*inputs)
        results = [results] if len(self.program.outputs) == 1 else results
        shapes = [output.shape for output in self.program.outputs]
        arrays = [np.reshape(result, shape) for result, shape in zip(results, shapes, strict=True)]
        if not outputs:
            return arrays[0] if len(arrays) == 1 else tuple(arrays)
        for output, array in zip(outputs, arrays, strict=True):
            np.frombuffer(output)[:] = array.ravel()
        return None

    def batch(self, *arrays, out=None, threads=1):
        """As CompiledProgram.batch, by columns of NumPy."""
        samples = next((len(array) for array in arrays if np.ndim(array) == 2), None)
        results = self._many(*(_for_each(array, samples) for array in arrays))
        if out is None:
            return results
        alone = len(self.program.outputs) == 1
        for target, result in zip([out] if alone else out, [results] if alone else results, strict=True):
            target[...] = result
        return out


def _for_each(array, samples):
    """An array (size,) as rows (samples, size) that are all the same; others as they are."""
    return array if np.ndim(array) != 1 or samples is None else np.broadcast_to(array, (samples, len(array)))


class CompiledModels:
    """Programs of a robot by what they compute: a name in MODELS; names of the links that wrenches act on; whether the
    base moves as told; whether the results that tell of singular states come too; numbers of the independent joints,
    None for those of Dynamics."""

    def __init__(self, robot):
        self._robot = robot
        self._programs, self._spent, self._started = {}, {}, set()
        self._lock = Lock()

    def get(self, name, wrenches=(), prescribed_base=False, with_pivots=False, independent=None, with_batch=False):
        """The CompiledProgram, or where none can be the PythonProgram, of a model. Compiles it if that is not done.

        batches: whether what batches run is compiled at once too, and not when the first one comes.
        """
        key = (name, tuple(wrenches), prescribed_base, with_pivots, independent)
        program = self._programs.get(key)
        if program is None:
            with self._lock:
                program = self._programs.get(key)
                if program is None:
                    program = self._made(*key)
                    if with_batch and isinstance(program, CompiledProgram):
                        program.compile_batch()
                    self._programs[key] = program
        return program

    def get_ready(self, name, wrenches=(), prescribed_base=False, with_pivots=False):
        """The program of a model where it is there already, else None."""
        return self._programs.get((name, tuple(wrenches), prescribed_base, with_pivots, None))

    def record_time(self, seconds, name, wrenches=(), prescribed_base=False, with_pivots=False):
        """Tell that a model took so long without a program; one that is worth it is made, in the background."""
        key = (name, tuple(wrenches), prescribed_base, with_pivots, None)
        self._spent[key] = self._spent.get(key, 0.0) + seconds
        if self._spent[key] > COMPILE_THRESHOLD and key not in self._started and len(self._started) < MAX_PROGRAMS:
            self._started.add(key)
            run_in_background(self._try, *key)

    def _try(self, *key):
        try:
            self.get(*key, with_batch=True)
        except SingularModelError:  # the recursions say so, and of which joint
            pass
        except Exception:  # a fault of ours must not end a thread in silence, and the recursions go on
            logger.exception("the model %s of %r could not be compiled", key[0], self._robot.name)

    def _made(self, name, wrenches, prescribed_base, with_pivots, independent):
        started = time.perf_counter()
        options = (
            {"wrenches": wrenches, "prescribed_base": prescribed_base, "with_pivots": with_pivots}
            if name in ("inverse", "direct")
            else {}
        )
        if name == "state_derivative":
            options = {"wrenches": wrenches}
        if independent is not None:
            options["independent"] = independent
        trace, key = cache(partial(self._traced, name, options)), fingerprint(self._robot, name, options)
        try:
            made = (key and load_program(key, trace)) or compile_program(trace(), key=key)
        except CompilationError as error:
            _warn_once(str(error))
            made = PythonProgram(trace())
        logger.debug("%s of %r: %s, ready in %.3f s", name, self._robot.name, made.interface.operations,
                     time.perf_counter() - started)  # fmt: skip
        return made

    def _traced(self, name, options):
        try:
            return MODELS[name](self._robot, **options)
        except ZeroDivisionError:
            raise SingularModelError(f"{name}: nothing with inertia resists some motion, whatever the state") from None


_warned = set()


def _warn_once(reason):
    if reason not in _warned:
        _warned.add(reason)
        logger.warning("models run as Python, some ten times slower than compiled: %s. pip install llvmlite", reason)
