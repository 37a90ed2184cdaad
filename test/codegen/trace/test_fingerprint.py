"""Fingerprints are equal for equal robots and options, and differ wherever these differ."""

import ast
import copy
import shutil
import subprocess
import sys
from dataclasses import fields, is_dataclass, replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from peers.random_chains import random_chain, with_symbols

from robot_dynamics import Inertia, load_robot
from robot_dynamics.codegen.trace import fingerprint as module
from robot_dynamics.codegen.trace.fingerprint import fingerprint, source_digest
from robot_dynamics.codegen.trace.scalar import Trace
from robot_dynamics.model.joint import Mimic, Spring
from robot_dynamics.model.visual import MeshShape, Visual

PACKAGE = module.PACKAGE


def robot_with_everything():
    """A robot with a value in every kind of field: springs, mimic joints, gravity, frames, friction."""
    robot = load_robot("panda")
    joints = list(robot.joints)
    joints[2] = replace(joints[2], spring=Spring(20.0, 0.1, 0.5), actuated=False)
    joints[4] = replace(joints[4], mimic=Mimic(joints[3].name, 0.5, 0.1))
    return replace(robot, joints=tuple(joints), gravity=(0.0, 0.1, -9.0))


ROBOT = robot_with_everything()


def value_paths(thing, path=()):
    """The paths to all values in a robot but what is drawn: names of fields, positions in tuples, indices of arrays."""
    if is_dataclass(thing):
        for field in fields(thing):
            if field.name != "visuals":
                yield from value_paths(getattr(thing, field.name), (*path, field.name))
    elif isinstance(thing, tuple):
        yield path
        for position, item in enumerate(thing):
            yield from value_paths(item, (*path, position))
    elif isinstance(thing, np.ndarray) and thing.ndim:
        yield from ((*path, index) for index in np.ndindex(thing.shape))
    else:
        yield path


def different(value):
    """The nearest different value."""
    if value is None:
        return Mimic("joint")
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return value + " "
    if isinstance(value, tuple):
        return value[:-1] if value else (0,)
    return value + 1 if isinstance(value, int) else type(value)(np.nextafter(value, inf if value < 1e300 else 0))


def changed(thing, path):
    """A copy with a different value at the path, without checks."""
    if not path:
        return different(thing)
    step, *rest = path
    if isinstance(thing, np.ndarray):
        copied = thing.copy()
        copied[step] = np.nextafter(copied[step], inf)
        return copied
    if isinstance(thing, tuple):
        return (*thing[:step], changed(thing[step], rest), *thing[step + 1 :])
    copied = copy.copy(thing)
    object.__setattr__(copied, step, changed(getattr(thing, step), rest))
    return copied


@given(st.sampled_from(list(value_paths(ROBOT))))
def test_fingerprint_changes_with_any_field(path):
    assert fingerprint(changed(ROBOT, path)) != fingerprint(ROBOT)


def test_fingerprints_of_changes_at_all_paths_differ():
    """No two of hundreds of robots, each with one changed value, have the same fingerprint."""
    fingerprints = {fingerprint(changed(ROBOT, path)) for path in value_paths(ROBOT)}
    assert None not in fingerprints and len(fingerprints) == len(list(value_paths(ROBOT))) > 300


def test_fingerprint_changes_with_options():
    options = [
        ("inverse", {"wrenches": wrenches, "prescribed_base": prescribed_base, "with_pivots": with_pivots})
        for wrenches in ((), ("a",), ("b",), ("a", "b"), ("b", "a"), ("ab",))
        for prescribed_base in (False, True)
        for with_pivots in (False, True)
    ]
    options += [("direct", options[0][1]), ("gravity", {})]
    assert len({fingerprint(ROBOT, *option) for option in options}) == len(options)


def test_fingerprint_changes_with_payload():
    assert fingerprint(ROBOT.with_payload("panda_link8", Inertia(1e-9))) != fingerprint(ROBOT)


def test_fingerprint_does_not_depend_on_what_is_drawn():
    shape = MeshShape("package://panda/hand.stl", np.ones(3), Path("/nowhere"))
    drawn = replace(ROBOT, visuals=(Visual("panda_link8", np.eye(4), shape, (1.0, 0.0, 0.0, 1.0)),))
    assert fingerprint(drawn) == fingerprint(ROBOT) is not None


