"""Generated Python agrees with an interpreter of the program, for any numbers and names."""

import ast
import math
import time
from array import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from peers.straight_lines import NUMBERS, SPECIAL, interpreted, programs

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.codegen.emit.python_source import python_source
from robot_dynamics.codegen.jit import python_functions
from robot_dynamics.codegen.jit.python_functions import python_batch, python_function
from robot_dynamics.codegen.trace.parameter_grouping import group_inertial_parameters
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.newton_euler import articulated_body
from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.kinematics import run_forward_pass
from robot_dynamics.newton_euler.walker_orin import inertia_matrix

HOSTILE = [
    '"""',
    "*/",
    "\\",
    "a\nb",
    "__import__('os')",
    "def",
    "print",
    "q1",
    "t1",
    "s_q1",
    "é",
    "",
    "1",
    "%s{0}",
    "_",
]
GRAVITY = np.array([0, 0, 9.81, 0, 0, 0])


def listed(results, program):
    """The results of a generated function as a list of lists."""
    return [results] if len(program.outputs) == 1 else list(results)


def same(actual, expected):
    """Assert that lists of numbers are equal except for rounding."""
    for values, expected_values in zip(actual, expected, strict=True):
        np.testing.assert_allclose(np.asarray(values), np.asarray(expected_values), rtol=1e-12, atol=1e-12)


def module(program):
    """The names that the module of python_source defines."""
    scope = {}
    exec(python_source(program), scope)
    return scope


def panda_programs(robot):
    """Inverse with friction of a parameter, inertia matrix and direct model of a robot."""
    size = len(robot.joints)
    trace = Trace()
    q, qd, qdd, efforts = (trace.input(name, size) for name in ("q", "qd", "qdd", "efforts"))
    sweep = run_forward_pass(robot, q, qd, np.zeros(6), {})
    forces, _ = inverse_dynamics(robot, sweep, qdd, GRAVITY)
    coulomb, gear = trace.parameter("Coulomb friction"), trace.parameter("gear")
    rubbed = forces + np.array([gear * gear * coulomb * rate.signum() for rate in qd])
    A = inertia_matrix(robot, q)
    accelerations = articulated_body.solve(robot, sweep, [None] * size, list(efforts[:, None]), GRAVITY).accelerations
    sizes = dict.fromkeys(("q", "qd", "qdd"), size)
    return [
        build_program(trace, "inverse", sizes, {"efforts": rubbed}),
        build_program(trace, "inertia matrix", {"q": size}, {"A": A}),
        build_program(
            trace, "direct", {"q": size, "qd": size, "efforts": size}, {"accelerations": accelerations, "A": A}
        ),
    ]


@pytest.fixture(scope="module", params=["as described", "gathered"])
def panda(request):
    robot = load_robot("panda")
    return robot if request.param == "as described" else group_inertial_parameters(robot)


@pytest.mark.slow
@settings(deadline=None, max_examples=150)
@given(programs(), st.lists(NUMBERS, min_size=7, max_size=7))
def test_random_programs_agree_with_their_statements(program, numbers):
    inputs, parameters = {"x": numbers[:3], "s_x": numbers[3:5]}, {"gear": numbers[5], "t1": numbers[6]}
    expected = interpreted(program, inputs, parameters)
    from_function = python_function(program, parameters)(*inputs.values())
    scope = module(program)
    constants = [run_setup(scope["setup"], program, parameters)] if program.parameters else []
    for results in (from_function, scope["random"](*inputs.values(), *constants)):
        for values, exact in zip(results, expected, strict=True):
            np.testing.assert_array_equal(values, exact)
            np.testing.assert_array_equal(np.signbit(values)[~np.isnan(values)], np.signbit(exact)[~np.isnan(exact)])


def run_setup(setup, program, parameters):
    """The result of a setup function; its keywords are in the order of the parameters of the program."""
    keywords = setup.__code__.co_varnames[: setup.__code__.co_kwonlyargcount]
    return setup(**dict(zip(keywords, (parameters[name] for name in program.parameters), strict=True)))


