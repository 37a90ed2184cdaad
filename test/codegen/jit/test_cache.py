"""Object code on disk: other processes load it too, and it is not trusted where other users may write."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from robot_dynamics.codegen.jit import cache as llvm_cache
from robot_dynamics.codegen.jit.compiled_program import compile_program
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace

llvm_engine = pytest.importorskip("robot_dynamics.codegen.jit.engine", reason="llvmlite is not installed")
PROGRAM = """
from robot_dynamics.codegen.jit.compiled_program import compile_program
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace
import numpy as np
import sys

trace = Trace()
a = trace.input("a", 40)
for _ in range(3):
    a = np.sin(a) * np.roll(a, 1) + 0.5
made = compile_program(build_program(trace, "long", {"a": 40}, {"b": a}))
print(repr(made.evaluate(np.arange(40.0)).sum()), repr(made.batch(np.arange(400.0).reshape(10, 40)).sum()))
"""


def doubling():
    trace = Trace()
    return build_program(trace, "doubling", {"a": 2}, {"b": 2 * trace.input("a", 2)})


def works():
    return np.array_equal(compile_program(doubling()).evaluate(np.array([1.0, 2.0])), [2.0, 4.0])


@pytest.fixture
def folder(tmp_path, monkeypatch, no_background_work):
    monkeypatch.setenv("ROBOT_DYNAMICS_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def compilations(monkeypatch, no_background_work, no_code_in_memory):
    """The list of the modules that were compiled, not loaded from the cache."""
    texts, compiled = [], llvm_engine.compile_ir
    monkeypatch.setattr(llvm_engine, "compile_ir", lambda text, level: texts.append(text) or compiled(text, level))
    return texts


def test_modules_are_compiled_once(folder, compilations):
    assert works()
    assert len(compilations) == 2  # the program, and the entry point of all programs
    assert works()
    assert len(compilations) == 2
    assert folder.stat().st_mode & 0o777 == 0o700
    assert not list(folder.glob(".*")), "a temporary file was left"


def sine():
    trace = Trace()
    return build_program(trace, "sine", {"a": 1}, {"b": np.sin(trace.input("a", 1))})


def test_modules_of_all_programs_stay_in_memory(folder, compilations, monkeypatch):
    monkeypatch.setenv("ROBOT_DYNAMICS_CACHE", "")
    monkeypatch.setattr(llvm_engine, "shared_object_code", {})
    assert works()
    compile_program(sine())
    assert len(compilations) == 4  # two programs, the entry point, and the sine of vectors of one width
    assert works()
    assert compile_program(sine()).evaluate(np.array([1.0])) == pytest.approx(np.sin(1.0))
    assert len(compilations) == 6


def test_other_processor_or_version_is_compiled_again(folder, compilations, monkeypatch):
    assert works()
    triple, name, features = llvm_engine.host_target()
    monkeypatch.setattr(llvm_engine, "host_target", lambda: (triple, name, features + ",-sse4a"))
    assert works()
    monkeypatch.setattr(llvm_engine.llvmlite, "__version__", "0.0")
    assert works()
    assert len(compilations) == 6


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[:-1],
        lambda content: content[1:],
        lambda content: content[:200] + bytes([content[200] ^ 1]) + content[201:],
        lambda content: content + b"\0",
    ],
)
def test_damaged_files_are_replaced(folder, compilations, damage):
    assert works()
    for file in folder.iterdir():
        file.write_bytes(damage(file.read_bytes()))
    assert works()
    assert len(compilations) == 4
    assert works()
    assert len(compilations) == 4


def test_complete_files_that_do_not_link_are_replaced(folder, compilations):
    assert works()
    for file in folder.iterdir():
        file.unlink()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(llvm_engine, "compile_ir", lambda text, level: b"no object code")
        with pytest.raises(Exception, match="could not be compiled"):
            works()
    assert works()


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777])
def test_directory_writable_by_others_is_not_used(folder, compilations, mode):
    folder.mkdir()
    folder.chmod(mode)
    assert works() and works()
    assert len(compilations) == 4
    assert not list(folder.iterdir())


def test_directory_of_another_user_is_not_used(folder, compilations, monkeypatch):
    assert works()
    own = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: own + 1)
    assert llvm_cache.load("key") is None
    assert works()
    assert len(compilations) == 4


def test_files_writable_by_others_and_links_are_not_read(folder):
    llvm_cache.store("key", b"image")
    (file,) = folder.iterdir()
    assert llvm_cache.load("key") == b"image"
    file.chmod(0o666)
    assert llvm_cache.load("key") is None
    file.chmod(0o600)
    moved = file.rename(folder.parent / "elsewhere")
    file.symlink_to(moved)
    assert llvm_cache.load("key") is None


@pytest.mark.parametrize("path", ["", "/dev/null", "/proc/no/such", "/dev/null/below", "\0", "~nobody-of-that-name/x"])
def test_unusable_directory_means_no_cache(monkeypatch, compilations, path):
    if "\0" in path:
        monkeypatch.setattr(llvm_cache, "cache_directory", lambda: Path(path).stat())
    else:
        monkeypatch.setenv("ROBOT_DYNAMICS_CACHE", path)
    assert works() and works()
    assert len(compilations) == 4


def test_cache_directory_follows_the_environment(monkeypatch, tmp_path):
    monkeypatch.delenv("ROBOT_DYNAMICS_CACHE", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert llvm_cache.cache_directory() == tmp_path / "xdg" / "robot_dynamics"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # ignored, as the XDG specification says
    assert llvm_cache.cache_directory() == tmp_path / "home" / ".cache" / "robot_dynamics"


def test_old_files_are_removed(folder, monkeypatch):
    monkeypatch.setattr(llvm_cache, "MAX_FILES", 10)
    for number in range(30):
        llvm_cache.store(str(number), b"image")
        assert len(list(folder.iterdir())) <= 10
    assert llvm_cache.load("29") == b"image"


@pytest.mark.slow
def test_processes_that_compile_at_once_agree(folder):
    root = Path(llvm_cache.__file__).parents[3]
    environment = {**os.environ, "ROBOT_DYNAMICS_CACHE": str(folder), "PYTHONPATH": str(root)}
    started = [
        subprocess.Popen([sys.executable, "-c", PROGRAM], env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    outputs = {process.communicate(timeout=120)[0] for process in started}
    assert all(process.returncode == 0 for process in started)
    assert len(outputs) == 1 and outputs.pop().strip()
    assert all(file.name.endswith(llvm_cache.SUFFIX) for file in folder.iterdir())
