"""The compiled Python function of a program: accepted and refused arguments; it never crashes."""

import array
import ctypes
import gc
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_dynamics.codegen.jit import runtime
from robot_dynamics.codegen.jit.compiled_program import compile_program
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace

pytest.importorskip("llvmlite")


def shifted_sums():
    """a (3,), b (2,) -> total (2, 2), sums of entries of b and of the first two of a; order (3,), a rotated."""
    trace = Trace()
    a, b = trace.input("a", 3), trace.input("b", 2)
    return build_program(
        trace, "100%s sums", {"a": 3, "b": 2}, {"total": a[:2, None] + b[None, :], "order": np.roll(a, 1)}
    )


@pytest.fixture(scope="module")
def evaluate():
    return compile_program(shifted_sums()).evaluate


A, B = np.array([1.0, 2.0, 3.0]), np.array([10.0, 20.0])
TOTAL, ORDER = np.array([[11.0, 21.0], [12.0, 22.0]]), np.array([3.0, 1.0, 2.0])


def test_evaluate_returns_new_arrays(evaluate):
    results = evaluate(A, B)
    assert isinstance(results, tuple)
    np.testing.assert_array_equal(results[0], TOTAL)
    np.testing.assert_array_equal(results[1], ORDER)
    assert results[0].flags.owndata and results[0].dtype == np.float64
    assert evaluate(A, B)[0] is not results[0]


def test_evaluate_with_one_output_or_no_input():
    trace = Trace()
    a = trace.input("a", 1)
    np.testing.assert_array_equal(compile_program(build_program(trace, "f", {"a": 1}, {"b": -a})).evaluate(A[:1]), [-1])
    constant = compile_program(build_program(Trace(), "f", {}, {"b": np.array(2.5)})).evaluate()
    assert constant.shape == () and constant == 2.5


class Derived(np.ndarray):
    """A derived array type, read through the buffer protocol."""


class DerivedSequence(array.array):
    """A derived type with a wrong length, read through the buffer protocol."""

    def __len__(self):
        return 10**9


def exported(values):
    """An array.array with an exported view."""
    sequence = array.array("d", values)
    VIEWS.append(memoryview(sequence))
    return sequence


VIEWS = []


def grown(values):
    """An array.array with spare capacity, whose numbers have moved."""
    sequence = array.array("d")
    for value in values:
        sequence.append(value)
    return sequence


def misaligned(values):
    bytes_ = bytearray(8 * len(values) + 1)
    odd = np.frombuffer(bytes_, np.float64, offset=1)
    odd[:] = values
    return odd


CARRIERS = {
    "array": np.array,
    "row": lambda values: np.array([values]),
    "derived": lambda values: np.array(values).view(Derived),
    "array.array": lambda values: array.array("d", values),
    "array.array grown": grown,
    "array.array exported": exported,
    "array.array derived": lambda values: DerivedSequence("d", values),
    "memoryview": lambda values: memoryview(array.array("d", values)),
    "ctypes": lambda values: (ctypes.c_double * len(values))(*values),
    "misaligned": misaligned,
    "dtype with metadata": lambda values: np.array(values, dtype=np.dtype(np.float64, metadata={"unit": "rad"})),
}


@pytest.mark.parametrize("kind", CARRIERS)
def test_evaluate_accepts_any_buffer(evaluate, kind):
    total, order = CARRIERS[kind]([0.0] * 4), CARRIERS[kind]([0.0] * 3)
    assert evaluate(CARRIERS[kind]([1.0, 2.0, 3.0]), CARRIERS[kind]([10.0, 20.0]), total, order) is None
    np.testing.assert_array_equal(np.ravel(total), TOTAL.ravel())
    np.testing.assert_array_equal(np.ravel(order), ORDER)