@pytest.mark.slow
@settings(deadline=None, max_examples=80)
@given(programs(), st.lists(st.lists(NUMBERS, min_size=5, max_size=5), min_size=1, max_size=9))
def test_batches_of_random_programs_agree_with_their_statements(program, rows):
    samples, parameters = np.array(rows), {"gear": 2.0, "t1": math.inf}
    columns = np.ascontiguousarray(samples.T)
    expected = interpreted(program, {"x": columns[:3], "s_x": columns[3:]}, parameters)
    actual = python_batch(program, parameters)(samples[:, :3], samples[:, 3:])
    assert [output.shape for output in actual] == [(len(rows), 2, 2), (len(rows),)]
    for output, entries in zip(actual, expected, strict=True):
        flat = np.stack([np.broadcast_to(entry, len(rows)) for entry in entries], axis=-1)
        np.testing.assert_allclose(output.reshape(flat.shape), flat, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(3))
def test_models_of_the_panda_agree_in_every_form(panda, number):
    program = panda_programs(panda)[number]
    parameters = {"Coulomb friction": 0.3, "gear": 2.0, "unread": 1.0}
    samples = np.random.default_rng(number).uniform(-2, 2, (len(program.inputs), 5, 7))
    function, batch, scope = python_function(program, parameters), python_batch(program, parameters), module(program)
    constants = [scope["setup"](Coulomb_friction=0.3, gear=2.0)] if program.parameters else []
    batches = listed(batch(*samples), program)
    for k in range(5):
        expected = interpreted(program, dict(zip(program.inputs, samples[:, k], strict=True)), parameters)
        same(listed(function(*samples[:, k]), program), expected)
        same(listed(scope[program.name.replace(" ", "_")](*samples[:, k], *constants), program), expected)
        same([output[k].ravel() for output in batches], expected)


