"""Values of a program that are known before a call: constants, parameters, and the setup that follows from them."""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from robot_dynamics.codegen.emit.code_text import FUNCTIONS, INFIX
from robot_dynamics.codegen.emit.python_helpers import HELPERS
from robot_dynamics.codegen.trace.program import constant_values
from robot_dynamics.codegen.trace.scalar import PARAMETER
from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.codegen.trace.program import Program


def fold_constants(program: Program, parameters: Mapping[str, float] | None = None) -> dict[int, float]:
    """The value of each constant, parameter and setup statement, by node number.

    Parameters
    ----------
    program : Program
    parameters : mapping of str to float, optional
        Values of the parameters of the program; further names are ignored.

    Returns
    -------
    dict of int to float
        May contain NaN and infinities.

    Raises
    ------
    InvalidInputError
        If a parameter has no value.
    """
    parameters = parameters or {}
    missing = [name for name in program.parameters if name not in parameters]
    if missing:
        raise InvalidInputError(f"{program.name} needs a value for {', '.join(map(repr, missing[:40]))}")
    values = constant_values(program)
    operations = _safe_operations()
    for number, operation, operands in program.leaves:
        if operation == PARAMETER:
            values[number] = float(parameters[operands[0]])
    for number, operation, operands in program.setup:
        values[number] = operations[operation](*(values[operand] for operand in operands))
    return values


@functools.cache
def _safe_operations() -> dict[str, Callable[..., float]]:
    """The function of each operation, with the results of compiled code instead of exceptions."""
    scope: dict[str, Any] = {"math": math}
    exec("\n".join(HELPERS.values()), scope)
    infix = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": scope["divide"]}
    operations: dict[str, Callable[..., float]] = {name: infix[symbol] for name, symbol in INFIX.items()}
    operations.update((name, scope[function]) for name, function in FUNCTIONS.items())
    return operations