def test_empty_arrays_are_accepted_for_empty_inputs():
    trace = Trace()
    a, _ = trace.input("a", 1), trace.input("none", 0)
    evaluate = compile_program(build_program(trace, "f", {"a": 1, "none": 0}, {"b": 2 * a})).evaluate
    for nothing in (array.array("d"), np.zeros(0), np.zeros((3, 0))):
        np.testing.assert_array_equal(evaluate(array.array("d", [2.0]), nothing), [4.0])


def test_array_array_is_read_directly_only_with_the_expected_layout(monkeypatch):
    slots = dict(zip(runtime.SLOTS, runtime.runtime_table(), strict=True))
    assert slots["sequence_type"] == id(array.array) and slots["sequence_of_doubles"]
    fields = runtime.SequenceFields._fields_

    class Shifted(ctypes.Structure):
        _fields_ = (fields[1], fields[0], *fields[2:])

    class Other(ctypes.Structure):
        _fields_ = (*fields[:2], ("description", ctypes.c_ssize_t))

    for wrong in (Shifted, Other):
        monkeypatch.setattr(runtime, "SequenceFields", wrong)
        slots = dict(zip(runtime.SLOTS, runtime.runtime_table(), strict=True))
        assert slots["sequence_type"] is None and slots["sequence_of_doubles"] is None
        careful = compile_program(shifted_sums()).evaluate
        np.testing.assert_array_equal(careful(array.array("d", A), array.array("d", B))[0], TOTAL)
        for wrong_argument in (array.array("f", B), array.array("d", A)):
            with pytest.raises((TypeError, ValueError), match=r"argument 2 \(b\)"):
                careful(A, wrong_argument)


def test_evaluate_reads_read_only_inputs(evaluate):
    a = np.frombuffer(A.tobytes())
    np.testing.assert_array_equal(evaluate(a, memoryview(B).toreadonly())[0], TOTAL)


def test_outputs_may_be_inputs(evaluate):
    a = A.copy()
    assert evaluate(a, B, np.empty(4), a) is None
    np.testing.assert_array_equal(a, ORDER)
    whole = np.array([1.0, 2.0, 3.0, 10.0, 20.0, 0.0])
    evaluate(whole[:3], whole[3:5], whole[1:5], np.empty(3))
    np.testing.assert_array_equal(whole[1:5], TOTAL.ravel())


def frozen(values):
    values.flags.writeable = False
    return values