def test_models_of_the_panda_agree_with_dynamics(panda):
    inverse, matrix, direct = panda_programs(panda)
    dynamics = Dynamics(load_robot("panda"))
    q, qd, last = np.random.default_rng(7).uniform(-2, 2, (3, 7))
    efforts = python_function(inverse, {"Coulomb friction": 0.0, "gear": 1.0})(q, qd, last)
    np.testing.assert_allclose(efforts, dynamics.inverse(q, qd, last), rtol=1e-10, atol=1e-10)
    A = np.reshape(python_function(matrix)(q), (7, 7))
    np.testing.assert_allclose(A, dynamics.inertia_matrix(q), rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(python_function(direct)(q, qd, last)[0], dynamics.direct(q, qd, last), rtol=1e-8)


def simple(outputs=lambda x, y: {"sum": x + y}):
    """A program with two inputs; `outputs` computes its outputs from their Scalars."""
    trace = Trace()
    x, y = trace.input("x", 2), trace.input("y", 2)
    return build_program(trace, "simple", {"x": 2, "y": 2}, outputs(x, y))


def test_outputs_are_a_list_a_tuple_of_lists_or_empty():
    single, double, empty = simple(), simple(lambda x, y: {"a": x, "b": y[0]}), simple(lambda x, y: {})
    for function in (python_function(single), module(single)["simple"]):
        assert function([1, 2], (3, 4)) == [4.0, 6.0]
    for function in (python_function(double), module(double)["simple"]):
        assert function([1, 2], [3, 4]) == ([1.0, 2.0], [3.0])
    for function in (python_function(empty), module(empty)["simple"]):
        assert function([1, 2], [3, 4]) == ()


def test_inputs_are_sequences_of_the_right_length():
    function = python_function(simple())
    for numbers in ([1, 2], (1.0, True + 1), np.array([1, 2]), array("d", [1, 2]), np.float32([1, 2])):
        results = function(numbers, y=numbers)
        assert results == [2.0, 4.0] and all(type(entry) is float for entry in results)
    with pytest.raises(ValueError, match="unpack"):
        function([1, 2, 3], [1, 2])


def test_non_finite_values_affect_only_dependent_outputs():
    program = simple(lambda x, y: {"out": [x[0].sin(), x[1].cos(), y[0] / y[1], x[1] + y[0], y[1].sqrt()]})
    for function in (python_function(program), module(program)["simple"]):
        results = function([math.inf, 0.0], [1.0, -0.0])
        np.testing.assert_array_equal(results, [math.nan, 1.0, -math.inf, 1.0, -0.0])
        np.testing.assert_array_equal(function([0.0, 0.0], [0.0, -1.0])[2:], [-0.0, 0.0, math.nan])
    assert math.isnan(python_function(simple(lambda x, y: {"s": x[0].signum()}))([math.nan, 0], [0, 0])[0])


def test_literals_are_exact():
    numbers = [*SPECIAL, 0.1, 2.0**53 - 1, 1 / 3, 2.2250738585072011e-308, 1.7976931348623157e308]
    program = simple(lambda x, y: {"out": numbers})
    for function in (python_function(program), module(program)["simple"]):
        np.testing.assert_array_equal(function([1, 2], [3, 4]), numbers)
    np.testing.assert_array_equal(python_batch(program)(np.zeros((3, 2)), np.zeros((3, 2))), [numbers] * 3)


def test_parameters_become_constants_and_missing_ones_are_named():
    trace = Trace()
    mass, x = trace.parameter("mass of arm"), trace.input("x", 1)
    program = build_program(trace, "weigh", {"x": 1}, {"out": [mass.sin() * x[0] / mass]})
    values = {"mass of arm": 0.0}
    function = python_function(program, values)
    values["mass of arm"] = 5.0
    assert math.isnan(function([math.inf])[0]) and math.isnan(function([1.0])[0])
    with pytest.raises(InvalidInputError, match="mass of arm"):
        python_function(program)
    with pytest.raises(InvalidInputError, match="mass of arm"):
        python_batch(program, {"mass": 1.0})


@pytest.mark.parametrize("name", HOSTILE)
def test_names_do_not_become_code(name):
    trace = Trace()
    x, z, p = trace.input(name, 2), trace.input("x", 0), trace.parameter(name)
    program = build_program(trace, name, {name: 2, "x": 0}, {name: [x[0].sin() * p, x[1], *z], name + " ": x * 2})
    body = ast.parse(python_source(program, joint_names=[name, *HOSTILE])).body
    assert [type(part) for part in body[:2]] == [ast.Expr, ast.Import]
    assert all(isinstance(part, ast.FunctionDef) for part in body[2:])
    called = {ast.unparse(node.func) for part in body for node in ast.walk(part) if isinstance(node, ast.Call)}
    assert called <= {"sin", "map", "math.sin", "math.isfinite"}
    results = python_function(program, {name: 3.0})([math.inf, 2.0], [])
    assert math.isnan(results[0][0]) and results[0][1] == 2.0 and results[1] == [math.inf, 4.0]
    assert python_batch(program, {name: 3.0})(np.ones((4, 2)), np.ones((4, 0)))[1].shape == (4, 2)


def test_source_is_documented_and_imports_only_math(panda):
    program = panda_programs(panda)[0]
    names = [joint.name for joint in panda.joints]
    source = python_source(program, joint_names=names)
    docstring = ast.get_docstring(ast.parse(source))
    assert all(word in docstring for word in (*names, str(program.operations), "q: 7 numbers", "rad", "robot_dynamics"))
    imports = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert [ast.unparse(node) for node in imports] == ["import math"]
    assert "s_q2 = sin(q2)" in source and max(map(len, source.splitlines())) <= 120


def test_batches_run_in_blocks_and_refuse_other_shapes(monkeypatch):
    monkeypatch.setattr(python_functions, "BLOCK_SIZE", 4)
    batch = python_batch(simple())
    x = np.arange(22.0).reshape(11, 2)
    np.testing.assert_array_equal(batch(x, 2 * x), 3 * x)
    assert batch(x[:0], x[:0]).shape == (0, 2)
    for wrong in ((x,), (x, x[:3]), (x, x[:, :1]), (x[0], x[0])):
        with pytest.raises(InvalidInputError, match="needed"):
            batch(*wrong)


@pytest.mark.slow
def test_twenty_thousand_statements_compile_in_reasonable_time():
    trace = Trace()
    x = list(trace.input("x", 10))
    for k in range(20_000):
        x.append(x[-1] * x[-7] - x[-10] if k % 3 else x[-2] * 0.5)
    program = build_program(trace, "long", {"x": 10}, {"out": x[-50:]})
    numbers = np.random.default_rng(0).uniform(-1, 1, 10)
    start = time.perf_counter()
    results = [python_function(program)(numbers), module(program)["long"](numbers)]
    assert time.perf_counter() - start < 30
    for result in results:
        same([result], interpreted(program, {"x": numbers}))
