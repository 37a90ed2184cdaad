"""Compiled programs agree with an evaluation of their statements in Python, and models of robots with Pinocchio."""

import sys
import threading
import time
from math import inf

import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from peers.pinocchio_model import PinocchioModel
from peers.random_robots import random_urdf
from peers.real_robots import real_urdf

from robot_dynamics.codegen.jit import compiled_program, kernel, machine_code, threads
from robot_dynamics.codegen.jit.compiled_program import compile_program
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import INPUT, PARAMETER, Trace
from robot_dynamics.errors import CompilationError, InvalidInputError, RobotDynamicsError
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.newton_euler import articulated_body
from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.kinematics import run_forward_pass

llvm_engine = pytest.importorskip("robot_dynamics.codegen.jit.engine", reason="llvmlite is not installed")
GRAVITY = 9.81
BASE_ACCELERATION = np.array([0, 0, GRAVITY, 0, 0, 0])


def models(robot):
    """The program q, qd, qdd -> efforts, accelerations, where the accelerations of the efforts are qdd again."""
    size = len(robot.joints)
    trace = Trace()
    q, qd, qdd = (trace.input(name, size) for name in ("q", "qd", "qdd"))
    sweep = run_forward_pass(robot, q, qd, np.zeros(6, int), {})
    efforts, _ = inverse_dynamics(robot, sweep, qdd, BASE_ACCELERATION)
    solution = articulated_body.solve(robot, sweep, [None] * size, list(efforts[:, None]), BASE_ACCELERATION)
    inputs = dict.fromkeys(("q", "qd", "qdd"), size)
    return build_program(trace, "models", inputs, {"efforts": efforts, "accelerations": solution.accelerations})


def pinocchio_efforts(urdf, robot, q, qd, qdd):
    joints = [joint.name for joint in robot.joints]
    model = PinocchioModel(urdf, joints, rotor_inertias=[joint.rotor_inertia for joint in robot.joints])
    return np.array([model.inertia_matrix(q) @ qdd + model.bias(q, qd) for q, qd, qdd in zip(q, qd, qdd, strict=True)])


@pytest.mark.parametrize("parts", [5000, 97])
@pytest.mark.parametrize("name", ["ur5", "z1", 1, 2])
def test_compiled_models_of_robots_agree_with_python(name, parts, monkeypatch):
    for name_of_length in ("MAX_LENGTH", "PART_LENGTH", "MAX_BLOCK_LENGTH"):
        monkeypatch.setattr(kernel, name_of_length, parts)
    monkeypatch.setattr(kernel, "MAX_BLOCK_STORES", parts // 50)
    urdf = real_urdf(name) if isinstance(name, str) else random_urdf(name, joints=6)
    robot = read_urdf(urdf)
    program = compile_program(models(robot))
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 21, len(robot.joints)))
    expected = pinocchio_efforts(urdf, robot, q, qd, qdd)
    scale = np.abs(expected).max()
    single = [np.array(results) for results in zip(*map(program.evaluate, q, qd, qdd), strict=True)]
    for efforts, accelerations in (program.batch(q, qd, qdd), single):
        np.testing.assert_allclose(efforts, expected, rtol=1e-12, atol=1e-12 * scale)
        np.testing.assert_allclose(accelerations, qdd, rtol=1e-7, atol=1e-7)


UNARY = ("sin", "cos", "sqrt", "signum", "negative")
BINARY = ("add", "subtract", "multiply", "divide")
places = st.integers(0, 10**6)
instructions = st.lists(
    st.one_of(
        st.tuples(st.sampled_from(BINARY), places, places),
        st.tuples(st.sampled_from(UNARY), places, places),
        st.tuples(st.just("constant"), st.floats(-4, 4), places),
    ),
    min_size=1,
    max_size=60,
)


def random_program(instructions, sizes=(3, 5)):
    """A program of arbitrary operations, except those that cannot be recorded (roots of negated expressions, ÷ 0)."""
    trace = Trace()
    inputs = {f"x{number}": size for number, size in enumerate(sizes)}
    values = [scalar for name, size in inputs.items() for scalar in trace.input(name, size)]
    values += list(trace.parameters(["mass", "length"]))
    for operation, a, b in instructions:
        if operation == "constant":
            values.append(trace.constant(a))
            continue
        a, b = values[a % len(values)], values[b % len(values)]
        try:
            if operation in BINARY:
                sign = {"add": "__add__", "subtract": "__sub__", "multiply": "__mul__", "divide": "__truediv__"}
                values.append(getattr(a, sign[operation])(b))
            else:
                values.append(-a if operation == "negative" else getattr(a, operation)())
        except (RobotDynamicsError, ValueError):
            continue
    outputs = {"last": values[-1], "some": np.array(values[::3]), "all": np.array(values[-6:]).reshape(2, 3)}
    return build_program(trace, "random", inputs, outputs)


