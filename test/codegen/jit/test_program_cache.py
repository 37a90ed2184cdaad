"""Programs of robots in the cache: loaded without a trace, and never for another robot."""

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from peers.random_loops import random_loops

from robot_dynamics import Dynamics, Inertia, SingularModelError, load_robot
from robot_dynamics.codegen.jit import cache as llvm_cache
from robot_dynamics.codegen.jit import compiled_models
from robot_dynamics.codegen.trace import fingerprint

pytest.importorskip("llvmlite")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, no_background_work, no_code_in_memory):
    monkeypatch.setenv("ROBOT_DYNAMICS_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def traces(monkeypatch):
    """The list of the models that were traced."""
    names = []

    def counting(name, model):
        return lambda robot, **options: names.append(name) or model(robot, **options)

    for name, model in compiled_models.MODELS.items():
        monkeypatch.setitem(compiled_models.MODELS, name, counting(name, model))
    return names


def check(robot, model="inverse"):
    """One sample and a batch of a new Dynamics, beside the recursions."""
    program = Dynamics(robot).compile(model)
    states = np.random.default_rng(0).uniform(-1, 1, (3, 9, len(robot.joints)))
    expected = getattr(Dynamics(robot, compiled=False), model)(*states)
    tolerance = 1e-9 * np.abs(expected).max()
    np.testing.assert_allclose(program.batch(*states), expected, rtol=0, atol=tolerance)
    for sample, result in zip(zip(*states, strict=True), expected, strict=True):
        np.testing.assert_allclose(program.evaluate(*sample), result, rtol=0, atol=tolerance)
    return program


@pytest.mark.parametrize("model", ["inverse", "direct"])
def test_program_is_traced_once_and_again_for_its_statements(traces, model):
    robot = load_robot("ur5e")
    first = check(robot, model)
    assert traces == [model]
    again = check(load_robot("ur5e"), model)
    assert traces == [model]
    assert again.interface == first.interface
    assert again.program.statements == first.program.statements
    assert again.program.operations == again.interface.operations
    assert traces == [model] * 2


FLYING = {
    "tree": lambda: load_robot("free_flying_arm"),
    "loops": lambda: random_loops(3, loops=1, kinds=("planar",), moving_base=True).robot,
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", FLYING)
def test_all_models_are_loaded_with_their_shapes(traces, kind):
    robot = FLYING[kind]()
    q = np.array([joint.initial_position for joint in robot.joints]) + 0.3
    arguments = {"q": q, "twist": np.ones(6), "gravity": np.array([0, 0, -9.81])}
    models = list(compiled_models.available_models(robot))
    for prescribed_base in (False, True):
        for model in models:
            if prescribed_base and model not in ("inverse", "direct"):
                continue
            programs = [Dynamics(robot).compile(model, prescribed_base=prescribed_base) for _ in range(2)]
            inputs = [
                arguments.get(name, np.full(size, 0.7))[:size] for name, size in programs[0].interface.inputs.items()
            ]
            results = [program.evaluate(*inputs) for program in programs]
            compiled, loaded = (result if isinstance(result, tuple) else [result] for result in results)
            for compiled_array, loaded_array in zip(compiled, loaded, strict=True):
                np.testing.assert_array_equal(compiled_array, loaded_array)
    assert len(traces) == len(models) + 2


def test_payload_has_its_own_program(traces):
    robot = load_robot("ur5e")
    for mass in (0.0, 2.0, 2.0 + 1e-12, 0.0):
        check(robot.with_payload("tool0", Inertia(mass, [0, 0, 0.1 * mass], np.eye(3) * 0.01)))
    assert len(traces) == 3


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[: len(content) // 2],
        lambda content: content + b"\0",
        lambda content: b"\0" * len(content),
        None,
    ],
)
def test_damaged_or_missing_program_files_are_replaced(folder, damage):
    robot = load_robot("ur5e")
    check(robot)
    files = sorted(folder.iterdir())
    assert len(files) == 5  # interface, sample, batch, and of all programs the entry point and sines
    for file in files:
        content = file.read_bytes()
        file.unlink()
        if damage is not None:
            file.write_bytes(damage(content))
            file.chmod(0o600)
        check(robot)
        assert file.read_bytes()[:20] == content[:20]


@pytest.mark.parametrize("content", [b"", b"{}", b"[]", b"null", b'{"name": 1, "inputs": 2, "outputs": 3}', b"\xff"])
def test_invalid_interface_files_are_replaced(traces, content):
    robot = load_robot("ur5e")
    key = fingerprint.fingerprint(robot, "inverse", {"wrenches": (), "prescribed_base": False, "with_pivots": False})
    llvm_cache.store(f"interface {key}", content)
    check(robot)
    check(robot)
    assert len(traces) == 1


def test_files_of_other_users_are_not_loaded(folder, traces, monkeypatch):
    robot = load_robot("ur5e")
    check(robot)
    folder.chmod(0o777)
    check(robot)
    folder.chmod(0o700)
    own = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: own + 1)
    check(robot)
    assert len(traces) == 3


def test_changed_source_causes_a_new_trace(traces, monkeypatch):
    robot = load_robot("ur5e")
    check(robot)
    monkeypatch.setattr(fingerprint, "IMPORT_TIME", 0.0)
    check(robot)
    assert len(traces) == 2


def test_singular_model_is_refused_each_time():
    robot = load_robot("""robot: sliders
joints:
  - {joint: a, link: one, type: prismatic, mdh: {d: 0.1}}
  - {joint: b, link: two, type: prismatic, mdh: {theta: 0.7, d: 0.2}, mass: 2}
""")
    for _ in range(2):
        with pytest.raises(SingularModelError, match="nothing with inertia resists"):
            Dynamics(robot).compile("direct")


PROGRAM = """
import numpy as np
from robot_dynamics import Dynamics, load_robot
print(Dynamics(load_robot("ur5e")).compile("inverse").evaluate(*np.ones((3, 6)))[0])
"""


@pytest.mark.slow
def test_changed_recursion_does_not_load_an_old_program(tmp_path, folder):
    root = tmp_path / "changed"
    package = root / "robot_dynamics"
    shutil.copytree(fingerprint.PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(fingerprint.PACKAGE.parent / "config", root / "config")
    environment = {**os.environ, "PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1"}

    def first_effort():
        return float(subprocess.check_output([sys.executable, "-c", PROGRAM], env=environment, text=True, cwd=root))

    expected = Dynamics(load_robot("ur5e"), compiled=False).inverse(*np.ones((3, 6)))[0]
    assert first_effort() == pytest.approx(expected, rel=1e-12)
    entries = len(list(folder.iterdir()))
    assert first_effort() == pytest.approx(expected, rel=1e-12)
    assert len(list(folder.iterdir())) == entries
    changed = package / "codegen" / "trace" / "models.py"
    text = changed.read_text()
    assert text.count("model.projected(model.add_friction(forces))") == 1
    changed.write_text(text.replace("projected(model.add_friction(forces))", "projected(2 * forces)"))
    assert first_effort() == pytest.approx(2 * expected, rel=1e-9)