REFUSED = {
    "none": (TypeError, r"argument 1 \(a\).*buffer of float64, not NoneType", lambda: (None, B)),
    "list": (TypeError, r"argument 2 \(b\).*not list", lambda: (A, [1.0, 2.0])),
    "float": (TypeError, r"argument 2 \(b\).*not float", lambda: (A, 1.0)),
    "no arguments": (TypeError, r"100%s sums takes \(a, b\), or these and \(total, order\).*not 0", lambda: ()),
    "one": (TypeError, "2 or 4 arrays, not 1", lambda: (A,)),
    "three": (TypeError, "not 3", lambda: (A, B, np.empty(4))),
    "five": (TypeError, "not 5", lambda: (A, B, np.empty(4), np.empty(3), A)),
    "short": (ValueError, r"100%s sums: argument 1 \(a\) must hold 3 numbers, not 2", lambda: (A[:2], B)),
    "long": (ValueError, r"argument 2 \(b\) must hold 2 numbers, not 3", lambda: (A, A)),
    "long buffer": (ValueError, "must hold 2 numbers, not 3", lambda: (A, array.array("d", A))),
    "short array.array": (
        ValueError,
        r"argument 2 \(b\) must hold 2 numbers, not 1",
        lambda: (A, array.array("d", [1])),
    ),
    "empty array.array": (ValueError, r"argument 1 \(a\) must hold 3 numbers, not 0", lambda: (array.array("d"), B)),
    "array.array of floats": (TypeError, "must hold float64.*not 'f'", lambda: (array.array("f", A), B)),
    "array.array of integers": (TypeError, "must hold float64.*not 'q'", lambda: (array.array("q", [1, 2, 3]), B)),
    "empty": (ValueError, "must hold 3 numbers, not 0", lambda: (A[:0], B)),
    "no axis": (ValueError, "must hold 3 numbers, not 1", lambda: (np.array(1.0), B)),
    "batch": (ValueError, "must hold 3 numbers, not 6", lambda: (np.zeros((2, 3)), B)),
    "float32": (TypeError, "must hold float64.*not 'f'", lambda: (A.astype(np.float32), B)),
    "int64": (TypeError, "must hold float64.*not 'l'", lambda: (A.astype(np.int64), B)),
    "bytes": (TypeError, "must hold float64.*not 'B'", lambda: (bytes(24), B)),
    "other order": (TypeError, "must hold float64.*not '[<>]d'", lambda: (A.astype(A.dtype.newbyteorder()), B)),
    "complex": (TypeError, "must hold float64.*not 'Zd'", lambda: (A.astype(complex), B)),
    "record": (TypeError, "must hold float64", lambda: (np.zeros(3, [("x", float)]), B)),
    "object": (TypeError, "must hold float64.*not 'O'", lambda: (A.astype(object), B)),
    "datetime": (TypeError, "buffer of float64, not numpy.ndarray", lambda: (np.zeros(3, "M8[s]"), B)),
    "strided": (ValueError, r"argument 1 \(a\) must be C-contiguous", lambda: (np.zeros(6)[::2], B)),
    "reversed": (ValueError, "must be C-contiguous", lambda: (A[::-1], B)),
    "strided view": (ValueError, "must be C-contiguous", lambda: (memoryview(np.zeros(6))[::2], B)),
    "Fortran": (ValueError, "must be C-contiguous", lambda: (A, B, np.zeros((2, 2), order="F"), np.empty(3))),
    "read-only": (ValueError, r"argument 4 \(order\) is written to", lambda: (A, B, np.empty(4), frozen(np.empty(3)))),
    "bytes out": (TypeError, "must hold float64", lambda: (A, B, bytes(32), np.empty(3))),
    "read-only view": (
        ValueError,
        r"argument 3 \(total\) is written to",
        lambda: (A, B, memoryview(array.array("d", [0.0] * 4)).toreadonly(), np.empty(3)),
    ),
    "released": (ValueError, "", lambda: (released(), B)),
}


def released():
    view = memoryview(array.array("d", [1.0, 2.0, 3.0]))
    view.release()
    return view


@pytest.mark.parametrize("kind", [kind for kind in REFUSED if kind != "released"])
def test_evaluate_names_the_refused_argument(evaluate, kind):
    error, text, arguments = REFUSED[kind]
    with pytest.raises(error, match=text):
        evaluate(*arguments())


def test_evaluate_refuses_keywords_and_released_views(evaluate):
    with pytest.raises(TypeError):
        evaluate(A, b=B)
    with pytest.raises(TypeError, match=r"argument 1 \(a\)"):
        evaluate(released(), B)


def test_evaluate_leaks_no_references(evaluate):
    view = array.array("d", A)
    held = memoryview(array.array("d", A))
    outputs = np.empty(4), np.empty(3)
    wrong = np.zeros(3, np.float32)

    def work():
        for _ in range(300):
            evaluate(view, B), evaluate(held, B), evaluate(A, B, *outputs)
            for bad in (wrong, A[:1], None):
                for arguments in ((view, bad), (held, bad), (bad, held), (held, B, bad, outputs[1])):
                    with pytest.raises((TypeError, ValueError)):
                        evaluate(*arguments)

    counted = (view, held, B, wrong, *outputs, np.ndarray, np.dtype(float), TypeError, ValueError)
    work()
    before = [sys.getrefcount(thing) for thing in counted]
    nothing = sys.getrefcount(None)
    work()
    assert [sys.getrefcount(thing) for thing in counted] == before
    assert abs(sys.getrefcount(None) - nothing) < 100
    view.append(1.0)  # no export is left
    held.release()


