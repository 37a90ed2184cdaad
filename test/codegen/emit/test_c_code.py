"""Generated C compiles without warnings, and agrees with an interpreter of the program and with generated Python."""

import ctypes
import math
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from peers.derivative_cases import random_state
from peers.straight_lines import NUMBERS, SPECIAL, interpreted, programs
from peers.traced_models import shipped_program, shipped_robot

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.codegen.emit.c_code import c_name, c_source
from robot_dynamics.codegen.jit.python_functions import python_function
from robot_dynamics.codegen.trace.parameter_grouping import group_inertial_parameters
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace
from robot_dynamics.newton_euler import articulated_body
from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.kinematics import run_forward_pass


def installed(*names):
    """The distinct paths of the commands that are installed."""
    paths = [path for name in names if (path := shutil.which(name))]
    return list({os.path.realpath(path): path for path in reversed(paths)}.values())[::-1]


COMPILERS, CPP_COMPILERS = installed("gcc", "clang", "cc"), installed("g++", "clang++", "c++")
STRICT = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow", "-Wfloat-equal"]
C99 = ["-std=c99", "-Wmissing-prototypes", *STRICT]
HOSTILE = [
    "*/ int injected; /*",
    "*/\n#error injected\n/*",
    "??/\n*??/ injected",
    "back\\\nslash\\",
    "\"quoted' %s %n",
    "é\u202e\u2028",
    "//",
    "*",
    "/",
    "",
    "1",
    "__x",
    "a__b",
    "q1",
    "t1",
    "s_q1",
    *"constants parameters sign_of double int restrict typename NAN INFINITY I M_PI".split(),
    *"sin y0 printf main exp gamma".split(),
]
pytestmark = pytest.mark.skipif(not COMPILERS, reason="no C compiler is here")


def run(*command):
    """The output of a command; its errors fail the test."""
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stderr[-3000:]}"
    return done.stdout


def written(folder, program, **options):
    """The path of the source of a program, written beside its header."""
    header, source = c_source(program, **options)
    name = c_name(program, options.get("prefix", ""))
    (Path(folder) / f"{name}.h").write_text(header, encoding="ascii")
    path = Path(folder) / f"{name}.c"
    path.write_text(source, encoding="ascii")
    return path


class Compiled:
    """A program compiled to a library: called with lists, it returns lists."""

    def __init__(self, folder, program, flags=("-O1",), **options):
        self.program, source = program, written(folder, program, **options)
        library = source.with_suffix(".so")
        run(COMPILERS[0], *C99, "-ffp-contract=off", *flags, "-shared", "-fPIC", source, "-o", library, "-lm")
        loaded = ctypes.CDLL(str(library))
        self.function = getattr(loaded, source.stem)
        self.setup = getattr(loaded, source.stem + "_setup") if program.parameters else None

    def __call__(self, inputs, parameters=None):
        arguments = [numbers_of(values) for values in inputs.values()]
        if self.setup:
            constants = numbers_of([0.0] * (len(self.program.parameters) + len(self.program.setup)))
            self.setup(constants, numbers_of([parameters[name] for name in self.program.parameters]))
            arguments.append(constants)
        outputs = [numbers_of([0.0] * len(output.entries)) for output in self.program.outputs]
        self.function(*arguments, *outputs)
        return [list(output) for output in outputs]


def numbers_of(values):
    return (ctypes.c_double * len(values))(*values)


def same(actual, expected):
    """Assert that lists of numbers are equal except for rounding."""
    for values, expected_values in zip(actual, expected, strict=True):
        np.testing.assert_allclose(values, expected_values, rtol=1e-12, atol=1e-12)


def panda_programs(robot):
    """Inverse with friction of a parameter, and direct model of a robot."""
    trace = Trace()
    q, qd, qdd, efforts = (trace.input(name, 7) for name in ("q", "qd", "qdd", "efforts"))
    sweep, gravity = run_forward_pass(robot, q, qd, np.zeros(6), {}), np.array([0, 0, 9.81, 0, 0, 0])
    forces, wrenches = inverse_dynamics(robot, sweep, qdd, gravity)
    coulomb, gear = trace.parameter("Coulomb friction"), trace.parameter("gear")
    rubbed = forces + np.array([gear * gear * coulomb * rate.signum() for rate in qd])
    accelerations = articulated_body.solve(robot, sweep, [None] * 7, list(efforts[:, None]), gravity).accelerations
    return [
        build_program(trace, "inverse", {"q": 7, "qd": 7, "qdd": 7}, {"efforts": rubbed, "wrenches": wrenches}),
        build_program(trace, "direct", {"q": 7, "qd": 7, "efforts": 7}, {"accelerations": accelerations}),
    ]


