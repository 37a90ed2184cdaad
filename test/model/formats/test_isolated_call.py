"""Calls in a process of their own: whatever the function does there, the caller gets a result or an error."""

import pytest

from robot_dynamics import DescriptionError
from robot_dynamics.model.formats import isolated_call
from robot_dynamics.model.formats.isolated_call import call_isolated

FUNCTION = "import os, sys, time\ndef run(arguments):\n    {}\n    return arguments\n"
ERRORS = {
    "exit": ("os._exit(3)", "task ended without a result .status 3"),
    "abort": ("os.abort()", "task ended without a result .status -6"),
    "exception": ("raise OSError('gone')", "task ended without a result .OSError: gone"),
    "memory": ("bytes(10**13)", "more than 4096 MB of memory"),
    "loop": ("time.sleep(60)", "task takes more than 1 s"),
}


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Return a function that writes a module with a statement, and returns its name."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(statement):
        (tmp_path / "isolated_function.py").write_text(FUNCTION.format(statement))
        return "isolated_function"

    return write


def test_output_is_no_part_of_the_result(module, capfd):
    name = module("print('loud'); os.system('echo louder'); sys.stderr.write('loudest')")
    assert call_isolated(name, {"a": [0.1, float("inf")]}, "source", "task") == {"a": [0.1, float("inf")]}
    assert capfd.readouterr() == ("", "")


def test_files_that_it_writes_are_removed(module, tmp_path, monkeypatch):
    (tmp_path / "folder").mkdir()
    monkeypatch.chdir(tmp_path / "folder")
    call_isolated(module("open('log.txt', 'w').close()"), {}, "source", "task", writes_files=True)
    assert not list((tmp_path / "folder").iterdir())


@pytest.mark.parametrize("case", ERRORS)
def test_end_of_the_process_is_an_error(case, module, monkeypatch):
    statement, message = ERRORS[case]
    monkeypatch.setattr(isolated_call, "TIME_LIMIT", 1.0 if case == "loop" else 60.0)
    with pytest.raises(DescriptionError, match=f"^source: .*{message}"):
        call_isolated(module(statement), {}, "source", "task")
