"""Numbers as expressions: `pi/2`, `-d8`, `0.5*(a + b)`, `atan2(1, 2)`. Parsed by a grammar, never by Python's eval."""

import math
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from functools import cache
from typing import Any, cast

from lark import Lark, Transformer, v_args
from lark.exceptions import LarkError, UnexpectedCharacters, UnexpectedToken, VisitError

from robot_dynamics.errors import DescriptionError, describe_unknown_name

MAX_EXPRESSION_LENGTH = 1000  # characters; an entry of a table has ten
MAX_EVALUATED_LENGTH = 500_000
"""Characters of all expressions of a description, with EXPRESSION_OVERHEAD for each. They take some seconds. Robots
that ship have at most 10 000."""
EXPRESSION_OVERHEAD = 10
"""Characters that take as long as an empty expression."""
CONSTANTS = {"pi": math.pi}
FUNCTIONS: dict[str, tuple[Callable[..., float], int]] = {
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
"""{name: (function, number of its arguments)}"""

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


class _EvaluationError(Exception):
    """An expression cannot be evaluated; the text becomes part of the message."""


@v_args(inline=True)
class _Evaluator(Transformer):  # type: ignore[type-arg, unused-ignore]  # releases of lark differ in their number
    """Evaluates while the text is parsed, so that nested parentheses need no deep stack."""

    add = staticmethod(lambda a, b: a + b)
    subtract = staticmethod(lambda a, b: a - b)
    multiply = staticmethod(lambda a, b: a * b)
    divide = staticmethod(lambda a, b: a / b)
    negative = staticmethod(lambda a: -a)
    raised = staticmethod(math.pow)
    number = staticmethod(float)
    arguments = staticmethod(lambda *values: values)

    def name(self, token: str) -> float:
        """Return the value of a name."""
        return _LOOKUP.get()(str(token))

    def call(self, token: str, values: tuple[float, ...]) -> float:
        """Return the value of a function of the FUNCTIONS."""
        if token not in FUNCTIONS:
            raise _EvaluationError(describe_unknown_name("function", token, FUNCTIONS) + _degree_hint(token))
        function, count = FUNCTIONS[token]
        if len(values) != count:
            raise _EvaluationError(f"{token} takes {count} argument{'s'[: count - 1]}, not {len(values)}")
        return function(*values)


class ExpressionBudget:
    """The expressions that one description may still evaluate."""

    def __init__(self) -> None:
        self._remaining = MAX_EVALUATED_LENGTH

    @property
    def is_spent(self) -> bool:
        """Whether an expression was refused because there were too many."""
        return self._remaining < 0

    def spend(self, text: str) -> None:
        """Count an expression that is evaluated. Raises DescriptionError where there are too many."""
        self._remaining -= len(text) + EXPRESSION_OVERHEAD
        if self.is_spent:
            raise DescriptionError(
                f"the expressions up to here are too many: they are evaluated up to {MAX_EVALUATED_LENGTH} characters "
                f"in total, {EXPRESSION_OVERHEAD} added for each, and parameters again for each leg with parameters of "
                "its own. Write numbers instead"
            )


_LOOKUP: ContextVar[Callable[[str], float]] = ContextVar("values of the names in the expression that is being parsed")


@cache
def _parser() -> Lark:
    """Return the parser, which is built at the first use."""
    return Lark(GRAMMAR, parser="lalr", transformer=_Evaluator(), maybe_placeholders=False)


def evaluate(value: object, names: Mapping[str, float] | None = None) -> float:
    """Return the number of an expression.

    Parameters
    ----------
    value : int, float or str
        A number, or the text of an expression with pi and the FUNCTIONS. Angles are in radians.
    names : mapping of str to float, optional
        Values of the other names in the expression.

    Raises
    ------
    DescriptionError
        If the expression has no finite real value, or a name in it has no value.
    """
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            return _require_finite(float(value), value)
        except OverflowError:
            return _require_finite(math.inf, value)
    values = names or {}

    def lookup(name: str) -> float:
        """Return the value of a name."""
        if name in values:
            return values[name]
        if name in CONSTANTS:
            return CONSTANTS[name]
        raise _EvaluationError(describe_unknown_name("name", name, [*values, *CONSTANTS]))

    return _require_finite(_parse(value, lookup), value)


def format_number(number: Any) -> str:
    """Return the text of a number from which `evaluate` restores it, whole numbers without a point.

    Where only rounding made a short number long, the text is the short one: 0.1035 for 0.10350000000000001. Raises
    DescriptionError for a symbol or an infinite number.
    """
    try:
        exact = float(number)
    except TypeError:
        raise DescriptionError(f"{number!r:.60} has no value yet, and cannot be written as a number") from None
    if not math.isfinite(exact):
        raise DescriptionError(f"{exact} cannot be written: a finite number is needed")
    short = float(f"{exact:.15g}")
    written = short if abs(short - exact) <= 2 * math.ulp(exact) and len(repr(short)) < 12 else exact
    return str(int(written)) if written == int(written) and abs(written) < 1e15 else repr(written)


def format_angle(angle: Any) -> str:
    """Return the text of an angle as `format_number`, with pi where it is exactly a multiple of π/12."""
    try:
        parts = round(float(angle) / math.pi * 12) if abs(angle) < 1e6 else 1
    except TypeError:
        return format_number(angle)
    for divisor in (1, 2, 3, 4, 6, 12):
        factor, remainder = divmod(parts * divisor, 12)
        if remainder == 0 and factor != 0:
            text = f"{'-' if factor < 0 else ''}{'' if abs(factor) == 1 else f'{abs(factor)}*'}pi"
            text += "" if divisor == 1 else f"/{divisor}"
            return text if evaluate(text) == angle else format_number(angle)
    return format_number(angle)


def _parse(text: object, lookup: Callable[[str], float]) -> float:
    """Return the value of the text of an expression; lookup: value of a name."""
    if not isinstance(text, str):
        raise DescriptionError(f"{text!r:.60} is no number: a number or an expression such as pi/2 is needed")
    if len(text) > MAX_EXPRESSION_LENGTH:
        raise DescriptionError(f"expression has {len(text)} characters: the maximum is {MAX_EXPRESSION_LENGTH}")
    _LOOKUP.set(lookup)
    reason: object
    try:
        return cast("float", _parser().parse(text))  # the transformer replaces the tree by its value
    except VisitError as error:
        reason = error.orig_exc
        if not isinstance(reason, _EvaluationError | ArithmeticError | ValueError):
            raise
    except (_EvaluationError, ArithmeticError, ValueError) as error:
        reason = error
    except UnexpectedCharacters as error:
        position = error.pos_in_stream
        reason = f"{text[position]!r} at character {position + 1} has no meaning there{_degree_hint(text)}"
    except UnexpectedToken as error:
        token: Any = vars(error)["token"]  # the stubs of lark lack this attribute
        name = f"{str(token)!r}" if token.type != "$END" else "the end"
        reason = f"{name} is not expected there{_degree_hint(text)}"
    except LarkError as error:
        reason = error
    raise DescriptionError(f"expression {text[:60]!r}: {reason}") from None


def _degree_hint(text: str) -> str:
    """Return the end of a message about an expression that seems to have degrees."""
    return ". Angles are in radians: radians(90) or pi/2" if "deg" in text or "°" in text else ""


def _require_finite(number: float, value: object) -> float:
    """Return the number of an expression. Raises DescriptionError unless it is finite."""
    if not math.isfinite(number):
        raise DescriptionError(f"{str(value)[:60]!r} is {number}: a finite number is needed")
    return number