@pytest.mark.parametrize("number", range(2))
@pytest.mark.parametrize("form", ["as described", "gathered"])
def test_generated_c_agrees_for_models_of_the_panda(tmp_path, form, number):
    robot = load_robot("panda")
    program = panda_programs(robot if form == "as described" else group_inertial_parameters(robot))[number]
    compiled = Compiled(tmp_path, program, prefix="panda_", joint_names=[joint.name for joint in robot.joints])
    parameters = {"Coulomb friction": 0.3, "gear": 2.0}
    function = python_function(program, parameters)
    for sample in np.random.default_rng(number).uniform(-2, 2, (5, 3, 7)):
        inputs = dict(zip(program.inputs, sample, strict=True))
        from_c = compiled(inputs, parameters)
        from_python = function(*sample)
        same(from_c, interpreted(program, inputs, parameters))
        same(from_c, from_python if len(program.outputs) > 1 else [from_python])


@pytest.mark.parametrize("name", ["rx90", "four_bar"])
def test_generated_c_of_derivatives_agrees_with_dynamics(tmp_path, name):
    dynamics = Dynamics(shipped_robot(name), compiled=False)
    state = random_state(dynamics.robot)
    last = {"inverse": "qdd", "direct": "efforts"}
    for model, argument in last.items():
        program = shipped_program(name, f"{model}_derivatives")
        compiled = Compiled(tmp_path, program, prefix=f"{name}_")
        results = compiled({key: state[key] for key in program.inputs})
        derivatives = getattr(dynamics, program.name)(state["q"], state["qd"], state[argument])
        for output, values in zip(program.outputs, results, strict=True):
            expected = getattr(derivatives, output.name.removeprefix("by_"))
            np.testing.assert_allclose(np.reshape(values, output.shape), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(programs(), st.lists(st.lists(NUMBERS, min_size=7, max_size=7), min_size=10, max_size=10))
def test_random_programs_agree_with_their_statements(program, samples):
    with tempfile.TemporaryDirectory() as folder:
        compiled = Compiled(folder, program)
    for numbers in samples:
        inputs, parameters = {"x": numbers[:3], "s_x": numbers[3:5]}, {"gear": numbers[5], "t1": numbers[6]}
        actual = compiled(inputs, parameters)
        expected = interpreted(program, inputs, parameters)
        for reference in (expected, python_function(program, parameters)(*inputs.values())):
            for values, reference_values in zip(actual, reference, strict=True):
                np.testing.assert_allclose(values, reference_values, rtol=1e-12)


def hostile_program(name):
    """A program in which nearly all names are the same."""
    trace = Trace()
    x, p = trace.input(name, 2), trace.parameters([name, name + "_constants"])
    outputs = {name: [x[0].sin() * p[0], x[1].signum()], name + "_setup": x * p[1] * p[0]}
    return build_program(trace, name, {name: 2, "unread": 3, "none": 0}, outputs)


@pytest.mark.parametrize("name", HOSTILE)
def test_names_do_not_become_code(tmp_path, name):
    program = hostile_program(name)
    options = {"joint_names": [name, *HOSTILE], "prefix": ""}
    compiled = Compiled(tmp_path, program, **options)
    results = compiled({name: [0.5, -2.0], "unread": [0] * 3, "none": []}, {name: 3.0, name + "_constants": 2.0})
    same(results, [[3 * math.sin(0.5), -1.0], [3.0, -12.0]])
    for text in c_source(program, **options):
        assert re.fullmatch(r"[ -~\n]*", text) and not re.search(r'\?\?|[\\%]|"(?!C"|[A-Za-z0-9_]+\.h"|\s|$)', text)
        bare = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
        assert not re.search(r"#error|/\*|\*/|__(?!cplusplus)", bare)
        assert "injected" in name or "injected" not in bare


@pytest.mark.slow
@pytest.mark.parametrize("compiler", [*COMPILERS[1:], *CPP_COMPILERS])
def test_generated_c_compiles_without_warnings(tmp_path, compiler):
    language = ["-x", "c++"] if "++" in Path(compiler).name else ["-std=c99"]
    for name in [*HOSTILE[9:], "class"]:
        run(
            compiler, *language, *STRICT, "-fsyntax-only", written(tmp_path, hostile_program(name), joint_names=HOSTILE)
        )


def test_generated_c_is_callable_from_cpp(tmp_path):
    if not CPP_COMPILERS:
        pytest.skip("no C++ compiler is here")
    trace = Trace()
    x = trace.input("x", 2)
    source = written(tmp_path, build_program(trace, "double", {"x": 2}, {"y": x + x}), prefix="my-")
    assert source.stem == "my_double"
    main = tmp_path / "main.cpp"
    main.write_text(
        '#include "my_double.h"\n#include "my_double.h"\n'
        "int main() { double x[2] = {1, 2}; my_double(x, x); return x[1] == 4 && x[0] == 2 ? 0 : 1; }\n"
    )
    run(COMPILERS[0], *C99, "-c", source, "-o", tmp_path / "model.o")
    run(CPP_COMPILERS[0], main, tmp_path / "model.o", "-o", tmp_path / "main", "-lm")
    run(tmp_path / "main")


def test_literals_are_exact(tmp_path):
    numbers = [*SPECIAL, 0.1, 2.0**53 - 1, 1 / 3, 2.2250738585072011e-308, 1.7976931348623157e308]
    program = build_program(Trace(), "numbers", {}, {"out": numbers})
    (written_numbers,) = Compiled(tmp_path, program)({})
    np.testing.assert_array_equal(written_numbers, numbers)
    np.testing.assert_array_equal(np.signbit(written_numbers), np.signbit(numbers))


def test_outputs_may_overlap_inputs(tmp_path):
    trace = Trace()
    x, y = trace.input("x", 2), trace.input("y", 2)
    program = build_program(trace, "swap", {"x": 2, "y": 2}, {"a": [y[1], x[0] + y[0]], "b": [x[1], x[0]]})
    compiled = Compiled(tmp_path, program)
    x, y = numbers_of([1, 2]), numbers_of([3, 4])
    compiled.function(x, y, x, y)
    assert [*x, *y] == [4, 4, 2, 1]


def test_object_file_defines_only_the_functions(tmp_path):
    """It has no variables that calls could share, and uses only functions of math.h."""
    if not (nm := shutil.which("nm")):
        pytest.skip("nm, which lists symbols, is not here")
    source = written(tmp_path, hostile_program("arm"))
    run(COMPILERS[0], *C99, "-O0", "-c", source, "-o", tmp_path / "arm.o")
    symbols = {}
    for line in run(nm, "-P", tmp_path / "arm.o").splitlines():
        name, kind = line.split()[:2]
        symbols.setdefault(kind, set()).add(name.strip("_"))
    assert symbols.pop("T") == {"arm", "arm_setup"} and symbols.pop("t") == {"sign_of"}
    assert symbols.pop("U") <= {"sin", "GLOBAL_OFFSET_TABLE"} and set(symbols) <= {"r", "R", "n", "N"}


def test_comments_contain_joints_units_and_operations():
    robot = load_robot("panda")
    program = panda_programs(robot)[0]
    names = [joint.name for joint in robot.joints]
    header, _ = c_source(program, prefix="panda_", joint_names=names)
    count = program.operations
    words = [
        *names,
        "[rad or m]",
        "[N m or N]",
        "q: 7 numbers",
        "wrenches: 48 numbers",
        "(8, 6)",
        "0: Coulomb friction",
    ]
    words += [f"multiplications {count.multiplications}", f"additions {count.additions}", f"signs {count.signs}"]
    assert all(word in header for word in words)
    assert "void panda_inverse(const double q[7], const double qd[7], const double qdd[7]," in header


MAIN = """
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "{name}.h"

int main(void)
{{
    const double special[] = {{0.0, -0.0, 5e-324, 1e308, -1e308, INFINITY, -INFINITY, NAN, 0.5, -2.0}};
    for (int round = 0; round < 40; ++round) {{
        {name}_constants *constants = malloc(sizeof *constants);
        double *parameters = malloc({parameters} * sizeof(double));
        double *in[{inputs}], *out[{outputs}];
        const size_t sizes[] = {{{sizes}}};
        for (int k = 0; k < {parameters}; ++k) parameters[k] = special[(round + k) % 10];
        for (int k = 0; k < {inputs} + {outputs}; ++k) {{
            double *numbers = malloc(sizes[k] * sizeof(double)); /* no more than declared */
            if (k < {inputs}) in[k] = numbers; else out[k - {inputs}] = numbers;
            for (size_t index = 0; index < sizes[k]; ++index) numbers[index] = special[(round + index * 3) % 10];
        }}
        {name}_setup(constants, parameters);
        {name}({call});
        for (int k = 0; k < {inputs}; ++k) free(in[k]);
        for (int k = 0; k < {outputs}; ++k) free(out[k]);
        free(constants);
        free(parameters);
    }}
    return 0;
}}
"""


def test_sanitisers_find_nothing(tmp_path):
    flags = ["-std=c99", "-g", "-fsanitize=undefined,address", "-fno-sanitize-recover=all"]
    (tmp_path / "empty.c").write_text("int main(void) { return 0; }\n")
    if subprocess.run([COMPILERS[0], *flags, tmp_path / "empty.c", "-o", tmp_path / "empty"], timeout=60).returncode:
        pytest.skip("the compiler has no sanitisers")
    program = panda_programs(group_inertial_parameters(load_robot("panda")))[0]
    sizes = [*program.inputs.values(), *(len(output.entries) for output in program.outputs)]
    source = written(tmp_path, program)
    main = MAIN.format(
        name=source.stem,
        parameters=len(program.parameters),
        inputs=len(program.inputs),
        outputs=len(program.outputs),
        sizes=", ".join(map(str, sizes)),
        call="in[0], in[1], in[2], constants, out[0], out[1]",
    )
    (tmp_path / "main.c").write_text(main)
    run(COMPILERS[0], *flags, tmp_path / "main.c", source, "-o", tmp_path / "main", "-lm")
    run(tmp_path / "main")
