"""BackgroundCompilation compiles once: on request, or in the background after enough time without the program."""

import logging
import threading

import pytest

from robot_dynamics.codegen.jit.background_compilation import BackgroundCompilation


class Compiler:
    """Counts its calls and returns "program", or raises an error."""

    def __init__(self, error=None):
        self.error = error
        self.calls = 0
        self.called = threading.Event()

    def __call__(self):
        self.calls += 1
        self.called.set()
        if self.error is not None:
            raise self.error
        return "program"


def test_program_is_compiled_once_on_request():
    compiler = Compiler()
    compilation = BackgroundCompilation(compiler, 1.0, "a program")
    assert compilation.program is None
    assert compilation.get() == compilation.get() == compilation.program == "program"
    assert compiler.calls == 1 and not compilation.is_started


def test_program_is_compiled_in_the_background_beyond_the_threshold():
    compiler = Compiler()
    prepared = threading.Event()
    seen = []

    def prepare(program):
        seen.append((program, compilation.program))
        prepared.set()

    compilation = BackgroundCompilation(compiler, 1.0, "a program", prepare=prepare)
    compilation.record_time(0.6)
    assert not compilation.is_started
    compilation.record_time(0.6)
    compilation.record_time(0.6)
    assert compilation.is_started and prepared.wait(60)
    assert compilation.get() == "program"
    assert seen == [("program", None)] and compiler.calls == 1


def test_start_compiles_in_the_background_whatever_the_threshold():
    compiler = Compiler()
    compilation = BackgroundCompilation(compiler, float("inf"), "a program")
    compilation.record_time(1e6)
    assert not compilation.is_started
    compilation.start()
    compilation.start()
    assert compilation.is_started and compiler.called.wait(60)
    assert compilation.get() == "program" and compiler.calls == 1


@pytest.mark.parametrize(("error", "level"), [(ValueError("no"), logging.DEBUG), (TypeError("no"), logging.ERROR)])
def test_errors_in_the_background_are_logged(error, level, caplog, no_background_work):
    compiler = Compiler(error)
    compilation = BackgroundCompilation(compiler, 0.0, "a program", expected_errors=(ValueError,))
    with caplog.at_level(logging.DEBUG):
        compilation.record_time(1.0)
        assert compiler.called.wait(60)
        for thread in threading.enumerate():
            if thread is not threading.current_thread() and not thread.daemon:
                thread.join(60)
    assert compilation.program is None
    assert [record.levelno for record in caplog.records if "a program" in record.getMessage()] == [level]
    with pytest.raises(type(error)):
        compilation.get()
