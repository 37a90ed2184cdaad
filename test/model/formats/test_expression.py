"""Expressions of tables: what they come to, and that no text does anything but come to a number or be refused."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from robot_dynamics import DescriptionError
from robot_dynamics.model.formats.expression import evaluate, format_angle, format_number

# what Python makes of the same texts, ^ written as **
SAME_IN_PYTHON = ["1 + 2*3", "-2**2", "2**-1", "2**3**2", "8/4/2", "7 - 3 - 2", "-(1 + 2)*-3", "+.5e1", "1e-3", "2*-3"]


@pytest.mark.parametrize("text", SAME_IN_PYTHON)
def test_precedence_and_association_are_those_of_python(text):
    assert evaluate(text) == evaluate(text.replace("**", "^")) == eval(text)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("pi/2", math.pi / 2),
        ("atan2(-1, -2)", math.atan2(-1, -2)),
        ("cos(pi/3) + sqrt(a)", math.cos(math.pi / 3) + 2),
        ("radians(90)", math.pi / 2),
        ("-d8*(a)", -0.5 * 4),
        (3, 3.0),
        (0.25, 0.25),
    ],
)
def test_names_functions_and_numbers(text, value):
    assert evaluate(text, {"a": 4.0, "d8": 0.5}) == value


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "the end is not expected"),
        ("1 +", "the end is not expected"),
        ("1 2", "'2' is not expected"),
        ("90deg", "Angles are in radians: radians(90) or pi/2"),
        ("deg(90)", "Angles are in radians"),
        ("90°", "Angles are in radians"),
        ("a; b", "';' at character 2"),
        ("dd8", "unknown name 'dd8': did you mean 'd8'"),
        ("sine(1)", "unknown function 'sine': did you mean 'sin'"),
        ("sin(1, 2)", "sin takes 1 argument, not 2"),
        ("atan2(1)", "atan2 takes 2 arguments, not 1"),
        ("1/0", "division by zero"),
        ("sqrt(-1)", "math domain error"),
        ("(-8)^(1/3)", "math domain error"),
        ("9^9^9", "math range error"),
        ("1e999", "inf: a finite number is needed"),
        ("__import__('os')", "has no meaning there"),
        ("(" * 100_000 + "1" + ")" * 100_000, "200001 characters: the maximum is 1000"),
        (None, "None is no number"),
        (True, "True is no number"),
        ([1], "is no number"),
        (math.nan, "a finite number is needed"),
        (10**400, "a finite number is needed"),
    ],
)
def test_invalid_expression_is_refused_with_a_reason(text, reason):
    with pytest.raises(DescriptionError) as refusal:
        evaluate(text, {"d8": 1.0})
    assert reason in str(refusal.value) and len(str(refusal.value)) < 300


def test_depth_of_parentheses_and_signs_needs_no_stack():
    assert evaluate("(" * 490 + "1" + ")" * 490) == 1
    assert evaluate("-" * 990 + "1") == 1


@given(st.text(max_size=60) | st.text(alphabet="()+-*/^,.eE0123456789 abpisnqrt2", max_size=60))
@example("1__0")
@example("0x10")
def test_text_is_a_finite_number_or_refused(text):
    try:
        number = evaluate(text, {"a": 1.0})
    except DescriptionError:
        return
    assert math.isfinite(number)


@given(st.floats(allow_nan=False, allow_infinity=False, max_value=1e299, min_value=-1e299))
def test_numbers_are_unchanged_by_write_and_read(number):
    """Numbers are equal to the last digit, but for rounding noise of short numbers."""
    for text in (format_number(number), format_angle(number)):
        noise = 2 * math.ulp(number) if len(text) < 12 else 0
        assert abs(evaluate(text) - number) <= noise
    assert format_number(0.1 + 0.2) == "0.3" and format_number(1 / 3) == repr(1 / 3)


@given(st.integers(-48, 48))
def test_multiples_of_15_degrees_are_written_with_pi(parts):
    angle = parts * (math.pi / 12)
    assert abs(evaluate(format_angle(angle)) - angle) <= math.ulp(angle)
    assert (
        format_angle(math.pi / 2) == "pi/2" and format_angle(-3 * math.pi / 4) == "-3*pi/4" and format_angle(0.0) == "0"
    )