EPSILON = np.finfo(float).eps


def bounded(operation, *operands):
    """(value, bound of its error) of an operation on such pairs; a bound that is not finite is no bound."""
    (a, da), (b, db) = operands if len(operands) == 2 else (*operands, (0.0, 0.0))
    a, b = np.float64(a), np.float64(b)
    if operation == "add" or operation == "subtract":
        value = a + b if operation == "add" else a - b
        error = da + db + EPSILON * (abs(a) + abs(b))
    elif operation == "multiply":
        value = a * b
        error = abs(a) * db + abs(b) * da + da * db + 2 * EPSILON * abs(value)
    elif operation == "divide":
        value = a / b
        error = (da + abs(value) * db) / (abs(b) - db) + 2 * EPSILON * abs(value) if abs(b) > db else inf
    elif operation in ("sin", "cos"):
        value = np.sin(a) if operation == "sin" else np.cos(a)
        error = da + 4 * EPSILON * abs(value)
    elif operation == "sqrt":
        value = np.sqrt(a)
        error = da / value + 2 * EPSILON * value if a > da else (0.0 if da == 0 else inf)
    else:
        value = np.sign(a)
        error = 0.0 if abs(a) > da or da == 0 else inf
    return value, error + 1e-300


def by_statements(program, arrays, parameters):
    """For each output, its entries and the bounds of their errors."""
    known = {}
    for number, operation, operands in program.leaves:
        if operation == INPUT:
            known[number] = arrays[operands[0]][operands[1]], 0.0
        else:
            known[number] = (parameters[operands[0]] if operation == PARAMETER else operands[0]), 0.0
    with np.errstate(all="ignore"):
        for number, operation, operands in (*program.setup, *program.statements):
            known[number] = bounded(operation, *(known[operand] for operand in operands))
    for output in program.outputs:
        values = np.array([sign * known[node][0] for node, sign in output.entries]).reshape(output.shape)
        yield values, np.array([known[node][1] for node, _ in output.entries]).reshape(output.shape)


def check(results, program, arrays, parameters):
    for result, (values, bounds) in zip(results, by_statements(program, arrays, parameters), strict=True):
        finite = np.isfinite(bounds) & np.isfinite(values)
        assert np.shape(result) == values.shape
        with np.errstate(invalid="ignore"):
            assert np.all(np.abs(result - values)[finite] <= 2 * bounds[finite])
        certain = np.isfinite(bounds) & np.isnan(values)
        assert np.all(np.isnan(result[certain]))


special = st.sampled_from([0.0, -0.0, 1.0, -1.0, 1e-310, 1e200, 1e10, np.inf, -np.inf, np.nan])
entries = st.one_of(st.floats(-10, 10), st.floats(-10, 10), special)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(instructions, st.lists(st.lists(entries, min_size=8, max_size=8), min_size=1, max_size=11), st.floats(0.5, 3))
def test_compiled_random_programs_agree_with_python(instructions, samples, mass):
    try:
        program = random_program(instructions)
    except (ZeroDivisionError, ValueError):  # a constant that is not recorded
        reject()
    parameters = {name: {"mass": mass, "length": -0.7}[name] for name in program.parameters}
    try:
        made = compile_program(program, parameters)
    except InvalidInputError:
        assert any(not np.isfinite(number) for number in setup(program, parameters))
        return
    samples = np.array(samples)
    x0, x1 = samples[:, :3], np.ascontiguousarray(samples[:, 3:])
    batch = made.batch(x0, x1)
    for row, (a, b) in enumerate(zip(x0.copy(), x1, strict=True)):
        check([result[row] for result in batch], program, {"x0": a, "x1": b}, parameters)
        check(made.evaluate(a, b), program, {"x0": a, "x1": b}, parameters)


def setup(program, parameters):
    known = {leaf.number: leaf.operands[0] for leaf in program.leaves if leaf.operation == "constant"}
    known |= {leaf.number: parameters[leaf.operands[0]] for leaf in program.leaves if leaf.operation == PARAMETER}
    with np.errstate(all="ignore"):
        for number, operation, operands in program.setup:
            known[number] = bounded(operation, *((known[operand], 0.0) for operand in operands))[0]
    return known.values()


