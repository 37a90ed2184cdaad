"""Compilation of one program, now or in the background once computing without it has taken long enough."""

import logging
from collections.abc import Callable
from threading import Lock
from typing import Generic, TypeVar

from robot_dynamics.codegen.jit.background import run_in_background

logger = logging.getLogger(__name__)

CompiledT = TypeVar("CompiledT")


class BackgroundCompilation(Generic[CompiledT]):
    """A program that is compiled at most once, and the time that was spent without it.

    Calls read `program` and use another way to compute while it is None, so that they never block on compilation. They
    report the time that this takes with `record_time`.

    Parameters
    ----------
    compile_program : callable
        Returns the compiled program. It must hold no reference to the owner of this object: the compilation is dropped
        when the owner is deleted before it starts.
    threshold : float
        Time spent without the program [s] after which it is compiled in the background. inf: `start` alone starts it.
    description : str
        Name of the program in log messages.
    expected_errors : tuple of exception types
        Errors of `compile_program` that mean that there is no program. Others are logged with their traceback.
    prepare : callable, optional
        Called with a program compiled in the background before `program` is set.

    Attributes
    ----------
    program : object or None
        The compiled program, None until it is ready.
    is_started : bool
        Whether a compilation in the background was started.
    """

    def __init__(
        self,
        compile_program: Callable[[], CompiledT],
        threshold: float,
        description: str,
        expected_errors: tuple[type[Exception], ...] = (),
        prepare: Callable[[CompiledT], object] | None = None,
    ) -> None:
        self.program: CompiledT | None = None
        self.is_started = False
        self._compile_program = compile_program
        self._threshold = threshold
        self._description = description
        self._expected_errors = expected_errors
        self._prepare = prepare
        self._seconds = 0.0
        self._lock = Lock()

    def get(self) -> CompiledT:
        """The program, compiled now if it is not ready. Raises the errors of `compile_program`."""
        return self._get(None)

    def record_time(self, seconds: float) -> None:
        """Add time spent without the program [s]; start the compilation once the total exceeds the threshold."""
        self._seconds += seconds
        if self._seconds > self._threshold:
            self.start()

    def start(self) -> None:
        """Start the compilation in the background, unless it was started before."""
        if not self.is_started:
            self.is_started = True
            run_in_background(self._compile_in_background)

    def _get(self, prepare: Callable[[CompiledT], object] | None) -> CompiledT:
        program = self.program
        if program is None:
            with self._lock:
                program = self.program
                if program is None:
                    program = self._compile_program()
                    if prepare is not None:
                        prepare(program)
                    self.program = program
        return program

    def _compile_in_background(self) -> None:
        """Compile, and log errors: an exception must not end the background thread."""
        try:
            self._get(self._prepare)
        except self._expected_errors as error:
            logger.debug("%s: there is no compiled program: %s", self._description, error)
        except Exception:
            logger.exception("%s could not be compiled", self._description)
