"""Fingerprints: the same for the same robot and question, another one for whatever differs."""

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

PACKAGE = module.PACKAGE


def robot_with_everything():
    """A robot in which every kind of field has a value: springs, mimic joints, gravity, frames, friction."""
    robot = load_robot("panda")
    joints = list(robot.joints)
    joints[2] = replace(joints[2], spring=Spring(20.0, 0.1, 0.5), actuated=False)
    joints[4] = replace(joints[4], mimic=Mimic(joints[3].name, 0.5, 0.1))
    return replace(robot, joints=tuple(joints), gravity=(0.0, 0.1, -9.0))


ROBOT = robot_with_everything()


def places(thing, path=()):
    """The paths to all values in a robot: fields of objects, places in tuples, indices of arrays."""
    if is_dataclass(thing):
        for field in fields(thing):
            yield from places(getattr(thing, field.name), (*path, field.name))
    elif isinstance(thing, tuple):
        yield path
        for place, item in enumerate(thing):
            yield from places(item, (*path, place))
    elif isinstance(thing, np.ndarray) and thing.ndim:
        yield from ((*path, index) for index in np.ndindex(thing.shape))
    else:
        yield path


def other(value):
    """The nearest value that is not this one."""
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
    """A copy with another value at the path, in whatever state that leaves it."""
    if not path:
        return other(thing)
    step, *rest = path
    if isinstance(thing, np.ndarray):
        made = thing.copy()
        made[step] = np.nextafter(made[step], inf)
        return made
    if isinstance(thing, tuple):
        return (*thing[:step], changed(thing[step], rest), *thing[step + 1 :])
    made = copy.copy(thing)
    object.__setattr__(made, step, changed(getattr(thing, step), rest))
    return made


@given(st.sampled_from(list(places(ROBOT))))
def test_a_change_of_any_field_is_another_fingerprint(path):
    assert fingerprint(changed(ROBOT, path)) != fingerprint(ROBOT)


def test_all_places_are_told_apart():
    """Each of them changed, all at once: no two of some thousand robots have one fingerprint."""
    found = {fingerprint(changed(ROBOT, path)) for path in places(ROBOT)}
    assert None not in found and len(found) == len(list(places(ROBOT))) > 300


def test_another_question_is_another_fingerprint():
    options = [("inverse", {"wrenches": wrenches, "prescribed_base": told, "with_pivots": with_pivots})
               for wrenches in ((), ("a",), ("b",), ("a", "b"), ("b", "a"), ("ab",))
               for told in (False, True) for with_pivots in (False, True)]  # fmt: skip
    options += [("direct", options[0][1]), ("gravity", {})]
    assert len({fingerprint(ROBOT, *option) for option in options}) == len(options)


def test_payload_is_another_fingerprint():
    assert fingerprint(ROBOT.with_payload("panda_link8", Inertia(1e-9))) != fingerprint(ROBOT)


def test_the_same_robot_has_the_same_fingerprint_in_every_process():
    assert fingerprint(robot_with_everything()) == fingerprint(ROBOT)
    program = (
        "from robot_dynamics import load_robot; from robot_dynamics.codegen.trace.fingerprint import fingerprint; "
    )
    program += "print(fingerprint(load_robot('panda'), {'wrenches': ()}))"
    told = {
        subprocess.check_output(
            [sys.executable, "-c", program],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": str(PACKAGE.parent), "PATH": ""},
            text=True,
        )
        for seed in ("1", "2")
    }
    assert told == {fingerprint(load_robot("panda"), {"wrenches": ()}) + "\n"}


scalars = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=3), st.binary(max_size=3))
arrays = st.tuples(st.sampled_from([(2, 3), (3, 2), (6,), (1, 6)]), st.sampled_from(["f8", "f4", "i8"])).map(
    lambda shaped: np.zeros(*shaped)
)
things = st.recursive(scalars | arrays, lambda inner: st.lists(inner, max_size=3), max_leaves=6)


@given(things, things)
def test_what_differs_has_another_fingerprint(one, two):
    assert fingerprint(one) == fingerprint(copy.deepcopy(one))
    assume(repr(one) != repr(two))
    assert fingerprint(one) != fingerprint(two)


ALIKE = [(0.0, -0.0), (1, True), (1, 1.0), ("1", 1), ("1", b"1"), (["ab", "c"], ["a", "bc"]), ([[1], 2], [1, [2]]),
         ([], [[]]), ("", []), (np.float64(1), np.float32(1))]  # fmt: skip


@pytest.mark.parametrize("pair", ALIKE)
def test_what_looks_alike_has_another_fingerprint(pair):
    assert fingerprint(pair[0]) != fingerprint(pair[1])


def test_symbols_and_what_is_not_known_have_none():
    robot, _ = with_symbols(random_chain(1), Trace())
    assert fingerprint(robot) is None
    assert fingerprint(object()) is None and fingerprint({1, 2}) is None and fingerprint(np.zeros(2, "O")) is None


def test_every_byte_of_the_source_counts(tmp_path):
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


def test_source_that_changed_since_it_was_imported_or_is_missing_has_none(tmp_path, monkeypatch):
    package = tmp_path / "robot_dynamics"
    shutil.copytree(PACKAGE, package)  # just now: what this process runs is older
    with pytest.raises(OSError, match="has changed since"):
        source_digest(package, module.IMPORT_TIME)
    with pytest.raises(OSError, match="no source"):
        source_digest(tmp_path / "nothing", inf)
    monkeypatch.setattr(module, "PACKAGE", package)
    assert fingerprint(ROBOT) is None


def imported(name):
    """The modules of this package that a module of it imports."""
    path = PACKAGE.parent / (name.replace(".", "/") + ".py")
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("robot_dynamics"):
            whole = PACKAGE.parent / node.module.replace(".", "/")
            yield from [f"{node.module}.{alias.name}" for alias in node.names] if whole.is_dir() else [node.module]


def test_all_that_a_program_is_made_with_is_in_the_folders_that_count():
    found, left = set(), {"robot_dynamics.codegen.jit.compiled_models"}
    while left:
        found |= left
        left = {name for module in left for name in imported(module)} - found
    assert {"robot_dynamics.newton_euler.augmented", "robot_dynamics.codegen.jit.engine"} < found
    outside = {name for name in found if name.split(".")[1] not in module.FOLDERS}
    assert outside == {"robot_dynamics.errors"}
    assert Path(module.__file__).relative_to(PACKAGE).parts[0] in module.FOLDERS
