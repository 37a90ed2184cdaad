"""Programs written as Python compute what a plain interpreter does, whatever numbers and names go in."""

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


def listed(answer, program):
    """What a generated function returned, as a list of lists."""
    return [answer] if len(program.outputs) == 1 else list(answer)


def same(found, expected):
    """Lists of numbers, equal but for rounding."""
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(np.asarray(one), np.asarray(other), rtol=1e-12, atol=1e-12)


def module(program):
    """What the module that python_source writes defines."""
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
    found = articulated_body.solve(robot, sweep, [None] * size, list(efforts[:, None]), GRAVITY).accelerations
    sizes = dict.fromkeys(("q", "qd", "qdd"), size)
    return [
        build_program(trace, "inverse", sizes, {"efforts": rubbed}),
        build_program(trace, "inertia matrix", {"q": size}, {"A": A}),
        build_program(trace, "direct", {"q": size, "qd": size, "efforts": size}, {"accelerations": found, "A": A}),
    ]


@pytest.fixture(scope="module", params=["as described", "gathered"])
def panda(request):
    robot = load_robot("panda")
    return robot if request.param == "as described" else group_inertial_parameters(robot)


@settings(deadline=None, max_examples=150)
@given(programs(), st.lists(NUMBERS, min_size=7, max_size=7))
def test_random_programs_compute_what_their_statements_mean(program, numbers):
    inputs, parameters = {"x": numbers[:3], "s_x": numbers[3:5]}, {"gear": numbers[5], "t1": numbers[6]}
    expected = interpreted(program, inputs, parameters)
    found = python_function(program, parameters)(*inputs.values())
    scope = module(program)
    constants = [run_setup(scope["setup"], program, parameters)] if program.parameters else []
    for answer in (found, scope["random"](*inputs.values(), *constants)):
        for one, other in zip(answer, expected, strict=True):
            np.testing.assert_array_equal(one, other)
            np.testing.assert_array_equal(np.signbit(one)[~np.isnan(one)], np.signbit(other)[~np.isnan(other)])


def run_setup(setup, program, parameters):
    """What a setup function returns; its keywords stand in the order of the program's parameters."""
    keywords = setup.__code__.co_varnames[: setup.__code__.co_kwonlyargcount]
    return setup(**dict(zip(keywords, (parameters[name] for name in program.parameters), strict=True)))


@settings(deadline=None, max_examples=80)
@given(programs(), st.lists(st.lists(NUMBERS, min_size=5, max_size=5), min_size=1, max_size=9))
def test_batches_of_random_programs_compute_what_their_statements_mean(program, rows):
    samples, parameters = np.array(rows), {"gear": 2.0, "t1": math.inf}
    columns = np.ascontiguousarray(samples.T)
    expected = interpreted(program, {"x": columns[:3], "s_x": columns[3:]}, parameters)
    found = python_batch(program, parameters)(samples[:, :3], samples[:, 3:])
    assert [output.shape for output in found] == [(len(rows), 2, 2), (len(rows),)]
    for output, entries in zip(found, expected, strict=True):
        flat = np.stack([np.broadcast_to(entry, len(rows)) for entry in entries], axis=-1)
        np.testing.assert_allclose(output.reshape(flat.shape), flat, rtol=1e-12)


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