@pytest.mark.slow
def test_fingerprint_is_the_same_in_every_process():
    assert fingerprint(robot_with_everything()) == fingerprint(ROBOT)
    program = (
        "from robot_dynamics import load_robot; from robot_dynamics.codegen.trace.fingerprint import fingerprint; "
    )
    program += "print(fingerprint(load_robot('panda'), {'wrenches': ()}))"
    outputs = {
        subprocess.check_output(
            [sys.executable, "-c", program],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": str(PACKAGE.parent), "PATH": ""},
            text=True,
        )
        for seed in ("1", "2")
    }
    assert outputs == {fingerprint(load_robot("panda"), {"wrenches": ()}) + "\n"}


scalars = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=3), st.binary(max_size=3))
arrays = st.tuples(st.sampled_from([(2, 3), (3, 2), (6,), (1, 6)]), st.sampled_from(["f8", "f4", "i8"])).map(
    lambda shaped: np.zeros(*shaped)
)
things = st.recursive(scalars | arrays, lambda inner: st.lists(inner, max_size=3), max_leaves=6)


@given(things, things)
def test_fingerprints_of_different_values_differ(a, b):
    assert fingerprint(a) == fingerprint(copy.deepcopy(a))
    assume(repr(a) != repr(b))
    assert fingerprint(a) != fingerprint(b)


SIMILAR = [
    (0.0, -0.0),
    (1, True),
    (1, 1.0),
    ("1", 1),
    ("1", b"1"),
    (["ab", "c"], ["a", "bc"]),
    ([[1], 2], [1, [2]]),
    ([], [[]]),
    ("", []),
    (np.float64(1), np.float32(1)),
]


@pytest.mark.parametrize("pair", SIMILAR)
def test_fingerprints_of_similar_values_differ(pair):
    assert fingerprint(pair[0]) != fingerprint(pair[1])


def test_fingerprint_of_symbols_and_unsupported_types_is_none():
    robot, _ = with_symbols(random_chain(1), Trace())
    assert fingerprint(robot) is None
    assert fingerprint(object()) is None and fingerprint({1, 2}) is None and fingerprint(np.zeros(2, "O")) is None


@pytest.mark.slow
def test_source_digest_changes_with_every_file(tmp_path):
    package = tmp_path / "robot_dynamics"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    files = [path for folder in module.FOLDERS for path in (package / folder).rglob("*.py")]
    digest = source_digest.__wrapped__
    before = digest(package, inf)
    assert before == digest(PACKAGE, inf) and len(files) > 30
    for path in files:
        text = path.read_bytes()
        path.write_bytes(text + b" ")
        assert digest(package, inf) != before
        path.write_bytes(text)
    assert digest(package, inf) == before
    files[0].rename(files[0].with_name("another_name.py"))
    assert digest(package, inf) != before


def test_source_digest_refuses_missing_and_changed_source(tmp_path, monkeypatch):
    package = tmp_path / "robot_dynamics"
    shutil.copytree(PACKAGE, package)  # newer than the source that this process runs
    with pytest.raises(OSError, match="has changed since"):
        source_digest(package, module.IMPORT_TIME)
    with pytest.raises(OSError, match="no source"):
        source_digest(tmp_path / "nothing", inf)
    monkeypatch.setattr(module, "PACKAGE", package)
    assert fingerprint(ROBOT) is None


class TypeImportRemover(ast.NodeTransformer):
    """Removes `if TYPE_CHECKING:` blocks, which never run."""

    def visit_If(self, node):
        return None if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING" else self.generic_visit(node)


def imported(name):
    """The modules of this package that a module of it imports when it runs."""
    path = PACKAGE.parent / (name.replace(".", "/") + ".py")
    for node in ast.walk(TypeImportRemover().visit(ast.parse(path.read_text()))):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("robot_dynamics"):
            whole = PACKAGE.parent / node.module.replace(".", "/")
            yield from [f"{node.module}.{alias.name}" for alias in node.names] if whole.is_dir() else [node.module]


def test_source_digest_folders_contain_everything_a_program_depends_on():
    modules = set()
    new_modules = {"robot_dynamics.codegen.jit.compiled_models"}
    while new_modules:
        modules |= new_modules
        new_modules = {name for module in new_modules for name in imported(module)} - modules
    assert {"robot_dynamics.newton_euler.augmented", "robot_dynamics.codegen.jit.engine"} < modules
    outside = {name for name in modules if name.split(".")[1] not in module.FOLDERS}
    files = {f"robot_dynamics.{Path(name).stem}" for name in module.FILES}
    assert files < outside
    outside -= files
    assert outside == {
        "robot_dynamics.array_checks",
        "robot_dynamics.array_types",
        "robot_dynamics.errors",
        "robot_dynamics.notebook_display",
        "robot_dynamics.optional_packages",
    }  # no program depends on them
    assert Path(module.__file__).relative_to(PACKAGE).parts[0] in module.FOLDERS
