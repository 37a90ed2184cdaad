"""Numbers as tables have them: `pi/2`, `-d8`, `0.5*(a + b)`, `atan2(1, 2)`. By a grammar, never by Python's eval."""

import math
from contextvars import ContextVar
from functools import cache

from lark import Lark, Transformer, v_args
from lark.exceptions import LarkError, UnexpectedCharacters, UnexpectedToken, VisitError

from robot_dynamics.errors import DescriptionError, describe_unknown_name

MAX_EXPRESSION_LENGTH = 1000  # characters; an entry of a table has ten
CONSTANTS = {"pi": math.pi}
FUNCTIONS = {
    "abs": (math.fabs, 1),
    "acos": (math.acos, 1),
    "asin": (math.asin, 1),
    "atan": (math.atan, 1),
    "atan2": (math.atan2, 2),
    "cos": (math.cos, 1),
    "exp": (math.exp, 1),
    "radians": (math.radians, 1),
    "sin": (math.sin, 1),
    "sqrt": (math.sqrt, 1),
    "tan": (math.tan, 1),
}

GRAMMAR = r"""
?start: sum
?sum: product | sum "+" product -> add | sum "-" product -> subtract
?product: signed | product "*" signed -> multiply | product "/" signed -> divide
?signed: power | "-" signed -> negative | "+" signed
?power: atom | atom ("^" | "**") signed -> raised
?atom: NUMBER -> number | NAME -> name | NAME "(" arguments ")" -> call | "(" sum ")"
arguments: sum ("," sum)*
NUMBER: /(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?/
NAME: /[A-Za-z_][A-Za-z0-9_]*/
%ignore /[ \t\r\n]+/
"""


class _Refused(Exception):
    """Raised where an expression is evaluated; carries the sentence that becomes the message."""


@v_args(inline=True)
class _Evaluator(Transformer):
    """Evaluates while the text is parsed, so that no depth of parentheses needs a deep stack."""

    add = staticmethod(lambda a, b: a + b)
    subtract = staticmethod(lambda a, b: a - b)
    multiply = staticmethod(lambda a, b: a * b)
    divide = staticmethod(lambda a, b: a / b)
    negative = staticmethod(lambda a: -a)
    raised = staticmethod(math.pow)
    number = staticmethod(float)
    arguments = staticmethod(lambda *values: values)

    def name(self, token):
        return _LOOKUP.get()(str(token))

    def call(self, token, values):
        if token not in FUNCTIONS:
            raise _Refused(describe_unknown_name("function", token, FUNCTIONS) + _hint(token))
        function, count = FUNCTIONS[token]
        if len(values) != count:
            raise _Refused(f"{token} takes {count} argument{'s'[: count - 1]}, not {len(values)}")
        return function(*values)


_LOOKUP = ContextVar("what the names of the expression that is being parsed stand for")


@cache
def _parser():
    return Lark(GRAMMAR, parser="lalr", transformer=_Evaluator(), maybe_placeholders=False)


def evaluate(value, names=None):
    """The number that `value`, an int, a float or the text of an expression, stands for.

    names: what the names in it stand for, {name: number}; pi is known, and the functions in FUNCTIONS are. Angles are
    in radians. Raises DescriptionError where it has no finite real value, an unbound name included.
    """
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            return _finite(float(value), value)
        except OverflowError:
            return _finite(math.inf, value)
    names = names or {}

    def lookup(name):
        if name in names:
            return names[name]
        if name in CONSTANTS:
            return CONSTANTS[name]
        raise _Refused(describe_unknown_name("name", name, [*names, *CONSTANTS]))

    return _finite(_parsed(value, lookup), value)


def format_number(number):
    """The text of a number that `evaluate` gives back, whole numbers without a point. Raises DescriptionError.

    Exactly, but where rounding alone made a long number of a short one: 0.10350000000000001 is written 0.1035.
    """
    try:
        number = float(number)
    except TypeError:
        raise DescriptionError(f"{number!r:.60} has no value yet, and cannot be written as a number") from None
    if not math.isfinite(number):
        raise DescriptionError(f"{number} cannot be written: a finite number is needed")
    short = float(f"{number:.15g}")
    if abs(short - number) <= 2 * math.ulp(number) and len(repr(short)) < 12:
        number = short
    return str(int(number)) if number == int(number) and abs(number) < 1e15 else repr(number)


def format_angle(angle):
    """As `number_text`, with pi where the angle is a multiple of π/12, to the last digit."""
    try:
        parts = round(float(angle) / math.pi * 12) if abs(angle) < 1e6 else 1
    except TypeError:
        return format_number(angle)
    for divisor in (1, 2, 3, 4, 6, 12):
        factor, rest = divmod(parts * divisor, 12)
        if rest == 0 and factor != 0:
            text = f"{'-' if factor < 0 else ''}{'' if abs(factor) == 1 else f'{abs(factor)}*'}pi"
            text += "" if divisor == 1 else f"/{divisor}"
            return text if evaluate(text) == angle else format_number(angle)
    return format_number(angle)


def _parsed(text, lookup):
    if not isinstance(text, str):
        raise DescriptionError(f"{text!r:.60} is no number: a number or an expression such as pi/2 is needed")
    if len(text) > MAX_EXPRESSION_LENGTH:
        raise DescriptionError(f"expression has {len(text)} characters: {MAX_EXPRESSION_LENGTH} at most are read")
    _LOOKUP.set(lookup)
    try:
        return _parser().parse(text)
    except VisitError as error:
        reason = error.orig_exc
        if not isinstance(reason, _Refused | ArithmeticError | ValueError):
            raise
    except (_Refused, ArithmeticError, ValueError) as error:
        reason = error
    except UnexpectedCharacters as error:
        reason = (
            f"{text[error.pos_in_stream]!r} at character {error.pos_in_stream + 1} has no meaning there{_hint(text)}"
        )
    except UnexpectedToken as error:
        found = f"{str(error.token)!r}" if error.token.type != "$END" else "the end"
        reason = f"{found} is not expected there{_hint(text)}"
    except LarkError as error:
        reason = error
    raise DescriptionError(f"expression {text[:60]!r}: {reason}") from None


def _hint(text):
    return ". Angles are in radians: radians(90) or pi/2" if "deg" in text or "°" in text else ""


def _finite(number, value):
    if not math.isfinite(number):
        raise DescriptionError(f"{str(value)[:60]!r} is {number}: a finite number is needed")
    return number