def test_models_of_the_panda_are_those_of_dynamics(panda):
    inverse, matrix, direct = panda_programs(panda)
    dynamics = Dynamics(load_robot("panda"))
    q, qd, given = np.random.default_rng(7).uniform(-2, 2, (3, 7))
    efforts = python_function(inverse, {"Coulomb friction": 0.0, "gear": 1.0})(q, qd, given)
    np.testing.assert_allclose(efforts, dynamics.inverse(q, qd, given), rtol=1e-10, atol=1e-10)
    A = np.reshape(python_function(matrix)(q), (7, 7))
    np.testing.assert_allclose(A, dynamics.inertia_matrix(q), rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(python_function(direct)(q, qd, given)[0], dynamics.direct(q, qd, given), rtol=1e-8)


def simple(outputs=lambda x, y: {"sum": x + y}):
    """A program of two inputs: what `outputs` makes of their Scalars."""
    trace = Trace()
    x, y = trace.input("x", 2), trace.input("y", 2)
    return build_program(trace, "simple", {"x": 2, "y": 2}, outputs(x, y))


def test_one_output_is_a_list_several_are_a_tuple_none_is_empty():
    one, two, none = simple(), simple(lambda x, y: {"a": x, "b": y[0]}), simple(lambda x, y: {})
    for function in (python_function(one), module(one)["simple"]):
        assert function([1, 2], (3, 4)) == [4.0, 6.0]
    for function in (python_function(two), module(two)["simple"]):
        assert function([1, 2], [3, 4]) == ([1.0, 2.0], [3.0])
    for function in (python_function(none), module(none)["simple"]):
        assert function([1, 2], [3, 4]) == ()


def test_any_sequence_of_numbers_will_do_and_of_the_right_length_only():
    function = python_function(simple())
    for numbers in ([1, 2], (1.0, True + 1), np.array([1, 2]), array("d", [1, 2]), np.float32([1, 2])):
        answer = function(numbers, y=numbers)
        assert answer == [2.0, 4.0] and all(type(entry) is float for entry in answer)
    with pytest.raises(ValueError, match="unpack"):
        function([1, 2, 3], [1, 2])


def test_what_is_not_finite_stays_where_it_belongs():
    program = simple(lambda x, y: {"out": [x[0].sin(), x[1].cos(), y[0] / y[1], x[1] + y[0], y[1].sqrt()]})
    for function in (python_function(program), module(program)["simple"]):
        answer = function([math.inf, 0.0], [1.0, -0.0])
        np.testing.assert_array_equal(answer, [math.nan, 1.0, -math.inf, 1.0, -0.0])
        np.testing.assert_array_equal(function([0.0, 0.0], [0.0, -1.0])[2:], [-0.0, 0.0, math.nan])
    assert math.isnan(python_function(simple(lambda x, y: {"s": x[0].signum()}))([math.nan, 0], [0, 0])[0])


def test_numbers_are_written_exactly():
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
def test_no_name_becomes_code(name):
    trace = Trace()
    x, z, p = trace.input(name, 2), trace.input("x", 0), trace.parameter(name)
    program = build_program(trace, name, {name: 2, "x": 0}, {name: [x[0].sin() * p, x[1], *z], name + " ": x * 2})
    body = ast.parse(python_source(program, joint_names=[name, *HOSTILE])).body
    assert [type(part) for part in body[:2]] == [ast.Expr, ast.Import]
    assert all(isinstance(part, ast.FunctionDef) for part in body[2:])
    called = {ast.unparse(node.func) for part in body for node in ast.walk(part) if isinstance(node, ast.Call)}
    assert called <= {"sin", "map", "math.sin", "math.isfinite"}
    answer = python_function(program, {name: 3.0})([math.inf, 2.0], [])
    assert math.isnan(answer[0][0]) and answer[0][1] == 2.0 and answer[1] == [math.inf, 4.0]
    assert python_batch(program, {name: 3.0})(np.ones((4, 2)), np.ones((4, 0)))[1].shape == (4, 2)


def test_the_source_tells_what_it_is_and_needs_math_alone(panda):
    program = panda_programs(panda)[0]
    names = [joint.name for joint in panda.joints]
    source = python_source(program, joint_names=names)
    told = ast.get_docstring(ast.parse(source))
    assert all(word in told for word in (*names, str(program.operations), "q: 7 numbers", "rad", "robot_dynamics"))
    imports = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert [ast.unparse(node) for node in imports] == ["import math"]
    assert "s_q2 = sin(q2)" in source and max(map(len, source.splitlines())) <= 120


def test_batches_pass_block_by_block_and_refuse_other_shapes(monkeypatch):
    monkeypatch.setattr(python_functions, "BLOCK_SIZE", 4)
    batch = python_batch(simple())
    x = np.arange(22.0).reshape(11, 2)
    np.testing.assert_array_equal(batch(x, 2 * x), 3 * x)
    assert batch(x[:0], x[:0]).shape == (0, 2)
    for wrong in ((x,), (x, x[:3]), (x, x[:, :1]), (x[0], x[0])):
        with pytest.raises(InvalidInputError, match="needed"):
            batch(*wrong)


def test_twenty_thousand_statements_compile_in_reasonable_time():
    trace = Trace()
    x = list(trace.input("x", 10))
    for k in range(20_000):
        x.append(x[-1] * x[-7] - x[-10] if k % 3 else x[-2] * 0.5)
    program = build_program(trace, "long", {"x": 10}, {"out": x[-50:]})
    numbers = np.random.default_rng(0).uniform(-1, 1, 10)
    start = time.perf_counter()
    answers = [python_function(program)(numbers), module(program)["long"](numbers)]
    assert time.perf_counter() - start < 30
    for answer in answers:
        same([answer], interpreted(program, {"x": numbers}))