@pytest.mark.skipif(sys.version_info < (3, 12), reason="no buffers written in Python")
def test_buffers_that_change_other_arguments_are_detected(evaluate):
    class Trap:
        def __init__(self, change):
            self.change = change

        def __buffer__(self, flags):
            self.change()
            return memoryview(B)

    a = A.copy()
    with pytest.raises(ValueError, match=r"argument 1 \(a\) must hold 3 numbers, not 0"):
        evaluate(a, Trap(lambda: a.resize(0, refcheck=False)))
    sequence = array.array("d", A)
    with pytest.raises(ValueError, match=r"argument 1 \(a\) must hold 3 numbers, not 2"):
        evaluate(sequence, Trap(sequence.pop))
    with pytest.raises(ZeroDivisionError):
        evaluate(Trap(lambda: 1 / 0), B)


def test_code_lives_as_long_as_the_function():
    evaluate = compile_program(shifted_sums()).evaluate
    gc.collect()
    np.testing.assert_array_equal(evaluate(A, B)[0], TOTAL)


numbers = st.floats(allow_nan=True, width=64)
shapes = st.lists(st.integers(0, 4), max_size=3).map(tuple)
dtypes = st.sampled_from(["<f8", ">f8", "<f4", "<i8", "O", "c16", "?", "S8", "M8[s]", "V8", "<f2"])


@st.composite
def arrays(draw):
    made = np.zeros(draw(shapes), draw(dtypes))
    for _ in range(draw(st.integers(0, 2))):
        if made.ndim:
            made = draw(
                st.sampled_from([made[::2], made[::-1], made.T, made[..., 1:], np.broadcast_to(made, (2, *made.shape))])
            )
    if draw(st.booleans()):
        made = made.view(Derived)
    if draw(st.booleans()):
        made.flags.writeable = False
    return made


non_arrays = st.one_of(
    st.none(),
    st.integers(),
    numbers,
    st.text(max_size=3),
    st.binary(max_size=40),
    st.binary(max_size=40).map(bytearray),
    st.lists(numbers, max_size=4),
    st.builds(array.array, st.sampled_from("fd"), st.lists(st.floats(-9, 9), max_size=5)),
    st.builds(array.array, st.sampled_from("bBhHiIlLqQ"), st.lists(st.integers(0, 9), max_size=5)),
    st.builds(DerivedSequence, st.sampled_from("fd"), st.lists(st.floats(-9, 9), max_size=5)),
    st.lists(numbers, max_size=5).map(grown),
    st.lists(numbers, max_size=5).map(lambda values: memoryview(array.array("d", values))),
    st.lists(numbers, max_size=5).map(lambda values: memoryview(array.array("d", values)).toreadonly()),
    st.integers(0, 4).map(lambda size: memoryview(np.zeros(size))),
    st.integers(1, 4).map(lambda size: memoryview(np.zeros(2 * size))[::2]),
    st.sampled_from([A, B, np.zeros(4), np.zeros((2, 2)), np.float64(1.0), np.ndarray, type, ...]),
)


@pytest.mark.slow
@settings(max_examples=2000, deadline=None)
@given(st.lists(st.one_of(arrays(), non_arrays), max_size=6))
def test_random_arguments_do_not_crash_evaluate(evaluate, arguments):
    a, b = A.copy(), B.copy()
    try:
        results = evaluate(*arguments)
    except (TypeError, ValueError) as error:
        assert str(error)
    else:
        assert results is None or len(results) == 2
        for index, (argument, size) in enumerate(zip(arguments, (3, 2, 4, 3), strict=False)):
            view = np.asarray(memoryview(argument))
            assert view.dtype == np.float64 and view.size == size and view.flags.c_contiguous
            assert index < 2 or view.flags.writeable
    A[:], B[:] = a, b