@pytest.fixture(scope="module")
def small():
    """x (2,), shift (6,) -> wave (6,), gap (1,), with an operation of each kind."""
    trace = Trace()
    x, shift = trace.input("x", 2), trace.input("shift", 6)
    wave = np.sin(x[0] + shift) / (x[1] * x[1] + 2) + trace.parameter("offset")
    gap = np.array([x[1].signum() * np.sqrt(x[0] * x[0] + 1)])
    program = build_program(trace, "small", {"x": 2, "shift": 6}, {"wave": wave, "gap": gap})
    return compile_program(program, {"offset": 0.25})


def expected_of_small(x, shift):
    x, shift = np.atleast_2d(x), np.atleast_2d(shift)
    wave = np.sin(x[:, :1] + shift) / (x[:, 1:] ** 2 + 2) + 0.25
    return wave, np.sign(x[:, 1:]) * np.sqrt(x[:, :1] ** 2 + 1)


def assert_close(results, expected):
    for result, values in zip(results, expected, strict=True):
        assert result.shape == values.shape
        np.testing.assert_allclose(result, values, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("vector_lanes", [4, 8])
@pytest.mark.parametrize("samples", [*range(20), 100])
def test_batch_of_any_number_of_samples(samples, vector_lanes, monkeypatch):
    monkeypatch.setattr(llvm_engine, "vector_lanes", lambda: vector_lanes)
    trace = Trace()
    inputs = {f"x{size}": size for size in range(10)}  # each size has its own transposition
    arrays = [trace.input(name, size) for name, size in inputs.items()]
    made = compile_program(
        build_program(trace, "twice", inputs, {f"y{index}": 2 * a for index, a in enumerate(arrays)})
    )
    rng = np.random.default_rng(samples)
    inputs = [rng.uniform(-1, 1, (samples, size)) for size in range(10)]
    room = [np.full((samples + 2, size), 7.0) for size in range(10)]
    results = made.batch(*inputs, out=[array[1:-1] for array in room])
    for array, twice, around in zip(inputs, results, room, strict=True):
        np.testing.assert_array_equal(twice, 2 * array)
        assert np.all(around[[0, -1]] == 7.0)  # nothing is written beside the rows


def test_batch_with_one_row_for_all_samples(small):
    x, shift = np.random.default_rng(0).uniform(-1, 1, (13, 2)), np.linspace(0, 1, 6)
    assert_close(small.batch(x, shift), expected_of_small(x, shift))
    assert_close(small.batch(x[0], np.tile(shift, (3, 1))), expected_of_small(np.tile(x[0], (3, 1)), shift))


def test_batch_copies_other_layouts(small):
    x, shift = np.random.default_rng(0).uniform(-9, 9, (13, 4))[:, ::2], np.arange(6)
    assert_close(small.batch(x, shift), expected_of_small(x, shift))
    assert_close(small.batch(np.asfortranarray(x).tolist(), shift), expected_of_small(x, shift))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("lane", range(10))
def test_non_finite_inputs_affect_one_sample(small, value, lane):
    x, shift = np.random.default_rng(0).uniform(0.1, 1, (10, 2)), np.zeros(6)
    x[lane, 0] = value
    wave, gap = small.batch(x, shift)
    bad = np.arange(10) == lane
    np.testing.assert_array_equal(np.isnan(wave), np.repeat(bad[:, None], 6, axis=1))
    np.testing.assert_array_equal(np.isfinite(gap[:, 0]), ~bad)
    assert_close((wave[~bad], gap[~bad]), expected_of_small(x[~bad], shift))


def test_sign_of_special_values(small):
    for value, sign in ((2.0, 1), (-2.0, -1), (0.0, 0), (-0.0, 0), (np.nan, np.nan), (-np.inf, -1), (5e-324, 1)):
        actual = small.evaluate(np.array([0.0, value]), np.zeros(6))[1]
        np.testing.assert_array_equal(actual, [sign])
        np.testing.assert_array_equal(small.batch(np.array([[0.0, value]]), np.zeros(6))[1], [[sign]])


def test_outputs_may_overlap_inputs(small):
    for shape in ((11, 6), (16, 6)):
        x, room = np.ones((shape[0], 2)), np.random.default_rng(0).uniform(-1, 1, (shape[0] + 1, 6))
        for wave in (room[:-1], room[1:]):
            shift = room[:-1]
            expected = expected_of_small(x, shift.copy())
            assert_close(small.batch(x, shift, out=(wave, np.empty((len(x), 1)))), expected)


@pytest.mark.parametrize("samples", [1, 8, 9, 255, 1003])
@pytest.mark.parametrize("count", [2, 3, 40])
def test_threads_share_the_samples(small, count, samples, monkeypatch):
    monkeypatch.setattr(compiled_program, "MIN_WORK_PER_THREAD", 1)
    x, shift = np.random.default_rng(0).uniform(-9, 9, (samples, 2)), np.linspace(0, 1, 6)
    room = [np.full((samples + 2, size), 7.0) for size in (6, 1)]
    actual = small.batch(x, shift, out=tuple(array[1:-1] for array in room), threads=count)
    assert_close(actual, expected_of_small(x, shift))
    assert all(np.all(array[[0, -1]] == 7.0) for array in room)


def test_batch_waits_for_threads_and_runs_where_none_can_start(small, monkeypatch):
    done = []

    def work():
        time.sleep(0.01 * (threading.current_thread() is not threading.main_thread()))
        done.append(threading.get_ident())

    threads.run_in_threads(work, 3)
    assert len(done) == 3 and len(set(done)) >= 2

    def refuse(*arguments):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threads, "start_new_thread", refuse)
    monkeypatch.setattr(compiled_program, "MIN_WORK_PER_THREAD", 1)
    x, shift = np.random.default_rng(0).uniform(-9, 9, (103, 2)), np.linspace(0, 1, 6)
    assert_close(small.batch(x, shift, threads=4), expected_of_small(x, shift))


