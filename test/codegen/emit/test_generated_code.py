"""Generated Python, generated C and the recursions agree on every shipped and real robot. C is compiled with all
warnings as errors and the undefined-behaviour sanitiser."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
from peers.random_robots import digits_left, random_states
from peers.real_robots import REAL_ROBOTS, real_urdf
from peers.traced_models import shipped_program, shipped_robot

from robot_dynamics import Base, Dynamics, shipped_robots
from robot_dynamics.codegen.emit.c_code import c_name, c_source
from robot_dynamics.codegen.emit.python_source import python_source
from robot_dynamics.codegen.jit.compiled_models import MODELS
from robot_dynamics.model.formats.urdf.reader import read_urdf

pytestmark = pytest.mark.slow

SAMPLES = 3
FLAGS = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O0", "-fPIC", "-shared"]
SANITISE = ["-fsanitize=undefined", "-fno-sanitize-recover=all"]
COMPILER = shutil.which("cc")
ROBOTS = [*(f"shipped {name}" for name in shipped_robots()), *REAL_ROBOTS]


def error(actual, expected):
    return np.abs(actual - expected).max(initial=0) / max(np.abs(expected).max(initial=0), 1e-6)


def python_code(program, names):
    """The function of the generated module, returning flat arrays."""
    scope = {}
    exec(compile(python_source(program, names), "generated", "exec"), scope)
    is_single = len(program.outputs) == 1

    def call(*arguments):
        results = scope[program.name](*(list(argument) for argument in arguments))
        return [np.ravel(result) for result in ([results] if is_single else results)]

    return call


def c_code(program, names, folder):
    """The compiled C function, returning flat arrays."""
    name = c_name(program)
    header, source = c_source(program, joint_names=names)
    (folder / f"{name}.h").write_text(header)
    (folder / f"{name}.c").write_text(source)
    library = folder / f"{name}.so"
    for sanitise in (SANITISE, []):  # some compilers have no sanitiser library
        command = [COMPILER, *FLAGS, *sanitise, f"{name}.c", "-o", str(library), "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
        if done.returncode == 0 or "cannot find" not in done.stderr:
            break
    assert done.returncode == 0, done.stderr[:2000]
    function = getattr(ctypes.CDLL(str(library)), name)
    pointer = ctypes.POINTER(ctypes.c_double)

    def call(*arguments):
        results = [np.empty(len(output.entries)) for output in program.outputs]
        arrays = [*(np.ascontiguousarray(argument, dtype=float) for argument in arguments), *results]
        function(*(array.ctypes.data_as(pointer) for array in arrays))
        return results

    return call


@pytest.mark.slow
@pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")
@pytest.mark.parametrize("name", ROBOTS)
def test_generated_python_and_c_agree_with_the_recursions(name, tmp_path):
    is_shipped = name.startswith("shipped")
    robot = shipped_robot(name.split()[1]) if is_shipped else read_urdf(real_urdf(name))
    dynamics = Dynamics(robot, compiled=False)
    if not dynamics.joint_names:
        pytest.skip("a single body: there is no joint to compute")
    states = random_states(robot, len(dynamics.joint_names), SAMPLES, 4)
    qdd = states.qdd.copy()
    qdd[:, [dynamics.joint_names.index(joint) for joint in dynamics.unactuated_joint_names]] = 0
    for model in ("inverse", "direct"):
        program = shipped_program(name.split()[1], model) if is_shipped else MODELS[model](robot)
        functions = [python_code(program, dynamics.joint_names), c_code(program, dynamics.joint_names, tmp_path)]
        for k in range(SAMPLES):
            base = Base(states.base.pose[k], states.base.twist[k]) if robot.moving_base else None
            base_arguments = (base.twist, base.pose[:3, :3].T @ robot.gravity) if base else ()
            q, qd = states.q[k], states.qd[k]
            expected = dynamics.solve(q, qd, qdd=qdd[k], base=base)
            last_argument, result, tolerance = qdd[k], expected.efforts, 1e-12
            if dynamics.unactuated_joint_names or robot.moving_base:
                tolerance *= max(1, np.linalg.cond(dynamics.inertia_matrix(q)) / 1e3)
            if model == "direct":
                last_argument, result = expected.efforts, expected.accelerations
                tolerance = max(1e-12, digits_left(dynamics.inertia_matrix(q), last_argument, result))
            from_python, from_c = (function(q, qd, last_argument, *base_arguments) for function in functions)
            for results in (from_python, from_c):
                assert error(results[0], result) < tolerance
            for python_array, c_array in zip(from_python, from_c, strict=True):
                assert error(python_array, c_array) < 1e-12