REFUSED = {
    "too few": (TypeError, "takes 2 arrays", lambda x, s: ((x,), {})),
    "size": (ValueError, r"argument 2 \(shift\).*\(N, 6\)", lambda x, s: ((x, s[:, :5]), {})),
    "axes": (ValueError, r"argument 1 \(x\)", lambda x, s: ((x[None], s), {})),
    "rows": (ValueError, "x has 5, shift has 4", lambda x, s: ((x, s[:4]), {})),
    "no rows": (ValueError, "no array has rows", lambda x, s: ((x[0], s[0]), {})),
    "complex": (TypeError, "float64, not complex128", lambda x, s: ((x + 1j, s), {})),
    "text": (TypeError, "float64, not", lambda x, s: ((x.astype(str), s), {})),
    "none": (TypeError, "float64, not object", lambda x, s: ((None, s), {})),
    "one out": (ValueError, "writes to 2 arrays, not 1", lambda x, s: ((x, s), {"out": np.empty((5, 6))})),
    "out type": (TypeError, "the array for wave", lambda x, s: ((x, s), {"out": (np.empty((5, 6), "f4"), x)})),
    "out shape": (ValueError, "the array for gap", lambda x, s: ((x, s), {"out": (np.empty((5, 6)), np.empty(5))})),
    "out order": (ValueError, "C-contig", lambda x, s: ((x, s), {"out": (np.empty((6, 5)).T, np.empty((5, 1)))})),
    "out twice": (ValueError, "overlap", lambda x, s: ((x, s), {"out": overlapping()})),
}


def overlapping():
    room = np.empty((6, 6))
    return room[:5], room.ravel()[:5].reshape(5, 1)


@pytest.mark.parametrize("kind", REFUSED)
def test_batch_refuses_invalid_arguments(small, kind):
    error, text, arguments = REFUSED[kind]
    positional, named = arguments(np.zeros((5, 2)), np.zeros((5, 6)))
    with pytest.raises(error, match=text):
        small.batch(*positional, **named)


def test_parameters_are_checked():
    trace = Trace()
    a, mass, length = trace.input("a", 1), trace.parameter("mass"), trace.parameter("length")
    program = build_program(trace, "pendulum", {"a": 1}, {"b": a * (mass / (length - 1))})
    assert compile_program(program, {"mass": 2, "length": 1.5}).evaluate(np.array([3.0])) == 12
    for parameters, text in (
        ({"mass": 1.0}, "needs a value for 'length'"),
        ({"mass": 1.0, "length": 2.0, "lenght": 3.0}, "unknown parameter of pendulum 'lenght'"),
        ({"mass": np.nan, "length": 2.0}, "'mass'.*must be finite"),
        ({"mass": 1.0, "length": 1.0}, "pendulum.*divide gives"),
    ):
        with pytest.raises(InvalidInputError, match=text):
            compile_program(program, parameters)


def test_compilation_error_without_llvmlite(small, monkeypatch):
    for name in list(sys.modules):
        if name.split(".")[0] == "llvmlite" or name == llvm_engine.__name__:
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr("robot_dynamics.codegen.jit.engine")
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    with pytest.raises(CompilationError, match="need llvmlite"):
        compile_program(small.program, {"offset": 0.0})


def test_compilation_error_where_llvm_fails(small, monkeypatch):
    monkeypatch.setenv("ROBOT_DYNAMICS_CACHE", "")
    monkeypatch.setattr(machine_code, "signature", lambda *_: "nonsense")
    with pytest.raises(CompilationError, match="could not be compiled"):
        compile_program(small.program, {"offset": 0.0})
